// Derivatives by the numbers of poses, against differences of a potential in closed form.
#include "tests/contact/batch/pose_gradients.h"

#include <cmath>

#include <gtest/gtest.h>

#include "src/math/internal/pose_of_matrix.h"

namespace palpate {
namespace {

using test::PosesOfSprings;
using test::Spring;

constexpr double kStep = 1e-5;

Pose pose_at(const double* x, bool is_matrix) {
  if (is_matrix) return pose_of_matrix(x);
  return {{x[0], x[1], x[2]}, normalized(Quaternion{x[3], x[4], x[5], x[6]})};
}

/// Changes of a pose's numbers that are motions: for seven numbers along each of them, for a matrix
/// shifts and turns.
std::vector<std::vector<double>> moved(const std::vector<double>& x, int k, double step) {
  std::vector<double> to = x, change(x.size(), 0.0);
  if (x.size() == 7) {
    to[std::size_t(k)] += step;
    change[std::size_t(k)] = step;
    return {to, change};
  }
  const Pose X = pose_of_matrix(x.data());
  Vec3d axis;
  axis[k % 3] = 1;
  const Pose there = k < 3 ? Pose{X.translation + step * axis, X.rotation}
                           : Pose{X.translation, axis_angle(axis, step) * X.rotation};
  to = test::matrix_of(there);
  for (std::size_t i = 0; i < 16; ++i) change[i] = to[i] - x[i];
  return {to, change};
}

class PoseGradientsTest : public testing::TestWithParam<bool> {};

TEST_P(PoseGradientsTest, AreThoseOfThePotential) {
  PosesOfSprings<double> asked(20, GetParam(), 1);
  ASSERT_TRUE(put_pose_gradients(asked.job(false)));
  for (std::size_t i = 0; i < asked.num; ++i) {
    const auto begin = asked.numbers.begin() + std::ptrdiff_t(asked.each * i);
    const std::vector<double> x(begin, begin + std::ptrdiff_t(asked.each));
    for (int k = 0; k < (GetParam() ? 6 : 7); ++k) {
      double by_gradient = 0;
      const auto ahead = moved(x, k, kStep), back = moved(x, k, -kStep);
      for (std::size_t j = 0; j < asked.each; ++j) {
        by_gradient += asked.to[asked.each * i + j] * (ahead[1][j] - back[1][j]);
      }
      const double change = asked.spring.potential(pose_at(ahead[0].data(), GetParam())) -
                            asked.spring.potential(pose_at(back[0].data(), GetParam()));
      EXPECT_NEAR(by_gradient, asked.scale[i] * change, 1e-8 * kStep + 1e-9 * std::abs(change))
          << i << " " << k;
    }
  }
}

/// The gradient of one pose by its numbers, not scaled.
std::vector<double> gradient_at(const Spring& spring, const std::vector<double>& x) {
  double wrench[6];
  spring.wrench(pose_at(x.data(), x.size() == 16), wrench, wrench + 3);
  std::vector<double> to(x.size());
  PoseGradients job;
  job.poses = {x.data(), 1, x.size() == 16, false, kHostMemory};
  job.p_TC = &spring.p_TC.x;
  job.by_shift = wrench;
  job.by_turn = wrench + 3;
  job.factor = -1;
  job.to = to.data();
  EXPECT_TRUE(put_pose_gradients(job));
  return to;
}

TEST_P(PoseGradientsTest, ChangeAsTheyAreSaidTo) {
  PosesOfSprings<double> asked(20, GetParam(), 2);
  ASSERT_TRUE(put_pose_gradients(asked.job(true)));
  for (std::size_t i = 0; i < asked.num; ++i) {
    const auto begin = asked.numbers.begin() + std::ptrdiff_t(asked.each * i);
    const std::vector<double> x(begin, begin + std::ptrdiff_t(asked.each));
    const double* const y = &asked.along[asked.each * i];
    const auto along = [&](const std::vector<double>& at) {
      const std::vector<double> g = gradient_at(asked.spring, at);
      double sum = 0;
      for (std::size_t j = 0; j < asked.each; ++j) sum += y[j] * g[j];
      return sum;
    };
    EXPECT_NEAR(asked.by_scale[i], along(x), 1e-12);
    for (int k = 0; k < (GetParam() ? 6 : 7); ++k) {
      const auto ahead = moved(x, k, kStep), back = moved(x, k, -kStep);
      double by_derivative = 0;
      for (std::size_t j = 0; j < asked.each; ++j) {
        by_derivative += asked.to[asked.each * i + j] * (ahead[1][j] - back[1][j]);
      }
      const double change = along(ahead[0]) - along(back[0]);
      EXPECT_NEAR(by_derivative, asked.scale[i] * change, 2e-8 * kStep + 1e-8 * std::abs(change))
          << i << " " << k;
    }
  }
}

TEST_P(PoseGradientsTest, TheirProductsNeedNoStiffness) {
  PosesOfSprings<double> asked(20, GetParam(), 2);
  PoseGradients job = asked.job(true);
  ASSERT_TRUE(put_pose_gradients(job));
  const std::vector<double> expected = asked.by_scale, to = asked.to;
  asked.by_scale.assign(asked.num, 77.0);
  job.stiffness = nullptr;
  job.to = nullptr;
  ASSERT_TRUE(put_pose_gradients(job));
  EXPECT_EQ(asked.by_scale, expected);
  EXPECT_EQ(asked.to, to);
}

/// A point Q that moves with the tool: U = n . (X p_TQ), whose stiffness is that of a plane.
TEST_P(PoseGradientsTest, OfAPointBeforeAPlaneNeedNoStiffness) {
  PosesOfSprings<double> asked(20, GetParam(), 3);
  const Vec3d n{0.6, 0, 0.8}, arm = asked.spring.p_TQ - asked.spring.p_TC;
  std::vector<double> shift, turn, arms, expected;
  for (std::size_t i = 0; i < asked.num; ++i) {
    const Vec3d lever = rotate(asked.X[i].rotation, arm), m = cross(lever, n);
    for (int k = 0; k < 3; ++k) {
      shift.push_back(n[k]);
      turn.push_back(m[k]);
      arms.push_back(arm[k]);
    }
    double* const K = &asked.stiffness[36 * i];
    std::fill_n(K, 36, 0.0);
    for (int column = 0; column < 3; ++column) {
      Vec3d w;
      w[column] = 1;
      const Vec3d by = cross(cross(w, lever), n);
      for (int k = 0; k < 3; ++k) K[6 * (3 + k) + 3 + column] = -by[k];
    }
  }
  PoseGradients job = asked.job(true);
  job.by_shift = shift.data();
  job.by_turn = turn.data();
  job.factor = 1;
  ASSERT_TRUE(put_pose_gradients(job));
  expected = asked.to;
  job.stiffness = nullptr;
  job.p_CQ = arms.data();
  ASSERT_TRUE(put_pose_gradients(job));
  for (std::size_t k = 0; k < expected.size(); ++k) EXPECT_NEAR(asked.to[k], expected[k], 1e-14);
}

TEST_P(PoseGradientsTest, AreZeroWhereThereIsNoPose) {
  PosesOfSprings<double> asked(4, GetParam(), 4);
  const std::size_t each = asked.each;
  asked.numbers[each] = NAN;
  std::fill_n(&asked.numbers[2 * each + 3], each - 3, 0.0);
  for (const bool is_second : {false, true}) {
    ASSERT_TRUE(put_pose_gradients(asked.job(is_second)));
    for (std::size_t k = 0; k < each; ++k) {
      EXPECT_EQ(asked.to[each + k], 0) << k;
      EXPECT_EQ(asked.to[2 * each + k], 0) << k;
    }
    EXPECT_NE(asked.to[3 * each], 0);
  }
  std::vector<double> seven(7 * 4);
  ASSERT_TRUE(put_plain_poses(asked.job(false).poses, seven.data()));
  const auto* const X = reinterpret_cast<const Pose*>(seven.data());
  for (const std::size_t i : {0u, 1u, 2u, 3u}) {
    EXPECT_EQ(is_finite(X[i]), i == 0 || i == 3) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Numbers, PoseGradientsTest, testing::Bool(),
                         [](const auto& of) { return std::string(of.param ? "Matrix" : "Seven"); });

/// Turns of all kinds: small ones, half turns about each axis, and any.
TEST(PlainPosesTest, AreThoseOfTheirMatrices) {
  test::Random random(5);
  std::vector<Quaternion> turns{{0, 0, 0, 1}, {1, 0, 0, 0},    {0, 1, 0, 0},
                                {0, 0, 1, 0}, {1e-9, 0, 0, 1}, {1, 1e-9, 0, 1e-9}};
  for (int i = 0; i < 50; ++i) turns.push_back(random.rotation(3.1));
  for (const Quaternion& turn : turns) {
    const Pose X{{0.1, 0.2, 0.3}, normalized(turn)};
    const std::vector<double> matrix = test::matrix_of(X);
    const std::vector<float> single(matrix.begin(), matrix.end());
    for (const bool is_single : {false, true}) {
      const void* const from = is_single ? static_cast<const void*>(single.data()) : matrix.data();
      Pose got;
      ASSERT_TRUE(put_plain_poses({from, 1, true, is_single}, &got.translation.x));
      const std::vector<double> back = test::matrix_of(got);
      for (std::size_t k = 0; k < 16; ++k)
        EXPECT_NEAR(back[k], matrix[k], is_single ? 2e-7 : 1e-14);
    }
  }
  std::vector<double> mirror = test::matrix_of({});
  mirror[0] = -1;
  Pose none;
  ASSERT_TRUE(put_plain_poses({mirror.data(), 1, true}, &none.translation.x));
  EXPECT_FALSE(is_finite(none));
}

TEST(SinglePoseGradientsTest, AreRounded) {
  PosesOfSprings<float> single(20, false, 6);
  PosesOfSprings<double> whole(20, false, 6);
  for (const bool is_second : {false, true}) {
    ASSERT_TRUE(put_pose_gradients(single.job(is_second)));
    ASSERT_TRUE(put_pose_gradients(whole.job(is_second)));
    for (std::size_t k = 0; k < whole.to.size(); ++k) {
      EXPECT_NEAR(single.to[k], whole.to[k], 2e-6 * (1 + std::abs(whole.to[k])));
    }
  }
}

}  // namespace
}  // namespace palpate
