// Jacobi's method: eigenvalues and eigenvectors of small symmetric matrices.
#pragma once

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {

/// Rotates rows and columns p and q of a symmetric matrix by the angle with cosine c and sine s,
/// and the columns of `vectors` along.
template <int N>
void rotate_plane(double (&a)[N][N], double (&vectors)[N][N], int p, int q, double c, double s) {
  for (int k = 0; k < N; ++k) {
    const double akp = a[k][p], akq = a[k][q];
    a[k][p] = c * akp - s * akq;
    a[k][q] = s * akp + c * akq;
    const double vkp = vectors[k][p], vkq = vectors[k][q];
    vectors[k][p] = c * vkp - s * vkq;
    vectors[k][q] = s * vkp + c * vkq;
  }
  for (int k = 0; k < N; ++k) {
    const double apk = a[p][k], aqk = a[q][k];
    a[p][k] = c * apk - s * aqk;
    a[q][k] = s * apk + c * aqk;
  }
}

/// Makes a[p][q] zero by the smaller rotation.
template <int N>
void jacobi_rotation(double (&a)[N][N], double (&vectors)[N][N], int p, int q) {
  const double apq = a[p][q];
  if (apq == 0) return;
  const double theta = (a[q][q] - a[p][p]) / (2 * apq);
  const double t = (theta < 0 ? -1 : 1) / (std::abs(theta) + std::hypot(theta, 1));
  const double c = 1 / std::hypot(t, 1), s = t * c;
  rotate_plane(a, vectors, p, q, c, s);
  a[p][q] = a[q][p] = 0;
}

/// Makes a symmetric matrix diagonal: its eigenvalues, whose eigenvectors are the columns of
/// `vectors`. False for a zero matrix and for one that is not finite, which stay as they are.
template <int N>
bool diagonalize(double (&a)[N][N], double (&vectors)[N][N]) {
  constexpr int kMaxSweeps = 12;        // the method converges quadratically: five or six do
  constexpr double kConverged = 1e-14;  // of the largest number
  double scale = 0;
  for (int i = 0; i < N; ++i) {
    for (int j = 0; j < N; ++j) {
      vectors[i][j] = i == j ? 1 : 0;
      scale = std::max(scale, std::abs(a[i][j]));
    }
  }
  if (!(scale > 0) || !std::isfinite(scale)) return false;
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    double rest = 0;
    for (int p = 0; p < N; ++p) {
      for (int q = p + 1; q < N; ++q) rest = std::max(rest, std::abs(a[p][q]));
    }
    if (rest <= kConverged * scale) break;
    for (int p = 0; p < N; ++p) {
      for (int q = p + 1; q < N; ++q) jacobi_rotation(a, vectors, p, q);
    }
  }
  return true;
}

/// The same by rotations that leave the smaller eigenvalue first, so that all ascend unless the
/// matrix is diagonal already.
template <int N>
void diagonalize_ascending(double (&a)[N][N], double (&vectors)[N][N]) {
  constexpr int kSweeps = 30;
  for (int i = 0; i < N; ++i) {
    for (int j = 0; j < N; ++j) vectors[i][j] = i == j ? 1 : 0;
  }
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (int p = 0; p < N; ++p) {
      for (int q = p + 1; q < N; ++q) {
        if (a[p][q] == 0) continue;
        const double angle = 0.5 * std::atan2(2 * a[p][q], a[q][q] - a[p][p]);
        rotate_plane(a, vectors, p, q, std::cos(angle), std::sin(angle));
      }
    }
  }
}

}}  // namespace palpate::v0
