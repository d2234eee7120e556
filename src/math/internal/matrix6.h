// Six-vectors and 6x6 matrices: translation first, then rotation.
#pragma once

#include "palpate/math/geometry.h"
#include "src/math/internal/cholesky.h"
#include "src/math/internal/jacobi.h"
#include "src/math/internal/matrix.h"

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

inline bool is_finite(const Vec6& v) { return is_finite(v.linear) && is_finite(v.angular); }
inline Vec6 to_vec6(const Wrench& w) { return {w.force, w.torque}; }
inline Wrench to_wrench(const Vec6& v) { return {v.linear, v.angular}; }

struct Mat6 {
  double m[6][6] = {};

  friend Vec6 operator*(const Mat6& a, const Vec6& v) {
    Vec6 result;
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) result[i] += a.m[i][j] * v[j];
    }
    return result;
  }
};

/// The triangular factor of a symmetric positive definite matrix (Cholesky).
class Factor6 {
 public:
  /// False if the matrix is not positive definite.
  bool set(const Mat6& a) {
    l_ = a;
    return factor_cholesky(l_.m[0], 6);
  }
  /// Returns x of a x = b.
  Vec6 solve(Vec6 b) const {
    solve_forward(l_.m[0], 6, b);
    solve_backward(l_.m[0], 6, b);
    return b;
  }

 private:
  Mat6 l_;
};

/// Solves a x = b for a symmetric positive definite `a`. False if it is not: x is as it was.
inline bool solve(const Mat6& a, const Vec6& b, Vec6& x) {
  Factor6 factor;
  if (!factor.set(a)) return false;
  const Vec6 y = factor.solve(b);
  if (!is_finite(y)) return false;
  x = y;
  return true;
}

/// Returns the symmetric part of a stiffness without its negative eigenvalues, which would drive a
/// motion instead of resisting it. An angle of 1 counts as `length` meters.
inline Mat6 positive_part(const double (&stiffness)[6][6], double length) {
  const auto unit = [length](int i) { return i < 3 ? 1.0 : length; };
  Mat6 a, vectors, result;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      a.m[i][j] = (stiffness[i][j] + stiffness[j][i]) / (2 * unit(i) * unit(j));
    }
  }
  if (!diagonalize(a.m, vectors.m)) return result;
  for (int k = 0; k < 6; ++k) {
    const double eigenvalue = a.m[k][k];
    if (!(eigenvalue > 0)) continue;
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        result.m[i][j] += eigenvalue * vectors.m[i][k] * unit(i) * vectors.m[j][k] * unit(j);
      }
    }
  }
  return result;
}

}}  // namespace palpate::v0
