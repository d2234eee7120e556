// Batches on the GPU: against the CPU's, against the definition in double, against themselves in
// other orders, sizes and places.
#include <algorithm>
#include <cmath>
#include <numeric>

#include <gtest/gtest.h>

#include "src/contact/batch/field_batch.h"
#include "src/contact/batch/field_batch_cuda.h"
#include "tests/contact/batch/batch_cases.h"
#include "tests/test_util/field_truth.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::Answers;
using test::PoseArgument;
using test::Random;

FieldBatchCuda batches_of(const Tool& tool, SphereVolumes volumes = {}, int num_warps = 0) {
  return FieldBatchCuda(ToolIndex::create(tool), FieldMethod{volumes}, 0, num_warps);
}
Answers answered_by(const BatchQuery& batches, const SurfaceBatch& surfaces,
                    const PoseArgument& poses, bool with_stiffness = true) {
  Answers got(poses.X_WT.size());
  const Status status = batches.measure(surfaces, poses.batch(),
                                        with_stiffness ? got.all() : got.without_stiffness(), {});
  EXPECT_TRUE(status) << status.error().message;
  return got;
}

/// Arrays on the GPU.
struct OnGpu {
  gpu::Memory memory{0};
  gpu::Stream stream{0, gpu::Priority::low};
  std::size_t num;
  PoseBatch poses;
  BatchAnswers answers;

  explicit OnGpu(const PoseArgument& requested) : num(requested.X_WT.size()) {
    poses.X_WT = {memory.copy_of(requested.X_WT), num};
    poses.surface_of_pose = {memory.copy_of(requested.surface), num};
    poses.gpu = 0;
    answers = {memory.take<double>(num),
               memory.take<double>(num),
               memory.take<double>(3 * num),
               memory.take<double>(3 * num),
               memory.take<double>(36 * num),
               memory.take<std::uint32_t>(num),
               0};
  }
  Answers answered() {
    Answers got(num);
    const auto copy = [&](auto& to, const auto* from) {
      stream.copy(to.data(), from, to.size() * sizeof(to[0]));
    };
    copy(got.volume, answers.volume);
    copy(got.potential, answers.potential);
    copy(got.force, answers.force);
    copy(got.torque, answers.torque);
    copy(got.stiffness, answers.stiffness);
    copy(got.status, answers.status);
    EXPECT_TRUE(stream.wait());
    return got;
  }
};

void expect_near(const Answers& got, std::size_t i, const Answers& want, double scale,
                 double tolerance = 1e-5) {
  EXPECT_EQ(got.status[i], want.status[i]);
  const double part = tolerance * (want.volume[i] + 1e-4 * scale), lever = 0.1;
  EXPECT_NEAR(got.volume[i], want.volume[i], part);
  EXPECT_NEAR(got.potential[i], want.potential[i],
              tolerance * (std::abs(want.potential[i]) + 1e-4 * scale));
  EXPECT_LE(norm(got.force_of(i) - want.force_of(i)), part);
  EXPECT_LE(norm(got.torque_of(i) - want.torque_of(i)), lever * part);
}
void expect_near_stiffness(const Answers& got, std::size_t i, const Answers& want) {
  double largest = 0;
  for (std::size_t k = 36 * i; k < 36 * i + 36; ++k) {
    largest = std::max(largest, std::abs(want.stiffness[k]));
  }
  for (std::size_t k = 36 * i; k < 36 * i + 36; ++k) {
    // An element on the edge of a pixel has the second derivatives of either side: one in a
    // thousand.
    EXPECT_NEAR(got.stiffness[k], want.stiffness[k], 2e-3 * largest + 1e-9);
  }
}

// 1 and 33: padding, and spheres so large that they are felt in parts; 3000: several turns of all
// warps.
TEST(ContactBatchCuda, EqualsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const auto scenes = test::batch_scenes();
  std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  surfaces.push_back({});
  for (const int num_spheres : {1, 33, 100, 3000}) {
    const Tool tool = test::random_tool(num_spheres, 0.05, 3);
    const std::size_t num = num_spheres > 1000 ? 30 : 80;
    PoseArgument poses(static_cast<int>(num), static_cast<int>(surfaces.size()), 4);
    poses.X_WT[3].translation.x = NAN;
    poses.X_WT[4].rotation.y = INFINITY;
    poses.X_WT[5].translation.z = 1e300;
    poses.X_WT[6].translation.x = 1e9;
    poses.surface[7] = 5;
    poses.surface[8] = -1;
    for (const SphereVolumes volumes : {SphereVolumes::own, SphereVolumes::represented}) {
      const FieldBatch cpu(ToolIndex::create(tool), FieldMethod{volumes}, {});
      const Answers want = answered_by(cpu, surfaces, poses);
      const Answers got = answered_by(batches_of(tool, volumes), surfaces, poses);
      const Answers plain = answered_by(batches_of(tool, volumes), surfaces, poses, false);
      int num_touching = 0, num_unmeasured = 0;
      for (std::size_t i = 0; i < num; ++i) {
        SCOPED_TRACE(i);
        expect_near(got, i, want, full_volume(tool, volumes));
        expect_near(plain, i, want, full_volume(tool, volumes));
        expect_near_stiffness(got, i, want);
        EXPECT_EQ(plain.stiffness[36 * i], -7);
        num_touching += want.volume[i] > 0;
        num_unmeasured += want.status[i] != 0;
        if (want.status[i] != 0) {
          EXPECT_TRUE(got.is_same(i, want, i, true));
        }
      }
      EXPECT_GT(num_touching, 8);
      EXPECT_GE(num_unmeasured, 5);
    }
  }
}

TEST(ContactBatchCuda, IsTheDefinition) {
  PALPATE_GPU_OR_SKIP();
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(200, 0.05, 5);
  const PoseArgument poses(60, static_cast<int>(surfaces.size()), 6);
  const Answers got =
      answered_by(batches_of(tool, SphereVolumes::represented), surfaces, poses, false);
  const double scale = full_volume(tool, SphereVolumes::represented);
  for (std::size_t i = 0; i < poses.X_WT.size(); ++i) {
    const auto& field = surfaces[static_cast<std::size_t>(poses.surface[i])].field;
    const Penetration want =
        test::field_truth(tool, field, poses.X_WT[i], SphereVolumes::represented);
    EXPECT_NEAR(got.volume[i], want.volume, 2e-5 * scale);
    EXPECT_NEAR(got.potential[i], want.potential, 2e-6 * scale);
    EXPECT_LT(norm(got.force_of(i) - want.measure_W.force), 1e-4 * scale);
    EXPECT_LT(norm(got.torque_of(i) - want.measure_W.torque), 1e-5 * scale);
  }
}

TEST(ContactBatchCuda, APoseIsAnsweredTheSameInAnyBatchAndPlace) {
  PALPATE_GPU_OR_SKIP();
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  for (const int num_spheres : {60, 1200}) {
    const Tool tool = test::random_tool(num_spheres, 0.05, 7);
    const std::size_t num = num_spheres > 1000 ? 12 : 40;
    const PoseArgument poses(static_cast<int>(num), static_cast<int>(surfaces.size()), 8);
    const FieldBatchCuda batches = batches_of(tool);
    const Answers want = answered_by(batches, surfaces, poses);
    PoseArgument reversed = poses;
    std::reverse(reversed.X_WT.begin(), reversed.X_WT.end());
    std::reverse(reversed.surface.begin(), reversed.surface.end());
    reversed.X_WT.resize(num / 2);
    reversed.surface.resize(num / 2);
    test::in_all_orders([&] {
      const Answers got = answered_by(batches, surfaces, reversed);
      for (std::size_t i = 0; i < num / 2; ++i) {
        EXPECT_TRUE(got.is_same(i, want, num - 1 - i, true)) << i;
      }
      OnGpu there(poses);
      ASSERT_TRUE(batches.measure(surfaces, there.poses, there.answers, {}));
      const Answers same = there.answered();
      for (std::size_t i = 0; i < num; ++i) EXPECT_TRUE(same.is_same(i, want, i, true)) << i;
    });
  }
}

TEST(ContactBatchCuda, CamerasInTheWorldAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(100, 0.05, 10);
  PoseArgument poses(60, static_cast<int>(surfaces.size()), 11);
  Random random(12);
  std::vector<Pose> X_WC;
  for (std::size_t k = 0; k < surfaces.size(); ++k) {
    X_WC.push_back({random.in_box(2), random.rotation(3)});
  }
  for (std::size_t i = 0; i < 60; ++i) {
    poses.X_WT[i] = X_WC[static_cast<std::size_t>(poses.surface[i])] * poses.X_WT[i];
  }
  const FieldBatch cpu(ToolIndex::create(tool), {}, {});
  Answers want(60), got(60);
  const PoseBatch requested{poses.X_WT, poses.surface, X_WC};
  ASSERT_TRUE(cpu.measure(surfaces, requested, want.all(), {}));
  ASSERT_TRUE(
      batches_of(tool, SphereVolumes::represented).measure(surfaces, requested, got.all(), {}));
  for (std::size_t i = 0; i < 60; ++i) {
    expect_near(got, i, want, full_volume(tool, SphereVolumes::represented));
    expect_near_stiffness(got, i, want);
  }
}

// Tools of many clusters have a kernel of their own, which measures what lies deep as one ball.
TEST(ContactBatchCuda, ClustersThatLieDeepCountAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  constexpr SphereVolumes kVolumes = SphereVolumes::represented;
  const Tool tool = test::grid_tool();
  PoseArgument poses(16, static_cast<int>(surfaces.size()), 21);
  for (std::size_t i = 0; i < 16; ++i) {
    poses.X_WT[i].translation = {0.01, -0.01, 0.6 + 0.008 * static_cast<double>(i)};
  }
  const Answers want =
      answered_by(FieldBatch(ToolIndex::create(tool), FieldMethod{kVolumes}, {}), surfaces, poses);
  const Answers got = answered_by(batches_of(tool, kVolumes), surfaces, poses);
  const Answers plain = answered_by(batches_of(tool, kVolumes), surfaces, poses, false);
  for (std::size_t i = 0; i < 16; ++i) {
    expect_near(got, i, want, full_volume(tool, kVolumes), 5e-5);
    expect_near(plain, i, want, full_volume(tool, kVolumes), 5e-5);
    expect_near_stiffness(got, i, want);
  }
}

// Any number of warps gives what the definition says, if not the same bits.
TEST(ContactBatchCuda, ABlockMayHaveAnyNumberOfWarps) {
  PALPATE_GPU_OR_SKIP();
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(1300, 0.05, 13);
  const PoseArgument poses(10, static_cast<int>(surfaces.size()), 14);
  const Answers want = answered_by(FieldBatch(ToolIndex::create(tool), {}, {}), surfaces, poses);
  for (const int num_warps : {1, 3, 8, 20}) {
    const Answers got =
        answered_by(batches_of(tool, SphereVolumes::represented, num_warps), surfaces, poses);
    for (std::size_t i = 0; i < 10; ++i) {
      expect_near(got, i, want, full_volume(tool, SphereVolumes::represented));
      expect_near_stiffness(got, i, want);
    }
  }
}

TEST(ContactBatchCuda, CanBeRecordedAndReadsWhatIsThereThen) {
  PALPATE_GPU_OR_SKIP();
  const auto scenes = test::batch_scenes();
  std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  gpu::Stream caller(0, gpu::Priority::low);
  GpuFields copies[] = {GpuFields(0), GpuFields(0), GpuFields(0), GpuFields(0)};
  for (std::size_t k = 0; k < surfaces.size(); ++k) {
    surfaces[k].field = copies[k].on_gpu(surfaces[k].field, caller);
  }
  const Tool tool = test::random_tool(60, 0.05, 15);
  const FieldBatchCuda batches = batches_of(tool);
  const PoseArgument first(20, 4, 16), second(20, 4, 17);
  const Answers want = answered_by(batches, surfaces, second);
  OnGpu there(first);
  const CallerStream stream{caller.handle()};
  // Not yet seen by this query.
  const FieldBatchCuda unprepared = batches_of(tool);
  caller.begin_recording();
  EXPECT_FALSE(unprepared.measure(surfaces, there.poses, there.answers, stream));
  caller.end_recording();
  ASSERT_TRUE(caller.status());
  // Nor are arrays in host memory ones that a replay could read.
  caller.begin_recording();
  Answers on_host(20);
  EXPECT_FALSE(batches.measure(surfaces, first.batch(), on_host.all(), stream));
  caller.end_recording();

  caller.begin_recording();
  ASSERT_TRUE(batches.measure(surfaces, there.poses, there.answers, stream));
  const gpu::Graph graph = caller.end_recording();
  EXPECT_EQ(there.answered().volume[0], 0) << "not yet done";
  caller.copy(const_cast<Pose*>(there.poses.X_WT.data()), second.X_WT.data(), 20 * sizeof(Pose));
  caller.copy(const_cast<std::int32_t*>(there.poses.surface_of_pose.data()), second.surface.data(),
              20 * sizeof(std::int32_t));
  caller.launch(graph);
  ASSERT_TRUE(caller.wait()) << caller.status().error().message;
  const Answers got = there.answered();
  for (std::size_t i = 0; i < 20; ++i) EXPECT_TRUE(got.is_same(i, want, i, true)) << i;
}

TEST(ContactBatchCuda, SurfacesAtEqualDistancesAreThoseOfATable) {
  PALPATE_GPU_OR_SKIP();
  // Two fields of one size in one memory: the second one's arrays so far behind the first one's.
  const test::FrozenField scenes[] = {
      test::FrozenField(test::noisy_wall(64, 48, 60, 0.75, 0.002, 1)),
      test::FrozenField(test::noisy_wall(64, 48, 60, 0.55, 0.002, 2))};
  gpu::Stream stream(0, gpu::Priority::low);
  gpu::Memory memory(0);
  const DepthFieldLevel& finest = scenes[0].field.view().levels[0];
  const DepthFieldLevel& widest =
      scenes[0].field.view().levels[scenes[0].field.view().num_levels - 1];
  constexpr std::ptrdiff_t kBorder = DepthFieldLevel::kBorder;
  const std::ptrdiff_t before = kBorder * (finest.stride + 1);
  const std::ptrdiff_t num = before + (widest.near_silhouette - finest.near_silhouette) +
                             (widest.height + kBorder) * finest.stride - kBorder;
  const std::ptrdiff_t num_tiles =
      scenes[0].field.view().tiles_wide * scenes[0].field.view().tiles_high;
  const auto size = static_cast<std::size_t>(num);
  auto* const planes = memory.take<float>(4 * size);
  auto* const silhouettes = memory.take<Silhouette>(4 * size);
  auto* const near_silhouette = memory.take<std::uint8_t>(2 * size);
  auto* const tiles = memory.take<DepthTile>(2 * static_cast<std::size_t>(num_tiles));
  for (int k = 0; k < 2; ++k) {
    const DepthFieldView& from = scenes[k].field.view();
    const DepthFieldLevel& level = from.levels[0];
    stream.copy(planes + 2 * k * num, level.planes - 2 * before, 2 * size * sizeof(float));
    stream.copy(silhouettes + 2 * k * num, level.silhouettes - 2 * before,
                2 * size * sizeof(Silhouette));
    stream.copy(near_silhouette + k * num, level.near_silhouette - before, size);
    stream.copy(tiles + k * num_tiles, from.tiles,
                static_cast<std::size_t>(num_tiles) * sizeof(DepthTile));
  }
  ASSERT_TRUE(stream.wait());
  DepthFieldView first = scenes[0].field.view();
  for (int k = 0; k < first.num_levels; ++k) {
    DepthFieldLevel& level = first.levels[k];
    level.planes = planes + 2 * before + (level.planes - finest.planes);
    level.silhouettes = silhouettes + 2 * before + (level.silhouettes - finest.silhouettes);
    level.near_silhouette =
        near_silhouette + before + (level.near_silhouette - finest.near_silhouette);
  }
  first.tiles = tiles;
  first.gpu = 0;
  const Tool tool = test::random_tool(60, 0.05, 18);
  const FieldBatchCuda batches = batches_of(tool);
  const PoseArgument poses(30, 2, 19);
  const std::vector<SurfaceView> apart{{{}, scenes[0].field.view()}, {{}, scenes[1].field.view()}};
  const Answers want = answered_by(batches, apart, poses);
  const Answers got = answered_by(batches, SurfaceBatch(first, 2, num, num_tiles), poses);
  for (std::size_t i = 0; i < 30; ++i) EXPECT_TRUE(got.is_same(i, want, i, true)) << i;
  EXPECT_GT(*std::max_element(got.volume.begin(), got.volume.end()), 0);
}

TEST(ContactBatchCuda, PosesInHostMemoryComeSomeAtATime) {
  PALPATE_GPU_OR_SKIP();
  const auto scenes = test::batch_scenes();
  const Tool tool = test::random_tool(40, 0.05, 24);
  const PoseArgument poses(23, 4, 25);
  // Each its own, or numbered.
  std::vector<SurfaceView> surfaces;
  for (const std::int32_t number : poses.surface) {
    surfaces.push_back({{}, scenes[static_cast<std::size_t>(number)].field.view()});
  }
  const FieldBatchCuda whole = batches_of(tool);
  const FieldBatchCuda parts(ToolIndex::create(tool), FieldMethod{SphereVolumes::own}, 0, 0, 7);
  const Answers want = answered_by(whole, test::surfaces_of(scenes), poses);
  const Answers numbered = answered_by(parts, test::surfaces_of(scenes), poses);
  Answers own(23);
  ASSERT_TRUE(parts.measure(surfaces, {poses.X_WT, {}, {}}, own.all(), {}));
  for (std::size_t i = 0; i < 23; ++i) {
    EXPECT_TRUE(numbered.is_same(i, want, i, true)) << i;
    EXPECT_TRUE(own.is_same(i, want, i, true)) << i;
  }
}

TEST(ContactBatchCuda, LooksAgainAtSurfacesThatChanged) {
  PALPATE_GPU_OR_SKIP();
  auto scenes = test::batch_scenes();
  std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(60, 0.05, 20);
  const FieldBatchCuda batches = batches_of(tool);
  ASSERT_TRUE(batches.reserve(4, 10));
  const PoseArgument poses(25, 4, 21);
  const Answers before = answered_by(batches, surfaces, poses);
  std::swap(surfaces[0], surfaces[1]);
  const Answers swapped = answered_by(batches, surfaces, poses);
  PoseArgument renamed = poses;
  for (std::int32_t& number : renamed.surface) number = number < 2 ? 1 - number : number;
  const Answers back = answered_by(batches, surfaces, renamed);
  bool is_any_other = false;
  for (std::size_t i = 0; i < 25; ++i) {
    EXPECT_TRUE(back.is_same(i, before, i, true)) << i;
    is_any_other |= !swapped.is_same(i, before, i, true);
  }
  EXPECT_TRUE(is_any_other);
}

TEST(ContactBatchCuda, WhatDoesNotFitIsRefused) {
  PALPATE_GPU_OR_SKIP();
  auto scenes = test::batch_scenes();
  std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(20, 0.05, 22);
  const FieldBatchCuda batches = batches_of(tool);
  const PoseArgument poses(7, 4, 23);
  Answers got(7);
  const auto expect_refused = [&](const SurfaceBatch& requested, const PoseBatch& batch,
                                  const BatchAnswers& answers, const char* words) {
    const Status status = batches.measure(requested, batch, answers, {});
    ASSERT_FALSE(status);
    EXPECT_NE(status.error().message.find(words), std::string::npos) << status.error().message;
    EXPECT_EQ(got.volume[0], -7);
  };
  expect_refused(surfaces, {poses.X_WT, {}, {}}, got.all(), "7 poses was given 4 surfaces");
  expect_refused(surfaces, {poses.X_WT, poses.surface, {}, 3}, got.all(), "GPU 3");
  ThreadPool pool(1);
  scenes[2].field.update(scenes[2].cloud.view(), pool, {0, 0, 10, 10});
  surfaces[2].field = scenes[2].field.view();
  expect_refused(surfaces, poses.batch(), got.all(), "surface 2 of a batch on a GPU was made");
}

}  // namespace
}  // namespace palpate
