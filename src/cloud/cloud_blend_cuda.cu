#include "src/cloud/internal/cloud_blend_cuda.h"

#include <algorithm>
#include <iterator>

#include "src/cloud/cloud_arrays_cuda.h"
#include "src/cloud/point_blend.h"
#include "src/core/internal/assert.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {

/// Arguments of the blending kernel.
struct CloudBlendJob {
  const double* progress = nullptr;
  double max_jump = 0;
  const float* from[6];
  const float* to[6];
  float* out[6];
  int num_points = 0;
};

namespace {

constexpr int kThreads = 256;

__device__ OrientedPoint load_point(const float* const (&channels)[6], int i) {
  OrientedPoint point;
  for (int k = 0; k < 6; ++k) point.values[k] = channels[k][i];
  return point;
}

__global__ void __launch_bounds__(kThreads) blend(const __grid_constant__ CloudBlendJob job) {
  const int i = gpu::grid_thread();
  if (i >= job.num_points) return;
  const OrientedPoint point = blend_points(load_point(job.from, i), load_point(job.to, i),
                                           BlendShares::at(*job.progress, job.max_jump));
  for (int k = 0; k < 6; ++k) job.out[k][i] = point.values[k];
}

}  // namespace

struct CloudBlendCuda::Impl {
  gpu::Memory memory;
  CloudArrays cloud;
  double* progress;  // page-locked
  double* device_progress;

  Impl(int width, int height, const Intrinsics& k, int gpu)
      : memory(gpu),
        cloud(CloudArrays::make(memory, width, height, k)),
        progress(memory.take_pinned<double>(1)),
        device_progress(memory.take<double>(1)) {}
};

Result<CloudBlendCuda> CloudBlendCuda::create(int width, int height, const Intrinsics& intrinsics,
                                              int gpu) {
  PALPATE_ASSERT(width > 0 && height > 0);
  const Status device = gpu::check_gpu(gpu);
  if (!device) return device.error();
  auto impl = std::make_unique<Impl>(width, height, intrinsics, gpu);
  if (!impl->memory.status()) return impl->memory.status().error();
  return CloudBlendCuda(std::move(impl));
}

CloudBlendCuda::CloudBlendCuda(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CloudBlendCuda::CloudBlendCuda(CloudBlendCuda&&) noexcept = default;
CloudBlendCuda& CloudBlendCuda::operator=(CloudBlendCuda&&) noexcept = default;
CloudBlendCuda::~CloudBlendCuda() = default;

void CloudBlendCuda::set_progress(double t) { *impl_->progress = t; }

void CloudBlendCuda::enqueue(gpu::Stream& stream, const PointCloudView& old_cloud,
                             const PointCloudView& new_cloud, double max_jump) {
  Impl& d = *impl_;
  const PointCloudView& out = d.cloud.view;
  PALPATE_ASSERT(old_cloud.size() == out.size() && new_cloud.size() == out.size() &&
                 old_cloud.gpu == out.gpu && new_cloud.gpu == out.gpu);
  stream.copy(d.device_progress, d.progress, sizeof(double));
  CloudBlendJob job{
      d.device_progress,
      max_jump,
      {old_cloud.x, old_cloud.y, old_cloud.z, old_cloud.nx, old_cloud.ny, old_cloud.nz},
      {new_cloud.x, new_cloud.y, new_cloud.z, new_cloud.nx, new_cloud.ny, new_cloud.nz},
      {},
      static_cast<int>(out.size())};
  std::copy(std::begin(d.cloud.channels), std::end(d.cloud.channels), job.out);
  const int blocks = (job.num_points + kThreads - 1) / kThreads;
  gpu::launch(stream, {.blocks = blocks, .threads = kThreads}, blend, job);
}

PointCloudView CloudBlendCuda::cloud() const { return impl_->cloud.view; }

}}  // namespace palpate::v0
