// Noise of a depth camera: its size by depth, and how far over the image it is shared.
//
//   sd(z) = at_zero + growth z^2
//   correlation of two pixels d pixels apart: exp(-d / length)
//
// Stereo and structured light measure a disparity, whose error grows with z^2. Matching shares it
// between neighbors: the mean over a square calms only as the number of independent patches in it.
#pragma once

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// Noise of the measurements of one camera. Defaults: a Kinect v1, pixels independent.
struct DepthNoise {
  double at_zero = 0.0009;  ///< standard deviation at depth 0, m
  double growth = 0.001;    ///< its growth at 1 m, m
  double length = 0;        ///< correlation length, pixels; 0: pixels are independent

  /// Standard deviation of a measurement at depth z (m), in m. O(1).
  PALPATE_HOSTDEV double deviation(double z) const { return at_zero + growth * z * z; }
  /// Variance of a measurement at depth z (m), in m^2. O(1).
  PALPATE_HOSTDEV double variance(double z) const { return deviation(z) * deviation(z); }
  /// Number of pixels that share their noise: the integral of the correlation over the image, at
  /// least 1. A mean over n pixels, many more than these, has the variance of n / patch() pixels.
  PALPATE_HOSTDEV double patch() const {
    const double shared = 2 * kPi * length * length;
    return shared > 1 ? shared : 1;
  }

  friend bool operator==(const DepthNoise&, const DepthNoise&) = default;
};

}}  // namespace palpate::v0
