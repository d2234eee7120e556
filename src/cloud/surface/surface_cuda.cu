#include "src/cloud/internal/surface_cuda.h"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <limits>
#include <numeric>
#include <optional>
#include <vector>

#include "src/cloud/cloud_arrays_cuda.h"
#include "src/cloud/frames/far_pixels.cuh"
#include "src/cloud/surface/adaptive/adaptive_cuda.h"
#include "src/cloud/surface/surface_kernels.cuh"
#include "src/cloud/surface/surface_settings.h"
#include "src/core/internal/assert.h"

namespace palpate { inline namespace v0 {
namespace one_lane { namespace {

/// Makes the depth of free pixels infinite.
__global__ void __launch_bounds__(kFarThreads) mark_far(const __grid_constant__ FilterJob job) {
  FarShared& shared = gpu::shared_memory<FarShared>();
  const Tile tile(job.tiling, static_cast<int>(blockIdx.x));
  if (!find_free(job, tile, shared)) return;
  float* const depth = job.depth + tile.image * job.tiling.points_apart;
  for (int i = static_cast<int>(threadIdx.x); i < kStripRows * kTileWidth; i += kFarThreads) {
    const int v = i / kTileWidth, column = i % kTileWidth;
    if ((shared.free[v] >> column & 1u) == 0) continue;
    depth[static_cast<std::ptrdiff_t>(tile.v0 + v) * job.tiling.width + tile.u0 + column] = kFar;
  }
}

}}  // namespace one_lane

namespace {

using one_lane::FilterJob;
using one_lane::FilterShared;
using one_lane::NormalJob;

/// Strips that each stage processes in a part: the filter is one strip ahead of the normals, whose
/// windows need it, and reading is one strip ahead of the filter.
struct Part {
  int num_strips, part, num_parts;

  /// The end of a stage that is `ahead` strips ahead, after `parts` parts.
  int end(int parts, int ahead) const {
    if (parts == 0) return 0;
    const auto strips = static_cast<int>(std::int64_t{num_strips} * parts / num_parts);
    return std::min(strips + ahead, num_strips);
  }
  ImageRows strips(int ahead) const { return {end(part, ahead), end(part + 1, ahead)}; }
};
static_assert(kMaxWindowRadius <= kStripRows);

void (*filter_kernel(const FilterJob& job))(FilterJob) {
  if (job.radius == 2) return one_lane::read_and_filter<2>;
  return job.margin() == 0 ? one_lane::read_and_filter<0> : one_lane::read_and_filter<-1>;
}

void (*normal_kernel(const NormalPass& pass))(NormalJob) {
  if (pass.anchoring || pass.weighting || pass.normalization) {
    return one_lane::find_normals<-1, false>;
  }
  return pass.radius == 3 ? one_lane::find_normals<3, true> : one_lane::find_normals<-1, true>;
}

}  // namespace

struct SurfaceCuda::Impl {
  gpu::Memory memory;
  int width, height;
  RawFrameCuda raw;
  CloudArrays cloud;
  TangentPlane* planes = nullptr;  // of a batch
  FilterJob filter;
  std::optional<AdaptiveCuda> adaptive;
  NormalJob normals;
  FrameNoise noise;  // unless the adaptive filter learns it
  bool learns_noise;
  std::size_t num_tiles;

  Impl(int image_width, int image_height, const Intrinsics& k, const SurfaceOptions& options,
       int gpu, int num_images, const Distortion& distortion);
  void enqueue(gpu::Stream& stream, const std::uint16_t* counts, const float* meters,
               const Part& part, int num_images = 0, FrameNoise* noises = nullptr);
};

SurfaceCuda::Impl::Impl(int image_width, int image_height, const Intrinsics& k,
                        const SurfaceOptions& options, int gpu, int num_images,
                        const Distortion& distortion)
    : memory(gpu),
      width(image_width),
      height(image_height),
      raw(memory, width, height),
      cloud(CloudArrays::make(memory, width, height, k)) {
  const int tiles_per_row = (width + one_lane::kTileWidth - 1) / one_lane::kTileWidth;
  const int num_strips = (height + kStripRows - 1) / kStripRows;
  num_tiles = static_cast<std::size_t>(tiles_per_row) * static_cast<std::size_t>(num_strips);
  const std::size_t padded_size = CloudArrays::padded_size(cloud.view);

  filter.tiling = {width, height, tiles_per_row, 0, 0, static_cast<std::ptrdiff_t>(padded_size)};
  filter.raw = raw.view();
  filter.depth = memory.copy_of(
      std::vector<float>(static_cast<std::size_t>(std::max(num_images, 1)) * padded_size,
                         std::numeric_limits<float>::quiet_NaN()));
  if (num_images > 0) {
    planes = memory.take<TangentPlane>(static_cast<std::size_t>(num_images) * padded_size);
  }
  const auto raw_pixels = lens_table_of(width, height, k, distortion);
  if (!raw_pixels.empty()) filter.raw_pixels = memory.copy_of(raw_pixels);
  filter.far = memory.take<unsigned>(static_cast<std::size_t>(std::max(num_images, 1)) *
                                     static_cast<std::size_t>(tiles_per_row) *
                                     static_cast<std::size_t>(height));
  filter.num_valid = memory.take_pinned<int>(num_tiles);
  filter.min_depth = static_cast<float>(options.min_depth);
  filter.max_depth = static_cast<float>(options.max_depth);
  const FilterPass settings = filter_settings(options);
  filter.radius = settings.radius;
  filter.range = settings.range;
  filter.flying_gap = settings.flying_gap;
  std::fill(std::begin(filter.space), std::end(filter.space), 0.0f);
  std::ranges::copy(space_exponents(options.filter), filter.space);
  if (is_adaptive(options.filter)) {
    adaptive.emplace(memory, width, height, num_images);
  }

  normals.tiling = filter.tiling;
  normals.depth = filter.depth;
  normals.max_depth = filter.max_depth;
  normals.pass = normal_settings(options.normals, k);
  std::copy(std::begin(cloud.channels), std::end(cloud.channels), normals.pass.cloud);
  normals.pass.ray_x = memory.copy_of(ray_table(width, k.fx, k.cx));
  normals.pass.ray_y = memory.copy_of(ray_table(height, k.fy, k.cy));
  normals.min_step = static_cast<float>(options.depth_change.min_step);
  normals.num_points = memory.take_pinned<int>(num_tiles);
  float* change[3];
  for (float*& axis : change) axis = memory.take<float>(padded_size);
  if (options.depth_change.enabled) std::copy(change, change + 3, normals.change);
  cloud.view.depth = filter.depth;
  cloud.view.max_depth = filter.max_depth;
  cloud.view.edge_x = change[0];
  cloud.view.edge_y = change[1];
  cloud.view.edge_z = change[2];
  noise = frame_noise(options.noise);
  learns_noise = adaptive && !is_known(options.noise);
  // The images of a batch learn a noise each.
  cloud.view.noise = learns_noise ? adaptive->noise() : &noise;
}

void SurfaceCuda::Impl::enqueue(gpu::Stream& stream, const std::uint16_t* counts,
                                const float* meters, const Part& part, int num_images,
                                FrameNoise* noises) {
  const bool is_batch = num_images > 0;
  const int tiles_per_row = filter.tiling.tiles_per_row;
  const auto shape = [&](ImageRows strips, std::size_t shared_bytes) {
    return gpu::LaunchShape{
        .blocks = std::max(num_images, 1) * (strips.end - strips.begin) * tiles_per_row,
        .threads = one_lane::kTileThreads,
        .shared_bytes = shared_bytes};
  };
  const bool is_last = part.part == part.num_parts - 1;
  // The adaptive filter smooths whole images, and normals follow it.
  const ImageRows whole{0, is_last ? part.num_strips : 0};
  const ImageRows filtered = adaptive ? whole : part.strips(1);
  const ImageRows finished = adaptive ? whole : part.strips(0);
  PALPATE_ASSERT(filter.raw_pixels == nullptr || part.num_parts == 1);
  FilterJob job = filter;
  job.meters = meters;
  if (counts != nullptr) job.raw.pixels = counts;
  if (filtered.begin < filtered.end) {
    job.tiling.first_tile = filtered.begin * tiles_per_row;
    job.tiling.num_tiles = (filtered.end - filtered.begin) * tiles_per_row;
    if (adaptive) {
      adaptive->enqueue(stream, job, std::max(num_images, 1), noises);
    } else {
      gpu::launch(stream, shape(filtered, sizeof(FilterShared)), filter_kernel(job), job);
    }
  }
  if (is_last && !(adaptive && adaptive->marks_far())) {
    job.tiling.first_tile = 0;
    job.tiling.num_tiles = part.num_strips * tiles_per_row;
    gpu::LaunchShape tiles = shape({0, part.num_strips}, sizeof(one_lane::FarShared));
    tiles.threads = one_lane::kFarThreads;
    gpu::launch(stream, tiles, one_lane::mark_far, job);
  }
  if (finished.begin < finished.end) {
    NormalJob rest = normals;
    if (is_batch) rest.planes = planes;
    rest.tiling.first_tile = finished.begin * tiles_per_row;
    rest.tiling.num_tiles = (finished.end - finished.begin) * tiles_per_row;
    gpu::launch(stream, shape(finished, one_lane::normal_shared_bytes(rest.pass)),
                normal_kernel(rest.pass), rest);
  }
}

Result<SurfaceCuda> SurfaceCuda::create(int width, int height, const Intrinsics& intrinsics,
                                        const SurfaceOptions& options, int gpu, int num_images,
                                        const Distortion& distortion) {
  const Status settings = check_surface_settings(width, height, intrinsics, options, distortion);
  if (!settings) return settings.error();
  const Status device = gpu::check_gpu(gpu);
  if (!device) return device.error();
  auto impl =
      std::make_unique<Impl>(width, height, intrinsics, options, gpu, num_images, distortion);
  if (!impl->memory.status()) return impl->memory.status().error();
  return SurfaceCuda(std::move(impl));
}

SurfaceCuda::SurfaceCuda(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SurfaceCuda::SurfaceCuda(SurfaceCuda&&) noexcept = default;
SurfaceCuda& SurfaceCuda::operator=(SurfaceCuda&&) noexcept = default;
SurfaceCuda::~SurfaceCuda() = default;

std::span<std::uint16_t> SurfaceCuda::input() { return impl_->raw.pixels(); }
void SurfaceCuda::set_unit(double unit) { impl_->raw.set_unit(unit); }

ImageRows SurfaceCuda::input_rows(int part, int num_parts) const {
  const int height = impl_->height;
  const Part which{(height + kStripRows - 1) / kStripRows, part, num_parts};
  const ImageRows strips = which.strips(2);
  return {std::min(strips.begin * kStripRows, height), std::min(strips.end * kStripRows, height)};
}

void SurfaceCuda::enqueue(gpu::Stream& stream, int part, int num_parts) {
  const ImageRows rows = input_rows(part, num_parts);
  impl_->raw.enqueue_copy(stream, rows.begin, rows.end);
  enqueue_depth(stream, nullptr, part, num_parts);
}

void SurfaceCuda::enqueue_counts(gpu::Stream& stream, const std::uint16_t* counts) {
  impl_->raw.enqueue_copy_of(stream, counts);
  enqueue_depth(stream, nullptr);
}

void SurfaceCuda::enqueue_depth(gpu::Stream& stream, const float* depth, int part, int num_parts) {
  const int num_strips = (impl_->height + kStripRows - 1) / kStripRows;
  impl_->enqueue(stream, nullptr, depth, {num_strips, part, num_parts});
}

void SurfaceCuda::enqueue_images(gpu::Stream& stream, const std::uint16_t* counts,
                                 const float* depth, int num, FrameNoise* noises) {
  if (counts != nullptr) impl_->raw.enqueue_unit(stream);
  const int num_strips = (impl_->height + kStripRows - 1) / kStripRows;
  impl_->enqueue(stream, counts, depth, {num_strips, 0, 1}, num, noises);
}
bool SurfaceCuda::learns_noise() const { return impl_->learns_noise; }

std::ptrdiff_t SurfaceCuda::points_apart() const { return impl_->filter.tiling.points_apart; }
PointCloudView SurfaceCuda::cloud() const { return impl_->cloud.view; }
const TangentPlane* SurfaceCuda::planes() const { return impl_->planes; }

SurfaceStats SurfaceCuda::stats() const {
  const Impl& d = *impl_;
  return {std::accumulate(d.filter.num_valid, d.filter.num_valid + d.num_tiles, 0),
          std::accumulate(d.normals.num_points, d.normals.num_points + d.num_tiles, 0)};
}

}}  // namespace palpate::v0
