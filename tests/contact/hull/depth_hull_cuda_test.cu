// The depth hull on the GPU against the CPU's.
#include <cmath>
#include <cstring>
#include <span>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/backends.h"
#include "src/contact/field/field_contact_cuda.h"
#include "src/field/internal/key_frames.h"
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
    const auto cpu = make_contact_query(Place::cpu(), index, FieldMethod{}).value();
    const auto gpu = make_contact_query_cuda(index, FieldMethod{}, 0).value();
    std::vector<SphereState> cpu_states(300), gpu_states(300);
    std::vector<Plane<float>> cpu_planes(300), gpu_planes(300);
    int num_with_force = 0;
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
      num_with_force += want.penetration.volume > 0.01 * scale;
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
    EXPECT_GT(num_with_force, 4);
  }
}

TEST_F(DepthHullCuda, ClustersThatLieDeepCountAsOnTheCpu) {
  const Tool tool = test::grid_tool();
  const auto index = ToolIndex::create(tool);
  const auto cpu = make_contact_query(Place::cpu(), index, FieldMethod{}).value();
  const auto gpu = make_contact_query_cuda(index, FieldMethod{}, 0).value();
  const HullScene scene = test::smooth_scene(2);
  const double scale = tool.mesh_mass().volume;
  Random random(7);
  int num_deep = 0;
  for (int i = 0; i < 10; ++i) {
    const Pose X_WT{random.in_box(0.05) + Vec3d{0, 0, 0.8}, random.rotation(3.0)};
    const ContactResult want = cpu->measure(scene.views, X_WT, {.stiffness = true});
    const ContactResult got = gpu->measure(scene.views, X_WT, {.stiffness = true});
    num_deep += want.penetration.volume > 0.8 * full_volume(tool, SphereVolumes::represented);
    expect_near(got, want, scale);
  }
  EXPECT_GE(num_deep, 1);
}

// A tool of few clusters has a block for each, which samples its ball beside its elements.
TEST_F(DepthHullCuda, ABlockForEachClusterChangesRoundingAlone) {
  Random random(11);
  const Tool grid = test::grid_tool(), loose = test::random_tool(300, 0.06, 3);
  std::vector<HullScene> scenes;
  scenes.push_back(test::smooth_scene(4));
  scenes.push_back(test::rough_memories(2, random));
  scenes.push_back(test::rough_scene(5, {}, random));
  scenes.push_back(test::rough_scene(5, {}, random));
  scenes.push_back(test::rough_memories(1, random));
  for (std::size_t s = 0; s < scenes.size(); ++s) {
    const HullScene& scene = scenes[s];
    const auto index = ToolIndex::create(s < 3 ? grid : loose);
    const auto cpu = make_contact_query(Place::cpu(), index, FieldMethod{}).value();
    const FieldContactCuda few(index, {}, 0, 2), many(index, {}, 0, 1000);
    const double scale = index->tool().mesh_mass().volume;
    for (int i = 0; i < 4; ++i) {
      const Pose X_WT =
          i % 2 == 0 ? Pose{{0, 0, 0.75 + 0.1 * i}, random.rotation(3.0)} : random_pose(random);
      const ContactResult plain = many.measure(scene.views, X_WT);
      const ContactResult got = many.measure(scene.views, X_WT, {.stiffness = true});
      const ContactResult want = few.measure(scene.views, X_WT, {.stiffness = true});
      expect_near(got, cpu->measure(scene.views, X_WT), scale);
      for (const ContactResult* result : {&plain, &got}) {
        const Penetration &a = result->penetration, &b = want.penetration;
        EXPECT_NEAR(a.volume, b.volume, 1e-6 * scale);
        EXPECT_NEAR(a.potential, b.potential, 1e-7 * scale);
        EXPECT_NEAR(norm(a.measure_W.force - b.measure_W.force), 0, 1e-6 * scale);
        EXPECT_NEAR(norm(a.measure_W.torque - b.measure_W.torque), 0, 1e-7 * scale);
        EXPECT_NEAR(a.unseen_volume, b.unseen_volume, 1e-6 * scale);
        EXPECT_EQ(a.num_boundary_spheres, b.num_boundary_spheres);
        EXPECT_EQ(a.num_inside_spheres, b.num_inside_spheres);
      }
      for (int k = 0; k < 36; ++k) {
        const double size = std::abs(want.stiffness->m[k % 6][k % 6]) + scale;
        EXPECT_NEAR(got.stiffness->m[k / 6][k % 6], want.stiffness->m[k / 6][k % 6], 1e-3 * size);
      }
    }
  }
}

TEST_F(DepthHullCuda, RemembersAsTheCpu) {
  Random random(33);
  for (const int num_cameras : {1, 2, 5}) {
    const HullScene scene = test::rough_memories(num_cameras, random);
    const Tool tool = test::random_tool(300, 0.06, 3);
    const auto index = ToolIndex::create(tool);
    const auto cpu = make_contact_query(Place::cpu(), index, FieldMethod{}).value();
    const auto gpu = make_contact_query_cuda(index, FieldMethod{}, 0).value();
    std::vector<SphereState> cpu_states(300), gpu_states(300);
    int num_with_force = 0;
    for (int i = 0; i < 20; ++i) {
      const Pose X_WT = i % 4 == 0 ? random_pose(random) : test::pose_in_front(scene, random);
      for (const bool stiffness : {false, true}) {
        const ContactResult want =
            cpu->measure(scene.views, X_WT, {.stiffness = stiffness, .states = cpu_states});
        const ContactResult got =
            gpu->measure(scene.views, X_WT, {.stiffness = stiffness, .states = gpu_states});
        expect_near(got, want, tool.mesh_mass().volume);
        num_with_force += want.penetration.volume > 0.01 * tool.mesh_mass().volume;
        int num_other = 0;
        for (std::size_t s = 0; s < gpu_states.size(); ++s) {
          num_other += gpu_states[s] != cpu_states[s];
        }
        EXPECT_LE(num_other, 4);
      }
    }
    EXPECT_GT(num_with_force, 8);
  }
}

/// A camera that passes a ball before a wall, and what it remembers: surfaces of these slots.
class Passing {
 public:
  explicit Passing(const KeyFrames::MakeSlots& make)
      : newest_(make(settings()).value()), kept_(KeyFrames::create(settings(), make).value()) {}

  static SlotSettings settings() {
    SlotSettings settings;
    settings.stream = test::stream_of(kCamera);
    settings.stream.is_moving = true;
    settings.field.emplace();
    settings.time.mode = TimeMode::latest;
    settings.time.memory = {.kind = DepthMemory::on, .frames = 4};
    settings.wants_depth_change = false;
    return settings;
  }
  void push(double x, bool has_ball) {
    DepthFrame frame{kCamera.width, kCamera.height, 0.0001, {}, 0};
    frame.X_WC = test::look_at({x, 0, 0}, {0, 0, 0.8});
    const auto ray = [&](const Vec3d& p, const Vec3d& d) {
      const double wall = test::to_wall(p, d, 1);
      return has_ball ? std::min(wall, test::to_ball(p, d, {0, 0, 0.7}, 0.06)) : wall;
    };
    for (const float z : test::depth_seen(ray, kCamera, frame.X_WC)) {
      frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(z / frame.unit)));
    }
    kept_.take(frame, pool_);
    newest_->take(0, frame, {}, {}, 1.0 / 30, pool_);
    X_WC_ = frame.X_WC;
  }
  std::vector<SurfaceBlend> views(double progress) const {
    SurfaceView now = newest_->surfaces(0);
    now.X_WC = X_WC_;
    std::vector<SurfaceBlend> views{{now, now, 1}};
    for (SurfaceBlend view : kept_.views()) {
      view.progress = progress;
      views.push_back(view);
    }
    return views;
  }
  const Status& status() const { return kept_.status(); }

 private:
  static constexpr Camera kCamera{128, 96, {105, 105, 63.5, 47.5}};

  ThreadPool pool_{1};
  std::unique_ptr<FrameSlots> newest_;
  KeyFrames kept_;
  Pose X_WC_;
};

// Frames that a camera keeps from where it was, made and queried on the GPU.
TEST_F(DepthHullCuda, KeyFramesAreThoseOfTheCpu) {
  Passing on_cpu(make_frame_slots_cpu);
  Passing on_gpu([](const SlotSettings& settings) { return make_frame_slots_cuda(settings, 0); });
  const Tool tool = test::ball_tool(0.03, 300);
  const auto index = ToolIndex::create(tool);
  const auto cpu = make_contact_query(Place::cpu(), index, FieldMethod{}).value();
  const auto gpu = make_contact_query_cuda(index, FieldMethod{}, 0).value();
  const double whole = tool.mesh_mass().volume;
  const Vec3d behind_ball{0, 0, 0.89};
  std::vector<std::int8_t> want_deciders(300), got_deciders(300);
  Random random(35);
  int num_with_force = 0, num_decided = 0, num_other = 0;
  for (const bool has_ball : {true, false}) {  // then it has gone
    for (const double x : {-0.35, -0.2, -0.1, 0.0, 0.1, 0.2, 0.35, 0.0}) {
      on_cpu.push(x, has_ball);
      on_gpu.push(x, has_ball);
      ASSERT_TRUE(on_gpu.status()) << on_gpu.status().error().message;
      for (int i = 0; i < 4; ++i) {
        const double progress = i % 2 == 0 ? 1 : random.uniform(0, 1);
        const Pose X_WT{{random.uniform(-0.2, 0.2), random.uniform(-0.1, 0.1),
                         random.uniform(i < 2 ? 0.7 : 0.97, 1.02)},
                        random.rotation(3)};
        const auto want_views = on_cpu.views(progress), got_views = on_gpu.views(progress);
        ASSERT_EQ(got_views.size(), want_views.size());
        const ContactResult want = cpu->measure(want_views, X_WT, {.deciders = want_deciders});
        const ContactResult got = gpu->measure(got_views, X_WT, {.deciders = got_deciders});
        expect_near(got, want, whole);
        num_with_force += want.penetration.volume > 0.01 * whole;
        for (std::size_t s = 0; s < want_deciders.size(); ++s) {
          num_decided += want_deciders[s] > 0;
          num_other += got_deciders[s] != want_deciders[s];
        }
      }
    }
    const auto views = on_gpu.views(1);
    EXPECT_GE(views.size(), 4u);
    EXPECT_LT(gpu->measure(views, {behind_ball, {}}).penetration.volume, 0.02 * whole);
    if (!has_ball) continue;
    const auto without = std::span(views).first(1);
    EXPECT_GT(gpu->measure(without, {behind_ball, {}}).penetration.volume, 0.9 * whole);
  }
  EXPECT_GT(num_with_force, 15);
  EXPECT_GT(num_decided, 200);  // by what is remembered
  EXPECT_LT(num_other, num_decided / 20);
}

TEST_F(DepthHullCuda, RefusesWhatTheCpuRefuses) {
  Random random(32);
  const HullScene scene = test::rough_scene(2, {}, random);
  const Tool tool = test::random_tool(50, 0.03, 5);
  const auto gpu = make_contact_query_cuda(ToolIndex::create(tool), FieldMethod{}, 0).value();
  const Pose X_WT{{0, 0, 0.9}, {}};
  const auto status = [&](const std::vector<SurfaceBlend>& views) {
    return gpu->measure(views, X_WT).penetration.status;
  };
  EXPECT_EQ(status({SurfaceBlend{}, SurfaceBlend{}}), StepStatus::no_surface);
  std::vector<SurfaceBlend> views = scene.views;
  test::set_apart(views[1].to);
  EXPECT_EQ(status(views), StepStatus::no_surface);
  views = scene.views;
  views[0].to.field.requested = {0, 0, 20, 20};
  EXPECT_EQ(status(views), StepStatus::outside_window);
  EXPECT_EQ(status(scene.views), StepStatus::ok);
}

}  // namespace
}  // namespace palpate
