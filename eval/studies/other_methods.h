// Other published methods of contact with a depth image, for comparison: a lookup in a voxel grid
// of distances, and a god-object (proxy) on the cloud.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "eval/studies/accuracy.h"

namespace palpate::eval {

/// Euclidean signed distances on a grid, like maps of robots (Voxblox, Oleynikova et al. 2017;
/// nvblox). A cell with points of the cloud holds their mean; each cell takes the nearest of these,
/// found by an exact distance transform of the cells (Felzenszwalb & Huttenlocher 2012) and from
/// those of its six neighbors; it is negative behind the depth of its pixel. Interpolated
/// trilinearly.
class DistanceGrid {
 public:
  /// Makes the cube of this side around `middle`. O(cells + points).
  DistanceGrid(const PointCloudView& cloud, const Vec3d& middle, double side, double cell);

  /// Returns the distance (negative behind the surface), unit gradient; free beyond the grid.
  scenes::SignedDistance at(const Vec3d& p) const;
  /// Computes the hinge cost of motion planners (cuRobo): sum of the depth of each penetrating
  /// sphere times the gradient, m. No volume. The torque is about the center of mass.
  Penetration hinge(const Tool& tool, const Pose& X_WT) const;

 private:
  std::size_t place(int x, int y, int z) const {
    return (static_cast<std::size_t>(z) * static_cast<std::size_t>(num_) +
            static_cast<std::size_t>(y)) *
               static_cast<std::size_t>(num_) +
           static_cast<std::size_t>(x);
  }
  Vec3d center(int x, int y, int z) const {
    return low_ + cell_ * Vec3d{x + 0.5, y + 0.5, z + 0.5};
  }
  std::vector<Vec3f> nearest_points(const PointCloudView& cloud) const;
  void spread(std::vector<std::int32_t>& nearest) const;

  Vec3d low_;
  double cell_;
  int num_;
  std::vector<float> distances_;
};

/// A point that follows the tool and stays in front of the cloud (Zilles & Salisbury 1995 on the
/// surface through noisy points of Leeper, Chan & Salisbury 2012). It represents the whole tool: no
/// volume, no torque.
class GodObject {
 public:
  /// Points within `reach` of the proxy count, nearer ones more. The cloud has to outlive it.
  GodObject(const PointCloudView& cloud, double reach) : cloud_(cloud), reach_(reach) {}

  /// Returns the vector from the point to the proxy, m: zero in front. Updates the proxy.
  Vec3d pull(const Vec3d& p_W);

 private:
  struct Surface {
    double distance = 0;
    Vec3d normal;  ///< zero: no point near
  };
  Surface at(const Vec3d& p) const;

  PointCloudView cloud_;
  double reach_;
  Vec3d proxy_;
  bool is_held_ = false;
};

}  // namespace palpate::eval
