#include <algorithm>
#include <cmath>

#include "palpate/field/sensor.h"

namespace palpate { inline namespace v0 {

PointCloud joined_clouds(std::span<const SurfaceBlend> cameras) {
  const auto has_edges = [](const SurfaceBlend& view) { return view.to.cloud.edge_x != nullptr; };
  std::size_t num = 0;
  for (const SurfaceBlend& view : cameras) num += view.to.cloud.size();
  PointCloud joined(static_cast<int>(num), 1, {},
                    std::all_of(cameras.begin(), cameras.end(), has_edges));
  std::size_t at = 0;
  for (const SurfaceBlend& view : cameras) {
    const PointCloudView& c = view.to.cloud;
    const Mat3d R_WC = rotation_matrix(normalized(view.to.X_WC.rotation));
    const float* const from[3][3] = {
        {c.x, c.y, c.z}, {c.nx, c.ny, c.nz}, {c.edge_x, c.edge_y, c.edge_z}};
    for (std::size_t i = 0; i < c.size(); ++i, ++at) {
      if (std::isnan(c.x[i])) continue;
      for (int k = 0; k < (joined.has_edges() ? 3 : 2); ++k) {
        Vec3d v = R_WC * Vec3d{from[k][0][i], from[k][1][i], from[k][2][i]};
        if (k == 0) v += view.to.X_WC.translation;
        for (int axis = 0; axis < 3; ++axis) {
          joined.channel(3 * k + axis)[at] = static_cast<float>(v[axis]);
        }
      }
    }
  }
  return joined;
}

}}  // namespace palpate::v0
