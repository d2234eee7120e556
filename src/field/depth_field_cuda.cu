#include "src/field/depth_field_cuda.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "src/core/internal/assert.h"
#include "src/core/internal/stamp.h"
#include "src/field/pyramid/gap_rules.h"
#include "src/field/pyramid/silhouettes_cuda.cuh"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {
namespace {

// A block makes all levels of a square of level 0, of which the widest level has one pixel. A
// thread has two by two pixels of level 0.
constexpr int kLevels = DepthFieldView::kMaxLevels;
constexpr int kSquare = 1 << (kLevels - 1), kQuads = kSquare / 2, kThreads = kQuads * kQuads;
constexpr int kTile = DepthFieldView::kTileSize;
static_assert(kSquare == 2 * kTile && kThreads == 256);

/// The pixels of the levels from 1 on that belong to a square.
struct SquareLevels {
  SharedPixel<TangentPlane> pixels[(kThreads * 4 - 1) / 3];

  __device__ static int first(int level) {
    int at = 0;
    for (int k = 1; k < level; ++k) at += (kSquare >> k) * (kSquare >> k);
    return at;
  }
  __device__ SharedPixel<TangentPlane>& at(int level, int x, int y) {
    return pixels[first(level) + y * (kSquare >> level) + x];
  }
};

/// A square of an image and this thread's place in it.
struct Place {
  int image;
  int square_u, square_v;  ///< number of the square
  int x, y;                ///< of the thread's pixel of level 1 in the square

  __device__ Place(const FieldJob& job)
      : image(static_cast<int>(blockIdx.x) / job.num_squares()),
        square_u(static_cast<int>(blockIdx.x) % job.num_squares() % job.squares_wide),
        square_v(static_cast<int>(blockIdx.x) % job.num_squares() / job.squares_wide),
        x(static_cast<int>(threadIdx.x) % kQuads),
        y(static_cast<int>(threadIdx.x) / kQuads) {}

  /// First column and row of the thread's four pixels.
  __device__ int u() const { return square_u * kSquare + 2 * x; }
  __device__ int v() const { return square_v * kSquare + 2 * y; }
};

template <class Pixel>
__device__ Pixel* pixel(const FieldJob& job, Pixel* pixels, int level, int u, int v) {
  return pixels + job.layout.origin(level) + static_cast<std::ptrdiff_t>(v) * job.layout.stride + u;
}

/// Makes the levels 1..top of a square in `out`, and with Choice::majority their shares, from the
/// four pixels that each thread has of level 0. Entries of `quad` outside of the image are ignored.
__device__ void widen_square(const FieldJob& job, const Place& place, const TangentPlane (&quad)[4],
                             int top, Choice choice, TangentPlane* out, float* shares,
                             SquareLevels& levels) {
  if (top < 1) return;
  const auto store = [&](int level, int x, int y, const SharedPixel<TangentPlane>& wide) {
    levels.at(level, x, y) = wide;
    const int u = place.square_u * (kSquare >> level) + x;
    const int v = place.square_v * (kSquare >> level) + y;
    *pixel(job, out, level, u, v) = wide.plane;
    if (choice == Choice::majority) *pixel(job, shares, level, u, v) = wide.share;
  };
  const auto inside = [&](int level, int x, int y) {
    const int size = kSquare >> level;
    return place.square_u * size + x < job.layout.levels[level].width &&
           place.square_v * size + y < job.layout.levels[level].height;
  };
  if (inside(1, place.x, place.y)) {
    const SharedPixel<TangentPlane> four[4] = {
        {quad[0], 1}, {quad[1], 1}, {quad[2], 1}, {quad[3], 1}};
    store(1, place.x, place.y, widened(four, 1, choice));
  }
  for (int level = 2; level <= top; ++level) {
    __syncthreads();
    const int size = kSquare >> level;
    const int x = static_cast<int>(threadIdx.x) % size, y = static_cast<int>(threadIdx.x) / size;
    if (y >= size || !inside(level, x, y)) continue;  // to the next barrier
    // At an odd end the last one counts twice.
    const int x1 = 2 * x + inside(level - 1, 2 * x + 1, 2 * y);
    const int y1 = 2 * y + inside(level - 1, 2 * x, 2 * y + 1);
    const SharedPixel<TangentPlane> four[4] = {
        levels.at(level - 1, 2 * x, 2 * y), levels.at(level - 1, x1, 2 * y),
        levels.at(level - 1, 2 * x, y1), levels.at(level - 1, x1, y1)};
    store(level, x, y, widened(four, level, choice));
  }
}

/// Calls f(index in the quad, u, v) for those of a thread's four pixels that are in the image.
template <class F>
__device__ void for_quad(const FieldJob& job, const Place& place, const F& f) {
  const PyramidLayout::Level& image = job.layout.levels[0];
  for (int k = 0; k < 4; ++k) {
    const int u = place.u() + k % 2, v = place.v() + k / 2;
    if (u < image.width && v < image.height) f(k, u, v);
  }
}

/// At an odd end the last pixel counts twice.
__device__ void complete_quad(const FieldJob& job, const Place& place, TangentPlane (&quad)[4]) {
  if (place.u() + 1 >= job.layout.levels[0].width) quad[1] = quad[0], quad[3] = quad[2];
  if (place.v() + 1 >= job.layout.levels[0].height) quad[2] = quad[0], quad[3] = quad[1];
}

constexpr int kWarps = kThreads / gpu::kWarpSize;

struct SquareScratch {
  SquareLevels levels;
  DepthTile tiles[kWarps][2];  // of each warp's pixels in the left and the right tile
};

/// Makes the tiles and the wider levels of a square without holes.
__device__ void finish_square(const FieldJob& job, const FieldArrays& arrays, const Place& place,
                              TangentPlane (&quad)[4], SquareScratch& shared) {
  // A warp has two rows of 16 threads: the left half of each is in one tile.
  DepthTile tile = empty_tile<DepthTile>();
  for_quad(job, place, [&](int k, int, int) { tile = join(tile, tile_of<DepthTile>(quad[k])); });
  for (int step = 1; step < gpu::kWarpSize; step *= 2) {
    if (step == kTile / 2) continue;
    tile = join(tile, {__shfl_xor_sync(gpu::kWholeWarp, tile.nearest, step),
                       __shfl_xor_sync(gpu::kWholeWarp, tile.min_slope, step)});
  }
  const int lane = gpu::lane_id();
  if (lane % 8 == 0 && lane < 16) shared.tiles[gpu::warp_id()][lane / 8] = tile;

  complete_quad(job, place, quad);
  widen_square(job, place, quad, job.layout.num_levels - 1, Choice::majority, arrays.planes,
               arrays.shares, shared.levels);
  __syncthreads();
  if (threadIdx.x < 4) {
    const int side = static_cast<int>(threadIdx.x) % 2, row = static_cast<int>(threadIdx.x) / 2;
    DepthTile all = empty_tile<DepthTile>();
    for (int k = 0; k < kWarps / 2; ++k) all = join(all, shared.tiles[row * kWarps / 2 + k][side]);
    const int u = 2 * place.square_u + side, v = 2 * place.square_v + row;
    const int tiles_wide = (job.layout.levels[0].width + kTile - 1) / kTile;
    const int tiles_high = (job.layout.levels[0].height + kTile - 1) / kTile;
    if (u < tiles_wide && v < tiles_high) arrays.tiles[v * tiles_wide + u] = all;
  }
}

struct TakeScratch {
  SquareScratch square;
  int has_hole;
};

/// First kernel: the planes of level 0, and those that fill holes. Squares without a hole are
/// finished.
__global__ void __launch_bounds__(kThreads)
    take_planes(const __grid_constant__ FieldJob job,
                const __grid_constant__ PointCloudView cloud) {
  auto& shared = gpu::shared_memory<TakeScratch>();
  if (threadIdx.x == 0) shared.has_hole = 0;
  __syncthreads();
  const Place place(job);
  const FieldArrays arrays = job.arrays_of(place.image);
  TangentPlane quad[4];
  bool has_hole = false;
  for_quad(job, place, [&](int k, int u, int v) {
    const std::ptrdiff_t i =
        place.image * job.points_apart + static_cast<std::ptrdiff_t>(v) * cloud.width + u;
    quad[k] = job.given != nullptr ? job.given[i] : plane_of(cloud, i);
    has_hole = has_hole || !quad[k].is_surface();
    *pixel(job, arrays.planes, 0, u, v) = quad[k];
    if (job.fills_runs) *pixel(job, arrays.nearest, 0, u, v) = quad[k];
  });
  if (has_hole) shared.has_hole = 1;
  complete_quad(job, place, quad);
  widen_square(job, place, quad, job.num_filled, Choice::nearest, arrays.nearest, nullptr,
               shared.square.levels);
  __syncthreads();
  if (threadIdx.x == 0) job.has_hole[blockIdx.x] = shared.has_hole;
  if (shared.has_hole == 0) finish_square(job, arrays, place, quad, shared.square);
}

/// Pixels that fill the holes of a square: of each level those from `start` on, counted from the
/// square's first one, as many as the level before reads.
struct Surroundings {
  static constexpr int kNum = 18 * 18 + 12 * 12 + 8 * 8 + 6 * 6 + 5 * 5;

  TangentPlane pixels[kNum];

  __device__ static int size(int level) {
    return level == 1 ? 18 : (level == 2 ? 12 : (level == 3 ? 8 : (level == 4 ? 6 : 5)));
  }
  __device__ static int start(int level) { return level == 1 ? -1 : -2; }
  __device__ static int first(int level) {
    int at = 0;
    for (int k = 1; k < level; ++k) at += size(k) * size(k);
    return at;
  }
  __device__ static int first_u(int level, int square) {
    return square * (kSquare >> level) + start(level);
  }
};

/// Returns the plane that fills the run of missing pixels around one of them, number `at` of `size`
/// in a row or column whose pixels lie `step` apart.
__device__ TangentPlane filling_at(const TangentPlane* pixel, int at, int size, std::ptrdiff_t step,
                                   float width) {
  const auto find_end = [&](int most, int sign) {
    int to = 1;
    while (to <= most && !pixel[sign * to * step].is_surface()) ++to;
    return to;
  };
  const int before = find_end(at < kMaxRun ? at : kMaxRun, -1);
  const int room = size - 1 - at, left = kMaxRun + 1 - before;
  if (before > at || left <= 0) return {};
  const int after = find_end(room < left ? room : left, 1);
  if (after > room || after > left) return {};
  return filling_of_run(pixel[-before * step], pixel[after * step],
                        static_cast<float>(before + after) * width);
}

__device__ void fill_quad(const FieldJob& job, const FieldArrays& arrays, const Place& place,
                          TangentPlane (&quad)[4], Surroundings& around) {
  // Calls f(u, v, pixel) for this thread's pixels of a level.
  const auto for_pixels = [&](int level, const auto& f) {
    const int size = Surroundings::size(level);
    const PyramidLayout::Level& image = job.layout.levels[level];
    for (int i = static_cast<int>(threadIdx.x); i < size * size; i += kThreads) {
      const int u = Surroundings::first_u(level, place.square_u) + i % size;
      const int v = Surroundings::first_u(level, place.square_v) + i / size;
      if (u < 0 || v < 0 || u >= image.width || v >= image.height) continue;
      f(u, v, around.pixels[Surroundings::first(level) + i]);
    }
  };
  // Interpolates `level` at pixel (u, v) of the level before.
  const auto look_up = [&](int level, int u, int v) {
    const PyramidLayout::Level& image = job.layout.levels[level];
    const int u1 = second_nearest(u, image.width), v1 = second_nearest(v, image.height);
    const auto at = [&](int wide_u, int wide_v) {
      return around.pixels[Surroundings::first(level) +
                           (wide_v - Surroundings::first_u(level, place.square_v)) *
                               Surroundings::size(level) +
                           wide_u - Surroundings::first_u(level, place.square_u)];
    };
    const TangentPlane four[4] = {at(u / 2, v / 2), at(u1, v / 2), at(u / 2, v1), at(u1, v1)};
    return interpolated(four, level);
  };
  for (int level = 1; level <= job.num_filled; ++level) {
    for_pixels(level, [&](int u, int v, TangentPlane& plane) {
      plane = *pixel(job, arrays.nearest, level, u, v);
    });
  }
  __syncthreads();
  for (int level = job.num_filled - 1; level >= 1; --level) {
    for_pixels(level, [&](int u, int v, TangentPlane& plane) {
      if (!plane.is_surface()) plane = look_up(level + 1, u, v);
    });
    __syncthreads();
  }
  for_quad(job, place, [&](int k, int u, int v) {
    if (quad[k].is_surface()) return;
    if (job.fills_runs) {
      const TangentPlane* const by_row = pixel(job, arrays.nearest, 0, u, v);
      quad[k] = by_row->is_surface() ? *by_row
                                     : filling_at(by_row, v, job.layout.levels[0].height,
                                                  job.layout.stride, job.width_v);
    }
    if (!quad[k].is_surface()) quad[k] = look_up(1, u, v);
    *pixel(job, arrays.planes, 0, u, v) = quad[k];
  });
}

struct WidenScratch {
  SquareScratch square;
  Surroundings around;
};

/// Second kernel, where runs are filled: those of rows.
__global__ void __launch_bounds__(kThreads) fill_rows(const __grid_constant__ FieldJob job) {
  if (!job.has_hole[blockIdx.x]) return;
  const Place place(job);
  const FieldArrays arrays = job.arrays_of(place.image);
  for_quad(job, place, [&](int, int u, int v) {
    const TangentPlane* const taken = pixel(job, arrays.planes, 0, u, v);
    if (taken->is_surface()) return;
    *pixel(job, arrays.nearest, 0, u, v) =
        filling_at(taken, u, job.layout.levels[0].width, 1, job.width_u);
  });
}

/// Next kernel: fills holes and finishes their squares.
__global__ void __launch_bounds__(kThreads) widen_planes(const __grid_constant__ FieldJob job) {
  if (!job.has_hole[blockIdx.x]) return;
  auto& shared = gpu::shared_memory<WidenScratch>();
  const Place place(job);
  const FieldArrays arrays = job.arrays_of(place.image);
  TangentPlane quad[4];
  for_quad(job, place, [&](int k, int u, int v) { quad[k] = *pixel(job, arrays.planes, 0, u, v); });
  if (job.num_filled > 0) fill_quad(job, arrays, place, quad, shared.around);
  if (job.unknown == UnknownSpace::blocked) {
    for_quad(job, place, [&](int k, int u, int v) {
      quad[k] = completed(quad[k], job.unknown);
      *pixel(job, arrays.planes, 0, u, v) = quad[k];
    });
  }

  finish_square(job, arrays, place, quad, shared.square);
}

}  // namespace

Result<DepthFieldCuda> DepthFieldCuda::create(int width, int height,
                                              const DepthFieldOptions& options, int gpu,
                                              int num_fields, int num_at_once) {
  const auto layout = pyramid_layout(width, height, options);
  if (!layout) return layout.error();
  FieldJob job;
  job.layout = *layout;
  job.num_filled = layout->num_filled(options);
  job.fills_runs = layout->fills_runs(options);
  job.going_on = PyramidLayout::going_on(options);
  job.unknown = options.unknown;
  const auto blocks_over = [](int size, int part) { return (size + part - 1) / part; };
  job.squares_wide = blocks_over(width, kSquare);
  job.squares_high = blocks_over(height, kSquare);
  // One image alone needs many tiles to fill the GPU.
  job.rim = num_at_once > 1 ? large_rim_tiles(job) : rim_tiling(job, 57, 16);
  constexpr int kBorders = 2 * DepthFieldLevel::kBorder;
  for (int level = 0; level < layout->num_levels; ++level) {
    const auto& image = layout->levels[level];
    job.first_rim_block[level + 1] =
        job.first_rim_block[level] + blocks_over(image.width + kBorders, job.rim.wide) *
                                         blocks_over(image.height + kBorders, job.rim.high);
  }
  // Any field's arrays are as well aligned as the first one's.
  constexpr std::size_t kAligned = 64;
  const std::size_t apart = (layout->num_pixels() + kAligned - 1) / kAligned * kAligned;
  job.pixels_apart = static_cast<std::ptrdiff_t>(apart);
  job.tiles_apart = static_cast<std::ptrdiff_t>(layout->num_tiles());
  const auto more = apart * static_cast<std::size_t>(num_fields - 1);
  const auto more_at_once = apart * static_cast<std::size_t>(num_at_once - 1);
  gpu::Memory memory(gpu);
  job.arrays = {memory.take<TangentPlane>(more + layout->num_planes()),
                memory.take<TangentPlane>(more_at_once + layout->num_planes()),
                memory.take<Silhouette>(2 * (more + layout->num_pixels())),
                memory.take<float>(more + layout->num_pixels()),
                memory.take<std::uint8_t>(more + layout->num_bytes()),
                memory.take<DepthTile>(static_cast<std::size_t>(num_fields) * layout->num_tiles())};
  job.has_hole = memory.take<int>(static_cast<std::size_t>(num_at_once) *
                                  static_cast<std::size_t>(job.num_squares()));
  if (!memory.status()) return memory.status().error();
  return DepthFieldCuda(std::move(memory), job, options);
}

std::size_t DepthFieldCuda::num_bytes(const PyramidLayout& layout) {
  return layout.num_pixels() * (sizeof(TangentPlane) + 2 * sizeof(Silhouette) + sizeof(float) + 1) +
         layout.num_tiles() * sizeof(DepthTile);
}

void DepthFieldCuda::enqueue(const PointCloudView& cloud, gpu::Stream& stream) {
  enqueue(job_, cloud, 1, stream);
}

void DepthFieldCuda::enqueue(const TangentPlane* planes, const PointCloudView& camera,
                             gpu::Stream& stream) {
  enqueue(planes, 0, camera, 0, 1, stream);
}

void DepthFieldCuda::enqueue(const TangentPlane* planes, std::ptrdiff_t points_apart,
                             const PointCloudView& camera, int first, int num,
                             gpu::Stream& stream) {
  FieldJob job = job_;
  job.given = planes;
  job.points_apart = points_apart;
  job.arrays = job_.arrays_of(first);
  job.arrays.nearest = job_.arrays.nearest;
  enqueue(job, camera, num, stream);
}

void DepthFieldCuda::enqueue(FieldJob job, const PointCloudView& cloud, int num,
                             gpu::Stream& stream) {
  PALPATE_ASSERT(cloud.pinhole && cloud.gpu == memory_.gpu() &&
                 cloud.width == job_.layout.levels[0].width &&
                 cloud.height == job_.layout.levels[0].height);
  const one_lane::RuleLevel finest = one_lane::rule_level(cloud.intrinsics, 0);
  job.width_u = finest.width_u;
  job.width_v = finest.width_v;
  const int squares = num * job.num_squares();
  gpu::launch(stream, {.blocks = squares, .threads = kThreads, .shared_bytes = sizeof(TakeScratch)},
              take_planes, job, cloud);
  if (job.fills_runs) {
    gpu::launch(stream, {.blocks = squares, .threads = kThreads, .shared_bytes = 0}, fill_rows,
                job);
  }
  gpu::launch(stream,
              {.blocks = squares, .threads = kThreads, .shared_bytes = sizeof(WidenScratch)},
              widen_planes, job);
  RimLevels rims{};
  for (int level = 0; level < job.layout.num_levels; ++level) {
    rims.levels[level] = one_lane::rule_level(cloud.intrinsics, level);
  }
  gpu::launch(stream,
              {.blocks = num * job.num_rim_blocks(),
               .threads = kRimThreads,
               .shared_bytes = job.rim.shared_bytes},
              find_silhouettes, job, rims);
  const FieldArrays& arrays = job_.arrays;
  view_ = job.layout.view(arrays.planes, arrays.silhouettes, arrays.near_silhouette, arrays.tiles,
                          options_);
  view_.intrinsics = cloud.intrinsics;
  view_.gpu = memory_.gpu();
  view_.stamp = next_stamp();
}

}}  // namespace palpate::v0
