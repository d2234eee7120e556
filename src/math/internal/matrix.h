// Arithmetic of small square matrices: Mat3d, Mat6, and whatever else holds n x n numbers in `m`.
#pragma once

#include <type_traits>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// Number of rows of a square matrix.
template <class Matrix>
inline constexpr int kRows = std::extent_v<decltype(Matrix::m), 0>;

template <class Matrix>
concept SquareMatrix = std::is_array_v<decltype(Matrix::m)> && std::extent_v<decltype(Matrix::m), 0>
== std::extent_v<decltype(Matrix::m), 1>;

/// Returns a b.
template <SquareMatrix Matrix>
Matrix product(const Matrix& a, const Matrix& b) {
  Matrix ab{};
  for (int i = 0; i < kRows<Matrix>; ++i) {
    for (int k = 0; k < kRows<Matrix>; ++k) {
      for (int j = 0; j < kRows<Matrix>; ++j) ab.m[i][j] += a.m[i][k] * b.m[k][j];
    }
  }
  return ab;
}

/// Returns the transpose of a.
template <SquareMatrix Matrix>
Matrix transposed(const Matrix& a) {
  Matrix t;
  for (int i = 0; i < kRows<Matrix>; ++i) {
    for (int j = 0; j < kRows<Matrix>; ++j) t.m[i][j] = a.m[j][i];
  }
  return t;
}

/// Returns a + s b.
template <SquareMatrix Matrix>
Matrix sum(const Matrix& a, double s, const Matrix& b) {
  Matrix result;
  for (int i = 0; i < kRows<Matrix>; ++i) {
    for (int j = 0; j < kRows<Matrix>; ++j) result.m[i][j] = a.m[i][j] + s * b.m[i][j];
  }
  return result;
}

/// Returns t a t^T.
template <SquareMatrix Map, SquareMatrix Matrix>
Matrix congruent(const Map& t, const Matrix& a) {
  static_assert(kRows<Map> == kRows<Matrix>);
  Matrix result{};
  for (int i = 0; i < kRows<Matrix>; ++i) {
    for (int j = 0; j < kRows<Matrix>; ++j) {
      for (int k = 0; k < kRows<Matrix>; ++k) {
        for (int l = 0; l < kRows<Matrix>; ++l) {
          result.m[i][j] += t.m[i][k] * a.m[k][l] * t.m[j][l];
        }
      }
    }
  }
  return result;
}

/// Returns the inverse of a matrix whose columns do not lie in one plane.
inline Mat3d inverse(const Mat3d& a) {
  const auto& m = a.m;
  const Vec3d x{m[0][0], m[1][0], m[2][0]}, y{m[0][1], m[1][1], m[2][1]},
      z{m[0][2], m[1][2], m[2][2]};
  const Vec3d yz = cross(y, z), zx = cross(z, x), xy = cross(x, y);
  const double by = 1 / dot(x, yz);
  return {{{by * yz.x, by * yz.y, by * yz.z},
           {by * zx.x, by * zx.y, by * zx.z},
           {by * xy.x, by * xy.y, by * xy.z}}};
}

/// Returns the 3 x 3 block of `m` that begins at a row and column.
template <int N>
Mat3d block(const double (&m)[N][N], int row, int column) {
  Mat3d result;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) result.m[i][j] = m[row + i][column + j];
  }
  return result;
}

/// Rotates each 3 x 3 block of `m` to other axes: R B R^T.
template <int N>
PALPATE_HOSTDEV void rotate_blocks(const Mat3d& R, double (&m)[N][N]) {
  static_assert(N % 3 == 0);
  for (int row = 0; row < N; row += 3) {
    for (int column = 0; column < N; column += 3) {
      double turned[3][3];  // R B
      for (int i = 0; i < 9; ++i) {
        double sum = 0;
        for (int j = 0; j < 3; ++j) sum += R.m[i / 3][j] * m[row + j][column + i % 3];
        turned[i / 3][i % 3] = sum;
      }
      for (int i = 0; i < 9; ++i) {
        double sum = 0;
        for (int j = 0; j < 3; ++j) sum += turned[i / 3][j] * R.m[i % 3][j];
        m[row + i / 3][column + i % 3] = sum;
      }
    }
  }
}

}}  // namespace palpate::v0
