// Eigenvalues against a closed form, and eigenvectors by their definition in long double.
#include "src/math/internal/jacobi.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/math/geometry.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

/// Requires A v = value v for each column v, and columns of unit length at right angles.
template <int N>
void expect_eigenvectors(const double (&a)[N][N], const double (&values)[N][N],
                         const double (&v)[N][N], double scale) {
  for (int k = 0; k < N; ++k) {
    for (int i = 0; i < N; ++i) {
      long double image = 0;
      for (int j = 0; j < N; ++j) image += static_cast<long double>(a[i][j]) * v[j][k];
      EXPECT_NEAR(static_cast<double>(image), values[k][k] * v[i][k], 1e-13 * scale)
          << i << " " << k;
    }
    for (int l = 0; l < N; ++l) {
      long double product = 0;
      for (int i = 0; i < N; ++i) product += static_cast<long double>(v[i][k]) * v[i][l];
      EXPECT_NEAR(static_cast<double>(product), k == l ? 1 : 0, 1e-14) << k << " " << l;
    }
  }
}

template <int N>
void check_random_matrices() {
  test::Random random(N);
  for (int n = 0; n < 300; ++n) {
    const double scale = std::pow(10, random.uniform(-9, 9));
    double a[N][N], values[N][N], vectors[N][N];
    for (int i = 0; i < N; ++i) {
      for (int j = 0; j <= i; ++j) a[i][j] = a[j][i] = scale * random.uniform(-1, 1);
      if (n % 3 == 0 && i > 0) a[i][i] = a[0][0];
    }
    std::copy_n(a[0], N * N, values[0]);
    ASSERT_TRUE(diagonalize(values, vectors));
    expect_eigenvectors(a, values, vectors, scale);
    std::copy_n(a[0], N * N, values[0]);
    diagonalize_ascending(values, vectors);
    expect_eigenvectors(a, values, vectors, scale);
    for (int k = 1; k < N; ++k) EXPECT_LE(values[k - 1][k - 1], values[k][k]);
  }
}

TEST(Jacobi, FindsEigenvectorsOfRandomMatrices) {
  check_random_matrices<2>();
  check_random_matrices<3>();
  check_random_matrices<6>();
}

// Second differences: eigenvalues 2 - 2 cos(k pi / 7).
TEST(Jacobi, FindsTheModesOfAString) {
  double a[6][6] = {}, vectors[6][6];
  for (int i = 0; i < 6; ++i) {
    a[i][i] = 2;
    if (i > 0) a[i][i - 1] = a[i - 1][i] = -1;
  }
  ASSERT_TRUE(diagonalize(a, vectors));
  double values[6];
  for (int i = 0; i < 6; ++i) values[i] = a[i][i];
  std::sort(values, values + 6);
  for (int k = 1; k <= 6; ++k) EXPECT_NEAR(values[k - 1], 2 - 2 * std::cos(k * kPi / 7), 1e-14);
}

TEST(Jacobi, LeavesADiagonalMatrix) {
  double a[3][3] = {{3, 0, 0}, {0, -2, 0}, {0, 0, 3}}, vectors[3][3];
  ASSERT_TRUE(diagonalize(a, vectors));
  const double expected[3] = {3, -2, 3};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      EXPECT_EQ(a[i][j], i == j ? expected[i] : 0);
      EXPECT_EQ(vectors[i][j], i == j ? 1 : 0);
    }
  }
}

TEST(Jacobi, RefusesZeroAndInfinity) {
  double zero[3][3] = {}, vectors[3][3];
  EXPECT_FALSE(diagonalize(zero, vectors));
  double infinite[3][3] = {{1, 2, 3}, {2, 1, 0}, {3, 0, std::numeric_limits<double>::infinity()}};
  EXPECT_FALSE(diagonalize(infinite, vectors));
  EXPECT_EQ(infinite[0][1], 2);
}

}  // namespace
}  // namespace palpate
