#include "src/field/depth_field_cuda.h"

#include <algorithm>
#include <type_traits>
#include <utility>
#include <vector>

#include "src/core/internal/assert.h"
#include "src/core/internal/stamp.h"
#include "src/field/pyramid/field_holes.cuh"
#include "src/field/pyramid/field_square.cuh"
#include "src/field/pyramid/rim_tile.cuh"
#include "src/field/pyramid/silhouettes_cuda.cuh"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {
namespace {

/// Shared memory of ten blocks at a time on a multiprocessor.
constexpr std::size_t kSmallRimBytes = 20 << 10;

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
  if (job.filled != nullptr && threadIdx.x < kSquare) {
    const int v = place.square_v * kSquare + static_cast<int>(threadIdx.x);
    if (v < job.layout.levels[0].height) job.filled[v * job.squares_wide + place.square_u] = 0;
  }
  complete_quad(job, place, quad);
  widen_square(job, place, quad, job.num_filled, Choice::nearest, arrays.nearest, nullptr,
               shared.square.levels);
  __syncthreads();
  if (threadIdx.x == 0) job.has_hole[blockIdx.x] = shared.has_hole;
  if (shared.has_hole == 0) finish_square(job, arrays, place, quad, shared.square);
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
  constexpr int kBorders = 2 * DepthFieldLevel::kBorder;
  for (int level = 0; level < layout->num_levels; ++level) {
    const auto& image = layout->levels[level];
    // One image alone needs many tiles to fill the GPU.
    const RimTiling tiling =
        num_at_once > 1 ? large_rim_tiles(job, level) : rim_tiling(job, level, 57, 16);
    job.rims[level] = tiling;
    if (num_at_once == 1 || tiling.shared_bytes > kSmallRimBytes) job.num_large_rims = level + 1;
    job.first_rim_block[level + 1] =
        job.first_rim_block[level] + blocks_over(image.width + kBorders, tiling.wide) *
                                         blocks_over(image.height + kBorders, tiling.high);
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
  if (num_fields == 1 && job.fills_runs) {
    job.filled = memory.take<std::uint32_t>(static_cast<std::size_t>(job.squares_wide) *
                                            static_cast<std::size_t>(height));
  }
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
  const auto find = [&]<int kRimThreads>(std::integral_constant<int, kRimThreads>, int begin,
                                         int end) {
    if (begin == end) return;
    rims.begin = begin;
    rims.end = end;
    std::size_t shared_bytes = 0;
    for (int level = begin; level < end; ++level) {
      shared_bytes = std::max(shared_bytes, job.rims[level].shared_bytes);
    }
    gpu::launch(stream,
                {.blocks = num * (job.first_rim_block[end] - job.first_rim_block[begin]),
                 .threads = kRimThreads,
                 .shared_bytes = shared_bytes},
                find_silhouettes<kRimThreads>, job, rims);
  };
  find(std::integral_constant<int, 256>{}, 0, job.num_large_rims);
  find(std::integral_constant<int, 128>{}, job.num_large_rims, job.layout.num_levels);
  const FieldArrays& arrays = job_.arrays;
  view_ = job.layout.view(arrays.planes, arrays.silhouettes, arrays.near_silhouette, arrays.tiles,
                          options_);
  view_.intrinsics = cloud.intrinsics;
  view_.filled_behind = job.filled;
  view_.filled_stride = job.squares_wide;
  view_.noise = cloud.noise;
  view_.gpu = memory_.gpu();
  view_.stamp = next_stamp();
}

}}  // namespace palpate::v0
