// The kernel that looks for the silhouettes of a depth field. A block does a tile of a level in
// steps: where surfaces end; of each pixel the nearest of these edges in its own row; then those
// above and below, with what was found in the rows there; which pixels are near any. Few pixels see
// an edge: those that may are put on a list, so that full warps go through it.
#pragma once

#include <cstdint>

#include "src/field/depth_field_cuda.h"
#include "src/field/pyramid/gap_rules.h"
#include "src/field/pyramid/rim_pixels.cuh"
#include "src/field/pyramid/rim_tile.cuh"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 { namespace {

// Threads that share the registers of a multiprocessor; older ones have no room for as many.
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ < 800
constexpr int kRimThreadsAtOnce = 1024;
#else
constexpr int kRimThreadsAtOnce = 1280;
#endif

/// Constants of all levels, and those of a launch: [begin, end).
struct RimLevels {
  one_lane::RuleLevel levels[DepthFieldView::kMaxLevels];
  int begin, end;
};

/// Last kernel of a field: borders and silhouettes. A block of `kRimThreads`.
template <int kRimThreads>
__global__ void __launch_bounds__(kRimThreads, kRimThreadsAtOnce / kRimThreads)
    find_silhouettes(const __grid_constant__ FieldJob job, const __grid_constant__ RimLevels rims) {
  constexpr int kRimWarps = kRimThreads / gpu::kWarpSize;
  const int num_blocks = job.first_rim_block[rims.end] - job.first_rim_block[rims.begin];
  const int image = static_cast<int>(blockIdx.x) / num_blocks;
  const int block =
      static_cast<int>(blockIdx.x) - image * num_blocks + job.first_rim_block[rims.begin];
  const FieldArrays arrays = job.arrays_of(image);
  const int thread = static_cast<int>(threadIdx.x), lane = gpu::lane_id(), warp = gpu::warp_id();
  int level = rims.begin;
  while (block >= job.first_rim_block[level + 1]) ++level;
  const RimTiling& tiling = job.rims[level];
  const RimMemory shared(tiling);
  constexpr int kBorder = DepthFieldLevel::kBorder;
  const int width = job.layout.levels[level].width, height = job.layout.levels[level].height;
  const int blocks_wide = (width + 2 * kBorder + tiling.wide - 1) / tiling.wide;
  const int number = block - job.first_rim_block[level];
  const int going_on = job.going_on, reach = going_on + 1;
  const RimSpans us(number % blocks_wide * tiling.wide - kBorder, tiling.wide, width, reach);
  const RimSpans vs(number / blocks_wide * tiling.high - kBorder, tiling.high, height, reach);
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
  const auto set_plane = [&](int i, const TangentPlane& plane) {
    shared.planes[i] = plane;
    shared.depths[i] = one_lane::surface_depth({plane.offset, plane.slope});
  };
  const bool has_lines = going_on > 0 && !is_endless && BeyondSpan::has_line(us.planes, width) &&
                         BeyondSpan::has_line(vs.planes, height);
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
    } else if (!has_lines && is_shown(u, v)) {
      plane = plane_beyond(arrays.planes + origin, job.layout.stride, width, height, u, v, level);
    }
    set_plane(i, plane);
  }
  if (has_lines) {
    // Rows go on beyond the image, and then columns do, as in plane_beyond.
    const BeyondSpan beyond_u(us.planes, width, going_on), beyond_v(vs.planes, height, going_on);
    const auto go_on = [&](int i, int step, int from) {
      TangentPlane line[GoingOn::kNum];
      for (int k = 0; k < GoingOn::kNum; ++k) line[k] = shared.planes[i + k * step];
      return GoingOn(line, level).at(from);
    };
    const Span rows{vs.planes.begin > 0 ? vs.planes.begin : 0,
                    vs.planes.end < height ? vs.planes.end : height};
    __syncthreads();
    for (int i = thread; i < rows.size() * beyond_u.num(); i += kRimThreads) {
      const int row = i / beyond_u.num();
      const BeyondSpan::Pixel at = beyond_u.at(i - row * beyond_u.num());
      const int first = (rows.begin + row - vs.planes.begin) * planes_wide - us.planes.begin;
      set_plane(first + at.place, go_on(first + at.last, at.inwards, at.from));
    }
    const Span columns{us.planes.begin > -going_on ? us.planes.begin : -going_on,
                       us.planes.end < width + going_on ? us.planes.end : width + going_on};
    __syncthreads();
    for (int i = thread; i < columns.size() * beyond_v.num(); i += kRimThreads) {
      const int row = i / columns.size();
      const BeyondSpan::Pixel at = beyond_v.at(row);
      const int column = columns.begin + i - row * columns.size() - us.planes.begin;
      const auto in_column = [&](int v) { return (v - vs.planes.begin) * planes_wide + column; };
      set_plane(in_column(at.place), go_on(in_column(at.last), at.inwards * planes_wide, at.from));
    }
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
        }
      }
    }
    if (going_on == 0) return;
    // The outermost pixels of a surface that goes on bound the tiles: all around the image.
    const int wide = width + 2 * going_on, high = height + 2 * going_on;
    for (int i = thread; i < 2 * (wide + high - 2); i += kRimThreads) {
      const bool is_row = i < 2 * wide;
      const int size = is_row ? wide : high - 2, along = is_row ? i : i - 2 * wide;
      const int side = along < size ? 0 : 1, at = along - side * size;
      const int u = (is_row ? at : side * (wide - 1)) - going_on;
      const int v = (is_row ? side * (high - 1) : 1 + at) - going_on;
      if (!us.tile.has(u) || !vs.tile.has(v)) continue;
      const RulePlane plane = pixel_at(u, v).plane;
      join_tiles(job, arrays.tiles, level, u, v, {plane.offset, plane.slope});
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
    // Nearest first: bit 2 k and the next one are the edges k pixels to the right and to the left,
    // which lanes that see different edges go through together.
    unsigned nearest = 0;
#pragma unroll
    for (int k = 0; k < kReach; ++k) {
      nearest |= static_cast<unsigned>(edges >> (kReach + k) & 1) << 2 * k |
                 static_cast<unsigned>(edges >> (kReach - 1 - k) & 1) << (2 * k + 1);
    }
    for (; nearest != 0; nearest &= nearest - 1) {
      const int which = __ffs(static_cast<int>(nearest)) - 1;
      const int from = which % 2 == 0 ? which / 2 : -1 - which / 2;
      const Edge edge(pixel_at(u + from, v), pixel_at(u + from + 1, v));
      const float du = du_to(u, v, from);
      search.offer_exit(edge, du, 0.0f, limits);
      search.offer_occluder(edge, du, 0.0f, rules.width_u);
      if (search.exit.du == du) exit = from + kFoundBias;
      if (search.occluder.du == du) occluder = from + kFoundBias;
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
