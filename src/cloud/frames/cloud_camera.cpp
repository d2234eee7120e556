// The image of a cloud: as it is, or projected, by the formula in cloud_camera.h.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "src/cloud/internal/cloud_camera.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/core/internal/message_text.h"

namespace palpate { inline namespace v0 {
namespace {

/// Distance from the center of a pixel, pixels: so near, a point is the pixel's own.
constexpr double kCentered = 0.01;

/// Steepest surface that is one surface, tan of its slant: beyond, a step between two pixels is an
/// edge.
constexpr double kSteepest = 4;

/// Largest relative difference of the depths of a surface within a pixel, or between neighbors.
double largest_step(const Intrinsics& k) { return kSteepest / std::min(k.fx, k.fy); }

std::size_t index_of(int u, int v, int width) {
  return static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
         static_cast<std::size_t>(u);
}

}  // namespace

std::string CloudShares::text() const {
  const auto percent = [this](std::size_t num) {
    const std::size_t all = std::max(points, std::size_t{1});
    return number_text(100.0 * static_cast<double>(num) / static_cast<double>(all), 2) + " %";
  };
  return "its clouds are projected into images; of the points of the first, " + percent(merged) +
         " share a pixel with others, " + percent(hidden) +
         " are hidden by others or turned away, and " + percent(outside) +
         " lie outside of the image";
}

void CloudCamera::describe(DepthStreamInfo& info) const {
  info.width = model_.width;
  info.height = model_.height;
  info.intrinsics = model_.intrinsics;
  info.unit = unit_;
}

bool CloudCamera::is_image_of(const PointsView& cloud) const {
  constexpr std::size_t kNumSamples = 4096;
  constexpr double kMaxOff = 0.5, kMaxShare = 0.01;  // pixels; of the samples
  if (cloud.width != model_.width || cloud.height != model_.height || !(X_FC_ == Pose{})) {
    return false;
  }
  const Intrinsics& k = model_.intrinsics;
  const std::size_t step = cloud.points.size() / kNumSamples + 1;
  std::size_t num = 0, num_off = 0;
  for (std::size_t i = 0; i < cloud.points.size(); i += step) {
    if (!is_measured(cloud.points[i])) continue;
    const Vec3d p = to_double(cloud.points[i]);
    const auto width = static_cast<std::size_t>(model_.width);
    const double u = k.fx * p.x / p.z + k.cx - static_cast<double>(i % width);
    const double v = k.fy * p.y / p.z + k.cy - static_cast<double>(i / width);
    ++num;
    num_off += !(p.z > 0) || std::abs(u) > kMaxOff || std::abs(v) > kMaxOff;
  }
  return static_cast<double>(num_off) <= kMaxShare * static_cast<double>(num);
}

CloudShares CloudCamera::take(const PointsView& cloud, DepthFrame& frame) {
  frame.width = model_.width;
  frame.height = model_.height;
  frame.unit = unit_;
  frame.flow.clear();
  frame.pixels.resize(index_of(0, model_.height, model_.width));
  if (!is_image_of(cloud)) return project(cloud, frame);
  std::ranges::transform(cloud.points, frame.pixels.begin(), [&](const Vec3f& p) {
    return is_measured(p) ? count_of(double(p.z), unit_) : std::uint16_t{0};
  });
  return {};
}

CloudShares CloudCamera::project(const PointsView& cloud, DepthFrame& frame) {
  const auto& [width, height, k, none] = model_;
  const Mat3d R_CF = rotation_matrix(conjugate(X_FC_.rotation));
  const double step = largest_step(k);
  pixels_.assign(frame.pixels.size(), {});
  is_grid_ = true;
  CloudShares shares;
  shares.is_image = false;
  /// Calls `use(pixel, offset u, offset v, 1/z)` for each point in the image that is not seen from
  /// behind; `on_rest` is told of the others.
  const auto for_each_seen = [&](const auto& use, const auto& on_rest) {
    for (std::size_t i = 0; i < cloud.points.size(); ++i) {
      if (!is_measured(cloud.points[i])) continue;
      const Vec3d to = to_double(cloud.points[i]);
      const Vec3d p = R_CF * to;
      const double u = k.fx * p.x / p.z + k.cx, v = k.fy * p.y / p.z + k.cy;
      const bool is_inside =
          p.z >= unit_ && u > -0.5 && v > -0.5 && u < width - 0.5 && v < height - 0.5;
      const bool is_turned = !cloud.normals.empty() && dot(to_double(cloud.normals[i]), to) > 0;
      if (!is_inside || is_turned) {
        on_rest(is_inside);
        continue;
      }
      const double at_u = std::round(u), at_v = std::round(v);
      use(pixels_[index_of(static_cast<int>(at_u), static_cast<int>(at_v), width)], u - at_u,
          v - at_v, 1 / p.z);
    }
  };
  for_each_seen(
      [&](Pixel& pixel, double, double, double inverse) {
        ++shares.points;
        pixel.nearest = std::max(pixel.nearest, static_cast<float>(inverse));
      },
      [&](bool is_hidden) {
        ++shares.points;
        ++(is_hidden ? shares.hidden : shares.outside);
      });
  for_each_seen(
      [&](Pixel& pixel, double u, double v, double inverse) {
        if (inverse * (1 + step) < static_cast<double>(pixel.nearest)) {
          ++shares.hidden;
          return;
        }
        pixel.u += static_cast<float>(u);
        pixel.v += static_cast<float>(v);
        pixel.inverse += static_cast<float>(inverse);
        pixel.count += 1;
        is_grid_ = is_grid_ && std::hypot(u, v) < kCentered;
      },
      [](bool) {});
  for (Pixel& pixel : pixels_) {
    if (pixel.count == 0) continue;
    if (pixel.count > 1) shares.merged += static_cast<std::size_t>(pixel.count);
    pixel.u /= pixel.count;
    pixel.v /= pixel.count;
    pixel.inverse /= pixel.count;
  }
  fill(frame);
  return shares;
}

/// Moves each pixel's depth to its center along the plane of its neighbors, and closes gaps of one
/// pixel in a surface: where there is no point, and where one behind shows through.
void CloudCamera::fill(DepthFrame& frame) {
  const int width = model_.width, height = model_.height;
  const double step = largest_step(model_.intrinsics);
  const auto pixel_at = [&](int u, int v) -> const Pixel& {
    return pixels_[index_of(u, v, width)];
  };
  const auto is_near = [&](double a, double b) { return std::abs(a - b) <= step * std::max(a, b); };
  inverse_.assign(pixels_.size(), 0);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const Pixel& own = pixel_at(u, v);
      float& inverse = inverse_[index_of(u, v, width)];
      inverse = own.inverse;
      if (own.count == 0 || std::hypot(own.u, own.v) < kCentered) continue;
      // Least squares of the differences to this pixel: inverse = a u + b v.
      double uu = 0, uv = 0, vv = 0, ui = 0, vi = 0;
      for (int j = std::max(v - 1, 0); j <= std::min(v + 1, height - 1); ++j) {
        for (int i = std::max(u - 1, 0); i <= std::min(u + 1, width - 1); ++i) {
          const Pixel& other = pixel_at(i, j);
          if (other.count == 0 || !is_near(own.inverse, other.inverse)) continue;
          const double du = i - u + double(other.u) - own.u, dv = j - v + double(other.v) - own.v;
          const double di = double(other.inverse) - own.inverse;
          uu += du * du;
          uv += du * dv;
          vv += dv * dv;
          ui += du * di;
          vi += dv * di;
        }
      }
      const double determinant = uu * vv - uv * uv;
      if (!(determinant > 0.1 * (uu + vv))) continue;  // too few of them, or all on a line
      const double a = (ui * vv - vi * uv) / determinant, b = (vi * uu - ui * uv) / determinant;
      const double moved = own.inverse - a * own.u - b * own.v;
      if (is_near(moved, own.inverse)) inverse = static_cast<float>(moved);
    }
  }
  constexpr std::array<std::pair<int, int>, 4> kWays{{{1, 0}, {0, 1}, {1, 1}, {1, -1}}};
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const float inverse = inverse_[index_of(u, v, width)];
      double sum = 0;
      int num = 0;
      for (const auto& [i, j] : kWays) {
        if (u - i < 0 || u + i >= width || v - j < 0 || v + j < 0 || v - j >= height ||
            v + j >= height) {
          continue;
        }
        const double a = inverse_[index_of(u - i, v - j, width)];
        const double b = inverse_[index_of(u + i, v + j, width)];
        const double mean = 0.5 * (a + b);
        if (a == 0 || b == 0 || !is_near(a, b) || mean < double(inverse) * (1 + 2 * step)) continue;
        ++num;
        sum += mean;
      }
      // Gaps of an image in another order are its own.
      const double shown = !is_grid_ && num >= 2 ? sum / num : double(inverse);
      frame.pixels[index_of(u, v, width)] = count_of(shown > 0 ? 1 / shown : 0, unit_);
    }
  }
}

}}  // namespace palpate::v0
