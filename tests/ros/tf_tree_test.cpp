// Chains of frames against poses that are multiplied by hand.
#include "src/ros/internal/tf_tree.h"

#include <gtest/gtest.h>

#include <limits>
#include <utility>

#include "src/ros/internal/tf_history.h"

namespace palpate {
namespace {

const Pose kBaseArm{{1, 2, 3}, normalized(Quaternion{0.1, 0.2, 0.3, 0.9})};
const Pose kArmTool{{0, 0, 0.5}, normalized(Quaternion{0.5, 0, 0, 0.8})};
const Pose kBaseCamera{{-1, 0, 1}, normalized(Quaternion{0, 0.7, 0, 0.7})};

void expect_near(const Pose& a, const Pose& b) {
  EXPECT_NEAR(norm(a.translation - b.translation), 0, 1e-12);
  const Quaternion turn = conjugate(a.rotation) * b.rotation;
  EXPECT_NEAR(std::abs(turn.w), 1, 1e-12);
}

TEST(TfTree, joins_frames_over_their_common_parent) {
  TfTree tree;
  EXPECT_FALSE(tree.find("camera", "tool"));
  tree.add({0, "arm", "tool", kArmTool}, false, 10);
  tree.add({0, "base", "camera", kBaseCamera}, true, 1);
  EXPECT_FALSE(tree.find("camera", "tool"));
  tree.add({0, "/base", "/arm", kBaseArm}, false, 20);  // with the slash of ROS 1
  const auto found = tree.find("camera", "tool");
  ASSERT_TRUE(found);
  expect_near(found->X_AB, inverse(kBaseCamera) * kBaseArm * kArmTool);
  expect_near(tree.find("tool", "camera")->X_AB, inverse(found->X_AB));
  expect_near(tree.find("base", "tool")->X_AB, kBaseArm * kArmTool);
  expect_near(tree.find("tool", "arm")->X_AB, inverse(kArmTool));
  expect_near(tree.find("tool", "tool")->X_AB, {});
}

TEST(TfTree, follows_what_moves) {
  TfTree tree;
  tree.add({1, "base", "arm", kBaseArm}, false, 1);
  tree.add({2, "base", "arm", kArmTool}, false, 2);
  expect_near(tree.find("base", "arm")->X_AB, kArmTool);
  tree.clear();
  EXPECT_FALSE(tree.find("base", "arm"));
}

TEST(TfTree, a_pose_is_as_old_as_the_oldest_of_its_moving_parts) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  TfTree tree;
  const auto times = [&] {
    const auto found = tree.find("camera", "tool");
    return std::pair(found->oldest, found->newest);
  };
  tree.add({0, "flange", "tool", kArmTool}, true, 1);
  tree.add({0, "base", "camera", kBaseCamera}, true, 1);
  tree.add({0, "base", "flange", kBaseArm}, true, 2);
  EXPECT_EQ(times(), std::pair(kInf, -kInf));
  tree.add({0, "base", "arm", kBaseArm}, false, 3);
  tree.add({0, "arm", "flange", kBaseArm}, false, 4);
  EXPECT_EQ(times(), std::pair(3.0, 4.0));
  tree.add({0, "arm", "flange", kBaseArm}, false, 5);
  EXPECT_EQ(times(), std::pair(3.0, 5.0));
  tree.add({0, "odom", "base", kBaseArm}, false, 6);  // of others
  EXPECT_EQ(times(), std::pair(3.0, 5.0));
  tree.add({0, "base", "camera", kBaseCamera}, false, 2);
  EXPECT_EQ(times(), std::pair(2.0, 5.0));
}

TEST(TfTree, comes_to_an_end_in_a_ring) {
  TfTree tree;
  tree.add({1, "a", "b", {}}, false, 1);
  tree.add({1, "b", "a", {}}, false, 1);
  EXPECT_FALSE(tree.find("a", "c"));
  EXPECT_FALSE(tree.find("c", "a"));
}

TEST(TfHistory, knows_where_frames_were) {
  TfHistory history;
  // Out of order, and twice.
  history.add({12, "base", "arm", {{0.2, 0, 0}, {}}}, false);
  history.add({10, "base", "arm", {}}, false);
  history.add({12, "base", "arm", {{0.2, 0, 0}, {}}}, false);
  history.add({0, "/arm", "camera", kArmTool}, true);
  history.add({3, "world", "base", kBaseArm}, true);
  expect_near(*history.find("world", "camera", 11), kBaseArm * Pose{{0.1, 0, 0}, {}} * kArmTool);
  expect_near(*history.find("camera", "world", 10.5),
              inverse(kBaseArm * Pose{{0.05, 0, 0}, {}} * kArmTool));
  expect_near(*history.find("arm", "camera", 1e9), kArmTool);
  expect_near(*history.find("world", "camera", 12), kBaseArm * Pose{{0.2, 0, 0}, {}} * kArmTool);
  expect_near(*history.find("world", "camera", 10), kBaseArm * kArmTool);
  EXPECT_FALSE(history.find("world", "camera", 12.001));  // nothing goes on
  EXPECT_FALSE(history.find("world", "camera", 9.999));
  EXPECT_FALSE(history.find("world", "camera", 11, 0.9));  // too long a gap
  EXPECT_FALSE(history.find("world", "gripper", 11));
  EXPECT_TRUE(history.is_moving("world", "camera"));
  EXPECT_FALSE(history.is_moving("world", "base"));
  EXPECT_EQ(history.known_until("world", "camera"), 12);
  EXPECT_EQ(history.known_until("world", "base"), std::numeric_limits<double>::infinity());
  EXPECT_LT(history.known_until("world", "gripper"), 0);
  EXPECT_EQ(history.frames(), (std::vector<std::string>{"arm", "base", "camera", "world"}));
  history.add({0, "camera", "world", {}}, true);  // a ring
  (void)history.find("world", "arm", 11);
}

TEST(TfHistory, knows_who_carried_a_frame_when) {
  // A cup stands on a table, is carried by an arm, and stands on the table again.
  const Pose table_cup{{1, 0, 0}, {}}, arm_cup{{0, 0, 0.1}, {}}, there{{2, 0, 0}, {}};
  for (const double kept : {5.0, std::numeric_limits<double>::infinity()}) {
    TfHistory history(kept);
    const auto arm = [](double time) { return Pose{{time, 5, 0}, {}}; };
    for (const double time : {10.0, 11.0, 12.0, 13.0}) {
      history.add({time, "table", "arm", arm(time)}, false);
    }
    for (const double time : {10.0, 11.0}) history.add({time, "table", "cup", table_cup}, false);
    for (const double time : {11.2, 12.2}) history.add({time, "arm", "cup", arm_cup}, false);
    history.add({12.5, "table", "cup", there}, false);
    expect_near(*history.find("table", "cup", 10.5), table_cup);
    expect_near(*history.find("table", "cup", 11), table_cup);
    expect_near(*history.find("table", "cup", 11.1), table_cup);  // nobody told of the arm yet
    expect_near(*history.find("table", "cup", 11.2), arm(11.2) * arm_cup);
    expect_near(*history.find("cup", "table", 11.75), inverse(arm(11.75) * arm_cup));
    expect_near(*history.find("table", "cup", 12.4), arm(12.4) * arm_cup);
    expect_near(*history.find("table", "cup", 12.5), there);
    EXPECT_FALSE(history.find("table", "cup", 12.6));
    EXPECT_EQ(history.known_until("table", "cup"), 12.5);
    EXPECT_EQ(history.known_until("arm", "cup", 11.5), 12.5);
    EXPECT_TRUE(history.is_moving("table", "cup"));
    EXPECT_TRUE(history.are_joined("table", "cup"));
    EXPECT_FALSE(history.are_joined("saucer", "cup"));
    EXPECT_EQ(history.frames(), (std::vector<std::string>{"arm", "cup", "table"}));
  }
}

TEST(TfHistory, forgets_what_is_old) {
  TfHistory history(2);
  for (int i = 0; i <= 1000; ++i) {
    const double time = 0.01 * i;
    history.add({time, "base", "arm", {{time, 0, 0}, {}}}, false);
  }
  EXPECT_FALSE(history.find("base", "arm", 4));
  for (const double time : {8.0, 8.005, 9.123, 10.0}) {
    EXPECT_NEAR(history.find("base", "arm", time)->translation.x, time, 1e-9);
  }
  EXPECT_EQ(history.known_until("arm", "base"), 10);
  history.add({1, "base", "arm", {}}, false);  // its clock has started anew
  EXPECT_EQ(history.known_until("arm", "base"), 1);
}

}  // namespace
}  // namespace palpate
