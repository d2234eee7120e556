// Three-vectors and 3x3 matrices: plain structs for host and device.
#pragma once

#include <cmath>

#include "palpate/core/hostdev.h"

namespace palpate {

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

}  // namespace palpate
