#include "src/field/internal/pinhole_cloud.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace palpate { inline namespace v0 {
namespace {

/// Least squares line value = slope * pixel + start.
struct LineFit {
  double n = 0, p = 0, pp = 0, v = 0, pv = 0;

  void add(double pixel, double value) {
    n += 1;
    p += pixel;
    pp += pixel * pixel;
    v += value;
    pv += pixel * value;
  }
  double slope() const { return (n * pv - p * v) / (n * pp - p * p); }
  double start() const { return (v - slope() * p) / n; }
};

/// Calls `use(i, u, v)` for each valid point in front of the camera.
template <class Use>
void for_points(const PointCloudView& cloud, const Use& use) {
  for (int v = 0; v < cloud.height; ++v) {
    for (int u = 0; u < cloud.width; ++u) {
      const std::size_t i = static_cast<std::size_t>(v) * static_cast<std::size_t>(cloud.width) +
                            static_cast<std::size_t>(u);
      if (cloud.z[i] > 0) use(i, u, v);
    }
  }
}

Vec3f point(const PointCloudView& c, std::size_t i) { return {c.x[i], c.y[i], c.z[i]}; }
Vec3f normal(const PointCloudView& c, std::size_t i) { return {c.nx[i], c.ny[i], c.nz[i]}; }

/// The pinhole camera whose rays an organized cloud lies on.
std::optional<Intrinsics> intrinsics_of(const PointCloudView& cloud) {
  if (cloud.pinhole) return cloud.intrinsics;
  constexpr double kTolerance = 0.25;  // pixels
  if (cloud.height < 8 || cloud.width < 8) return std::nullopt;
  LineFit columns, rows;
  for_points(cloud, [&](std::size_t i, int u, int v) {
    columns.add(u, static_cast<double>(cloud.x[i]) / static_cast<double>(cloud.z[i]));
    rows.add(v, static_cast<double>(cloud.y[i]) / static_cast<double>(cloud.z[i]));
  });
  const Intrinsics k{1 / columns.slope(), 1 / rows.slope(), -columns.start() / columns.slope(),
                     -rows.start() / rows.slope()};
  if (!(k.fx > 0 && k.fy > 0 && std::isfinite(k.fx + k.fy + k.cx + k.cy))) return std::nullopt;
  bool fits = true;
  for_points(cloud, [&](std::size_t i, int u, int v) {
    const Vec3d p = to_double(point(cloud, i));
    fits = fits && std::abs(k.fx * p.x / p.z + k.cx - u) <= kTolerance &&
           std::abs(k.fy * p.y / p.z + k.cy - v) <= kTolerance;
  });
  return fits ? std::optional(k) : std::nullopt;
}

/// All points in the smallest image that holds them, about one for each pixel.
PointCloud splat(const PointCloudView& cloud, std::size_t num_points) {
  constexpr int kMinSide = 8, kMaxSide = 2048;
  double low[2] = {1e300, 1e300}, high[2] = {-1e300, -1e300};
  const auto direction = [&](std::size_t i, int axis) {
    return static_cast<double>((axis == 0 ? cloud.x : cloud.y)[i]) /
           static_cast<double>(cloud.z[i]);
  };
  for_points(cloud, [&](std::size_t i, int, int) {
    for (int axis = 0; axis < 2; ++axis) {
      low[axis] = std::min(low[axis], direction(i, axis));
      high[axis] = std::max(high[axis], direction(i, axis));
    }
  });
  constexpr double kNarrow = 1e-3;
  const double w = std::max(high[0] - low[0], kNarrow), h = std::max(high[1] - low[1], kNarrow);
  double f = std::sqrt(static_cast<double>(num_points) / (w * h));
  f = std::min(f, (kMaxSide - 1) / std::max(w, h));
  const auto pixels = [&](double side) {
    return std::clamp(static_cast<int>(std::ceil(f * side)) + 1, kMinSide, kMaxSide);
  };
  const Intrinsics k{f, f, -low[0] * f, -low[1] * f};
  PointCloud image(pixels(w), pixels(h), k);
  for_points(cloud, [&](std::size_t i, int, int) {
    const auto u = static_cast<std::size_t>(std::lround(f * direction(i, 0) + k.cx));
    const auto v = static_cast<std::size_t>(std::lround(f * direction(i, 1) + k.cy));
    const std::size_t to = v * static_cast<std::size_t>(image.width()) + u;
    if (!(image.channel(2)[to] <= cloud.z[i])) image.set(to, point(cloud, i), normal(cloud, i));
  });
  return image;
}

}  // namespace

Result<PointCloud> make_pinhole_cloud(const PointCloudView& cloud) {
  std::size_t num_points = 0;
  for_points(cloud, [&](std::size_t, int, int) { ++num_points; });
  if (num_points == 0) {
    return Error{Errc::bad_input,
                 "no point of the cloud is in front of the camera (z > 0), so it has no depth "
                 "field; check its axes or use another method"};
  }
  const auto k = intrinsics_of(cloud);
  if (!k) return splat(cloud, num_points);
  PointCloud copy(cloud.width, cloud.height, k);
  for_points(cloud,
             [&](std::size_t i, int, int) { copy.set(i, point(cloud, i), normal(cloud, i)); });
  return copy;
}

}}  // namespace palpate::v0
