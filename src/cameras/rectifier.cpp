#include "src/cameras/rectifier.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate {
namespace {

/// r' of a point at r, without the tangential part.
double seen_radius(const Distortion& d, double r) {
  const double q = r * r;
  return r * (1 + q * (d.k1 + q * (d.k2 + q * d.k3))) / (1 + q * (d.k4 + q * (d.k5 + q * d.k6)));
}

/// The same view with another number of pixels; pixel centres are at whole numbers.
Intrinsics scaled(const Intrinsics& camera, double x, double y) {
  return {camera.fx * x, camera.fy * y, (camera.cx + 0.5) * x - 0.5, (camera.cy + 0.5) * y - 0.5};
}

}  // namespace

double largest_radius(const Distortion& distortion, double limit) {
  constexpr int kSteps = 4096;
  double last = 0;
  for (int i = 1; i <= kSteps; ++i) {
    const double r = limit * i / kSteps, seen = seen_radius(distortion, r);
    if (!(seen > last)) return limit * (i - 1) / kSteps;
    last = seen;
  }
  return limit;
}

CameraModel CameraTruth::model_of(const DepthStreamInfo& stream, int width, int height) const {
  CameraModel model{width, height, stream.intrinsics, stream.distortion};
  if (intrinsics) {
    model.intrinsics = *intrinsics;
    if (size.width > 0 && !(size == ImageSize{width, height})) {
      model.intrinsics =
          scaled(*intrinsics, double(width) / size.width, double(height) / size.height);
    }
  }
  if (distortion) model.distortion = *distortion;
  return model;
}

Rectifier::Rectifier(const CameraModel& pinhole) : pinhole_(pinhole), table_model_(pinhole) {
  pinhole_.distortion = {};
  table_model_.width = 0;  // there is no table yet
}

void Rectifier::apply(const CameraModel& model, DepthFrame& frame) {
  if (model == pinhole_) return;
  if (!(model == table_model_)) make_table(model);
  frame.pixels.push_back(0);  // what is seen where the camera sees nothing
  spare_.resize(raw_pixels_.size());
  const std::uint16_t* const raw = frame.pixels.data();
  for (std::size_t i = 0; i < raw_pixels_.size(); ++i) spare_[i] = raw[raw_pixels_[i]];
  std::swap(frame.pixels, spare_);
  frame.width = pinhole_.width;
  frame.height = pinhole_.height;
}

const std::vector<std::uint32_t>& Rectifier::raw_pixels(const CameraModel& model) {
  if (!(model == table_model_)) make_table(model);
  return raw_pixels_;
}

void Rectifier::make_table(const CameraModel& model) {
  table_model_ = model;
  const auto& [fx, fy, cx, cy] = pinhole_.intrinsics;
  const Distortion& d = model.distortion;
  const double widest =
      std::hypot(std::max(cx, pinhole_.width - cx) / fx, std::max(cy, pinhole_.height - cy) / fy);
  const double limit = largest_radius(d, widest);
  const auto none = static_cast<std::uint32_t>(model.width * model.height);
  raw_pixels_.clear();
  raw_pixels_.reserve(static_cast<std::size_t>(pinhole_.width) *
                      static_cast<std::size_t>(pinhole_.height));
  for (int v = 0; v < pinhole_.height; ++v) {
    for (int u = 0; u < pinhole_.width; ++u) {
      const double x = (u - cx) / fx, y = (v - cy) / fy, q = x * x + y * y, r = std::sqrt(q);
      const double scale = r > 0 ? seen_radius(d, r) / r : 1;
      const double x_seen = x * scale + 2 * d.p1 * x * y + d.p2 * (q + 2 * x * x);
      const double y_seen = y * scale + d.p1 * (q + 2 * y * y) + 2 * d.p2 * x * y;
      const double u_raw = std::floor(model.intrinsics.fx * x_seen + model.intrinsics.cx + 0.5);
      const double v_raw = std::floor(model.intrinsics.fy * y_seen + model.intrinsics.cy + 0.5);
      const bool is_seen =
          r <= limit && u_raw >= 0 && v_raw >= 0 && u_raw < model.width && v_raw < model.height;
      raw_pixels_.push_back(is_seen ? static_cast<std::uint32_t>(v_raw * model.width + u_raw)
                                    : none);
    }
  }
}

}  // namespace palpate
