#include "src/haptics/internal/matrix6.h"

#include <algorithm>

namespace palpate { inline namespace v0 {
namespace {

constexpr int kMaxSweeps = 12;  // Jacobi's method converges quadratically: five or six do

/// One rotation of Jacobi's method: makes a[p][q] zero and turns the columns of `vectors` along.
void jacobi_rotation(Mat6& a, Mat6& vectors, int p, int q) {
  const double apq = a.m[p][q];
  if (apq == 0) return;
  const double theta = (a.m[q][q] - a.m[p][p]) / (2 * apq);
  const double t = (theta < 0 ? -1 : 1) / (std::abs(theta) + std::hypot(theta, 1));
  const double c = 1 / std::hypot(t, 1), s = t * c;
  for (int k = 0; k < 6; ++k) {
    const double akp = a.m[k][p], akq = a.m[k][q];
    a.m[k][p] = c * akp - s * akq;
    a.m[k][q] = s * akp + c * akq;
    const double vkp = vectors.m[k][p], vkq = vectors.m[k][q];
    vectors.m[k][p] = c * vkp - s * vkq;
    vectors.m[k][q] = s * vkp + c * vkq;
  }
  for (int k = 0; k < 6; ++k) {
    const double apk = a.m[p][k], aqk = a.m[q][k];
    a.m[p][k] = c * apk - s * aqk;
    a.m[q][k] = s * apk + c * aqk;
  }
  a.m[p][q] = a.m[q][p] = 0;
}

}  // namespace

Vec6 operator*(const Mat6& a, const Vec6& v) {
  Vec6 result;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) result[i] += a.m[i][j] * v[j];
  }
  return result;
}

Mat6 sum(const Mat6& a, double s, const Mat6& b) {
  Mat6 result;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) result.m[i][j] = a.m[i][j] + s * b.m[i][j];
  }
  return result;
}

bool Factor6::set(const Mat6& a) {
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j <= i; ++j) {
      double value = a.m[i][j];
      for (int k = 0; k < j; ++k) value -= l_[i][k] * l_[j][k];
      if (i != j) {
        l_[i][j] = value / l_[j][j];
      } else if (value > 0) {
        l_[i][i] = std::sqrt(value);
      } else {
        return false;
      }
    }
  }
  return true;
}

Vec6 Factor6::solve(const Vec6& b) const {
  Vec6 y;
  for (int i = 0; i < 6; ++i) {
    y[i] = b[i];
    for (int k = 0; k < i; ++k) y[i] -= l_[i][k] * y[k];
    y[i] /= l_[i][i];
  }
  for (int i = 5; i >= 0; --i) {
    for (int k = i + 1; k < 6; ++k) y[i] -= l_[k][i] * y[k];
    y[i] /= l_[i][i];
  }
  return y;
}

bool solve(const Mat6& a, const Vec6& b, Vec6& x) {
  Factor6 factor;
  if (!factor.set(a)) return false;
  const Vec6 y = factor.solve(b);
  if (!is_finite(y)) return false;
  x = y;
  return true;
}

Mat6 positive_part(const Stiffness& stiffness, double length) {
  const auto unit = [length](int i) { return i < 3 ? 1.0 : length; };
  Mat6 a, vectors;
  double scale = 0;
  for (int i = 0; i < 6; ++i) {
    vectors.m[i][i] = 1;
    for (int j = 0; j < 6; ++j) {
      a.m[i][j] = (stiffness.m[i][j] + stiffness.m[j][i]) / (2 * unit(i) * unit(j));
      scale = std::max(scale, std::abs(a.m[i][j]));
    }
  }
  if (!(scale > 0) || !std::isfinite(scale)) return {};

  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    double rest = 0;
    for (int p = 0; p < 6; ++p) {
      for (int q = p + 1; q < 6; ++q) rest = std::max(rest, std::abs(a.m[p][q]));
    }
    if (rest <= 1e-14 * scale) break;
    for (int p = 0; p < 6; ++p) {
      for (int q = p + 1; q < 6; ++q) jacobi_rotation(a, vectors, p, q);
    }
  }

  Mat6 result;
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
