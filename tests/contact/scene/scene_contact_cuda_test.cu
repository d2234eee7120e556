// Scenes on the GPU: contact, clearance and yes or no against the CPU.
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/contact/scene/answered_scene.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::Answered;
using test::Both;
using test::HullScene;
using test::Random;
using test::surfaces_of;

/// The number of poses with a clearance by cameras and by bodies.
struct Compared {
  int by_cameras = 0, by_bodies = 0, inside = 0, touching = 0, softened = 0;
};

Compared compare(const Both& both, const Scene& scene, const ScenePoses& poses, double volume,
                 bool has_unseen, double reach = 0.1) {
  const std::size_t num = poses.X_WT.size(), num_spheres = both.cpu.max_spheres();
  const auto num_groups = static_cast<std::size_t>(poses.num_groups);
  Answered want(num, num_spheres, num_groups), got(num, num_spheres, num_groups);
  if (!has_unseen) want.answers.unseen = got.answers.unseen = nullptr;
  const Status status = both.gpu.measure(scene, poses, got.answers);
  EXPECT_TRUE(status) << status.error().message;
  EXPECT_TRUE(both.cpu.measure(scene, poses, want.answers));
  Compared found;
  const BatchAnswers &a = got.answers.contact, &b = want.answers.contact;
  for (std::size_t i = 0; i < num; ++i) {
    SCOPED_TRACE(i);
    EXPECT_EQ(a.status[i], b.status[i]);
    EXPECT_NEAR(a.volume[i], b.volume[i], 1e-5 * volume);
    EXPECT_NEAR(a.potential[i], b.potential[i], 1e-5 * volume * reach);
    for (std::size_t k = 3 * i; k < 3 * i + 3; ++k) {
      EXPECT_NEAR(a.force[k], b.force[k], 1e-5 * volume);
      EXPECT_NEAR(a.torque[k], b.torque[k], 1e-5 * volume * reach);
    }
    double largest = 1e-9;
    for (std::size_t k = 36 * i; k < 36 * i + 36; ++k) {
      largest = std::max(largest, std::abs(b.stiffness[k]));
    }
    for (std::size_t k = 36 * i; k < 36 * i + 36; ++k) {
      EXPECT_NEAR(a.stiffness[k], b.stiffness[k], 2e-3 * largest);
    }
    if (has_unseen) {
      EXPECT_NEAR(got.answers.unseen[i], want.answers.unseen[i], 0.02);
    }
    // The same arithmetic; compilers may round differently.
    EXPECT_NEAR(got.answers.clearance[i], want.answers.clearance[i], 1e-7);
    EXPECT_EQ(got.nearest[i], want.nearest[i]);
    EXPECT_EQ(got.decided[i], want.decided[i]);
    for (std::size_t k = 6 * i; k < 6 * i + 6; ++k) {
      EXPECT_NEAR(got.answers.clearance_gradient[k], want.answers.clearance_gradient[k], 1e-5);
    }
    const auto num_cameras = static_cast<std::int32_t>(scene.surfaces.size());
    found.by_cameras += want.decided[i] >= 0 && want.decided[i] < num_cameras;
    found.by_bodies += want.decided[i] >= num_cameras;
    found.inside += want.nearest[i] >= 0 && want.answers.clearance[i] < 0;
    found.touching += b.volume[i] > 0;
  }
  int num_other = 0;
  for (std::size_t i = 0; i < got.sphere_depth.size(); ++i) {
    num_other += got.sphere_decided[i] != want.sphere_decided[i] ||
                 !(std::abs(got.sphere_depth[i] - want.sphere_depth[i]) < 1e-4f);
  }
  EXPECT_LE(num_other, 2 + static_cast<int>(got.sphere_depth.size()) / 500);
  EXPECT_EQ(got.group_pose, want.group_pose);
  for (std::size_t g = 0; g < num_groups; ++g) {
    EXPECT_NEAR(got.group_clearance[g], want.group_clearance[g], 1e-7);
    EXPECT_NEAR(got.group_volume[g], want.group_volume[g], 1e-4 * volume);
  }
  std::vector<double> soft(7 * num), wanted(7 * num);
  SceneAnswers smooth;
  smooth.clearance_smoothing = 0.003;
  for (auto [to, contact] : {std::pair{&soft, &both.gpu}, {&wanted, &both.cpu}}) {
    smooth.clearance = to->data();
    smooth.clearance_gradient = to->data() + num;
    EXPECT_TRUE(contact->measure(scene, poses, smooth));
  }
  for (std::size_t k = 0; k < 7 * num; ++k) {
    EXPECT_NEAR(soft[k], wanted[k], k < num ? 1e-7 : 1e-5) << k;
    if (k < num) found.softened += soft[k] < got.answers.clearance[k] - 1e-4;
  }
  for (const double margin : {0.0, 0.02}) {
    std::vector<std::uint8_t> hits(num_groups > 0 ? num_groups : num), others(hits.size());
    EXPECT_TRUE(both.gpu.any(scene, poses, margin, hits.data()));
    EXPECT_TRUE(both.cpu.any(scene, poses, margin, others.data()));
    EXPECT_EQ(hits, others);
  }
  return found;
}

TEST(SceneContactCuda, ThreeCamerasAndTwoBodiesAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  Random random(31);
  const HullScene seen = test::rough_scene(3, {}, random);
  const Tool tool = test::random_tool(60, 0.05, 3), small = test::random_tool(20, 0.03, 4);
  const Tool shape =
      Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 50}).value().with_solid_field();
  const Body body(shape, {{0.1, 0, 0.8}, {}});
  const Scene scene{.surfaces = surfaces_of(seen),
                    .bodies = {body, body.at({{-0.2, 0.05, 0.7}, random.rotation(1)})}};
  const Tool* const tools[] = {&tool, &small};
  const Both both(tools);
  std::vector<Pose> poses;
  std::vector<std::int32_t> tool_of_pose, group_of_pose;
  for (int i = 0; i < 48; ++i) {
    const double x = random.uniform(-0.3, 0.3), y = random.uniform(-0.2, 0.2);
    poses.push_back({{x, y, random.uniform(0.3, 1.4)}, random.rotation(3)});
    tool_of_pose.push_back(i % 2);
    group_of_pose.push_back(i / 4);
  }
  poses[5].translation.x = NAN;
  const Compared found = compare(both, scene, {poses, tool_of_pose, group_of_pose, 12},
                                 tool.sphere_mass().volume, true);
  EXPECT_GT(found.by_cameras, 3);
  EXPECT_GT(found.by_bodies, 3);
  EXPECT_GT(found.inside, 2);
  EXPECT_GT(found.touching, 5);
  EXPECT_GT(found.softened, 5);
  // Without cameras, and the same shapes in another order.
  const Scene bodies{.bodies = {scene.bodies[1], scene.bodies[0]}};
  (void)compare(both, bodies, {poses, tool_of_pose, group_of_pose, 12}, tool.sphere_mass().volume,
                false);
}

// More cameras than the short kernel has, the same bits in any batch, and no sphere asked for.
TEST(SceneContactCuda, APoseHasTheSameBitsInAnyBatch) {
  PALPATE_GPU_OR_SKIP();
  Random random(35);
  const HullScene seen = test::rough_scene(5, {}, random);
  const Tool tool = test::random_tool(60, 0.05, 3);
  const Tool* const tools[] = {&tool};
  const Both both(tools);
  const Scene scene{.surfaces = surfaces_of(seen)};
  std::vector<Pose> poses;
  for (int i = 0; i < 8; ++i) {
    const double x = random.uniform(-0.2, 0.2), y = random.uniform(-0.1, 0.1);
    poses.push_back({{x, y, random.uniform(1.1, 1.5)}, random.rotation(3)});
  }
  std::vector<double> want(8), got(8), alone(8), stiffness(8 * 36);
  SceneAnswers answers;
  answers.contact.volume = want.data();
  ASSERT_TRUE(both.cpu.measure(scene, {poses}, answers));
  answers.contact.volume = got.data();
  answers.contact.stiffness = stiffness.data();
  ASSERT_TRUE(both.gpu.measure(scene, {poses}, answers));
  int num_touching = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    answers.contact.volume = &alone[i];
    ASSERT_TRUE(both.gpu.measure(scene, {{&poses[i], 1}}, answers));
    EXPECT_NEAR(got[i], want[i], 1e-5 * tool.sphere_mass().volume);
    num_touching += want[i] > 0;
  }
  EXPECT_EQ(got, alone);
  EXPECT_GT(num_touching, 2);
}

TEST(SceneContactCuda, ShapesOfPastScenesAreDropped) {
  PALPATE_GPU_OR_SKIP();
  const Tool tool = test::random_tool(10, 0.03, 3);
  const Tool box =
      Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 5}).value().with_solid_field();
  const Tool* const tools[] = {&tool};
  const Both both(tools);
  const std::vector<Pose> poses{{{0.05, 0, 0}, {}}};
  double volume = 0, clearance = 0;
  SceneAnswers answers;
  answers.contact.volume = &volume;
  answers.clearance = &clearance;
  Scene scene{.bodies = {Body(box)}};
  for (int i = 0; i < 2; ++i) {
    ASSERT_TRUE(both.gpu.measure(scene, {poses}, answers));
    EXPECT_GT(volume, 0);
    EXPECT_LT(clearance, 0);
    const std::weak_ptr<const ToolIndex> last = scene.bodies[0].placed().shape;
    scene.bodies = {Body(box)};
    ASSERT_TRUE(both.gpu.measure(scene, {poses}, answers));
    EXPECT_TRUE(last.expired());
  }
}

TEST(SceneContactCuda, OneCameraAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  Random random(32);
  const Tool tool = test::random_tool(100, 0.05, 3);
  const Tool* const tools[] = {&tool};
  const Both both(tools);
  Compared all;
  for (const DepthFieldOptions& options :
       {DepthFieldOptions{}, DepthFieldOptions{.unseen = UnseenSpace::free, .thickness = 0.03}}) {
    const HullScene rough = test::rough_scene(1, options, random);
    std::vector<Pose> poses;
    for (int i = 0; i < 30; ++i) {
      const double x = random.uniform(-0.3, 0.3), y = random.uniform(-0.2, 0.2);
      poses.push_back({{x, y, random.uniform(0.3, 1.4)}, random.rotation(3)});
    }
    const Compared found =
        compare(both, {.surfaces = surfaces_of(rough)}, {poses}, tool.sphere_mass().volume, true);
    all.by_cameras += found.by_cameras;
    all.inside += found.inside;
  }
  EXPECT_GT(all.by_cameras, 5);
  EXPECT_GT(all.inside, 2);
}

TEST(SceneContactCuda, OneCameraWithAMemoryAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  Random random(33);
  const HullScene seen = test::rough_memories(1, random, false);
  const Tool tool = test::random_tool(40, 0.03, 3);
  const Tool* const tools[] = {&tool};
  const Both both(tools);
  std::vector<Pose> poses;
  for (int i = 0; i < 20; ++i) poses.push_back(test::pose_in_front(seen, random));
  const Compared found =
      compare(both, {.surfaces = surfaces_of(seen)}, {poses}, tool.sphere_mass().volume, false);
  EXPECT_GT(found.by_cameras, 5);
  EXPECT_GT(found.softened, 2);
}

/// Compares the space that a camera by itself has not seen, of a batch and of single poses.
double compare_unseen(const Both& both, const Tool& tool, const Scene& scene,
                      const std::vector<Pose>& poses) {
  const std::size_t num = poses.size();
  std::vector<double> want(num), got(num), volume(num), alone(num);
  SceneAnswers answers;
  answers.unseen = want.data();
  EXPECT_TRUE(both.cpu.measure(scene, {poses}, answers));
  answers.unseen = got.data();
  answers.contact.volume = volume.data();
  EXPECT_TRUE(both.gpu.measure(scene, {poses}, answers));
  answers.unseen = nullptr;
  answers.contact.volume = alone.data();
  EXPECT_TRUE(both.gpu.measure(scene, {poses}, answers));
  EXPECT_EQ(volume, alone);  // whatever else is asked
  double sum = 0;
  SpherePicture here, there;
  here.resize(tool.spheres().size());
  there.resize(tool.spheres().size());
  for (std::size_t i = 0; i < num; ++i) {
    EXPECT_NEAR(got[i], want[i], 1e-5) << i;
    sum += want[i];
    const ContactResult one = both.cpu.measure(scene, poses[i], here.wants());
    const ContactResult other = both.gpu.measure(scene, poses[i], there.wants());
    EXPECT_NEAR(other.penetration.unseen_volume, one.penetration.unseen_volume,
                1e-5 * tool.sphere_mass().volume);
    EXPECT_EQ(there.unseen, here.unseen) << i;
  }
  return sum / static_cast<double>(num);
}

TEST(SceneContactCuda, WhatOneCameraByItselfHasNotSeen) {
  PALPATE_GPU_OR_SKIP();
  Random random(39);
  const Tool tool = test::random_tool(60, 0.05, 3);
  const Tool* const tools[] = {&tool};
  const Both both(tools);
  HullScene rough = test::rough_scene(1, {}, random);
  test::set_apart(rough.views[0].from, rough.views[0].to);
  std::vector<Pose> poses;
  for (int i = 0; i < 24; ++i) {
    const double x = random.uniform(-0.5, 0.5), y = random.uniform(-0.4, 0.4);
    poses.push_back({{x, y, random.uniform(0.3, 1.4)}, random.rotation(3)});
  }
  const double share = compare_unseen(both, tool, {.surfaces = surfaces_of(rough)}, poses);
  EXPECT_GT(share, 0.1);
  EXPECT_LT(share, 0.9);
  const HullScene remembered = test::rough_memories(1, random, false);
  for (Pose& X_WT : poses) X_WT = test::pose_in_front(remembered, random);
  (void)compare_unseen(both, tool, {.surfaces = surfaces_of(remembered)}, poses);
}

// The edge of a block that was not measured: the wall behind goes on there, and is not seen.
TEST(SceneContactCuda, APatchThatShowsWhatIsBehindIsUnseen) {
  PALPATE_GPU_OR_SKIP();
  const Camera camera = test::vga();
  std::vector<float> meters;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const double x = (u - camera.intrinsics.cx) / camera.intrinsics.fx * 0.5;
      const bool is_dark = x > 0.06 && x < 0.1 && v > 60 && v < 420;
      meters.push_back(is_dark ? 0.0f : x < 0.1 ? 0.5f : 1.2f);
    }
  }
  HullScene scene;
  test::add_view(scene, camera, {}, meters);
  test::set_apart(scene.views[0].from, scene.views[0].to);
  const Tool tool = test::random_tool(60, 0.008, 5);
  const Tool* const tools[] = {&tool};
  const double share = compare_unseen(Both(tools), tool, {.surfaces = surfaces_of(scene)},
                                      {{{0.08, 0, 0.505}, {}}, {{0.08, 0, 0.55}, {}}});
  EXPECT_GT(share, 0.98);
}

}  // namespace
}  // namespace palpate
