#include "src/packing/linear_program.h"

#include <gtest/gtest.h>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

struct Row {
  double a[4];
  double b;
};

// Solves four equations by Gaussian elimination; false if they are nearly dependent.
bool intersect(const Row* const rows[4], double z[4]) {
  double m[4][5];
  for (int i = 0; i < 4; ++i) {
    for (int k = 0; k < 4; ++k) m[i][k] = rows[i]->a[k];
    m[i][4] = rows[i]->b;
  }
  for (int k = 0; k < 4; ++k) {
    int pivot = k;
    for (int i = k + 1; i < 4; ++i) {
      if (std::abs(m[i][k]) > std::abs(m[pivot][k])) pivot = i;
    }
    if (std::abs(m[pivot][k]) < 1e-9) return false;
    std::swap(m[k], m[pivot]);
    for (int i = 0; i < 4; ++i) {
      if (i == k) continue;
      const double factor = m[i][k] / m[k][k];
      for (int j = k; j < 5; ++j) m[i][j] -= factor * m[k][j];
    }
  }
  for (int k = 0; k < 4; ++k) z[k] = m[k][4] / m[k][k];
  return true;
}

// The best feasible corner.
double brute_force(const LinearConstraints& constraints, double box) {
  std::vector<Row> rows;
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    rows.push_back(
        {{-constraints.nx[i], -constraints.ny[i], -constraints.nz[i], 1}, constraints.f[i]});
  }
  for (int k = 0; k < 3; ++k) {
    for (double sign : {-1.0, 1.0}) {
      Row row{{0, 0, 0, 0}, box};
      row.a[k] = sign;
      rows.push_back(row);
    }
  }
  double best = -1e300;
  const std::size_t n = rows.size();
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      for (std::size_t k = j + 1; k < n; ++k) {
        for (std::size_t l = k + 1; l < n; ++l) {
          const Row* const corner[4] = {&rows[i], &rows[j], &rows[k], &rows[l]};
          double z[4];
          if (!intersect(corner, z) || z[3] <= best) continue;
          bool feasible = true;
          for (const Row& row : rows) {
            const double value =
                row.a[0] * z[0] + row.a[1] * z[1] + row.a[2] * z[2] + row.a[3] * z[3];
            feasible = feasible && value <= row.b + 1e-9;
          }
          if (feasible) best = z[3];
        }
      }
    }
  }
  return best;
}

TEST(LinearProgram, FindsTheBestCorner) {
  test::Random random(3);
  for (int i = 0; i < 300; ++i) {
    LinearConstraints constraints;
    const int n = 1 + i % 14;
    for (int k = 0; k < n; ++k) constraints.add(random.direction(), random.uniform(0.5, 1.5));
    const double box = random.uniform(0.05, 2);
    const LinearOptimum best = solve_linear_program(constraints, box);
    EXPECT_NEAR(best.t, brute_force(constraints, box), 1e-9);
    double t = 1e300;
    for (std::size_t k = 0; k < constraints.size(); ++k) {
      t = std::min(t,
                   constraints.f[k] +
                       dot(Vec3d{constraints.nx[k], constraints.ny[k], constraints.nz[k]}, best.d));
    }
    EXPECT_NEAR(best.t, t, 1e-9);
    for (int k = 0; k < 3; ++k) EXPECT_LE(std::abs(best.d[k]), box);
  }
}

TEST(LinearProgram, SurvivesEqualAndOppositeConstraints) {
  LinearConstraints constraints;
  for (int i = 0; i < 100; ++i) {
    constraints.add({0, 0, 1}, 1);
    constraints.add({0, 0, -1}, 2);
    constraints.add({1, 0, 0}, 1.5);
  }
  const LinearOptimum best = solve_linear_program(constraints, 1);
  EXPECT_NEAR(best.t, 1.5, 1e-12);
  EXPECT_NEAR(best.d.z, 0.5, 1e-12);
}

}  // namespace
}  // namespace palpate
