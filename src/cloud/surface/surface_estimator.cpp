#include "palpate/cloud/surface_estimator.h"

#include "src/cloud/surface/surface_settings.h"
#include "src/cloud/surface/surface_stages.h"
#include "src/core/internal/assert.h"
#include "src/core/internal/stamp.h"

namespace palpate { inline namespace v0 {

struct SurfaceEstimator::Impl {
  SurfaceStages stages;
  SurfaceParts made;
  std::uint64_t stamp = 0;

  SurfaceStats update(const DepthImageView& image, ThreadPool& pool, const SurfaceParts& parts) {
    SurfaceStats stats;
    stats.num_valid = stages.read(image, pool);
    stats.num_points = make_points(parts.points, pool);
    if (parts.depth_change) stages.find_depth_change(pool);
    made = parts;
    return stats;
  }
  int make_points(const PixelWindow& window, ThreadPool& pool) {
    stamp = next_stamp();
    stages.filter(pool, window);
    return stages.estimate_normals(pool, window);
  }
};

SurfaceEstimator::SurfaceEstimator(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SurfaceEstimator::SurfaceEstimator(SurfaceEstimator&&) noexcept = default;
SurfaceEstimator& SurfaceEstimator::operator=(SurfaceEstimator&&) noexcept = default;
SurfaceEstimator::~SurfaceEstimator() = default;

Result<SurfaceEstimator> SurfaceEstimator::create(int width, int height,
                                                  const Intrinsics& intrinsics,
                                                  const SurfaceOptions& options, Isa isa,
                                                  const Distortion& distortion) {
  const Status status = check_surface_settings(width, height, intrinsics, options, distortion);
  if (!status) return status.error();
  return SurfaceEstimator(std::unique_ptr<Impl>(
      new Impl{{width, height, intrinsics, options, isa, distortion}, {}, 0}));
}

SurfaceStats SurfaceEstimator::update(const DepthImageView& image, ThreadPool& pool,
                                      const SurfaceParts& parts) {
  return impl_->update(image, pool, parts);
}

SurfaceStats SurfaceEstimator::update(std::span<const float> depth, ThreadPool& pool,
                                      const SurfaceParts& parts) {
  const PointCloud& cloud = impl_->stages.cloud();
  const DepthImageView image(cloud.width(), cloud.height(), depth.data());
  PALPATE_ASSERT(depth.size() == image.num_pixels());
  return impl_->update(image, pool, parts);
}

void SurfaceEstimator::complete(ThreadPool& pool) {
  Impl& d = *impl_;
  const PointCloud& cloud = d.stages.cloud();
  if (!d.made.points.has_all(cloud.width(), cloud.height())) d.make_points({}, pool);
  if (!d.made.depth_change) d.stages.find_depth_change(pool);
  d.made = {};
}

PointCloudView SurfaceEstimator::cloud() const {
  PointCloudView view = impl_->stages.cloud().view();
  if (impl_->made.depth_change) {
    view.edge_x = depth_change(0).data();
    view.edge_y = depth_change(1).data();
    view.edge_z = depth_change(2).data();
  }
  view.depth = depth().data();
  view.max_depth = impl_->stages.max_depth();
  view.noise = &impl_->stages.noise();
  view.stamp = impl_->stamp;
  return view;
}

std::span<const float> SurfaceEstimator::depth() const { return impl_->stages.depth(); }

std::span<const float> SurfaceEstimator::depth_change(int axis) const {
  PALPATE_ASSERT(axis >= 0 && axis < 3);
  return impl_->stages.depth_change(axis);
}

}}  // namespace palpate::v0
