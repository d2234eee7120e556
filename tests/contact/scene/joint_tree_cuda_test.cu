// Configurations of an arm on the GPU, whose links are placed there, against links that are placed
// and measured on the CPU.
#include "src/contact/internal/joint_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "src/gpu/internal/runtime.h"
#include "tests/test_util/arm_tree.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/gpu.h"
#include "tests/test_util/gpu_scenes.h"
#include "tests/test_util/hull_scenes.h"

namespace palpate {
namespace {

using test::ArmTree;
using test::Random;

/// The base stands below the middle of the view, its z axis along the cameras'.
const Pose kBase{{0.05, 0.1, 0.25}, axis_angle({0.3, 1, 0.2}, 0.4)};
constexpr double kLimit = 0.1;

struct ArmRig {
  ArmTree arm = test::arm_tree(0.025);
  std::vector<const Tool*> tools = arm.pointers();
  SceneContact cpu = SceneContact::create(tools, FieldMethod{}, Place::cpu(), 1).value();
  SceneContact gpu = test::scenes_on_gpu(tools);
};

/// The answers of the CPU by the poses of all links.
struct Truth {
  std::vector<double> clearance, by_joint;
  std::vector<std::int32_t> link, decided;
};

/// The derivative by a joint of what a link moves with `gradient`, by differences of its poses.
double slope(const ArmTree& arm, std::vector<double> q, std::size_t j, std::size_t link,
             const double* gradient) {
  constexpr double kStep = 1e-5;
  Pose X[2];
  for (const int side : {0, 1}) {
    std::vector<double> there = q;
    there[j] += side == 0 ? -kStep : kStep;
    X[side] = arm.placed(kBase, there.data())[link];
  }
  const Vec3d C = arm.tools[link].sphere_mass().center_of_mass;
  const Vec3d moved = (X[1] * C - X[0] * C) / (2 * kStep);
  const Quaternion turn = X[1].rotation * conjugate(X[0].rotation);
  const Vec3d turned = Vec3d{turn.x, turn.y, turn.z} * ((turn.w < 0 ? -2 : 2) / (2 * kStep));
  return dot(moved, {gradient[0], gradient[1], gradient[2]}) +
         dot(turned, {gradient[3], gradient[4], gradient[5]});
}

Truth truth(const ArmRig& rig, const Scene& scene, const std::vector<double>& positions) {
  const std::size_t n = rig.arm.num_positions(), num_links = rig.tools.size();
  Truth made;
  for (std::size_t i = 0; i < positions.size() / n; ++i) {
    const std::vector<double> q(positions.begin() + static_cast<std::ptrdiff_t>(i * n),
                                positions.begin() + static_cast<std::ptrdiff_t>((i + 1) * n));
    const std::vector<Pose> X_WT = rig.arm.placed(kBase, q.data());
    std::vector<std::int32_t> numbers, nearest(num_links), decided(num_links);
    for (std::size_t l = 0; l < num_links; ++l) numbers.push_back(static_cast<std::int32_t>(l));
    std::vector<double> clearance(num_links), gradient(6 * num_links);
    SceneAnswers to;
    to.clearance = clearance.data();
    to.nearest = nearest.data();
    to.decided = decided.data();
    to.clearance_gradient = gradient.data();
    to.clearance_limit = kLimit;
    EXPECT_TRUE(rig.cpu.measure(scene, {X_WT, numbers}, to));
    const auto least =
        static_cast<std::size_t>(std::ranges::min_element(clearance) - clearance.begin());
    made.clearance.push_back(clearance[least]);
    made.decided.push_back(decided[least]);
    made.link.push_back(nearest[least] >= 0 ? static_cast<std::int32_t>(least) : -1);
    for (std::size_t j = 0; j < n; ++j) {
      made.by_joint.push_back(
          nearest[least] < 0 ? 0 : slope(rig.arm, q, j, least, gradient.data() + 6 * least));
    }
  }
  return made;
}

/// Positions within their ranges by more than the step of differences.
std::vector<double> inner_positions(const ArmTree& arm, std::size_t num, Random& random) {
  std::vector<double> positions = arm.random_positions(num, random);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const JointRange& range = arm.tree->ranges[i % arm.num_positions()];
    positions[i] = std::clamp(positions[i], range.lower + 1e-3, range.upper - 1e-3);
  }
  return positions;
}

/// Returns how many configurations are near to cameras, to bodies, and inside.
std::array<int, 3> compare(const ArmRig& rig, const Scene& scene,
                           const std::vector<double>& positions) {
  const std::size_t n = rig.arm.num_positions(), num = positions.size() / n;
  const Truth want = truth(rig, scene, positions);
  std::vector<double> clearance(num), by_joint(num * n);
  std::vector<std::int32_t> link(num);
  std::vector<std::uint8_t> hits(num), held(num, 7);
  JointPoses poses{rig.arm.tree, kBase, positions};
  const auto refused =
      measure_tree(rig.gpu, scene, poses,
                   {clearance.data(), link.data(), by_joint.data(), held.data(), nullptr, kLimit});
  EXPECT_TRUE(refused) << refused.error().message;
  EXPECT_FALSE(*refused);
  EXPECT_EQ(std::ranges::count(held, 0), static_cast<std::ptrdiff_t>(num));
  std::array<int, 3> found{};
  for (std::size_t i = 0; i < num; ++i) {
    SCOPED_TRACE(i);
    EXPECT_NEAR(clearance[i], want.clearance[i], 1e-6);
    if (want.clearance[i] == -kLimit) {
      EXPECT_GE(link[i], 0);  // one of those that are deeper than the limit
    } else {
      EXPECT_EQ(link[i], want.link[i]);
    }
    for (std::size_t j = 0; j < n; ++j) {
      EXPECT_NEAR(by_joint[i * n + j], want.by_joint[i * n + j], 2e-5);
    }
    const auto num_cameras = static_cast<std::int32_t>(scene.surfaces.size());
    found[0] += want.decided[i] >= 0 && want.decided[i] < num_cameras;
    found[1] += want.decided[i] >= num_cameras;
    found[2] += want.link[i] >= 0 && want.clearance[i] < 0;
  }
  for (const double margin : {0.0, 0.02, -0.01}) {
    EXPECT_TRUE(measure_tree(rig.gpu, scene, poses, {.hits = hits.data(), .limit = margin}));
    for (std::size_t i = 0; i < num; ++i) {
      if (std::abs(want.clearance[i] - margin) < 1e-6) continue;
      EXPECT_EQ(hits[i] != 0, want.clearance[i] < margin) << i << ", margin " << margin;
    }
  }
  return found;
}

std::vector<SurfaceView> surfaces_of(const test::HullScene& scene) {
  std::vector<SurfaceView> surfaces;
  for (const SurfaceBlend& view : scene.views) surfaces.push_back(view.to);
  return surfaces;
}

TEST(JointTreeCuda, OneCameraAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  Random random(61);
  const ArmRig rig;
  std::array<int, 3> all{};
  for (const DepthFieldOptions& options :
       {DepthFieldOptions{}, DepthFieldOptions{.unseen = UnseenSpace::free, .thickness = 0.03}}) {
    const test::HullScene seen = test::rough_scene(1, options, random);
    const auto found =
        compare(rig, {.surfaces = surfaces_of(seen)}, inner_positions(rig.arm, 40, random));
    for (std::size_t k = 0; k < 3; ++k) all[k] += found[k];
  }
  EXPECT_GT(all[0], 10);
  EXPECT_GT(all[2], 2);
}

TEST(JointTreeCuda, ThreeCamerasAndABodyAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  Random random(62);
  const ArmRig rig;
  const test::HullScene seen = test::rough_scene(3, {}, random);
  const Tool shape =
      Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 50}).value().with_solid_field();
  const Body body(shape, {{0.3, 0.2, 0.6}, {}});
  const Scene scene{.surfaces = surfaces_of(seen), .bodies = {body, body.at({{-0.3, 0, 0.4}, {}})}};
  const std::vector<double> positions = inner_positions(rig.arm, 24, random);
  const auto found = compare(rig, scene, positions);
  EXPECT_GT(found[0], 3);
  EXPECT_GT(compare(rig, {.bodies = scene.bodies}, positions)[1], 3);
}

// Four are on the GPU at a time here.
TEST(JointTreeCuda, AnswersAreTheSameBitsInAnyMemoryAndBatch) {
  PALPATE_GPU_OR_SKIP();
  Random random(63);
  const ArmRig rig;
  const SceneContact few = test::scenes_on_gpu<2>(rig.tools);
  const test::HullScene seen = test::rough_scene(1, {}, random);
  const Scene scene{.surfaces = surfaces_of(seen)};
  const std::size_t n = rig.arm.num_positions(), num = 9;
  std::vector<double> positions = inner_positions(rig.arm, num, random);
  struct Answers {
    std::vector<double> clearance = std::vector<double>(num), by_joint;
    std::vector<std::int32_t> link = std::vector<std::int32_t>(num);
    std::vector<std::uint8_t> held = std::vector<std::uint8_t>(num), hits = held;
    bool operator==(const Answers&) const = default;
  };
  const auto measured = [&](const SceneContact& contact) {
    Answers a;
    a.by_joint.resize(num * n);
    const JointPoses poses{rig.arm.tree, kBase, positions};
    EXPECT_TRUE(measure_tree(
        contact, scene, poses,
        {a.clearance.data(), a.link.data(), a.by_joint.data(), a.held.data(), nullptr, kLimit}));
    EXPECT_TRUE(measure_tree(contact, scene, poses, {.hits = a.hits.data(), .limit = 0.02}));
    return a;
  };
  const Answers all = measured(rig.gpu);
  EXPECT_TRUE(all == measured(few));
  EXPECT_GT(std::ranges::count(all.hits, 1), 1);
  gpu::Memory memory(0);
  gpu::Stream stream(0, gpu::Priority::low);
  const JointPoses there{rig.arm.tree, kBase, {memory.copy_of(positions), num * n}, false, 0};
  TreeAnswers answers{.clearance = memory.take<double>(num),
                      .clearance_by_joint = memory.take<double>(num * n)};
  for (const SceneContact* const contact : {&rig.gpu, &few}) {
    ASSERT_TRUE(measure_tree(*contact, scene, there, answers));
    std::vector<double> clearance(num), by_joint(num * n);
    stream.copy(clearance.data(), answers.clearance, num * sizeof(double));
    stream.copy(by_joint.data(), answers.clearance_by_joint, num * n * sizeof(double));
    ASSERT_TRUE(stream.wait());
    EXPECT_EQ(clearance, all.clearance);
    EXPECT_EQ(by_joint, all.by_joint);
  }
  // The first of all that are refused is in the second four.
  positions[8 * n + 1] = positions[6 * n + 2] = std::numeric_limits<double>::quiet_NaN();
  std::vector<double> clearance(num);
  const auto refused =
      measure_tree(few, scene, {rig.arm.tree, kBase, positions}, {.clearance = clearance.data()});
  ASSERT_TRUE(refused && *refused);
  EXPECT_EQ((*refused)->number, 6 * n + 2);
}

TEST(JointTreeCuda, HoldsOrRefusesPositionsBeyondRanges) {
  PALPATE_GPU_OR_SKIP();
  Random random(64);
  const ArmRig rig;
  const test::HullScene seen = test::rough_scene(1, {}, random);
  const Scene scene{.surfaces = surfaces_of(seen)};
  const std::size_t n = rig.arm.num_positions(), num = 5;
  std::vector<double> positions = rig.arm.random_positions(num, random);
  positions[3 * n + 1] = 2;
  positions[4 * n + 7] = -1;
  std::vector<double> within = positions, clearance(num), want(num);
  within[3 * n + 1] = 1.7628;
  within[4 * n + 7] = 0;
  std::vector<std::uint8_t> held(num);
  JointPoses poses{rig.arm.tree, kBase, positions};
  const auto kept =
      measure_tree(rig.gpu, scene, poses, {.clearance = clearance.data(), .held = held.data()});
  ASSERT_TRUE(kept && !*kept);
  EXPECT_EQ(held, (std::vector<std::uint8_t>{0, 0, 0, 1, 1}));
  ASSERT_TRUE(
      measure_tree(rig.gpu, scene, {rig.arm.tree, kBase, within}, {.clearance = want.data()}));
  EXPECT_EQ(clearance, want);
  poses.refuses_beyond_ranges = true;
  const auto beyond = measure_tree(rig.gpu, scene, poses, {.clearance = clearance.data()});
  ASSERT_TRUE(beyond && *beyond);
  EXPECT_EQ((*beyond)->number, 3 * n + 1);
  EXPECT_EQ((*beyond)->value, 2);
  poses.refuses_beyond_ranges = false;
  positions[n + 2] = std::numeric_limits<double>::quiet_NaN();
  const auto no_number = measure_tree(rig.gpu, scene, poses, {.clearance = clearance.data()});
  ASSERT_TRUE(no_number && *no_number);
  EXPECT_EQ((*no_number)->number, n + 2);
  const auto on_cpu = measure_tree(rig.cpu, scene, poses, {.clearance = clearance.data()});
  ASSERT_FALSE(on_cpu);
  EXPECT_NE(on_cpu.error().message.find("on a GPU alone"), std::string::npos);
}

}  // namespace
}  // namespace palpate
