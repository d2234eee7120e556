// Robots of many links: placed by vectors, and searched together, against one link after the other
// and every pixel in double.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "src/contact/internal/clearance_slack.h"
#include "src/robot/robot_poses.h"
#include "tests/test_util/clearance_truth.h"
#include "tests/test_util/hull_scenes.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr int kNumLinks = 14;

/// A chain of boxes that turn about x and y by turns. One is fixed, one slides, and one follows
/// another.
Robot chain() {
  std::string text = "<robot name=\"chain\"><link name=\"base\"/>";
  for (int i = 0; i < kNumLinks; ++i) {
    const std::string name = std::to_string(i), before = i > 0 ? std::to_string(i - 1) : "base";
    const char* const kind = i == 4 ? "fixed" : (i == 7 ? "prismatic" : "revolute");
    text += "<link name=\"" + name +
            "\"><collision><origin xyz=\"0 0 0.03\"/><geometry><box size=\"0.04 0.03 0.06\"/>"
            "</geometry></collision></link><joint name=\"j" +
            name + "\" type=\"" + kind + "\"><origin xyz=\"0.001 0 0.06\" rpy=\"0.1 0 0.2\"/>" +
            "<parent link=\"" + before + "\"/><child link=\"" + name + "\"/><axis xyz=\"" +
            (i % 2 == 0 ? "1 0 0.3" : "0 1 0") + "\"/><limit lower=\"-0.5\" upper=\"0.6\"/>" +
            (i == 9 ? "<mimic joint=\"j3\" multiplier=\"0.7\" offset=\"0.05\"/>" : "") + "</joint>";
  }
  return Robot::from_urdf(text + "</robot>", "chain.urdf").value();
}

std::vector<double> random_joints(const Robot& robot, test::Random& random, std::size_t num) {
  std::vector<double> joints(num * robot.joints().size());
  for (double& joint : joints) joint = random.uniform(-0.7, 0.7);  // some are held
  return joints;
}

TEST(RobotLinks, Have_the_places_of_the_model_to_the_bit) {
  const Robot robot = chain();
  const Robot::Data& data = robot.data();
  test::Random random(3);
  constexpr std::size_t kNum = 21;
  const std::size_t n = robot.joints().size();
  ASSERT_EQ(n, kNumLinks - 2u);
  const std::vector<double> joints = random_joints(robot, random, kNum);
  const Pose X_WB{{0.1, -0.2, 0.4}, random.rotation(2)};
  for (const Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
    RobotPlaces places(isa);
    places.resize(data, kNum);
    std::vector<Pose> X_WL(kNum * kNumLinks);
    for (std::size_t block = 0; block < places.num_blocks(); ++block) {
      places.place(data, block, joints, X_WB, X_WL);
    }
    for (std::size_t i = 0; i < kNum; ++i) {
      std::vector<double> positions(data.model.joints.size());
      bool is_held = false;
      for (std::size_t j = 0; j < n; ++j) {
        const double given = joints[i * n + j];
        double& position = positions[data.moved[j]];
        position = std::clamp(given, robot.joints()[j].lower, robot.joints()[j].upper);
        is_held = is_held || position != given;
      }
      std::vector<Pose> X_BL(data.model.links.size());
      data.model.place(positions, X_BL);
      EXPECT_EQ(places.held(i) != 0, is_held);
      for (std::size_t link = 0; link < X_BL.size(); ++link) {
        EXPECT_EQ(places.X_BL(i, link), X_BL[link]);
      }
      for (std::size_t l = 0; l < kNumLinks; ++l) {
        EXPECT_EQ(X_WL[i * kNumLinks + l], X_WB * X_BL[data.limbs[l].link]);
      }
    }
  }
}

TEST(RobotLinks, Are_as_clear_as_every_pixel_says_together_and_apart) {
  test::Random random(5);
  const Robot robot = chain();
  const std::size_t n = robot.joints().size();
  constexpr std::size_t kNum = 23;  // several screens
  constexpr double kLimit = 0.2;
  int num_near = 0, num_deep = 0, num_far = 0;
  for (const DepthFieldOptions& field :
       {DepthFieldOptions{}, DepthFieldOptions{.unseen = UnseenSpace::free, .thickness = 0.05}}) {
    const test::HullScene seen = test::rough_scene(1, field, random);
    const Scene scene{.surfaces = {seen.views[0].to}};
    const test::SolidScene truth(scene.surfaces);
    const std::vector<double> joints = random_joints(robot, random, kNum);
    const Pose X_WB{{-0.3, 0.1, 0.3}, random.rotation(0.5)};
    std::vector<double> least(kNum), by_joint(kNum * n), each(kNum * kNumLinks);
    std::vector<double> each_by_joint(kNum * kNumLinks * n);
    std::vector<std::int32_t> link(kNum);
    RobotAnswers of_least, of_each;
    of_least.clearance = least.data();
    of_least.clearance_by_joint = by_joint.data();
    of_least.link = link.data();
    of_each.link_clearance = each.data();
    of_each.link_clearance_by_joint = each_by_joint.data();
    of_least.clearance_limit = of_each.clearance_limit = kLimit;
    std::vector<Pose> X_WL(kNumLinks);
    for (const int num_threads : {1, 3}) {
      const RobotContact contact = RobotContact::create(robot, Place::cpu(), num_threads).value();
      ASSERT_TRUE(contact.measure(scene, {joints, X_WB}, of_least));
      ASSERT_TRUE(contact.measure(scene, {joints, X_WB}, of_each));
      for (std::size_t i = 0; i < kNum; ++i) {
        const double* const here = &each[i * kNumLinks];
        const auto nearest = std::min_element(here, here + kNumLinks) - here;
        EXPECT_EQ(least[i], here[nearest]);
        num_far += least[i] == kLimit;
        num_deep += least[i] == -kLimit;
        if (least[i] == kLimit) {
          EXPECT_EQ(link[i], -1);
          continue;
        }
        if (least[i] == -kLimit) {  // one of them
          ASSERT_GE(link[i], 0);
          EXPECT_EQ(here[link[i]], -kLimit);
          continue;
        }
        ++num_near;
        EXPECT_EQ(link[i], nearest);
        const std::size_t from = i * kNumLinks + static_cast<std::size_t>(nearest);
        EXPECT_TRUE(std::equal(&by_joint[i * n], &by_joint[i * n] + n, &each_by_joint[from * n]));
      }
      // The same bits whatever else is asked.
      const std::vector<double> least_before = least;
      const std::vector<std::int32_t> link_before = link;
      ASSERT_TRUE(contact.measure(scene, {std::span(joints).subspan(3 * n), X_WB}, of_least));
      EXPECT_TRUE(std::equal(least_before.begin() + 3, least_before.end(), least.begin()));
      EXPECT_TRUE(std::equal(link_before.begin() + 3, link_before.end(), link.begin()));
      least = least_before;
      for (const double margin : {-0.02, 0.0, 0.03}) {
        std::vector<std::uint8_t> hits(kNum);
        ASSERT_TRUE(contact.any(scene, {joints, X_WB}, margin, hits.data()));
        for (std::size_t i = 0; i < kNum; ++i) EXPECT_EQ(hits[i] != 0, least[i] < margin);
      }
    }
    for (std::size_t i = 0; i < kNum; ++i) {
      ASSERT_TRUE(robot.place(std::span(joints).subspan(i * n, n), X_WB, X_WL));
      for (std::size_t l = 0; l < kNumLinks; ++l) {
        const double want = truth.clearance(robot.tool(l), X_WL[l], kLimit);
        const double slack = clearance_slack(scene, X_WL[l].translation, kLimit + 0.1);
        EXPECT_NEAR(each[i * kNumLinks + l], want, slack) << i << " " << l;
      }
    }
  }
  EXPECT_GT(num_near, 20);
  EXPECT_GT(num_far + num_deep, 4);
}

TEST(RobotLinks, Are_placed_by_a_base_whose_quaternion_has_any_length) {
  test::Random random(7);
  const Robot robot = chain();
  const std::size_t n = robot.joints().size();
  constexpr std::size_t kNum = 5;
  const std::vector<double> joints = random_joints(robot, random, kNum);
  const test::HullScene seen = test::rough_scene(1, {}, random);
  const Scene scene{.surfaces = {seen.views[0].to}};
  const RobotContact contact = RobotContact::create(robot, Place::cpu(), 1).value();
  const Pose X_WB{{-0.3, 0.1, 0.3}, random.rotation(0.5)};
  Pose longer = X_WB;
  longer.rotation = {2 * X_WB.rotation.x, 2 * X_WB.rotation.y, 2 * X_WB.rotation.z,
                     2 * X_WB.rotation.w};
  std::vector<double> clearance(kNum), again(kNum);
  RobotAnswers to;
  to.clearance = clearance.data();
  ASSERT_TRUE(contact.measure(scene, {joints, X_WB}, to));
  to.clearance = again.data();
  ASSERT_TRUE(contact.measure(scene, {joints, longer}, to));
  std::vector<Pose> X_WL(kNumLinks), by_longer(kNumLinks);
  for (std::size_t i = 0; i < kNum; ++i) {
    EXPECT_NEAR(again[i], clearance[i], 1e-6);
    ASSERT_TRUE(robot.place(std::span(joints).subspan(i * n, n), X_WB, X_WL));
    ASSERT_TRUE(robot.place(std::span(joints).subspan(i * n, n), longer, by_longer));
    for (std::size_t l = 0; l < kNumLinks; ++l) {
      EXPECT_LT(norm(by_longer[l].translation - X_WL[l].translation), 1e-12);
    }
  }
}

}  // namespace
}  // namespace palpate
