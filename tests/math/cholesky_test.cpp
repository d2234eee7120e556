// Cholesky's factors against a closed form, and solutions against elimination in long double.
#include "src/math/internal/cholesky.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

using Rows = std::vector<double>;  // n rows of n numbers

double& at(Rows& a, int n, int i, int j) { return a[static_cast<std::size_t>(i * n + j)]; }

/// The matrix min(i, j) + 1: its factor is 1 in the lower half, without rounding.
Rows stairs(int n) {
  Rows a(static_cast<std::size_t>(n * n));
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) at(a, n, i, j) = std::min(i, j) + 1;
  }
  return a;
}

/// Returns B B^T + 1 for random B.
Rows positive(int n, test::Random& random) {
  Rows b(static_cast<std::size_t>(n * n)), a(b.size());
  for (double& x : b) x = random.uniform(-1, 1);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      at(a, n, i, j) = i == j ? 1 : 0;
      for (int k = 0; k < n; ++k) at(a, n, i, j) += at(b, n, i, k) * at(b, n, j, k);
    }
  }
  return a;
}

/// Solves a x = b by Gaussian elimination with pivots, in long double.
std::vector<long double> eliminated(Rows a, int n, const std::vector<double>& b) {
  std::vector<std::vector<long double>> rows;
  for (int i = 0; i < n; ++i) {
    rows.emplace_back();
    for (int j = 0; j < n; ++j) rows.back().push_back(at(a, n, i, j));
    rows.back().push_back(b[static_cast<std::size_t>(i)]);
  }
  const auto size = static_cast<std::size_t>(n);
  for (std::size_t k = 0; k < size; ++k) {
    for (std::size_t i = k + 1; i < size; ++i) {
      if (std::abs(rows[i][k]) > std::abs(rows[k][k])) std::swap(rows[i], rows[k]);
    }
    for (std::size_t i = 0; i < size; ++i) {
      if (i == k) continue;
      const long double factor = rows[i][k] / rows[k][k];
      for (std::size_t j = k; j <= size; ++j) rows[i][j] -= factor * rows[k][j];
    }
  }
  std::vector<long double> x;
  for (std::size_t i = 0; i < size; ++i) x.push_back(rows[i][size] / rows[i][i]);
  return x;
}

TEST(Cholesky, FactorsAMatrixWithAKnownFactorExactly) {
  for (int n = 1; n <= 24; ++n) {
    Rows a = stairs(n);
    ASSERT_TRUE(factor_cholesky(a.data(), n)) << n;
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) {
        EXPECT_EQ(at(a, n, i, j), j <= i ? 1 : i + 1) << n << ": " << i << " " << j;
      }
    }
  }
}

TEST(Cholesky, ReadsTheLowerHalfAlone) {
  Rows a = stairs(6);
  for (int i = 0; i < 6; ++i) {
    for (int j = i + 1; j < 6; ++j) at(a, 6, i, j) = NAN;
  }
  ASSERT_TRUE(factor_cholesky(a.data(), 6));
  EXPECT_EQ(at(a, 6, 5, 0), 1);
  EXPECT_TRUE(std::isnan(at(a, 6, 0, 5)));
}

TEST(Cholesky, SolvesAsElimination) {
  test::Random random(1);
  for (int n = 1; n <= 24; ++n) {
    const Rows a = positive(n, random);
    std::vector<double> x(static_cast<std::size_t>(n));
    for (double& value : x) value = random.uniform(-1, 1);
    const std::vector<long double> expected = eliminated(a, n, x);
    Rows l = a;
    ASSERT_TRUE(factor_cholesky(l.data(), n));
    solve_forward(l.data(), n, x);
    solve_backward(l.data(), n, x);
    for (std::size_t i = 0; i < x.size(); ++i) {
      EXPECT_NEAR(x[i], static_cast<double>(expected[i]), 1e-13) << n << ": " << i;
    }
  }
}

TEST(Cholesky, RefusesWhatIsNotPositiveDefinite) {
  for (const double last : {-1.0, 0.0, 1.0, 1 + 1e-13, double{NAN}}) {
    double a[4] = {1, 0, 1, last};  // rows 1 1 and 1 last: the second pivot is last - 1
    EXPECT_FALSE(factor_cholesky(a, 2, 1e-12)) << last;
  }
  double good[4] = {1, 0, 1, 1 + 1e-11};
  EXPECT_TRUE(factor_cholesky(good, 2, 1e-12));
}

}  // namespace
}  // namespace palpate
