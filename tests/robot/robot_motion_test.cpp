// Motions that are proved free have no blocked sample.
#include <gtest/gtest.h>

#include "src/robot/robot_data.h"
#include "tests/robot/robot_arm.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

TEST(RobotMotion, Proved_motions_have_no_blocked_sample) {
  const test::SeenWall wall(true);
  const Robot robot = test::arm();
  const RobotContact contact = RobotContact::create(robot, Place::cpu(), 2).value();
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
  const RobotContact contact = RobotContact::create(test::arm(), Place::cpu(), 1).value();
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

/// A rod on an arm that turns about x, held 0.3 m out by a joint that follows another one.
std::string rod_urdf(const std::string& followed, const std::string& mimic) {
  return R"(<robot name="rod"><link name="base"/><link name="car"/><link name="arm"/>
    <link name="rod"><collision><geometry><box size="0.04 0.04 0.06"/></geometry></collision></link>
    <joint name="ride" type="prismatic"><parent link="base"/><child link="car"/><axis xyz="1 0 0"/>)" +
         followed + R"(
    <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="1 0 0"/>
      <limit lower="-2" upper="2"/></joint>
    <joint name="out" type="prismatic"><parent link="arm"/><child link="rod"/><axis xyz="0 0 1"/>)" +
         mimic + "</joint></robot>";
}

TEST(RobotMotion, Joints_that_follow_what_never_moves_them_reach_as_far_as_they_stand) {
  const test::SeenWall wall;
  const Pose X_WB{{0, -0.25, 0.8}, axis_angle({1, 0, 0}, -kPi / 2)};  // the rod lies along y
  const std::string bolt =  // limits that take 0.3 m back, would they count
      R"(<limit lower="-0.31" upper="-0.29"/></joint><link name="nut"/>
        <joint name="bolt" type="fixed"><parent link="base"/><child link="nut"/></joint>)";
  for (const std::string& urdf :
       {rod_urdf("</joint>", R"(<mimic joint="ride" multiplier="0" offset="0.3"/>)"),
        rod_urdf(bolt, R"(<mimic joint="bolt" offset="0.3"/>)")}) {
    const Robot robot = Robot::from_urdf(urdf, "rod.urdf").value();
    double reach = 0;  // from the axis x
    for (const Sphere& s : robot.tool(0).spheres()) {
      const Vec3d c = to_double(s.center);
      reach = std::max(reach, std::hypot(c.y, c.z + 0.3) + static_cast<double>(s.radius));
    }
    const RobotLimb& limb = robot.data().limbs[0];
    double turning = 0;
    for (const RobotLimb::Mover& mover : limb.movers) {
      if (robot.joints()[mover.moved].turns) turning = mover.reach;
    }
    EXPECT_GE(turning, reach);
    EXPECT_LE(turning, reach + limb.radius);
    const RobotContact contact = RobotContact::create(robot, Place::cpu(), 1).value();
    const std::vector<double> from{-0.3, 0, -0.3, 0}, to{-0.3, 1.2, -0.3, 0.2};
    std::uint8_t is_free[2] = {}, hits[300];
    double until[2] = {};
    ASSERT_TRUE(contact.free_motions(wall.scene, {from, X_WB}, to, 0, is_free, until));
    EXPECT_EQ(is_free[0], 0);  // into the wall
    EXPECT_EQ(is_free[1], 1);
    EXPECT_GT(until[0], 0.1);
    std::vector<double> samples;
    for (int k = 0; k < 300; ++k) samples.insert(samples.end(), {-0.3, 1.2 * until[0] * k / 299});
    ASSERT_TRUE(contact.any(wall.scene, {samples, X_WB}, 0, hits));
    EXPECT_EQ(std::ranges::count(hits, 1), 0);
    const std::vector<double> away{0.5, 0};  // of the car, which has no shape
    ASSERT_TRUE(
        contact.free_motions(wall.scene, {std::span(from).first(2), X_WB}, away, 0, is_free));
    EXPECT_EQ(is_free[0], 1);
  }
  // A rod that may slide out without limits has no bound when it turns, but one when it slides.
  const Robot robot =
      Robot::from_urdf(rod_urdf("</joint>", R"(<mimic joint="ride" offset="0.3"/>)"), "rod.urdf")
          .value();
  const RobotContact contact = RobotContact::create(robot, Place::cpu(), 1).value();
  const std::vector<double> from{0, 0, 0, 0}, to{0, 0.2, 0.05, 0};
  std::uint8_t is_free[2] = {};
  ASSERT_TRUE(contact.free_motions(wall.scene, {from, X_WB}, to, 0, is_free));
  EXPECT_EQ(is_free[0], 0);
  EXPECT_EQ(is_free[1], 1);
}

TEST(RobotMotion, What_cannot_be_proved_is_refused) {
  test::SeenWall wall;
  const RobotContact contact = RobotContact::create(test::arm(), Place::cpu(), 1).value();
  const std::vector<double> joints{0, 0, 0};
  std::vector<double> ends = joints;
  const Pose clear{{0, 0, 0.3}, axis_angle({1, 0, 0}, -kPi / 2)};
  std::uint8_t is_free = 1;
  const auto told = [&](double margin) {
    const Status status = contact.free_motions(wall.scene, {joints, clear}, ends, margin, &is_free);
    return status ? std::string() : status.error().message;
  };
  const auto has = [](const std::string& text, const char* part) {
    return text.find(part) != std::string::npos;
  };
  EXPECT_EQ(told(0), "");
  for (const double margin : {-1e-3, static_cast<double>(NAN), HUGE_VAL}) {
    EXPECT_TRUE(has(told(margin), "margin of 0 m or more")) << margin;
  }
  ends[1] = 99;
  EXPECT_EQ(told(0), "");
  ends[1] = 9e5;  // of the elbow, which is endless
  EXPECT_TRUE(has(told(0), "motion 0 moves a joint by more than 100 rad"));
  ends[1] = 0;
  const Tool shape = Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 20}).value();
  wall.scene.bodies.emplace_back(shape, Pose{{0, 0, 5}, {}});
  EXPECT_TRUE(has(told(0), "CAD bodies"));
}

}  // namespace
}  // namespace palpate
