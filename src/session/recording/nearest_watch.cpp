#include "src/session/recording/nearest_watch.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace palpate { inline namespace v0 {

NearestWatch::NearestWatch(const Tool& tool, std::vector<DepthStreamInfo> streams) : tool_(tool) {
  for (DepthStreamInfo& stream : streams) cameras_.push_back({std::move(stream), {}, {}});
}

void NearestWatch::take(const FrameRecord& record, const DepthFrame& frame) {
  if (has_touched_) return;
  Camera& camera = cameras_[record.camera];
  camera.frame = frame;
  camera.X_WC = record.X_WC;
}

void NearestWatch::take(const ContactRecord& contact) {
  has_touched_ = has_touched_ || contact.penetration.volume > 0;
  if (has_touched_ || contact.time < next_look_) return;
  next_look_ = contact.time + kPeriod;
  for (const Camera& camera : cameras_) look(camera, contact);
}

std::optional<NearestApproach> NearestWatch::nearest() const {
  return has_touched_ ? std::nullopt : nearest_;
}

void NearestWatch::look(const Camera& camera, const ContactRecord& contact) {
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
void NearestWatch::look_at(const Camera& camera, const Pose& X_TC, Pixel low, Pixel high, int step,
                           double& nearest, Pixel& at) const {
  const DepthFrame& frame = camera.frame;
  const auto& [fx, fy, cx, cy] = camera.stream.intrinsics;
  for (int v = low.v; v < high.v; v += step) {
    for (int u = low.u; u < high.u; u += step) {
      const std::uint16_t count =
          frame.pixels[static_cast<std::size_t>(v) * static_cast<std::size_t>(frame.width) +
                       static_cast<std::size_t>(u)];
      if (count == 0 || count == kFarCount) continue;
      const double z = count * frame.unit;
      const double distance =
          distance_below(X_TC * Vec3d{(u - cx) / fx * z, (v - cy) / fy * z, z}, nearest);
      if (distance >= nearest) continue;
      nearest = distance;
      at = {u, v};
    }
  }
}

/// Returns the distance of a point from the spheres if it is below `limit`; else `limit`.
double NearestWatch::distance_below(const Vec3d& p_T, double limit) const {
  const auto nodes = tool_.tree().nodes();
  std::array<std::int32_t, InnerSphereTree::kMaxWaiting> waiting;
  std::size_t num_waiting = 0;
  waiting[num_waiting++] = 0;
  while (num_waiting > 0) {
    const IstNode& node = nodes[static_cast<std::size_t>(waiting[--num_waiting])];
    const double distance =
        norm(p_T - to_double(node.bound.center)) - static_cast<double>(node.bound.radius);
    if (distance >= limit) continue;
    if (node.num_children == 0) limit = distance;
    for (int k = 0; k < node.num_children; ++k) waiting[num_waiting++] = node.first_child + k;
  }
  return limit;
}

}}  // namespace palpate::v0
