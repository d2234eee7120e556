// How sure a measurement is: what the random noise of the depth does to it.
#pragma once

#include <cmath>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// Variance and covariances of the measure by the random noise of the cameras alone, to first
/// order: nothing of what they do not see, of their calibration or of edges that flicker. With
/// bodies it is that of the cameras: a CAD model has no noise.
struct MeasureNoise {
  double volume = 0;  ///< m6
  Mat3d force = {};   ///< of VolumeWrench::force, m6, in W
  Mat3d torque = {};  ///< of VolumeWrench::torque, m8, in W

  /// Standard deviations along the axes of W: m3, m3 and m4.
  double volume_std() const { return std::sqrt(volume); }
  Vec3d force_std() const { return deviations(force); }
  Vec3d torque_std() const { return deviations(torque); }

  /// Adds independent noise that counts `share` times.
  void add(const MeasureNoise& other, double share = 1) {
    const double square = share * share;
    volume += square * other.volume;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        force.m[row][column] += square * other.force.m[row][column];
        torque.m[row][column] += square * other.torque.m[row][column];
      }
    }
  }

 private:
  static Vec3d deviations(const Mat3d& covariance) {
    const auto& m = covariance.m;
    return {std::sqrt(m[0][0]), std::sqrt(m[1][1]), std::sqrt(m[2][2])};
  }
};

}}  // namespace palpate::v0
