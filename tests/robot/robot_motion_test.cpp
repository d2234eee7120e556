// Motions that are proved free have no blocked sample.
#include <gtest/gtest.h>

#include "tests/robot/robot_arm.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

TEST(RobotMotion, Proved_motions_have_no_blocked_sample) {
  const test::SeenWall wall(true);
  const Robot robot = test::arm();
  const RobotContact contact = RobotContact::create(robot, 2).value();
  const Pose X_WB{{-0.1, 0, 0.7}, axis_angle({1, 1, 0}, -1.2)};
  constexpr std::size_t kNum = 200, kSamples = 300;
  constexpr double kMargin = 0.01;
  test::Random random(2);
  std::vector<double> from, to;
  for (std::vector<double>* ends : {&from, &to}) {
    for (std::size_t i = 0; i < kNum; ++i) {
      ends->insert(ends->end(),
                   {random.uniform(-1, 1.5), random.uniform(-1.5, 1.5), random.uniform(0, 0.05)});
    }
  }
  std::vector<std::uint8_t> is_free(kNum), hits(kSamples);
  std::vector<double> until(kNum);
  ASSERT_TRUE(
      contact.free_motions(wall.scene, {from, X_WB}, to, kMargin, is_free.data(), until.data()));
  std::size_t num_free = 0, num_blocked = 0, num_open = 0;
  for (std::size_t i = 0; i < kNum; ++i) {
    std::vector<double> samples;
    const double share = is_free[i] != 0 ? 1 : until[i];
    for (std::size_t k = 0; k < kSamples; ++k) {
      for (std::size_t j = 0; j < 3; ++j) {
        const auto held = [&](double q) {
          return std::clamp(q, robot.joints()[j].lower, robot.joints()[j].upper);
        };
        const double a = held(from[3 * i + j]), b = held(to[3 * i + j]);
        samples.push_back(a + (b - a) * share * static_cast<double>(k) / (kSamples - 1));
      }
    }
    ASSERT_TRUE(contact.any(wall.scene, {samples, X_WB}, kMargin, hits.data()));
    const bool is_hit = std::ranges::count(hits, 1) > 0;
    if (is_free[i] != 0) {
      EXPECT_FALSE(is_hit) << i;
      EXPECT_EQ(until[i], 1);
      ++num_free;
      continue;
    }
    EXPECT_FALSE(until[i] > 0 && is_hit) << i << " until " << until[i];
    // Not proved means blocked somewhere, or near to it.
    samples.clear();
    for (std::size_t k = 0; k < kSamples; ++k) {
      for (std::size_t j = 0; j < 3; ++j) {
        samples.push_back(from[3 * i + j] + (to[3 * i + j] - from[3 * i + j]) *
                                                static_cast<double>(k) / (kSamples - 1));
      }
    }
    ASSERT_TRUE(contact.any(wall.scene, {samples, X_WB}, kMargin, hits.data()));
    num_blocked += std::ranges::count(hits, 1) > 0;
    ASSERT_TRUE(contact.any(wall.scene, {samples, X_WB}, kMargin + 0.012, hits.data()));
    num_open += std::ranges::count(hits, 1) == 0;
  }
  EXPECT_GT(num_free, 20u);
  EXPECT_GT(num_blocked, 20u);
  EXPECT_EQ(num_open, 0u);
}

TEST(RobotMotion, A_motion_that_stands_still_is_free_where_it_is_clear) {
  const test::SeenWall wall;
  const RobotContact contact = RobotContact::create(test::arm(), 1).value();
  const std::vector<double> joints{0, 0, 0, 0.1, 0.1, 0};
  std::uint8_t is_free[2] = {};
  const Pose clear{{0, 0, 0.3}, axis_angle({1, 0, 0}, -kPi / 2)}, inside{{0, 0, 1.2}, {}};
  ASSERT_TRUE(contact.free_motions(wall.scene, {joints, clear}, joints, 0, is_free));
  EXPECT_TRUE(is_free[0] && is_free[1]);
  ASSERT_TRUE(contact.free_motions(wall.scene, {joints, inside}, joints, 0, is_free));
  EXPECT_FALSE(is_free[0] || is_free[1]);
  EXPECT_FALSE(
      contact.free_motions(wall.scene, {joints, clear}, std::span(joints).first(3), 0, is_free));
}

}  // namespace
}  // namespace palpate
