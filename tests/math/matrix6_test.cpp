// Systems of six, and the part of a stiffness that resists motion, by their definitions.
#include "src/math/internal/matrix6.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

TEST(Matrix6, SolvesAndKnowsWhatIsNotPositive) {
  test::Random random(1);
  for (int n = 0; n < 500; ++n) {
    Mat6 s;
    for (auto& row : s.m) {
      for (double& x : row) x = random.uniform(-1, 1);
    }
    const Mat6 positive = positive_part(s.m, 1);
    Mat6 symmetric, a = positive;
    for (int i = 0; i < 6; ++i) {
      a.m[i][i] += 0.1;
      for (int j = 0; j < 6; ++j) symmetric.m[i][j] = (s.m[i][j] + s.m[j][i]) / 2;
    }
    const Vec6 b{random.in_box(1), random.in_box(1)};
    Vec6 x;
    ASSERT_TRUE(solve(a, b, x));
    const Vec6 error = a * x - b;
    EXPECT_LT(norm(error.linear) + norm(error.angular), 1e-12);

    // P and P - S have no negative direction, and P S = P P: eigenvectors with S's own values.
    const Mat6 rest = sum(positive, -1, symmetric);
    for (const Mat6& m : {positive, rest}) {
      const Vec6 mb = m * b;
      EXPECT_GT(dot(mb.linear, b.linear) + dot(mb.angular, b.angular), -1e-12);
    }
    const Vec6 zero = positive * (rest * b);
    EXPECT_LT(norm(zero.linear) + norm(zero.angular), 1e-12);

    // With angles counted as ways at a length: that of the stiffness in these units, and back.
    const double length = random.uniform(0.02, 3);
    const auto unit = [length](int i) { return i < 3 ? 1.0 : length; };
    Mat6 scaled;
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) scaled.m[i][j] = s.m[i][j] / (unit(i) * unit(j));
    }
    const Mat6 at_length = positive_part(s.m, length), inner = positive_part(scaled.m, 1);
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        const double want = inner.m[i][j] * unit(i) * unit(j);
        EXPECT_NEAR(at_length.m[i][j], want, 1e-9 * (1 + std::abs(want)));
      }
    }
  }
  Mat6 negative;
  for (int i = 0; i < 6; ++i) negative.m[i][i] = i == 4 ? -1 : 1;
  Vec6 x{{1, 2, 3}, {}};
  EXPECT_FALSE(solve(negative, x, x));
  EXPECT_EQ(x.linear.z, 3);
}

}  // namespace
}  // namespace palpate
