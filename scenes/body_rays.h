// The pixels of a camera that see a mesh, and how deep. Two files define BodyRays, of which the
// build takes one: by Embree, or by no library (body_rays_plain.cpp).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <span>

#include "scenes/scene.h"

namespace palpate { inline namespace v0 { namespace scenes {

/// Pixels [u0, u1) x [v0, v1).
struct PixelBox {
  int u0, u1, v0, v1;
};

/// The rays of the pixels of an image. Directions have z = 1 in C, so that lengths along them are
/// depths.
struct ImageRays {
  Intrinsics intrinsics;
  int width, height;

  Vec3d ray(int u, int v) const {
    return {(u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, 1};
  }
  std::size_t index(int u, int v) const {
    return static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(u);
  }
  /// Returns the pixels that a hull of points can cover; all of them if it reaches behind the
  /// camera.
  PixelBox box_around(std::span<const Vec3d> points_B, const Pose& X_CB) const {
    const Intrinsics& k = intrinsics;
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    double u0 = kInfinity, u1 = -kInfinity, v0 = kInfinity, v1 = -kInfinity;
    const Mat3d R_CB = rotation_matrix(X_CB.rotation);
    for (const Vec3d& p_B : points_B) {
      const Vec3d p = R_CB * p_B + X_CB.translation;
      if (p.z < 1e-3) return {0, width, 0, height};
      const double u = k.cx + k.fx * p.x / p.z, v = k.cy + k.fy * p.y / p.z;
      u0 = std::min(u0, u), u1 = std::max(u1, u);
      v0 = std::min(v0, v), v1 = std::max(v1, v);
    }
    const auto pixel = [](double x, int size) {
      return static_cast<int>(std::clamp(x, 0.0, double(size)));
    };
    return {pixel(std::floor(u0), width), pixel(std::ceil(u1) + 1, width),
            pixel(std::floor(v0), height), pixel(std::ceil(v1) + 1, height)};
  }
};

/// Returns the length along a ray to the plane of a triangle.
inline double plane_depth(const TriangleMesh& mesh, std::size_t triangle, const Vec3d& origin,
                          const Vec3d& direction) {
  const auto& [i, j, k] = mesh.triangles[triangle];
  const Vec3d& p = mesh.vertices[i];
  const Vec3d normal = cross(mesh.vertices[j] - p, mesh.vertices[k] - p);
  return dot(normal, p - origin) / dot(normal, direction);
}

/// A mesh in its body frame, ready for rays. `mesh` must outlive it.
class BodyRays {
 public:
  explicit BodyRays(const TriangleMesh& mesh);
  BodyRays(BodyRays&&) noexcept;
  ~BodyRays();

  /// Writes the depth of the body at X_CB where it is nearer than what `image` has (NaN: nothing).
  /// Each maker finds the triangle that a ray meets; the depth is that of its plane in double.
  void draw(const ImageRays& rays, const Pose& X_CB, std::span<float> image) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}}}  // namespace palpate::v0::scenes
