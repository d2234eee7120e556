// The noise of single measures on the GPU against the CPU's, and against itself in other orders of
// threads.
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/cuda/gpu_field.h"
#if defined(PALPATE_EMULATE_CUDA)
#include "src/gpu/internal/short_memory.h"
#endif
#include "tests/contact/noise/compared_noise.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/cuda_queries.h"
#include "tests/test_util/frozen_field.h"
#include "tests/test_util/gpu.h"
#include "tests/test_util/hull_scenes.h"

namespace palpate {
namespace {

using test::deviations_of;
using test::FrozenField;
using test::HullScene;
using test::Random;

constexpr ContactOptions kCounted{.method = MethodKind::field,
                                  .volumes = SphereVolumes::represented};

PointCloud block_before_wall() {
  return test::stepped_wall(96, 72, 84, 0.6, 0.12, 0.002, 2,
                            [](int u, int v) { return u > 30 && u < 60 && v > 24 && v < 51; })
      .cloud;
}

/// Compares a measure of both, and returns the deviation of its volume.
double compare(test::ContactQueries& cpu, test::ContactQueries& gpu,
               std::span<const SurfaceBlend> cameras, const Pose& X_WT) {
  const ContactResult want = cpu.by(kCounted).measure(cameras, X_WT, {.noise = true});
  const ContactResult got = gpu.by(kCounted).measure(cameras, X_WT, {.noise = true});
  EXPECT_EQ(got.penetration.status, want.penetration.status);
  EXPECT_EQ(got.noise.has_value(), want.noise.has_value());
  if (!want.noise || !got.noise) return 0;
  test::expect_near(deviations_of(*got.noise), deviations_of(*want.noise));
  double largest = 0;
  for (const auto& row : want.noise->force.m) {
    for (const double entry : row) largest = std::max(largest, std::abs(entry));
  }
  for (int i = 0; i < 9; ++i) {
    EXPECT_NEAR(got.noise->force.m[i / 3][i % 3], want.noise->force.m[i / 3][i % 3],
                2 * test::kGpuNoise * largest);
  }
  return want.noise->volume_std();
}

// 1 and 33: padding, and spheres so large that they are felt in parts; 4096: several clusters a
// warp, of which some count as one ball.
TEST(MeasureNoiseCuda, EqualsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const auto kinds = test::kinds_of_noise();
  std::vector<FrozenField> fields;
  fields.emplace_back(test::noisy_wall(96, 72, 84, 0.6, 0.002, 1));
  fields.emplace_back(block_before_wall());
  fields.emplace_back(test::noisy_wall(96, 72, 84, 0.12, 0.0005, 3),
                      DepthFieldOptions{.unknown = UnknownSpace::solid});
  for (const int num_spheres : {1, 33, 400, 4096}) {
    const Tool tool =
        num_spheres == 4096 ? test::grid_tool() : test::random_tool(num_spheres, 0.05, 3);
    test::ContactQueries cpu(tool), gpu = test::cuda_queries(tool);
    Random random(5);
    int num_touching = 0;
    for (std::size_t k = 0; k < fields.size(); ++k) {
      for (int i = 0; i < (num_spheres > 1000 ? 4 : 12); ++i) {
        SCOPED_TRACE(testing::Message() << num_spheres << " spheres, field " << k << ", " << i);
        SurfaceView surface = fields[k].surface();
        surface.field.noise = &kinds[(k + static_cast<std::size_t>(i)) % kinds.size()];
        const double wall = k == 2 ? 0.12 : 0.6;
        const double x = random.uniform(-0.1, 0.1), y = random.uniform(-0.06, 0.06);
        Pose X_WT{{x, y, wall + random.uniform(-0.04, 0.05)}, random.rotation(3.0)};
        if (k == 2) X_WT.translation.x *= 0.3;
        const SurfaceBlend camera{surface, surface, 1};
        num_touching += compare(cpu, gpu, {&camera, 1}, X_WT) > 0;
      }
    }
    EXPECT_GE(num_touching, 8) << num_spheres;
  }
}

TEST(MeasureNoiseCuda, BlendsAndFieldsOnTheGpuAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const auto kinds = test::kinds_of_noise();
  const FrozenField fields[] = {FrozenField(test::noisy_wall(96, 72, 84, 0.6, 0.002, 1)),
                                FrozenField(test::noisy_wall(96, 72, 84, 0.61, 0.002, 2))};
  gpu::Stream stream(0, gpu::Priority::low);
  GpuFields copies(0);
  SurfaceView on_cpu[2], on_gpu[2];
  for (std::size_t i = 0; i < 2; ++i) {
    on_cpu[i] = fields[i].surface();
    on_cpu[i].field.noise = &kinds[i];
    on_gpu[i] = on_cpu[i];
    on_gpu[i].field = copies.on_gpu(on_cpu[i].field, stream);
  }
  ASSERT_TRUE(stream.wait());
  const Tool tool = test::random_tool(200, 0.05, 6);
  test::ContactQueries cpu(tool), gpu = test::cuda_queries(tool);
  const Pose X_WT{{0.01, 0, 0.61}, axis_angle({1, 2, 3}, 0.7)};
  for (const double alpha : {0.0, 0.3, 1.0}) {
    const auto want = cpu.by(kCounted).measure(on_cpu[0], on_cpu[1], alpha, X_WT, {.noise = true});
    const auto got = gpu.by(kCounted).measure(on_gpu[0], on_gpu[1], alpha, X_WT, {.noise = true});
    ASSERT_TRUE(got.noise && want.noise);
    EXPECT_GT(want.noise->volume, 0);
    test::expect_near(deviations_of(*got.noise), deviations_of(*want.noise));
  }
  SurfaceView unknown = on_gpu[0];
  unknown.field.noise = nullptr;
  const auto said = [&](const SurfaceView& from, const SurfaceView& to) {
    return gpu.by(kCounted).measure(from, to, 0.3, X_WT, {.noise = true}).noise.has_value();
  };
  EXPECT_FALSE(said(unknown, on_gpu[1]));
  EXPECT_FALSE(said(on_gpu[1], unknown));
  EXPECT_TRUE(said(SurfaceView{}, on_gpu[1])) << "a camera without a frame has none";
}

/// Compares poses against the cameras of a scene; returns how many have a deviation.
int compare_hull(const HullScene& scene, const Tool& tool, Random& random, bool moves,
                 bool has_memory = false) {
  test::ContactQueries cpu(tool), gpu = test::cuda_queries(tool);
  int num_touching = 0;
  for (int i = 0; i < 8; ++i) {
    SCOPED_TRACE(i);
    std::vector<SurfaceBlend> views = scene.views;
    for (std::size_t k = 0; moves && k < views.size(); ++k) {
      views[k].progress = random.uniform(0, 1);
      views[k].from = scene.views[(k + 1) % views.size()].to;
      if (i % 2 == 0) views[k].from.X_WC = views[k].to.X_WC;
    }
    const double x = random.uniform(-0.2, 0.2), y = random.uniform(-0.1, 0.1);
    Pose X_WT{{x, y, random.uniform(0.9, 1.4)}, random.rotation(3)};
    if (has_memory) X_WT = test::pose_in_front(scene, random);
    num_touching += compare(cpu, gpu, views, X_WT) > 0;
  }
  return num_touching;
}

TEST(MeasureNoiseCuda, SeveralCamerasAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  Random random(31);
  const Tool small = test::random_tool(60, 0.06, 3), fine = test::grid_tool();
  int num_touching = 0;
  num_touching += compare_hull(test::rough_scene(3, {}, random), small, random, true);
  num_touching += compare_hull(test::rough_scene(5, {}, random), small, random, false);
  num_touching += compare_hull(test::rough_scene(2, {}, random), fine, random, false);
  EXPECT_GT(num_touching, 4);
  num_touching = compare_hull(test::rough_memories(1, random, false), small, random, false, true);
  num_touching += compare_hull(test::rough_memories(2, random, true), small, random, false, true);
  EXPECT_GT(num_touching, 4);
}

TEST(MeasureNoiseCuda, OfCamerasIsUnknownIfThatOfAFrameIs) {
  PALPATE_GPU_OR_SKIP();
  Random random(31);
  const test::HullScene scene = test::rough_scene(2, {}, random);
  const Tool tool = test::random_tool(60, 0.06, 3);
  test::ContactQueries gpu = test::cuda_queries(tool);
  const Pose X_WT{{0, 0, 1.2}, {}};
  std::vector<SurfaceBlend> views = scene.views;
  views[0].from.field.noise = nullptr;
  EXPECT_TRUE(gpu.by(kCounted).measure(views, X_WT, {.noise = true}).noise);
  views[0].progress = 0.5;
  EXPECT_FALSE(gpu.by(kCounted).measure(views, X_WT, {.noise = true}).noise);
  // Nobody reads it who does not ask for it.
  const ContactResult want = gpu.by(kCounted).measure(views, X_WT);
  for (SurfaceBlend& view : views) {
    view.to.field.noise = view.from.field.noise = reinterpret_cast<const FrameNoise*>(64);
  }
  const ContactResult got = gpu.by(kCounted).measure(views, X_WT);
  EXPECT_EQ(got.penetration.volume, want.penetration.volume);
}

#if defined(PALPATE_EMULATE_CUDA)
TEST(MeasureNoiseCuda, WithoutMemoryForItOneQueryFails) {
  const auto kinds = test::kinds_of_noise();
  const FrozenField field(block_before_wall());
  SurfaceView surface = field.surface();
  surface.field.noise = &kinds[1];
  const Tool tool = test::random_tool(700, 0.06, 15);
  const auto make = [&](bool reserves_noise) {
    return make_contact_query_cuda(ToolIndex::create(tool), FieldMethod{}, 0, reserves_noise);
  };
  const auto query = make(false).value();
  const Pose X_WT{{0.02, 0, 0.6}, axis_angle({1, 2, 3}, 0.7)};
  const auto has_failed = [&](bool noise) {
    return query->measure(surface, X_WT, {.noise = noise})
        .penetration.status.has(StepStatus::backend_failed);
  };
  EXPECT_FALSE(has_failed(false));
  {
    const emulator::ShortMemory too_little(20000);
    EXPECT_TRUE(has_failed(true));
    EXPECT_FALSE(make(true)) << "it was to be there";
  }
  EXPECT_FALSE(has_failed(false));
  EXPECT_FALSE(has_failed(true));
  EXPECT_GT(query->measure(surface, X_WT, {.noise = true}).noise.value_or(MeasureNoise{}).volume,
            0);
}
#endif

TEST(MeasureNoiseCuda, HasTheSameBitsInAnyOrderOfThreads) {
  PALPATE_GPU_OR_SKIP();
  const auto kinds = test::kinds_of_noise();
  const FrozenField field(block_before_wall());
  SurfaceView surface = field.surface();
  surface.field.noise = &kinds[1];
  const Tool tool = test::random_tool(700, 0.06, 15);
  test::ContactQueries gpu = test::cuda_queries(tool);
  const Pose X_WT{{0.02, 0, 0.6}, axis_angle({1, 2, 3}, 0.7)};
  const auto said = [&](bool stiffness) {
    const auto result =
        gpu.by(kCounted).measure(surface, X_WT, {.stiffness = stiffness, .noise = true});
    return result.noise.value_or(MeasureNoise{});
  };
  const MeasureNoise want = said(false);
  EXPECT_GT(want.volume, 0);
  bool with_stiffness = false;
  test::in_all_orders([&] {
    with_stiffness = !with_stiffness;
    const MeasureNoise got = said(with_stiffness);
    EXPECT_EQ(std::memcmp(&got, &want, sizeof got), 0);
  });
}

// Far out of the image all that is solid touches.
TEST(MeasureNoiseCuda, AbsurdPosesReadNothingOutOfBounds) {
  PALPATE_GPU_OR_SKIP();
  const auto kinds = test::kinds_of_noise();
  const FrozenField field(test::noisy_wall(96, 72, 84, 0.6, 0.002, 1),
                          {.unknown = UnknownSpace::solid});
  SurfaceView surface = field.surface();
  surface.field.noise = &kinds[0];
  const Tool tool = test::random_tool(60, 0.05, 6);
  test::ContactQueries cpu(tool), gpu = test::cuda_queries(tool);
  for (const Vec3d& p : {Vec3d{1e6, 0, 1},
                         {0, 1e9, 1},
                         {1e3, -1e3, 0.7},
                         {0, 1e30, 1e30},
                         {0, 0, 1e300},
                         {0, 0, 0.03},
                         {0, 0, -1}}) {
    const auto said = [&](test::ContactQueries& queries) {
      return deviations_of(*queries.by(kCounted).measure(surface, {p, {}}, {.noise = true}).noise);
    };
    const auto want = said(cpu), got = said(gpu);
    for (std::size_t k = 0; k < want.size(); ++k) {
      EXPECT_EQ(std::isfinite(got[k]), std::isfinite(want[k])) << p.x << ' ' << p.z << ' ' << k;
    }
  }
}

TEST(MeasureNoiseCuda, WhatIsNoNumberStaysNone) {
  PALPATE_GPU_OR_SKIP();
  const FrozenField field(block_before_wall());
  SurfaceView surface = field.surface();
  FrameNoise broken = test::kinds_of_noise()[1];
  broken.base[0] = NAN;
  surface.field.noise = &broken;
  const Tool tool = test::random_tool(60, 0.05, 6);
  test::ContactQueries gpu = test::cuda_queries(tool);
  const auto said = gpu.by(kCounted).measure(surface, {{0, 0, 0.6}, {}}, {.noise = true}).noise;
  ASSERT_TRUE(said);
  for (const double each : deviations_of(*said)) EXPECT_TRUE(std::isnan(each));
}

TEST(MeasureNoiseCuda, UnknownNoiseIsNone) {
  PALPATE_GPU_OR_SKIP();
  const FrozenField field(test::noisy_wall(96, 72, 84, 0.6, 0.002, 1));
  const Tool tool = test::random_tool(60, 0.05, 6);
  test::ContactQueries gpu = test::cuda_queries(tool);
  const Pose X_WT{{0, 0, 0.6}, {}};
  EXPECT_FALSE(gpu.by(kCounted).measure(field.surface(), X_WT, {.noise = true}).noise);
  const ContactResult nothing = gpu.by(kCounted).measure(SurfaceView{}, X_WT, {.noise = true});
  EXPECT_EQ(nothing.noise.value_or(MeasureNoise{1}).volume, 0);
}

}  // namespace
}  // namespace palpate
