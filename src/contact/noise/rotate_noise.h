// The noise of a measure in the axes of another frame: a covariance K becomes R K R^T. Shared by
// the single camera and batches, whose elements are added up in the frame of the camera.
#pragma once

#include <limits>

#include "palpate/math/geometry.h"
#include "src/math/internal/matrix.h"

namespace palpate { inline namespace v0 {

inline void rotate_noise(const Mat3d& R_WC, MeasureNoise& noise) {
  noise.force = congruent(R_WC, noise.force);
  noise.torque = congruent(R_WC, noise.torque);
}

/// Returns the noise where that of a camera is unknown.
inline MeasureNoise unknown_noise() {
  constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  constexpr Mat3d matrix{{{unknown, 0, 0}, {0, unknown, 0}, {0, 0, unknown}}};
  return {unknown, matrix, matrix};
}

}}  // namespace palpate::v0
