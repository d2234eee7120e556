// The kernel that looks for the silhouettes of a depth field. A block does a tile of a level in
// steps: where surfaces end; of each pixel the nearest of these edges in its own row; then those
// above and below, with what was found in the rows there; which pixels are near any. Few pixels see
// an edge: those that may are put on a list, so that full warps go through it.
#pragma once

#include <cstdint>

#include "src/field/depth_field_cuda.h"
#include "src/field/pyramid/gap_rules.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 { namespace {

using one_lane::RulePlane;

constexpr int kReach = DepthFieldLevel::kSilhouetteReach;
constexpr int kRimThreads = 256, kRimWarps = kRimThreads / gpu::kWarpSize;
constexpr int kWordBits = gpu::kWarpSize;
// Blocks that share the registers of a multiprocessor; older ones have no room for five.
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ < 800
constexpr int kRimBlocks = 4;
#else
constexpr int kRimBlocks = 5;
#endif

/// Constants of all levels.
struct RimLevels {
  one_lane::RuleLevel levels[DepthFieldView::kMaxLevels];
};

/// Columns or rows [begin, end).
struct Span {
  int begin, end;

  __device__ int size() const { return end - begin; }
};

__device__ inline int clamped_to(int value, int least, int most) {
  return value < least ? least : (value > most ? most : value);
}

/// Along one axis of a level of `size` pixels: the tile, the pixels of it and just around it that
/// queries look at, and those whose planes are read. Beyond `around` pixels around the image all
/// planes are those of the last one.
struct RimSpans {
  Span tile, requested, planes;

  __device__ RimSpans(int first, int tile_size, int size, int around) {
    constexpr int kBorder = DepthFieldLevel::kBorder;
    const int end = first + tile_size;
    tile = {first, end < size + kBorder ? end : size + kBorder};
    requested = {clamped_to(tile.begin - 1, -kSilhouetteBorder, size + kSilhouetteBorder + 1),
                 clamped_to(tile.end + 1, -kSilhouetteBorder, size + kSilhouetteBorder + 1)};
    planes = {clamped_to(requested.begin - kReach, -around, size - 1 + around),
              clamped_to(requested.end + kReach - 1, -around, size - 1 + around) + 1};
  }
};

/// One bit per pixel of a block's rows, 32 to a word; one more word of a row is 0.
struct RimBits {
  std::uint32_t* words;
  int stride;

  __device__ std::uint32_t& at(int row, int word) const { return words[row * stride + word]; }
  /// Joins the bits of `num` rows.
  __device__ std::uint32_t any_of(int first_row, int num, int word) const {
    std::uint32_t bits = 0;
    for (int row = first_row; row < first_row + num; ++row) bits |= at(row, word);
    return bits;
  }
};

/// The bits of a word and of those `left` columns before and `right` columns after them.
__device__ inline std::uint32_t widened_bits(std::uint32_t before, std::uint32_t word,
                                             std::uint32_t after, int left, int right) {
  std::uint32_t bits = word;
  for (int k = 1; k <= left; ++k) bits |= word >> k | after << (kWordBits - k);
  for (int k = 1; k <= right; ++k) bits |= word << k | before >> (kWordBits - k);
  return bits;
}

/// A block's shared memory, of the size that RimTiling says. Rows and columns of everything but the
/// planes are counted from kReach pixels before the first requested one.
struct RimMemory {
  static constexpr int kNumBits = 4;

  TangentPlane* planes;
  float* depths;      ///< surface_depth of the planes
  RimBits right;      ///< there is an edge between a pixel and the next one of its row
  RimBits sees_edge;  ///< in its own row, or just below
  RimBits may_have;   ///< a silhouette; at last: is near one that has
  RimBits has_any;    ///< silhouette
  int* has_edge;
  int* num_listed;  ///< from the front of the list, and from its end
  std::uint16_t* list;
  int list_size;
  /// Nearest edges in each pixel's own row: of an exit in the lowest three bits (columns to the
  /// pixel left of the edge, and kFoundBias; 0: none), of an occluder likewise from bit 4 on. Bit
  /// 3: there is an edge between the pixel and the one below.
  std::uint8_t* found;
  int found_stride;

  __device__ explicit RimMemory(const RimTiling& tiling)
      : planes(&gpu::shared_memory<TangentPlane>()),
        depths(reinterpret_cast<float*>(planes + tiling.num_planes)) {
    const int stride = tiling.num_words + 1;
    auto* words = reinterpret_cast<std::uint32_t*>(depths + tiling.num_planes);
    for (RimBits* bits : {&right, &sees_edge, &may_have, &has_any}) {
      *bits = {words, stride};
      words += tiling.num_rows * stride;
    }
    has_edge = reinterpret_cast<int*>(words);
    num_listed = has_edge + 1;
    list = reinterpret_cast<std::uint16_t*>(num_listed + 2);
    found_stride = tiling.num_words * kWordBits;
    list_size = tiling.num_rows * found_stride;
    found = reinterpret_cast<std::uint8_t*>(list + list_size);
  }

  static std::size_t num_bytes(const RimTiling& t) {
    const auto rows = static_cast<std::size_t>(t.num_rows);
    const auto words = static_cast<std::size_t>(t.num_words);
    return static_cast<std::size_t>(t.num_planes) * (sizeof(TangentPlane) + sizeof(float)) +
           kNumBits * rows * (words + 1) * sizeof(std::uint32_t) + 3 * sizeof(int) +
           rows * words * kWordBits * (sizeof *list + sizeof *found);
  }

  /// Puts the pixels of a word on the list. Their order does not matter.
  __device__ void put(std::uint32_t bits, int row, int word, bool at_end) const {
    if (bits == 0) return;
    int at = atomicAdd(num_listed + at_end, __popc(bits));
    for (; bits != 0; bits &= bits - 1, ++at) {
      const int column = word * kWordBits + __ffs(static_cast<int>(bits)) - 1;
      list[at_end ? list_size - 1 - at : at] =
          static_cast<std::uint16_t>(row << kColumnBits | column);
    }
  }
  static constexpr int kColumnBits = 8;
};
constexpr int kFoundBias = kReach + 1, kFoundBits = 4, kEdgeBelow = 8;

/// The columns [begin, end) of a word.
__device__ inline std::uint32_t span_bits(int begin, int end, int word) {
  const int first = clamped_to(begin - word * kWordBits, 0, kWordBits);
  const int last = clamped_to(end - word * kWordBits, 0, kWordBits);
  return static_cast<std::uint32_t>((std::uint64_t{1} << last) - (std::uint64_t{1} << first));
}

/// A pixel's plane and depth.
struct RimPixel {
  RulePlane plane;
  float depth;
};

__device__ inline bool is_edge(const RimPixel& a, const RimPixel& b, float width) {
  const bool a_is_near = one_lane::is_nearer(a.plane, b.plane);
  return one_lane::ends_between(a_is_near ? a.plane : b.plane, a_is_near ? a.depth : b.depth,
                                a_is_near ? b.plane : a.plane, width);
}

/// The two sides of an edge.
struct Edge {
  RimPixel near, far;

  __device__ Edge(const RimPixel& a, const RimPixel& b) {
    const bool a_is_near = one_lane::is_nearer(a.plane, b.plane);
    near = a_is_near ? a : b;
    far = a_is_near ? b : a;
  }
};

/// Search for the nearest silhouettes of a pixel among those that are offered. Edges farther than a
/// known one are skipped.
struct RimSearch {
  RimPixel own;
  one_lane::NearestSilhouette exit, occluder;

  __device__ bool wants_exit(float squared) const {
    return own.plane.slope > 0.0f && squared < exit.squared;
  }
  __device__ bool wants_occluder(float squared) const { return squared < occluder.squared; }
  __device__ static void set(one_lane::NearestSilhouette& to, float du, float dv, float squared,
                             const RulePlane& other) {
    to = {du, dv, squared, other};
  }
  __device__ void offer_exit(const Edge& edge, float du, float dv,
                             const one_lane::ExitLimits& limits) {
    const float squared = du * du + dv * dv;
    if (wants_exit(squared) && one_lane::is_exit(own.plane, limits, edge.far.plane)) {
      set(exit, du, dv, squared, edge.far.plane);
    }
  }
  __device__ void offer_occluder(const Edge& edge, float du, float dv, float width) {
    const float squared = du * du + dv * dv;
    if (wants_occluder(squared) && one_lane::is_occluder(own.plane, own.depth, edge.near.plane,
                                                         edge.near.depth, squared, width)) {
      set(occluder, du, dv, squared, edge.near.plane);
    }
  }
};

/// Returns the plane of a pixel beyond the image, where its outermost surface goes on.
__device__ TangentPlane plane_beyond(const TangentPlane* image, std::ptrdiff_t stride, int width,
                                     int height, int u, int v, int level) {
  // Pixel `at` of a line of `size`, from those inside of the image.
  const auto in_line = [=](int at, int size, const auto& inside) {
    if (at >= 0 && at < size) return inside(at);
    const int last = at < 0 ? 0 : size - 1, inwards = at < 0 ? 1 : -1;
    const TangentPlane line[GoingOn::kNum] = {inside(last), inside(last + inwards),
                                              inside(last + 2 * inwards),
                                              inside(last + 3 * inwards)};
    return GoingOn(line, level).at(at < 0 ? -at : at - last);
  };
  return in_line(v, height, [&](int row) {
    return in_line(u, width, [&](int column) { return image[row * stride + column]; });
  });
}

/// Joins a pixel of a level beyond the image into the tiles at the border: those of the outermost
/// pixels bound the others.
__device__ void join_tiles(const FieldJob& job, DepthTile* tiles, int level, int u, int v,
                           const TangentPlane& plane) {
  constexpr int kTile = DepthFieldView::kTileSize;
  const DepthTile tile = tile_of<DepthTile>(plane);
  // Tiles that show column or row `at` of a level.
  const auto find = [&](int at, int size, int num) -> Span {
    if (at < 0) return {0, 1};
    if (at >= size) return {num - 1, num};
    const int last = ((at + 1) * (1 << level) - 1) / kTile;
    return {at * (1 << level) / kTile, (last < num ? last : num - 1) + 1};
  };
  const PyramidLayout::Level& image = job.layout.levels[level];
  const int tiles_wide = job.layout.tiles_wide(), tiles_high = job.layout.tiles_high();
  const Span us = find(u, image.width, tiles_wide), vs = find(v, image.height, tiles_high);
  for (int y = vs.begin; y < vs.end; ++y) {
    for (int x = us.begin; x < us.end; ++x) {
      DepthTile& to = tiles[y * tiles_wide + x];
      // Their bits grow as positive numbers do.
      atomicMin(reinterpret_cast<int*>(&to.nearest), one_lane::bits_of(tile.nearest));
      atomicMin(reinterpret_cast<int*>(&to.min_slope), one_lane::bits_of(tile.min_slope));
    }
  }
}

/// Third kernel of a field: borders and silhouettes.
__global__ void __launch_bounds__(kRimThreads, kRimBlocks)
    find_silhouettes(const __grid_constant__ FieldJob job, const __grid_constant__ RimLevels rims) {
  const RimMemory shared(job.rim);
  const int block = static_cast<int>(blockIdx.x) % job.num_rim_blocks();
  const FieldArrays arrays = job.arrays_of(static_cast<int>(blockIdx.x) / job.num_rim_blocks());
  const int thread = static_cast<int>(threadIdx.x), lane = gpu::lane_id(), warp = gpu::warp_id();
  int level = 0;
  while (block >= job.first_rim_block[level + 1]) ++level;
  constexpr int kBorder = DepthFieldLevel::kBorder;
  const int width = job.layout.levels[level].width, height = job.layout.levels[level].height;
  const int blocks_wide = (width + 2 * kBorder + job.rim.wide - 1) / job.rim.wide;
  const int number = block - job.first_rim_block[level];
  const int going_on = job.going_on, reach = going_on + 1;
  const RimSpans us(number % blocks_wide * job.rim.wide - kBorder, job.rim.wide, width, reach);
  const RimSpans vs(number / blocks_wide * job.rim.high - kBorder, job.rim.high, height, reach);
  const one_lane::RuleLevel& rules = rims.levels[level];
  const std::ptrdiff_t origin = job.layout.origin(level);
  // Pixels outside of the image: the outermost surface going on, for a few pixels or without end,
  // nothing, or a blocking surface. The border in memory is not read here. No surface ends where
  // all pixels are the same.
  const bool is_endless = job.unknown == UnknownSpace::solid;
  const auto is_within = [&](int u, int v, int beyond) {
    return u >= -beyond && u < width + beyond && v >= -beyond && v < height + beyond;
  };
  const auto is_inside = [&](int u, int v) { return is_within(u, v, 0); };
  const auto is_shown = [&](int u, int v) { return is_within(u, v, going_on); };

  if (thread < 2) shared.num_listed[thread] = 0;
  if (thread == 0) *shared.has_edge = 0;
  const int planes_wide = us.planes.size(), num_planes = planes_wide * vs.planes.size();
  const int step_rows = kRimThreads / planes_wide, step_columns = kRimThreads % planes_wide;
  for (int i = thread, row = thread / planes_wide, column = thread % planes_wide; i < num_planes;
       i += kRimThreads) {
    const int u = us.planes.begin + column, v = vs.planes.begin + row;
    row += step_rows, column += step_columns;
    if (column >= planes_wide) column -= planes_wide, ++row;
    TangentPlane plane = completed({}, job.unknown);
    if (is_endless || is_inside(u, v)) {
      plane = arrays.planes[origin + clamped_to(v, 0, height - 1) * job.layout.stride +
                            clamped_to(u, 0, width - 1)];
    } else if (is_shown(u, v)) {
      plane = plane_beyond(arrays.planes + origin, job.layout.stride, width, height, u, v, level);
    }
    shared.planes[i] = plane;
    shared.depths[i] = one_lane::surface_depth({plane.offset, plane.slope});
  }
  __syncthreads();
  const auto row_of = [&](int v) {
    return (clamped_to(v, -reach, height - 1 + reach) - vs.planes.begin) * planes_wide -
           us.planes.begin;
  };
  const auto pixel_in = [&](int first, int u) -> RimPixel {
    const int i = first + clamped_to(u, -reach, width - 1 + reach);
    const TangentPlane plane = shared.planes[i];
    return {{plane.offset, plane.slope}, shared.depths[i]};
  };
  const auto pixel_at = [&](int u, int v) { return pixel_in(row_of(v), u); };
  const auto share_at = [&](int u, int v) {
    return level > 0 && is_inside(u, v) ? arrays.shares[origin + v * job.layout.stride + u] : 1.0f;
  };
  // Returns the columns from pixel u to the edge between pixels u + from and u + from + 1.
  const auto du_to = [&](int u, int v, int from) {
    return static_cast<float>(from) + 0.5f +
           one_lane::edge_shift(share_at(u + from, v), share_at(u + from + 1, v));
  };
  const auto dv_to = [&](int u, int v, int from) {
    return static_cast<float>(from) + 0.5f +
           one_lane::edge_shift(share_at(u, v + from), share_at(u, v + from + 1));
  };

  const int first_u = us.requested.begin - kReach, first_v = vs.requested.begin - kReach;
  const int num_rows = vs.requested.size() + 2 * kReach;
  const int end_row = num_rows - kReach,
            end_column = kReach + us.requested.size();  // of the requested ones
  const int num_columns = end_column + kReach - 1;
  const int num_words = (num_columns + kWordBits - 1) / kWordBits;
  // Calls f(row, word) for a thread's words of rows [begin, end).
  const auto for_words = [&](int begin, int end, const auto& f) {
    for (int i = begin * num_words + thread; i < end * num_words; i += kRimThreads) {
      f(i / num_words, i % num_words);
    }
  };
  const auto requested_bits = [&](int word) { return span_bits(kReach, end_column, word); };
  // Calls f(row, column) for a thread's pixels of the list.
  const auto for_listed = [&](bool at_end, const auto& f) {
    for (int i = thread; i < shared.num_listed[at_end]; i += kRimThreads) {
      const int pixel = shared.list[at_end ? shared.list_size - 1 - i : i];
      f(pixel >> RimMemory::kColumnBits, pixel & ((1 << RimMemory::kColumnBits) - 1));
    }
  };

  // Writes near_silhouette and the border.
  const RimBits& is_near = shared.may_have;
  const auto mark = [&](bool has_edge) {
    for (int v = vs.tile.begin + warp; v < vs.tile.end; v += kRimWarps) {
      const bool row_is_requested =
          has_edge && v > -kSilhouetteBorder && v < height + kSilhouetteBorder;
      for (int u = us.tile.begin + lane; u < us.tile.end; u += kWordBits) {
        const std::ptrdiff_t at = origin + static_cast<std::ptrdiff_t>(v) * job.layout.stride + u;
        const int column = u - first_u;
        arrays.near_silhouette[at] =
            row_is_requested && u > -kSilhouetteBorder && u < width + kSilhouetteBorder &&
            (is_near.at(v - first_v, column / kWordBits) >> column % kWordBits & 1) != 0;
        if (!is_inside(u, v)) {
          const RulePlane plane = pixel_at(u, v).plane;
          arrays.planes[at] = {plane.offset, plane.slope};
          if (is_shown(u, v) && !is_within(u, v, going_on - 1)) {
            join_tiles(job, arrays.tiles, level, u, v, arrays.planes[at]);
          }
        }
      }
    }
  };

  // Edges.
  for (int row = warp; row < num_rows; row += kRimWarps) {
    const int v = first_v + row, planes = row_of(v), planes_below = row_of(v + 1);
    const bool has_edges = is_endless || (v >= -reach && v < height + going_on);
    for (int word = 0; word < num_words; ++word) {
      const int column = word * kWordBits + lane, u = first_u + column;
      bool ends_right = false, ends_below = false;
      if (has_edges && column < num_columns &&
          (is_endless || (u >= -reach && u < width + going_on))) {
        const RimPixel own = pixel_in(planes, u);
        ends_right = is_edge(own, pixel_in(planes, u + 1), rules.width_u);
        // Below the last row no plane is at hand, and no pixel reaches as far.
        if (row + 1 < num_rows) ends_below = is_edge(own, pixel_in(planes_below, u), rules.width_v);
      }
      const std::uint32_t right = __ballot_sync(gpu::kWholeWarp, ends_right);
      const std::uint32_t below = __ballot_sync(gpu::kWholeWarp, ends_below);
      shared.found[row * shared.found_stride + column] = ends_below ? kEdgeBelow : 0;
      if (lane == 0) {
        shared.right.at(row, word) = right;
        shared.sees_edge.at(row, word) = below;
        shared.has_any.at(row, word) = 0;
        if ((right | below) != 0) *shared.has_edge = 1;
      }
    }
    if (lane == 0) {
      for (const RimBits* bits : {&shared.right, &shared.may_have, &shared.has_any}) {
        bits->at(row, num_words) = 0;
      }
    }
  }
  __syncthreads();
  if (*shared.has_edge == 0) {
    mark(false);
    return;
  }
  for_words(0, num_rows, [&](int row, int word) {
    // The edges between a pixel and its kReach next ones on both sides.
    const std::uint32_t before = word > 0 ? shared.right.at(row, word - 1) : 0;
    const std::uint32_t bits = widened_bits(before, shared.right.at(row, word),
                                            shared.right.at(row, word + 1), kReach - 1, kReach) &
                               requested_bits(word);
    shared.sees_edge.at(row, word) |= bits;
    shared.put(bits, row, word, false);
  });
  __syncthreads();

  // The nearest edges in the row of each pixel.
  for_listed(false, [&](int row, int column) {
    const int u = first_u + column, v = first_v + row;
    // Bit kReach + from: the edge between pixels u + from and u + from + 1.
    const int first = column - kReach;
    const std::uint32_t* const words = &shared.right.at(row, first / kWordBits);
    const std::uint64_t edges =
        (std::uint64_t{words[1]} << kWordBits | words[0]) >> first % kWordBits;
    RimSearch search{pixel_at(u, v), {}, {}};
    const auto limits = one_lane::exit_limits(search.own.plane, search.own.depth, rules.width_u);
    int exit = 0, occluder = 0;
#pragma unroll 1
    for (int n = 1; n <= kReach; ++n) {
      for (int side = 0; side < 2; ++side) {
        const int from = side == 0 ? n - 1 : -n;
        if ((edges >> (kReach + from) & 1) == 0) continue;
        const Edge edge(pixel_at(u + from, v), pixel_at(u + from + 1, v));
        const float du = du_to(u, v, from);
        search.offer_exit(edge, du, 0.0f, limits);
        search.offer_occluder(edge, du, 0.0f, rules.width_u);
        if (search.exit.du == du) exit = from + kFoundBias;
        if (search.occluder.du == du) occluder = from + kFoundBias;
      }
    }
    shared.found[row * shared.found_stride + column] |=
        static_cast<std::uint8_t>(exit | occluder << kFoundBits);
  });
  for_words(0, num_rows, [&](int row, int word) {
    const int begin = row < kReach ? 0 : row - kReach;
    const int end = row + kReach < num_rows ? row + kReach + 1 : num_rows;
    shared.may_have.at(row, word) =
        shared.sees_edge.any_of(begin, end - begin, word) & requested_bits(word);
  });
  __syncthreads();
  if (thread < 2) shared.num_listed[thread] = 0;
  __syncthreads();
  for_words(kReach, end_row, [&](int row, int word) {
    const auto around = [&](int at) { return shared.may_have.any_of(row - 2, 5, at); };
    const std::uint32_t bits = shared.may_have.at(row, word);
    shared.put(bits, row, word, false);
    // Samples beside a silhouette also read pixels that have none.
    const std::uint32_t beside =
        widened_bits(word > 0 ? around(word - 1) : 0, around(word), around(word + 1), 2, 2);
    shared.put(beside & ~bits & requested_bits(word), row, word, true);
  });
  __syncthreads();

  // Pixels just around the tile are written by two blocks, the same by both.
  const auto silhouettes_of = [&](int u, int v) {
    return arrays.silhouettes +
           2 * (origin + static_cast<std::ptrdiff_t>(v) * job.layout.stride + u);
  };
  for_listed(false, [&](int row, int column) {
    const int u = first_u + column, v = first_v + row;
    // Byte k: what was found in row v + k, or in row v - k.
    std::uint32_t below = 0, above = 0;
    for (int k = 0; k <= kReach; ++k) {
      const std::uint8_t* const here = shared.found + row * shared.found_stride + column;
      below |= std::uint32_t{here[k * shared.found_stride]} << 8 * k;
      above |= std::uint32_t{here[-k * shared.found_stride]} << 8 * k;
    }
    const auto edge_in = [&](int code, int k) {
      const int from = code - kFoundBias, planes = row_of(v + k);
      return Edge(pixel_in(planes, u + from), pixel_in(planes, u + from + 1));
    };
    const auto du_of = [&](int code, int k) { return du_to(u, v + k, code - kFoundBias); };

    RimSearch search{pixel_at(u, v), {}, {}};
    const RimPixel& own = search.own;
    // An edge in the own row is nearer than all edges beyond so many rows.
    const auto take_own = [&](int code, one_lane::NearestSilhouette& nearest, bool is_exit) {
      if (code == 0) return kReach;
      const float du = du_of(code, 0);
      const Edge edge = edge_in(code, 0);
      nearest = {du, 0.0f, du * du, is_exit ? edge.far.plane : edge.near.plane};
      return code < kFoundBias ? kFoundBias - code - 1 : code - kFoundBias;
    };
    const auto bytes_to = [](int last) { return ~std::uint32_t{0} >> 8 * (3 - last); };
    static_assert(kReach == 3);
    constexpr std::uint32_t kExits = 0x07070707, kBelow = 0x08080808, kOccluders = 0xf0f0f0f0;
    const int exit_rows = take_own(below & (kEdgeBelow - 1), search.exit, true);
    const int occluder_rows = take_own(below >> kFoundBits & 0xf, search.occluder, false);
    const std::uint32_t exits = own.plane.slope > 0.0f ? kExits & bytes_to(exit_rows) : 0;
    const std::uint32_t requested = exits | kBelow | (kOccluders & bytes_to(occluder_rows));
    below &= requested;
    above &= requested;
    const auto limits_u = one_lane::exit_limits(own.plane, own.depth, rules.width_u);
    const auto limits_v = one_lane::exit_limits(own.plane, own.depth, rules.width_v);
#pragma unroll 1
    for (int n = 1; n <= kReach; ++n) {
      for (int side = 0; side < 2; ++side) {
        const int from = side == 0 ? n - 1 : -n;
        if (((side == 0 ? below >> 8 * (n - 1) : above >> 8 * n) & kEdgeBelow) == 0) continue;
        const Edge edge(pixel_at(u, v + from), pixel_at(u, v + from + 1));
        const float dv = dv_to(u, v, from);
        search.offer_exit(edge, 0.0f, dv, limits_v);
        search.offer_occluder(edge, 0.0f, dv, rules.width_v);
      }
      for (int side = 0; side < 2; ++side) {
        const int k = side == 0 ? n : -n;
        const int found = static_cast<int>((side == 0 ? below : above) >> 8 * n) & 0xf7;
        if (found == 0) continue;
        const float dv = static_cast<float>(k);
        if (const int code = found & (kEdgeBelow - 1); code != 0) {
          const float du = du_of(code, k);
          if (search.wants_exit(du * du + dv * dv)) {
            search.offer_exit(edge_in(code, k), du, dv, limits_u);
          }
        }
        if (const int code = found >> kFoundBits; code != 0) {
          const float du = du_of(code, k);
          if (search.wants_occluder(du * du + dv * dv)) {
            search.offer_occluder(edge_in(code, k), du, dv, rules.width_u);
          }
        }
      }
    }
    const bool has_exit = one_lane::is_any(search.exit);
    const bool has_occluder = one_lane::is_any(search.occluder);
    const float at_x = rules.first_u + static_cast<float>(u) * rules.width_u;
    const float at_y = rules.first_v + static_cast<float>(v) * rules.width_v;
    Silhouette* const to = silhouettes_of(u, v);
    to[0] = {has_exit ? -one_lane::side_of(search.exit, at_x, at_y, rules) : 0.0f,
             search.exit.other.offset, search.exit.other.slope, 0};
    to[1] = {has_occluder ? one_lane::side_of(search.occluder, at_x, at_y, rules) : 0.0f,
             search.occluder.other.offset, search.occluder.other.slope, 0};
    if (has_exit || has_occluder) {
      atomicOr(&shared.has_any.at(row, column / kWordBits), 1u << column % kWordBits);
    }
  });
  for_listed(true, [&](int row, int column) {
    Silhouette* const to = silhouettes_of(first_u + column, first_v + row);
    to[0] = to[1] = Silhouette{};
  });
  __syncthreads();

  // Pixels are near if they or a neighbor have a silhouette.
  for_words(kReach, end_row, [&](int row, int word) {
    const auto around = [&](int at) { return shared.has_any.any_of(row - 1, 3, at); };
    is_near.at(row, word) =
        widened_bits(word > 0 ? around(word - 1) : 0, around(word), around(word + 1), 1, 1);
  });
  __syncthreads();
  mark(true);
}

}}}  // namespace palpate::v0
