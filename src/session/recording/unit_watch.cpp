#include "src/session/recording/unit_watch.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace palpate { inline namespace v0 {
namespace {

constexpr double kUsualUnits[] = {0.001, 0.00025, 0.0002, 0.000125, 0.0001};
constexpr double kApart = 1.8;                // factor; below it the tool may have met something
constexpr double kAlike = 1.2;                // factor; within it a ratio is that of two units
constexpr double kNearest = 0.05;             // m, of a tool that a camera sees
constexpr std::size_t kMinMeasurements = 20;  // measurements around the tool
constexpr int kMinLooks = 3, kSamples = 15;   // a side

/// Returns the usual unit with which a surface `ratio` times as far as the tool would be where the
/// tool is; 0: none.
double likely_unit(double unit, double ratio) {
  double best = 0, least = std::log(kAlike);
  for (const double usual : kUsualUnits) {
    const double off = std::abs(std::log(ratio * usual / unit));
    if (off < least && std::abs(std::log(usual / unit)) > 0.1) {
      least = off;
      best = usual;
    }
  }
  return best;
}

}  // namespace

UnitWatch::UnitWatch(const Tool& tool, std::size_t num_cameras) : cameras_(num_cameras) {
  const Bounds box = bounds(tool.mesh());
  center_T_ = 0.5 * (box.low + box.high);
  radius_ = 0.5 * norm(box.high - box.low);
}

void UnitWatch::look(std::span<const NewestFrame> cameras, const Pose& X_WT) {
  for (std::size_t number = 0; number < cameras.size(); ++number) {
    const NewestFrame& seen = cameras[number];
    Camera& camera = cameras_[number];
    const DepthFrame& frame = seen.frame;
    const Vec3d p_C = inverse(seen.X_WC) * (X_WT * center_T_);
    if (camera.has_reported || frame.pixels.empty() || !(p_C[2] > kNearest)) continue;
    camera.name = seen.stream.name.substr(0, 80);
    camera.unit = seen.unit;
    const auto& [fx, fy, cx, cy] = seen.stream.intrinsics;
    const double u = fx * p_C[0] / p_C[2] + cx, v = fy * p_C[1] / p_C[2] + cy;
    const double half = std::max(3.0, fx * radius_ / p_C[2]);
    counts_.clear();
    for (int i = 0; i <= kSamples; ++i) {
      for (int k = 0; k <= kSamples; ++k) {
        const double x = std::round(u + half * (2.0 * k / kSamples - 1));
        const double y = std::round(v + half * (2.0 * i / kSamples - 1));
        if (!(x >= 0 && y >= 0 && x < frame.width && y < frame.height)) continue;
        const std::uint16_t count = seen.count(static_cast<int>(x), static_cast<int>(y));
        if (count != 0 && count != kFarCount) counts_.push_back(count);
      }
    }
    if (counts_.size() < kMinMeasurements) continue;
    const auto middle = counts_.begin() + static_cast<std::ptrdiff_t>(counts_.size() / 2);
    std::nth_element(counts_.begin(), middle, counts_.end());
    const double ratio = *middle * camera.unit / p_C[2];
    camera.least = camera.num_looks == 0 ? ratio : std::min(camera.least, ratio);
    camera.most = std::max(camera.most, ratio);
    ++camera.num_looks;
  }
}

std::vector<std::string> UnitWatch::doubts() {
  std::vector<std::string> doubts;
  for (Camera& camera : cameras_) {
    if (camera.has_reported || camera.num_looks < kMinLooks) continue;
    const bool is_far = camera.least > kApart, is_near = camera.most < 1 / kApart;
    // A tool that approaches something is nearest to it, in the right unit, where this is least.
    const double unit = is_far || is_near ? likely_unit(camera.unit, camera.least) : 0;
    if (unit == 0) continue;
    camera.has_reported = true;
    char text[300];
    std::snprintf(text, sizeof text,
                  "%s: around the tool it sees nothing %s than %.3g times the tool's own distance; "
                  "if they should meet, its unit is not %g m per count: --depth-unit %g (of a "
                  "--camera ?unit=%g) would fit",
                  camera.name.c_str(), is_far ? "nearer" : "farther",
                  is_far ? camera.least : camera.most, camera.unit, unit, unit);
    doubts.emplace_back(text);
  }
  return doubts;
}

}}  // namespace palpate::v0
