#include "src/session/recording/nearest_watch.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "src/session/internal/sphere_distance.h"

namespace palpate { inline namespace v0 {

void NearestWatch::look(std::span<const NewestFrame> cameras, const ContactRecord& contact) {
  if (has_touched_) return;
  for (const NewestFrame& camera : cameras) look(camera, contact);
}

std::optional<NearestApproach> NearestWatch::nearest() const {
  return has_touched_ ? std::nullopt : nearest_;
}

void NearestWatch::look(const NewestFrame& camera, const ContactRecord& contact) {
  constexpr int kSamples = 80;  // a side
  if (camera.frame.pixels.empty()) return;
  const Pose X_TC = inverse(contact.X_WT) * camera.X_WC;
  const int width = camera.frame.width, height = camera.frame.height;
  const int step = std::max(1, std::max(width, height) / kSamples);
  double nearest = std::numeric_limits<double>::infinity();
  Pixel at;
  look_at(camera, X_TC, {0, 0}, {width, height}, step, nearest, at);
  if (!std::isfinite(nearest)) return;
  const Pixel low{std::max(0, at.u - step), std::max(0, at.v - step)};
  const Pixel high{std::min(width, at.u + step + 1), std::min(height, at.v + step + 1)};
  look_at(camera, X_TC, low, high, 1, nearest, at);
  if (!nearest_ || nearest < nearest_->distance) {
    nearest_ = {std::max(0.0, nearest), contact.time};
  }
}

/// Lowers `nearest` to that of every `step`-th pixel of a window, and sets its place.
void NearestWatch::look_at(const NewestFrame& camera, const Pose& X_TC, Pixel low, Pixel high,
                           int step, double& nearest, Pixel& at) const {
  const auto& [fx, fy, cx, cy] = camera.stream.intrinsics;
  for (int v = low.v; v < high.v; v += step) {
    for (int u = low.u; u < high.u; u += step) {
      const std::uint16_t count = camera.count(u, v);
      if (count == 0 || count == kFarCount) continue;
      const double z = count * camera.unit;
      const double distance = sphere_distance_below(
          tool_, X_TC * Vec3d{(u - cx) / fx * z, (v - cy) / fy * z, z}, nearest);
      if (distance >= nearest) continue;
      nearest = distance;
      at = {u, v};
    }
  }
}

}}  // namespace palpate::v0
