// The faces of a placed mesh, cut into what can be integrated.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 { namespace scenes {

using Triangle = std::array<Vec3d, 3>;

/// Calls visit(triangle in W) for all faces.
template <class Visit>
void for_each_face(const TriangleMesh& mesh, const Pose& X_WT, Visit visit) {
  const Mat3d R_WT = rotation_matrix(X_WT.rotation);
  const auto corner = [&](std::uint32_t i) { return R_WT * mesh.vertices[i] + X_WT.translation; };
  for (const auto& [a, b, c] : mesh.triangles) visit(Triangle{corner(a), corner(b), corner(c)});
}

/// Twice the area times the normal.
inline Vec3d doubled_area(const Triangle& t) { return cross(t[1] - t[0], t[2] - t[0]); }

inline double height_over(const Plane<double>& plane, const Vec3d& p) {
  return dot(plane.normal, p) - plane.offset;
}

inline Plane<double> flipped(const Plane<double>& plane) { return {-plane.normal, -plane.offset}; }

/// The point of the plane nearest to p.
inline Vec3d foot(const Plane<double>& a, const Vec3d& p) {
  return p - a.normal * height_over(a, p);
}

/// The point of the common line of both planes nearest to p.
inline Vec3d foot(const Plane<double>& a, const Plane<double>& b, const Vec3d& p) {
  const double da = height_over(a, p), db = height_over(b, p);
  const double c = dot(a.normal, b.normal), s2 = 1 - c * c;
  return p - a.normal * ((da - c * db) / s2) - b.normal * ((db - c * da) / s2);
}

/// A triangle cut by at most six planes has at most nine corners.
class Polygon {
 public:
  explicit Polygon(const Triangle& t) : size_(3) {
    std::copy(t.begin(), t.end(), corners_.begin());
  }

  /// Keeps what lies behind the plane or on it (Sutherland & Hodgman).
  void clip(const Plane<double>& plane) {
    const std::array<Vec3d, kCapacity> old = corners_;
    const std::size_t old_size = size_;
    size_ = 0;
    for (std::size_t i = 0; i < old_size; ++i) {
      const Vec3d &p = old[i], &q = old[i + 1 < old_size ? i + 1 : 0];
      const double hp = height_over(plane, p), hq = height_over(plane, q);
      if (hp <= 0) corners_[size_++] = p;
      if ((hp < 0 && hq > 0) || (hp > 0 && hq < 0))
        corners_[size_++] = p + (q - p) * (hp / (hp - hq));
    }
  }

  /// Keeps the rest: a polygon that lies on the plane is not in front of it.
  void clip_in_front(const Plane<double>& plane) {
    const auto end = corners_.begin() + static_cast<std::ptrdiff_t>(size_);
    const bool some = std::any_of(corners_.begin(), end,
                                  [&](const Vec3d& p) { return height_over(plane, p) > 0; });
    if (some) {
      clip(flipped(plane));
    } else {
      size_ = 0;
    }
  }

  /// Calls visit(triangle) for triangles that make up the polygon and turn as it does.
  template <class Visit>
  void for_each_triangle(Visit visit) const {
    for (std::size_t i = 2; i < size_; ++i) {
      visit(Triangle{corners_[0], corners_[i - 1], corners_[i]});
    }
  }

 private:
  static constexpr std::size_t kCapacity = 9;
  std::array<Vec3d, kCapacity> corners_;
  std::size_t size_;
};

/// Seen from a point of its plane, a triangle is a sum of fans, one over each edge, those over
/// edges seen from outside counted negative. Adds up fan(d, t0, t1), the integral over the fan over
/// the edge at distance d > 0 between the tangential coordinates t0 < t1.
template <class Fan>
double sum_of_fans(const Triangle& triangle, const Vec3d& normal, const Vec3d& seen_from, Fan fan) {
  double sum = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3d p = triangle[i] - seen_from, q = triangle[(i + 1) % 3] - seen_from;
    const Vec3d along = normalized(q - p);
    const double d = dot(cross(p, along), normal), t0 = dot(p, along), t1 = dot(q, along);
    if (d > 0) sum += fan(d, t0, t1);
    if (d < 0) sum -= fan(-d, t0, t1);
  }
  return sum;
}

}}}  // namespace palpate::v0::scenes
