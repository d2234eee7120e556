#include "palpate/cloud/cloud_blend.h"

#include <cmath>

#include "palpate/core/assert.h"

namespace palpate {

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
  const float new_share = static_cast<float>(t), old_share = static_cast<float>(1 - t);
  const float jump = static_cast<float>(max_jump);

  pool.parallel_for(new_cloud.height, [&](int v) {
    const std::size_t begin =
        static_cast<std::size_t>(v) * static_cast<std::size_t>(new_cloud.width);
    const std::size_t end = begin + static_cast<std::size_t>(new_cloud.width);
    for (std::size_t i = begin; i < end; ++i) {
      float mixed[6];
      for (int k = 0; k < 6; ++k) mixed[k] = old_share * a[k][i] + new_share * b[k][i];
      const float length =
          std::sqrt(mixed[3] * mixed[3] + mixed[4] * mixed[4] + mixed[5] * mixed[5]);
      // Comparisons with an invalid point, which is NaN, fail.
      const bool is_one_surface =
          std::abs(b[2][i] - a[2][i]) <= jump * std::abs(b[2][i]) && length > 0.1f;
      for (int k = 0; k < 3; ++k) {
        c[k][i] = is_one_surface ? mixed[k] : b[k][i];
        c[3 + k][i] = is_one_surface ? mixed[3 + k] / length : b[3 + k][i];
      }
    }
  });
}

}  // namespace palpate
