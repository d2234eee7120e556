// Chains of frames against poses that are multiplied by hand.
#include "src/ros/tf_tree.h"

#include <gtest/gtest.h>

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
  tree.add({10, "arm", "tool", kArmTool});
  tree.add({0, "base", "camera", kBaseCamera});
  EXPECT_FALSE(tree.find("camera", "tool"));
  tree.add({20, "/base", "/arm", kBaseArm});  // with the slash of ROS 1
  const auto found = tree.find("camera", "tool");
  ASSERT_TRUE(found);
  expect_near(found->X_AB, inverse(kBaseCamera) * kBaseArm * kArmTool);
  EXPECT_EQ(found->time, 10);
  expect_near(tree.find("tool", "camera")->X_AB, inverse(found->X_AB));
  expect_near(tree.find("base", "tool")->X_AB, kBaseArm * kArmTool);
  expect_near(tree.find("tool", "arm")->X_AB, inverse(kArmTool));
  expect_near(tree.find("tool", "tool")->X_AB, {});
}

TEST(TfTree, follows_what_moves) {
  TfTree tree;
  tree.add({1, "base", "arm", kBaseArm});
  tree.add({2, "base", "arm", kArmTool});
  expect_near(tree.find("base", "arm")->X_AB, kArmTool);
}

TEST(TfTree, comes_to_an_end_in_a_ring) {
  TfTree tree;
  tree.add({1, "a", "b", {}});
  tree.add({1, "b", "a", {}});
  EXPECT_FALSE(tree.find("a", "c"));
  EXPECT_FALSE(tree.find("c", "a"));
}

}  // namespace
}  // namespace palpate
