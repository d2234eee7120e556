// A robot on the GPU against the same robot on the CPU.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "src/gpu/internal/runtime.h"
#include "src/robot/robot_measures.h"
#include "tests/robot/robot_arm.h"
#include "tests/test_util/gpu.h"
#include "tests/test_util/gpu_scenes.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr std::size_t kNum = 24, kJoints = 3, kLinks = 4;

RobotContact on_gpu(const Robot& robot) {
  return RobotContactMaker::make(robot, test::scenes_on_gpu(tools_of(robot)), Place::cuda(0), 1);
}

struct Answered {
  std::vector<double> numbers = std::vector<double>(kNum * (3 + 2 * kJoints + kLinks * 10));
  std::vector<std::int32_t> link = std::vector<std::int32_t>(kNum);
  std::vector<std::uint8_t> held = std::vector<std::uint8_t>(kNum);
  RobotAnswers to;

  Answered() {
    double* at = numbers.data();
    const auto take = [&](std::size_t each) { return std::exchange(at, at + each * kNum); };
    to = {.clearance = take(1),
          .link = link.data(),
          .clearance_by_joint = take(kJoints),
          .link_clearance = take(kLinks),
          .link_clearance_by_joint = take(kLinks * kJoints),
          .volume = take(1),
          .wrench = take(kLinks * 6),
          .joint_torque = take(kJoints),
          .held = held.data()};
  }
};

TEST(RobotCuda, MeasuresAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const Robot robot = test::arm();
  const test::SeenWall wall(true);
  const RobotContact cpu = RobotContact::create(robot, Place::cpu(), 1).value();
  const RobotContact gpu = on_gpu(robot);
  test::Random random(9);
  std::vector<double> joints;
  for (std::size_t i = 0; i < kNum; ++i) {
    joints.insert(joints.end(), {random.uniform(-0.6, 0.6), random.uniform(-0.6, 0.6),
                                 random.uniform(-0.01, 0.029)});
  }
  const RobotPoses poses{joints, {{0.1, -0.2, 0.7}, axis_angle({1, 0, 0}, -kPi / 2)}};
  Answered want, got;
  ASSERT_TRUE(cpu.measure(wall.scene, poses, want.to));
  ASSERT_TRUE(gpu.measure(wall.scene, poses, got.to));
  EXPECT_EQ(got.held, want.held);
  int num_near = 0, num_touching = 0;
  for (std::size_t i = 0; i < kNum; ++i) {
    EXPECT_NEAR(got.to.clearance[i], want.to.clearance[i], 1e-6) << i;
    EXPECT_NEAR(got.to.volume[i], want.to.volume[i], 1e-8) << i;
    // Each of the links that are deeper than the limit may be named.
    if (want.to.clearance[i] > -kClearanceLimit) {
      EXPECT_EQ(got.link[i], want.link[i]) << i;
    } else {
      const auto link = static_cast<std::size_t>(got.link[i]);
      ASSERT_LT(link, kLinks) << i;
      EXPECT_EQ(want.to.link_clearance[i * kLinks + link], -kClearanceLimit) << i;
    }
    num_near += want.link[i] >= 0;
    num_touching += want.to.volume[i] > 0;
  }
  EXPECT_GT(num_near, 8);
  EXPECT_GT(num_touching, 4);
  for (std::size_t k = 0; k < kNum * kJoints; ++k) {
    EXPECT_NEAR(got.to.clearance_by_joint[k], want.to.clearance_by_joint[k], 1e-5) << k;
    EXPECT_NEAR(got.to.joint_torque[k], want.to.joint_torque[k], 1e-8) << k;
  }
  for (std::size_t k = 0; k < kNum * kLinks; ++k) {
    EXPECT_NEAR(got.to.link_clearance[k], want.to.link_clearance[k], 1e-6) << k;
  }
  std::vector<std::uint8_t> hits(kNum), others(kNum);
  ASSERT_TRUE(cpu.any(wall.scene, poses, 0.03, hits.data()));
  ASSERT_TRUE(gpu.any(wall.scene, poses, 0.03, others.data()));
  EXPECT_EQ(hits, others);
}

TEST(RobotCuda, RefusesAsTheCpuDoes) {
  PALPATE_GPU_OR_SKIP();
  const Robot robot = test::arm();
  const test::SeenWall wall;
  const RobotContact cpu = RobotContact::create(robot, Place::cpu(), 1).value();
  const RobotContact gpu = on_gpu(robot);
  std::vector<double> joints{0, 0, 0.01, 0, 0, 0.05};
  std::vector<double> clearance(2);
  RobotPoses poses{joints, {}, true};
  const std::string want = cpu.measure(wall.scene, poses, {}).error().message;
  EXPECT_NE(want.find("'finger' of configuration 1 is at 0.05"), std::string::npos) << want;
  // In the memory of a GPU they are looked at there.
  gpu::Memory memory(0);
  poses.joints = {memory.copy_of(joints), joints.size()};
  poses.gpu = 0;
  auto* const to = memory.take<double>(2);
  EXPECT_EQ(gpu.measure(wall.scene, poses, {.clearance = to}).error().message, want);
  poses.refuses_beyond_limits = false;
  EXPECT_TRUE(gpu.measure(wall.scene, poses, {.clearance = to}));
  for (const Status& status : {gpu.measure(wall.scene, poses, {.volume = to}),
                               cpu.measure(wall.scene, poses, {.clearance = to}),
                               gpu.free_motions(wall.scene, poses, joints, 0, nullptr)}) {
    ASSERT_FALSE(status);
    EXPECT_NE(status.error().message.find("host memory"), std::string::npos);
  }
}

}  // namespace
}  // namespace palpate
