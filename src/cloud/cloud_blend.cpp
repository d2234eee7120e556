#include "src/cloud/internal/cloud_blend.h"

#include "src/cloud/point_blend.h"
#include "src/core/internal/assert.h"

namespace palpate { inline namespace v0 {

void blend_clouds(const PointCloudView& old_cloud, const PointCloudView& new_cloud, double t,
                  double max_jump, ThreadPool& pool, PointCloud& out) {
  PALPATE_ASSERT(old_cloud.width == new_cloud.width && old_cloud.height == new_cloud.height &&
                 out.width() == new_cloud.width && out.height() == new_cloud.height);
  const float* const a[6] = {old_cloud.x,  old_cloud.y,  old_cloud.z,
                             old_cloud.nx, old_cloud.ny, old_cloud.nz};
  const float* const b[6] = {new_cloud.x,  new_cloud.y,  new_cloud.z,
                             new_cloud.nx, new_cloud.ny, new_cloud.nz};
  float* c[6];
  for (int channel = 0; channel < 6; ++channel) c[channel] = out.channel(channel);
  const BlendShares shares = BlendShares::at(t, max_jump);

  pool.parallel_for(new_cloud.height, [&](int v) {
    const std::size_t begin =
        static_cast<std::size_t>(v) * static_cast<std::size_t>(new_cloud.width);
    const std::size_t end = begin + static_cast<std::size_t>(new_cloud.width);
    for (std::size_t i = begin; i < end; ++i) {
      OrientedPoint from, to;
      for (int k = 0; k < 6; ++k) {
        from.values[k] = a[k][i];
        to.values[k] = b[k][i];
      }
      const OrientedPoint point = blend_points(from, to, shares);
      for (int k = 0; k < 6; ++k) c[k][i] = point.values[k];
    }
  });
}

}}  // namespace palpate::v0
