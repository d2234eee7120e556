// Products of small matrices against sums in long double and against their meaning for vectors.
#include "src/math/internal/matrix.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "src/math/internal/matrix6.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

template <class Matrix>
Matrix random_matrix(test::Random& random) {
  Matrix a;
  for (auto& row : a.m) {
    for (double& x : row) x = random.uniform(-1, 1);
  }
  return a;
}

template <class Matrix>
void expect_near(const Matrix& a, const Matrix& b, double tolerance) {
  for (int i = 0; i < kRows<Matrix>; ++i) {
    for (int j = 0; j < kRows<Matrix>; ++j) {
      EXPECT_NEAR(a.m[i][j], b.m[i][j], tolerance) << i << " " << j;
    }
  }
}

template <class Matrix>
void check_products() {
  constexpr int n = kRows<Matrix>;
  test::Random random(n);
  for (int round = 0; round < 100; ++round) {
    const auto a = random_matrix<Matrix>(random), b = random_matrix<Matrix>(random);
    Matrix ab, aba;
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        long double one = 0, two = 0;
        for (int k = 0; k < n; ++k) {
          one += static_cast<long double>(a.m[i][k]) * b.m[k][j];
          for (int l = 0; l < n; ++l) {
            two += static_cast<long double>(a.m[i][k]) * b.m[k][l] * a.m[j][l];
          }
        }
        ab.m[i][j] = static_cast<double>(one);
        aba.m[i][j] = static_cast<double>(two);
        EXPECT_EQ(transposed(a).m[i][j], a.m[j][i]);
        EXPECT_EQ(sum(a, 0.5, b).m[i][j], a.m[i][j] + 0.5 * b.m[i][j]);
      }
    }
    expect_near(product(a, b), ab, 1e-15 * n);
    expect_near(congruent(a, b), aba, 1e-15 * n * n);
  }
}

TEST(Matrix, ProductsAreThoseInLongDouble) {
  check_products<Mat3d>();
  check_products<Mat6>();
}

TEST(Matrix, APermutationMovesRowsAndColumnsExactly) {
  const Mat3d p{{{0, 1, 0}, {0, 0, 1}, {1, 0, 0}}}, a{{{1, 2, 3}, {4, 5, 6}, {7, 8, 9}}};
  expect_near(product(p, a), {{{4, 5, 6}, {7, 8, 9}, {1, 2, 3}}}, 0);
  expect_near(congruent(p, a), {{{5, 6, 4}, {8, 9, 7}, {2, 3, 1}}}, 0);
}

TEST(Matrix, InvertsByItsAdjugate) {
  // Determinant 1: the inverse has whole numbers.
  expect_near(inverse(Mat3d{{{2, 3, 1}, {1, 2, 1}, {1, 1, 1}}}),
              {{{1, -2, 1}, {0, 1, -1}, {-1, 1, 1}}}, 0);
  test::Random random(3);
  for (int n = 0; n < 100; ++n) {
    Mat3d a = random_matrix<Mat3d>(random);
    for (int i = 0; i < 3; ++i) a.m[i][i] += 3;
    expect_near(product(a, inverse(a)), {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, 1e-14);
  }
}

TEST(Matrix, BlocksAreThoseOfTheLargeMatrix) {
  test::Random random(4);
  const Mat6 a = random_matrix<Mat6>(random);
  for (const int row : {0, 2, 3}) {
    for (const int column : {0, 1, 3}) {
      const Mat3d b = block(a.m, row, column);
      for (int i = 0; i < 9; ++i) EXPECT_EQ(b.m[i / 3][i % 3], a.m[row + i / 3][column + i % 3]);
    }
  }
}

// A rotated matrix maps a rotated vector to the rotated image.
TEST(Matrix, RotatedBlocksMapRotatedVectors) {
  test::Random random(5);
  for (int n = 0; n < 100; ++n) {
    const Mat6 k = random_matrix<Mat6>(random);
    const Quaternion q = random.rotation(kPi);
    Mat6 turned = k;
    rotate_blocks(rotation_matrix(q), turned.m);
    const Vec6 v{random.in_box(1), random.in_box(1)}, image = k * v;
    const Vec6 got = turned * Vec6{rotate(q, v.linear), rotate(q, v.angular)};
    EXPECT_LT(norm(got.linear - rotate(q, image.linear)), 1e-14);
    EXPECT_LT(norm(got.angular - rotate(q, image.angular)), 1e-14);
  }
}

TEST(Finite, NoNumberMayBeInfiniteOrNone) {
  constexpr double kLargest = std::numeric_limits<double>::max();
  EXPECT_TRUE(is_finite(Vec3d{kLargest, kLargest, -kLargest}));
  for (const double bad : {double{INFINITY}, double{-INFINITY}, double{NAN}}) {
    for (int axis = 0; axis < 3; ++axis) {
      Vec3d v{1, 2, 3};
      v[axis] = bad;
      EXPECT_FALSE(is_finite(v));
      EXPECT_FALSE(is_finite(to_float(v)));
      EXPECT_FALSE(is_finite(Wrench{v, {}}));
      EXPECT_FALSE(is_finite(Wrench{{}, v}));
      EXPECT_FALSE(is_finite(Vec6{{}, v}));
      EXPECT_FALSE(is_finite(Pose{v, {}}));
    }
  }
}

}  // namespace
}  // namespace palpate
