// The undistortion table: the distorted pixel for each pixel of a pinhole camera.
#pragma once

#include <cstdint>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Camera model of one image.
struct CameraModel {
  int width = 0, height = 0;
  Intrinsics intrinsics;
  Distortion distortion;

  friend bool operator==(const CameraModel&, const CameraModel&) = default;
};

/// An error names the first coefficient that is no number from -1e6 to 1e6.
Status check_distortion(const Distortion& distortion);

/// Returns for each pixel of the pinhole image the raw pixel nearest to the image of its ray, never
/// a mixture of two depths; past the end (raw.width * raw.height) where the camera sees nothing.
/// The distortion of `pinhole` is ignored. O(pixels): some milliseconds.
std::vector<std::uint32_t> lens_table(const CameraModel& pinhole, const CameraModel& raw);

/// Returns the largest radius r (X / Z), up to `limit`, at which a lens still maps different rays
/// to different pixels: below it the radial distortion grows with r.
double largest_radius(const Distortion& distortion, double limit);

}}  // namespace palpate::v0
