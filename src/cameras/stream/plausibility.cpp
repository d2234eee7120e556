#include "src/cameras/internal/plausibility.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

namespace palpate { inline namespace v0 {
namespace {

bool is_measurement(int count) { return count != 0 && count != kFarCount; }

/// The middle one; 0: there are too few.
template <class Number>
Number median(std::vector<Number>& numbers) {
  if (numbers.size() < 100) return 0;
  const auto middle = numbers.begin() + static_cast<std::ptrdiff_t>(numbers.size() / 2);
  std::nth_element(numbers.begin(), middle, numbers.end());
  return *middle;
}

/// Depth of the middle of all measurements, m; 0: there are too few.
double median_depth(const DepthFrame& frame) {
  std::vector<std::uint16_t> counts;
  for (const std::uint16_t count : frame.pixels) {
    if (is_measurement(count)) counts.push_back(count);
  }
  return median(counts) * frame.unit;
}

std::string doubt_intrinsics(const CameraModel& model) {
  // No depth camera is known whose axis is farther off the middle than a tenth of the image.
  constexpr double kMaxOffset = 0.2;
  constexpr double kNarrowest = 15, kWidest = 160;  // degrees, of the fields of view of cameras
  const auto& [fx, fy, cx, cy] = model.intrinsics;
  const double view = 2 * std::atan(0.5 * model.width / fx) * 180 / std::numbers::pi;
  if (view < kNarrowest || view > kWidest) {
    char text[200];
    std::snprintf(
        text, sizeof text,
        "its focal length of %g pixels makes a field of view of %.0f degrees for %d pixels "
        "in width, which no usual camera has: check the intrinsics",
        fx, view, model.width);
    return text;
  }
  const double x = (cx + 0.5) / model.width, y = (cy + 0.5) / model.height;
  if (std::abs(x - 0.5) <= kMaxOffset && std::abs(y - 0.5) <= kMaxOffset) return {};
  char text[320];
  const double scale = 2 * x, other = 2 * y;
  if (std::abs(scale - other) < 0.2 * scale) {
    // As if of an image `scale` times as large.
    std::snprintf(text, sizeof text,
                  "its intrinsics look like those of another image size: %g,%g is not near the "
                  "middle of %d x %d pixels; %.6g,%.6g,%.6g,%.6g would be",
                  cx, cy, model.width, model.height, fx / scale, fy / scale,
                  (cx + 0.5) / scale - 0.5, (cy + 0.5) / scale - 0.5);
  } else {
    std::snprintf(text, sizeof text,
                  "its principal point %g,%g is far from the middle of %d x %d pixels; check the "
                  "intrinsics",
                  cx, cy, model.width, model.height);
  }
  return text;
}

std::string doubt_unit(const DepthFrame& frame) {
  constexpr double kFarthest = 8, kNearest = 0.1;  // m, of the middle of what depth cameras see
  char text[240];
  const int divisor = common_divisor(frame);
  if (divisor > 1 && frame.unit > 0.9 * 0.001) {
    std::snprintf(text, sizeof text,
                  "all its depths are multiples of %d counts, as in files of 1/%d m read as "
                  "millimeters; if everything looks %d times too far, give --depth-unit %g (of a "
                  "--camera ?unit=%g)",
                  divisor, 1000 * divisor, divisor, 0.001 / divisor, 0.001 / divisor);
    return text;
  }
  const double depth = median_depth(frame);
  const auto num_far = static_cast<std::size_t>(std::ranges::count(frame.pixels, kFarCount));
  if (depth == 0 && 2 * num_far > frame.pixels.size()) {
    std::snprintf(text, sizeof text,
                  "all that it sees is more than %.3g m away: does it look like that because its "
                  "images are of 32FC1 in millimeters? Then give scale=0.001",
                  kFarCount * frame.unit);
    return text;
  }
  if (depth == 0 || (depth >= kNearest && depth <= kFarthest)) return {};
  std::snprintf(
      text, sizeof text,
      "what it sees is %.3g m away in the middle: is %g m per count the right unit? Usual "
      "are 0.001, 0.0002, 0.000125 and 0.0001",
      depth, frame.unit);
  return text;
}

/// `depth`: of the middle of the points, m; 0: there are too few. `remedy`: goes on after "Else".
std::string doubt_scale(double depth, const char* remedy) {
  constexpr double kFarthest = 200, kNearest = 0.1;  // m, of the middle of what scanners see
  if (depth == 0 || (depth >= kNearest && depth <= kFarthest)) return {};
  char text[240];
  std::snprintf(text, sizeof text,
                "its points are %.3g m away in the middle: are they in meters? Else %s", depth,
                remedy);
  return text;
}

}  // namespace

int common_divisor(const DepthFrame& frame) {
  constexpr double kNearlyAll = 0.995;
  for (const int divisor : {8, 5}) {
    std::size_t num = 0, num_divided = 0;
    int least = 65535, most = 0;
    for (const std::uint16_t count : frame.pixels) {
      if (!is_measurement(count)) continue;
      ++num;
      if (count % divisor == 0) ++num_divided;
      least = std::min<int>(least, count);
      most = std::max<int>(most, count);
    }
    // A flat wall has one depth, which may be anything.
    if (most - least < 20 * divisor || num < 1000) continue;
    if (static_cast<double>(num_divided) >= kNearlyAll * static_cast<double>(num)) return divisor;
  }
  return 1;
}

std::string doubt_points(const PointCloudView& cloud) {
  std::vector<float> distances;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!std::isnan(cloud.x[i]))
      distances.push_back(norm(Vec3f{cloud.x[i], cloud.y[i], cloud.z[i]}));
  }
  return doubt_scale(median(distances),
                     "write the file in meters, or give its folder as a camera with "
                     "--camera 'folder:FOLDER?scale=METERS', e.g. scale=0.001");
}

std::string Plausibility::look(const DepthFrame& frame, const CameraModel& model,
                               bool is_projected) {
  if (num_looks_ >= kNumLooks) return {};
  std::string doubt = num_looks_ == 0 && !is_projected ? doubt_intrinsics(model) : "";
  const std::string unit =
      is_projected ? doubt_scale(median_depth(frame), "give scale=METERS, e.g. scale=0.001")
                   : doubt_unit(frame);
  if (!unit.empty()) doubt += (doubt.empty() ? "" : "; ") + unit;
  num_looks_ = doubt.empty() ? num_looks_ + 1 : kNumLooks;
  return doubt;
}

}}  // namespace palpate::v0
