// Noise of a depth camera: its size by depth, and how far over the image it is shared.
//
//   sd(z) = at_zero + growth z^2
//   correlation of two pixels d pixels apart: exp(-d / length)
//
// Stereo and structured light measure a disparity, whose error grows with z^2. Matching shares it
// between neighbors: the mean over a square calms only as the number of independent patches in it.
#pragma once

#include "palpate/cloud/depth_source.h"
#include "palpate/core/core.h"
#include "palpate/math/geometry.h"
#include "palpate/settings/setting_table.h"

namespace palpate { inline namespace v0 {

/// Noise of the measurements of one camera. Defaults: a Kinect v1, pixels independent.
struct MeasurementNoise {
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

  friend bool operator==(const MeasurementNoise&, const MeasurementNoise&) = default;
};

/// Noise of one camera in one mode, measured where nothing moved: a sensor file
/// (docs/guide/cameras.md, "Noise of your camera").
struct SensorNoise {
  SensorKind kind = SensorKind::none;
  int width = 0, height = 0;         ///< of the images, pixels
  double unit = 0.001;               ///< m per count
  double nearest = 0, farthest = 0;  ///< depths it was measured at, m
  MeasurementNoise noise = {};
};
inline void add_settings(SettingTable& t, SensorNoise& s) {
  t.section("sensor");
  t.add("kind", s.kind, "measuring principle, which selects defaults of surfaces");
  t.add("width", s.width, {1, kMaxImageWidth, "pixels"}, "of the images");
  t.add("height", s.height, {1, kMaxImageHeight, "pixels"}, "of the images");
  t.add("unit", s.unit, {1e-6, 1, "m"}, "of a count");
  t.add("nearest", s.nearest, {0, 100, "m"}, "least depth that the noise was measured at");
  t.add("farthest", s.farthest, {0, 100, "m"}, "largest depth that the noise was measured at");
  t.add("noise", s.noise.at_zero, {1e-6, 1, "m"}, "standard deviation at depth 0");
  t.add("noise_growth", s.noise.growth, {0, 1, "m"},
        "its growth at 1 m; it grows with the square of the depth");
  t.add("noise_length", s.noise.length, {0, 40, "pixels"},
        "distance over which the correlation of pixels falls to 37 %; 0: none");
}

/// Settings of averages for a camera that was measured: those of its kind, with its noise.
DepthAverageOptions depth_average_options_for(const SensorNoise& sensor);

}}  // namespace palpate::v0
