// Clearance by its definition: every sphere, every pixel of every camera, in double.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "palpate/field/sensor.h"
#include "palpate/tool/tool.h"

namespace palpate::test {

/// One image as rays from the eye that are solid from a depth on.
struct SolidRays {
  SolidRays(const DepthFieldView& field, bool is_blocked)
      : k(field.intrinsics),
        width(field.levels[0].width),
        height(field.levels[0].height),
        is_blocked_outside(is_blocked) {
    const DepthFieldLevel& level = field.levels[0];
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u) {
        const float* const plane = level.planes + 2 * (v * level.stride + u);
        depth.push_back(plane[1] > 0 ? static_cast<double>(plane[0] / plane[1]) : kFree);
      }
    }
    if (!is_blocked && field.unseen() != UnseenSpace::solid) {
      back = 2 * std::abs(static_cast<double>(field.thickness));
    }
  }

  static constexpr double kFree = 1e9;

  bool is_solid(const Vec3d& p) const {
    const double u = std::floor(p.x / p.z * k.fx + k.cx + 0.5);
    const double v = std::floor(p.y / p.z * k.fy + k.cy + 0.5);
    if (!(p.z > 1e-3) || u < 0 || v < 0 || u >= width || v >= height) return is_blocked_outside;
    const double first = depth[static_cast<std::size_t>(v * width + u)];
    return p.z >= first && p.z <= first + back;
  }
  double to_part(const Vec3d& p, int u, int v, double first, double last) const {
    const Vec3d ray{(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1};
    const double t = std::clamp(dot(p, ray) / dot(ray, ray), first, last);
    return norm(p - t * ray);
  }
  /// Distance to the least far of the planes of the border, positive inside of the image.
  double to_border(const Vec3d& p) const {
    const auto plane = [](double across, double z, double slope, double sign) {
      return sign * (across - slope * z) / std::sqrt(1 + slope * slope);
    };
    return std::min({plane(p.x, p.z, (-0.5 - k.cx) / k.fx, 1),
                     plane(p.x, p.z, (width - 0.5 - k.cx) / k.fx, -1),
                     plane(p.y, p.z, (-0.5 - k.cy) / k.fy, 1),
                     plane(p.y, p.z, (height - 0.5 - k.cy) / k.fy, -1)});
  }
  /// Signed distance, negative in solid space.
  double distance(const Vec3d& p) const {
    const bool inside = is_solid(p);
    double least = std::numeric_limits<double>::infinity();
    if (inside != is_blocked_outside) least = std::max(to_border(p), 0.0);
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u) {
        const double first = depth[static_cast<std::size_t>(v * width + u)];
        if (inside) {
          least = std::min(least, to_part(p, u, v, 0, first));
          if (back < kFree) least = std::min(least, to_part(p, u, v, first + back, kFree));
        } else if (first < kFree) {
          least = std::min(least, to_part(p, u, v, first, first + back));
        }
      }
    }
    return inside ? -least : least;
  }

  Intrinsics k;
  int width, height;
  bool is_blocked_outside;
  double back = kFree;
  std::vector<double> depth;
};

/// All cameras of a scene. One camera counts by itself.
struct SolidScene {
  explicit SolidScene(std::span<const SurfaceView> surfaces) {
    for (const SurfaceView& surface : surfaces) {
      X_CW.push_back(inverse(surface.X_WC));
      field.emplace_back(surface.field, false);
      if (surfaces.size() > 1) seen_free.emplace_back(surface.seen_free, true);
    }
  }
  double distance(const Vec3d& p_W) const {
    double of_fields = std::numeric_limits<double>::infinity(), seen = -of_fields;
    for (std::size_t k = 0; k < field.size(); ++k) {
      const Vec3d p_C = X_CW[k] * p_W;
      of_fields = std::min(of_fields, field[k].distance(p_C));
      if (!seen_free.empty()) seen = std::max(seen, seen_free[k].distance(p_C));
    }
    return std::max(of_fields, seen);
  }
  double clearance(const Tool& tool, const Pose& X_WT, double limit) const {
    double least = limit;
    for (const Sphere& sphere : tool.spheres()) {
      least = std::min(
          least, distance(X_WT * to_double(sphere.center)) - static_cast<double>(sphere.radius));
    }
    return std::max(least, -limit);
  }

  std::vector<Pose> X_CW;
  std::vector<SolidRays> field, seen_free;
};

}  // namespace palpate::test
