// Checks whether unit and intrinsics fit an image.
#pragma once

#include <array>
#include <string>

#include "palpate/cloud/point_cloud.h"
#include "src/cloud/internal/lens_table.h"

namespace palpate { inline namespace v0 {

/// Looks at the first frames of a stream. It only reports doubts: nothing is changed.
class Plausibility {
 public:
  /// One sentence, once; empty if there is nothing to doubt. Cost: nothing after a few frames.
  /// `is_projected`: an image of points, whose camera and unit were chosen here.
  std::string look(const DepthFrame& frame, const CameraModel& model, bool is_projected = false);

 private:
  static constexpr int kNumLooks = 3;
  int num_looks_ = 0;
};

/// Doubts the unit of points in meters, seen from the origin; empty if there is nothing to doubt.
std::string doubt_points(const PointCloudView& cloud);

/// The largest number that divides the counts of nearly all measurements, of those that people
/// store depth in: 1, 5 or 8. An image of millimeters that was stored as counts of 1/5000 m has
/// multiples of 5 only.
int common_divisor(const DepthFrame& frame);

}}  // namespace palpate::v0
