// The depth hull on the GPU against the CPU's.
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/cuda/contact_query_cuda.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/gpu.h"
#include "tests/test_util/hull_scenes.h"

namespace palpate {
namespace {

using test::HullScene;
using test::Random;

Pose random_pose(Random& random) {
  const double x = random.uniform(-0.25, 0.25), y = random.uniform(-0.2, 0.2);
  return {{x, y, random.uniform(0.9, 1.5)}, random.rotation(3.0)};
}

class DepthHullCuda : public testing::Test {
 protected:
  void SetUp() override { PALPATE_GPU_OR_SKIP(); }
};

void expect_near(const ContactResult& got, const ContactResult& want, double scale) {
  const Penetration &a = got.penetration, &b = want.penetration;
  EXPECT_EQ(a.status, b.status);
  EXPECT_NEAR(a.volume, b.volume, 1e-5 * scale);
  EXPECT_NEAR(a.potential, b.potential, 1e-6 * scale);
  EXPECT_NEAR(norm(a.measure_W.force - b.measure_W.force), 0, 5e-5 * scale);
  EXPECT_NEAR(norm(a.measure_W.torque - b.measure_W.torque), 0, 5e-6 * scale);
  EXPECT_NEAR(a.num_boundary_spheres, b.num_boundary_spheres, 2);
  EXPECT_NEAR(a.num_inside_spheres, b.num_inside_spheres, 2);
  EXPECT_NEAR(a.unseen_volume, b.unseen_volume, 0.02 * scale);
}

TEST_F(DepthHullCuda, EqualsTheOneOfTheCpu) {
  Random random(31);
  for (const int num_cameras : {2, 4, 6}) {
    const HullScene scene = test::rough_scene(num_cameras, {}, random);
    const HullScene later = test::rough_scene(num_cameras, {}, random);
    const Tool tool = test::random_tool(300, 0.06, 3);
    const auto index = ToolIndex::create(tool);
    const auto cpu = make_contact_query(Backend::cpu, index, FieldMethod{}).value();
    const auto gpu = make_contact_query_cuda(index, FieldMethod{}, {}).value();
    std::vector<SphereState> cpu_states(300), gpu_states(300);
    std::vector<Plane<float>> cpu_planes(300), gpu_planes(300);
    int num_felt = 0;
    for (int i = 0; i < 20; ++i) {
      const Pose X_WT = random_pose(random);
      std::vector<SurfaceBlend> views = scene.views;
      for (std::size_t k = 0; i % 2 == 1 && k < views.size(); ++k) {
        views[k] = {scene.views[k].to, later.views[k].to, random.uniform(0, 1)};
        if (i % 4 == 1) views[k].from.X_WC = views[k].to.X_WC;  // else it has moved
      }
      const ContactResult want =
          cpu->measure(views, X_WT, {.states = cpu_states, .planes = cpu_planes});
      const ContactResult got =
          gpu->measure(views, X_WT, {.states = gpu_states, .planes = gpu_planes});
      const double scale = tool.mesh_mass().volume;
      num_felt += want.penetration.volume > 0.01 * scale;
      expect_near(got, want, scale);
      int num_other = 0;
      for (std::size_t s = 0; s < gpu_states.size(); ++s) {
        num_other += gpu_states[s] != cpu_states[s];
        if (gpu_states[s] != cpu_states[s] || norm(cpu_planes[s].normal) == 0) continue;
        num_other += norm(gpu_planes[s].normal - cpu_planes[s].normal) > 1e-2f ||
                     std::abs(gpu_planes[s].offset - cpu_planes[s].offset) > 1e-3f;
      }
      EXPECT_LE(num_other, 4);
      // Again, and with a stiffness.
      const ContactResult again = gpu->measure(views, X_WT);
      EXPECT_EQ(again.penetration.volume, got.penetration.volume);
      EXPECT_EQ(again.penetration.measure_W.force, got.penetration.measure_W.force);
      const ContactResult stiff = gpu->measure(views, X_WT, {.stiffness = true});
      const ContactResult stiff_want = cpu->measure(views, X_WT, {.stiffness = true});
      expect_near(stiff, stiff_want, scale);
      double largest = 0;
      for (const auto& row : stiff_want.stiffness->m) {
        for (const double k : row) largest = std::max(largest, std::abs(k));
      }
      for (int row = 0; row < 6; ++row) {
        for (int column = 0; column < 6; ++column) {
          EXPECT_NEAR(stiff.stiffness->m[row][column], stiff_want.stiffness->m[row][column],
                      2e-3 * largest);
        }
      }
    }
    EXPECT_GT(num_felt, 4);
  }
}

TEST_F(DepthHullCuda, RemembersAsTheCpu) {
  Random random(33);
  for (const int num_cameras : {1, 2, 5}) {
    const HullScene scene = test::rough_memories(num_cameras, random);
    const Tool tool = test::random_tool(300, 0.06, 3);
    const auto index = ToolIndex::create(tool);
    const auto cpu = make_contact_query(Backend::cpu, index, FieldMethod{}).value();
    const auto gpu = make_contact_query_cuda(index, FieldMethod{}, {}).value();
    std::vector<SphereState> cpu_states(300), gpu_states(300);
    int num_felt = 0;
    for (int i = 0; i < 20; ++i) {
      const Pose X_WT = i % 4 == 0 ? random_pose(random) : test::pose_in_front(scene, random);
      for (const bool stiffness : {false, true}) {
        const ContactResult want =
            cpu->measure(scene.views, X_WT, {.stiffness = stiffness, .states = cpu_states});
        const ContactResult got =
            gpu->measure(scene.views, X_WT, {.stiffness = stiffness, .states = gpu_states});
        expect_near(got, want, tool.mesh_mass().volume);
        num_felt += want.penetration.volume > 0.01 * tool.mesh_mass().volume;
        int num_other = 0;
        for (std::size_t s = 0; s < gpu_states.size(); ++s) {
          num_other += gpu_states[s] != cpu_states[s];
        }
        EXPECT_LE(num_other, 4);
      }
    }
    EXPECT_GT(num_felt, 8);
  }
}

TEST_F(DepthHullCuda, RefusesWhatTheCpuRefuses) {
  Random random(32);
  const HullScene scene = test::rough_scene(2, {}, random);
  const Tool tool = test::random_tool(50, 0.03, 5);
  const auto gpu = make_contact_query_cuda(ToolIndex::create(tool), FieldMethod{}, {}).value();
  const Pose X_WT{{0, 0, 0.9}, {}};
  const auto status = [&](const std::vector<SurfaceBlend>& views) {
    return gpu->measure(views, X_WT).penetration.status;
  };
  EXPECT_EQ(status({SurfaceBlend{}, SurfaceBlend{}}), StepStatus::no_surface);
  std::vector<SurfaceBlend> views = scene.views;
  views[1].to.seen_free = {};
  EXPECT_EQ(status(views), StepStatus::no_surface);
  views = scene.views;
  views[0].to.field.asked = {0, 0, 20, 20};
  EXPECT_EQ(status(views), StepStatus::outside_window);
  EXPECT_EQ(status(scene.views), StepStatus::ok);
}

}  // namespace
}  // namespace palpate
