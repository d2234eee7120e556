#include "src/cloud/internal/lens_table.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "palpate/settings/setting_table.h"

namespace palpate { inline namespace v0 {
namespace {

/// r' of a point at r, without the tangential part.
double seen_radius(const Distortion& d, double r) {
  const double q = r * r;
  return r * (1 + q * (d.k1 + q * (d.k2 + q * d.k3))) / (1 + q * (d.k4 + q * (d.k5 + q * d.k6)));
}

}  // namespace

Status check_distortion(const Distortion& distortion) {
  Distortion d = distortion;
  const std::pair<const char*, double&> coefficients[] = {{"k1", d.k1}, {"k2", d.k2}, {"p1", d.p1},
                                                          {"p2", d.p2}, {"k3", d.k3}, {"k4", d.k4},
                                                          {"k5", d.k5}, {"k6", d.k6}};
  SettingTable table;
  for (const auto& [name, value] : coefficients) {
    table.add(std::string("distortion coefficient ") + name, value, {-1e6, 1e6, ""}, "");
  }
  return check_settings(table);
}

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

std::vector<std::uint32_t> lens_table(const CameraModel& pinhole, const CameraModel& raw) {
  const auto& [fx, fy, cx, cy] = pinhole.intrinsics;
  const Distortion& d = raw.distortion;
  const double widest =
      std::hypot(std::max(cx, pinhole.width - cx) / fx, std::max(cy, pinhole.height - cy) / fy);
  const double limit = largest_radius(d, widest);
  const auto none = static_cast<std::uint32_t>(raw.width * raw.height);
  std::vector<std::uint32_t> raw_pixels;
  raw_pixels.reserve(static_cast<std::size_t>(pinhole.width) *
                     static_cast<std::size_t>(pinhole.height));
  for (int v = 0; v < pinhole.height; ++v) {
    for (int u = 0; u < pinhole.width; ++u) {
      const double x = (u - cx) / fx, y = (v - cy) / fy, q = x * x + y * y, r = std::sqrt(q);
      const double scale = r > 0 ? seen_radius(d, r) / r : 1;
      const double x_seen = x * scale + 2 * d.p1 * x * y + d.p2 * (q + 2 * x * x);
      const double y_seen = y * scale + d.p1 * (q + 2 * y * y) + 2 * d.p2 * x * y;
      const double u_raw = std::floor(raw.intrinsics.fx * x_seen + raw.intrinsics.cx + 0.5);
      const double v_raw = std::floor(raw.intrinsics.fy * y_seen + raw.intrinsics.cy + 0.5);
      const bool is_seen =
          r <= limit && u_raw >= 0 && v_raw >= 0 && u_raw < raw.width && v_raw < raw.height;
      raw_pixels.push_back(is_seen ? static_cast<std::uint32_t>(v_raw * raw.width + u_raw) : none);
    }
  }
  return raw_pixels;
}

}}  // namespace palpate::v0
