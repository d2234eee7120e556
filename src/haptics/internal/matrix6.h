// Six-vectors and symmetric 6x6 matrices: translation first, then rotation.
#pragma once

#include "palpate/contact/contact.h"

namespace palpate { inline namespace v0 {

struct Vec6 {
  Vec3d linear, angular;

  double& operator[](int i) { return i < 3 ? linear[i] : angular[i - 3]; }
  double operator[](int i) const { return i < 3 ? linear[i] : angular[i - 3]; }

  friend Vec6 operator+(const Vec6& a, const Vec6& b) {
    return {a.linear + b.linear, a.angular + b.angular};
  }
  friend Vec6 operator-(const Vec6& a, const Vec6& b) {
    return {a.linear - b.linear, a.angular - b.angular};
  }
  friend Vec6 operator*(double s, const Vec6& a) { return {s * a.linear, s * a.angular}; }
};

inline bool is_finite(const Vec3d& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}
inline bool is_finite(const Vec6& v) { return is_finite(v.linear) && is_finite(v.angular); }
inline bool is_finite(const Wrench& w) { return is_finite(w.force) && is_finite(w.torque); }
inline Vec6 to_vec6(const Wrench& w) { return {w.force, w.torque}; }
inline Wrench to_wrench(const Vec6& v) { return {v.linear, v.angular}; }

struct Mat6 {
  double m[6][6] = {};
};

Vec6 operator*(const Mat6& a, const Vec6& v);

/// a + s b.
Mat6 sum(const Mat6& a, double s, const Mat6& b);

/// The triangular factor of a symmetric positive definite matrix (Cholesky).
class Factor6 {
 public:
  /// False if the matrix is not positive definite.
  bool set(const Mat6& a);
  /// x of a x = b.
  Vec6 solve(const Vec6& b) const;

 private:
  double l_[6][6] = {};
};

/// x of a x = b for a symmetric positive definite `a` (Cholesky). False if it is not: x is as it
/// was.
bool solve(const Mat6& a, const Vec6& b, Vec6& x);

/// The symmetric part of a stiffness without its negative eigenvalues, which would drive a motion
/// instead of resisting it. An angle of 1 counts as `length` meters.
Mat6 positive_part(const Stiffness& stiffness, double length);

}}  // namespace palpate::v0
