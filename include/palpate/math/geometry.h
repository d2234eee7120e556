// Vectors, rotations, poses, wrenches, spheres, planes and spherical caps.
#pragma once

#include <algorithm>
#include <cmath>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

// Three-vectors and 3x3 matrices: plain structs for host and device.

/// A vector of three numbers.
template <class T>
struct Vec3 {
  T x{}, y{}, z{};

  PALPATE_HOSTDEV constexpr T& operator[](int i) { return i == 0 ? x : (i == 1 ? y : z); }
  PALPATE_HOSTDEV constexpr const T& operator[](int i) const {
    return i == 0 ? x : (i == 1 ? y : z);
  }
  PALPATE_HOSTDEV constexpr Vec3& operator+=(const Vec3& b) { return *this = *this + b; }
  PALPATE_HOSTDEV constexpr Vec3& operator-=(const Vec3& b) { return *this = *this - b; }
  PALPATE_HOSTDEV constexpr Vec3& operator*=(T s) { return *this = *this * s; }

  PALPATE_HOSTDEV friend constexpr Vec3 operator+(const Vec3& a, const Vec3& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
  }
  PALPATE_HOSTDEV friend constexpr Vec3 operator-(const Vec3& a, const Vec3& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
  }
  PALPATE_HOSTDEV friend constexpr Vec3 operator-(const Vec3& a) { return {-a.x, -a.y, -a.z}; }
  PALPATE_HOSTDEV friend constexpr Vec3 operator*(const Vec3& a, T s) {
    return {a.x * s, a.y * s, a.z * s};
  }
  PALPATE_HOSTDEV friend constexpr Vec3 operator*(T s, const Vec3& a) { return a * s; }
  PALPATE_HOSTDEV friend constexpr Vec3 operator/(const Vec3& a, T s) {
    return {a.x / s, a.y / s, a.z / s};
  }
  PALPATE_HOSTDEV friend constexpr bool operator==(const Vec3& a, const Vec3& b) {
    return a.x == b.x && a.y == b.y && a.z == b.z;
  }
};

using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;

template <class T>
PALPATE_HOSTDEV constexpr T dot(const Vec3<T>& a, const Vec3<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

template <class T>
PALPATE_HOSTDEV constexpr Vec3<T> cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <class T>
PALPATE_HOSTDEV T norm(const Vec3<T>& a) {
  return std::sqrt(dot(a, a));
}

/// a / |a|, or zero for the zero vector.
template <class T>
PALPATE_HOSTDEV Vec3<T> normalized(const Vec3<T>& a) {
  const T length = norm(a);
  return length > T(0) ? a / length : Vec3<T>{};
}

PALPATE_HOSTDEV constexpr Vec3d to_double(const Vec3f& a) { return {a.x, a.y, a.z}; }
PALPATE_HOSTDEV constexpr Vec3f to_float(const Vec3d& a) {
  return {static_cast<float>(a.x), static_cast<float>(a.y), static_cast<float>(a.z)};
}

/// Row-major 3x3 matrix.
struct Mat3d {
  double m[3][3] = {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}};

  PALPATE_HOSTDEV friend Vec3d operator*(const Mat3d& a, const Vec3d& v) {
    return {a.m[0][0] * v.x + a.m[0][1] * v.y + a.m[0][2] * v.z,
            a.m[1][0] * v.x + a.m[1][1] * v.y + a.m[1][2] * v.z,
            a.m[2][0] * v.x + a.m[2][1] * v.y + a.m[2][2] * v.z};
  }
};

// Poses, twists and wrenches in monogram notation: X_WT is the pose of frame T in frame W and maps
// T coordinates to W coordinates. Adjacent letters match: X_WC = X_WT * X_TC.

/// Unit quaternion, stored x, y, z, w (the order of TUM files).
struct Quaternion {
  double x = 0, y = 0, z = 0, w = 1;

  friend bool operator==(const Quaternion&, const Quaternion&) = default;
};

PALPATE_HOSTDEV inline Quaternion operator*(const Quaternion& a, const Quaternion& b) {
  return {
      a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
      a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
}

PALPATE_HOSTDEV inline Quaternion conjugate(const Quaternion& q) { return {-q.x, -q.y, -q.z, q.w}; }

/// q scaled to unit length; identity for the zero quaternion.
PALPATE_HOSTDEV inline Quaternion normalized(const Quaternion& q) {
  const double length = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  if (!(length > 0)) return {};
  return {q.x / length, q.y / length, q.z / length, q.w / length};
}

/// Rotation by `angle` radians about the axis (any length but zero).
inline Quaternion axis_angle(const Vec3d& axis, double angle) {
  const Vec3d v = normalized(axis) * std::sin(angle / 2);
  return {v.x, v.y, v.z, std::cos(angle / 2)};
}

/// The rotation matrix of a unit quaternion.
PALPATE_HOSTDEV inline Mat3d rotation_matrix(const Quaternion& q) {
  const double xx = q.x * q.x, yy = q.y * q.y, zz = q.z * q.z;
  const double xy = q.x * q.y, xz = q.x * q.z, yz = q.y * q.z;
  const double wx = q.w * q.x, wy = q.w * q.y, wz = q.w * q.z;
  return {{{1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)},
           {2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)},
           {2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)}}};
}

/// Rigid transform: rotation, then translation (meters).
struct Pose {
  Vec3d translation = {};
  Quaternion rotation = {};

  friend bool operator==(const Pose&, const Pose&) = default;
};

/// v_A from v_B: rotates only.
PALPATE_HOSTDEV inline Vec3d rotate(const Quaternion& q, const Vec3d& v) {
  return rotation_matrix(q) * v;
}

/// p_A from p_B: X_AB * p_B.
PALPATE_HOSTDEV inline Vec3d operator*(const Pose& X_AB, const Vec3d& p_B) {
  return rotate(X_AB.rotation, p_B) + X_AB.translation;
}

PALPATE_HOSTDEV inline Pose operator*(const Pose& X_AB, const Pose& X_BC) {
  return {X_AB * X_BC.translation, normalized(X_AB.rotation * X_BC.rotation)};
}

/// X_BA from X_AB.
PALPATE_HOSTDEV inline Pose inverse(const Pose& X_AB) {
  const Quaternion q = conjugate(X_AB.rotation);
  return {-rotate(q, X_AB.translation), q};
}

/// Shortest rotation (slerp) and straight line from a (t = 0) to b (t = 1).
inline Pose interpolate(const Pose& a, const Pose& b, double t) {
  const Quaternion& p = a.rotation;
  Quaternion q = b.rotation;
  double cosine = p.x * q.x + p.y * q.y + p.z * q.z + p.w * q.w;
  if (cosine < 0) {
    q = {-q.x, -q.y, -q.z, -q.w};
    cosine = -cosine;
  }
  double weight_p = 1 - t, weight_q = t;
  if (cosine < 0.9995) {
    const double angle = std::acos(std::min(cosine, 1.0));
    weight_p = std::sin((1 - t) * angle) / std::sin(angle);
    weight_q = std::sin(t * angle) / std::sin(angle);
  }
  return {a.translation * (1 - t) + b.translation * t,
          normalized(Quaternion{weight_p * p.x + weight_q * q.x, weight_p * p.y + weight_q * q.y,
                                weight_p * p.z + weight_q * q.z, weight_p * p.w + weight_q * q.w})};
}

/// Force and torque about a stated point in a stated frame, e.g. F_To_W: at To, expressed in W.
struct Wrench {
  Vec3d force;   ///< N
  Vec3d torque;  ///< N m
};

/// Volume times direction: a wrench before any stiffness, about a stated point and in a stated
/// frame.
struct VolumeWrench {
  Vec3d force;   ///< m3
  Vec3d torque;  ///< m4
};

/// Linear velocity of a stated point and angular velocity.
struct Twist {
  Vec3d linear;
  Vec3d angular;
};

/// True if all numbers are finite.
template <class T>
bool is_finite(const Vec3<T>& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}
inline bool is_finite(const Wrench& w) { return is_finite(w.force) && is_finite(w.torque); }
inline bool is_finite(const Pose& X) {
  const Vec3d& t = X.translation;
  const Quaternion& q = X.rotation;
  return std::isfinite(t.x + t.y + t.z + q.x + q.y + q.z + q.w);
}

// Spheres, planes and the part of a sphere behind a plane.

inline constexpr double kPi = 3.14159265358979323846;

/// A ball in the tool frame, in single precision. All checks and backends use exactly these stored
/// numbers.
struct Sphere {
  Vec3f center;
  float radius = 0;
};

/// Points x with normal . x = offset. `normal` is unit and points out of the environment.
template <class T>
struct Plane {
  Vec3<T> normal;
  T offset{};
};

/// 4/3 pi r^3.
template <class Real>
PALPATE_HOSTDEV constexpr Real sphere_volume(Real radius) {
  return Real(4.0 / 3.0 * kPi) * radius * radius * radius;
}

/// Volume of the part of a ball of radius r behind a plane. d is the *signed* distance of the
/// center in front of the plane (thesis Alg. 3.1 and eq. 3.1; d = n.(c - p) with |n| = 1, eq. 3.2
/// corrected). 0 for d >= r, the whole ball for d <= -r. Branch-free after the clamp.
template <class Real>
PALPATE_HOSTDEV constexpr Real cap_volume(Real radius, Real distance) {
  const Real h_raw = radius - distance;
  const Real h_low = h_raw < Real(0) ? Real(0) : h_raw;
  const Real h = h_low > radius + radius ? radius + radius : h_low;
  return Real(kPi / 3.0) * h * h * (Real(3) * radius - h);
}

/// Intersection volume of two balls with centers `distance` apart (a lens made of two caps).
template <class Real>
PALPATE_HOSTDEV constexpr Real lens_volume(Real a, Real b, Real distance) {
  const Real small = a < b ? a : b, large = a < b ? b : a;
  if (distance >= a + b) return Real(0);
  if (distance <= large - small) return sphere_volume(small);
  const Real s = a + b - distance, diff = a - b;
  return Real(kPi / 12.0) * s * s *
         (distance * distance + Real(2) * distance * (a + b) - Real(3) * diff * diff) / distance;
}

/// Variance and covariances of the measure by the random noise of the cameras alone, to first
/// order: nothing of what they do not see, of their calibration or of edges that flicker. With
/// bodies it is that of the cameras: a CAD model has no noise.
struct MeasureNoise {
  double volume = 0;  ///< m6
  Mat3d force = {};   ///< of VolumeWrench::force, m6, in W
  Mat3d torque = {};  ///< of VolumeWrench::torque, m8, in W

  /// Standard deviations along the axes of W: m3, m3 and m4.
  double volume_std() const { return std::sqrt(volume); }
  Vec3d force_std() const { return deviations(force); }
  Vec3d torque_std() const { return deviations(torque); }

  /// Adds independent noise that counts `share` times.
  void add(const MeasureNoise& other, double share = 1) {
    const double square = share * share;
    volume += square * other.volume;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        force.m[row][column] += square * other.force.m[row][column];
        torque.m[row][column] += square * other.torque.m[row][column];
      }
    }
  }

 private:
  static Vec3d deviations(const Mat3d& covariance) {
    const auto& m = covariance.m;
    return {std::sqrt(m[0][0]), std::sqrt(m[1][1]), std::sqrt(m[2][2])};
  }
};

}}  // namespace palpate::v0
