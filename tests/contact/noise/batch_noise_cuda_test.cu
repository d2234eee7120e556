// Standard deviations of batches and scenes on the GPU against the CPU's, and against themselves in
// other batches.
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/batch/field_batch.h"
#include "src/contact/batch/field_batch_cuda.h"
#if defined(PALPATE_EMULATE_CUDA)
#include "src/gpu/internal/short_memory.h"
#endif
#include "tests/contact/batch/batch_cases.h"
#include "tests/contact/noise/compared_noise.h"
#include "tests/contact/scene/answered_scene.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::PoseArgument;
using test::Random;

constexpr SphereVolumes kVolumes = SphereVolumes::represented;

/// Deviations of P poses, preset to what nobody writes.
struct Deviations {
  std::vector<double> numbers;
  explicit Deviations(std::size_t num) : numbers(7 * num, -7) {}

  BatchAnswers answers() {
    const std::size_t num = numbers.size() / 7;
    double* const at = numbers.data();
    return {.volume_std = at, .force_std = at + num, .torque_std = at + 4 * num};
  }
  std::array<double, 7> of(std::size_t i) const {
    const std::size_t num = numbers.size() / 7;
    const double *force = &numbers[num + 3 * i], *torque = &numbers[4 * num + 3 * i];
    return {numbers[i], force[0], force[1], force[2], torque[0], torque[1], torque[2]};
  }
};

Deviations answered(const BatchQuery& batches, const SurfaceBatch& surfaces,
                    const PoseBatch& poses) {
  Deviations got(poses.X_WT.size());
  const Status status = batches.measure(surfaces, poses, got.answers(), {});
  EXPECT_TRUE(status) << (status ? "" : status.error().message);
  return got;
}
FieldBatchCuda on_gpu(const Tool& tool, int max_staged = 1 << 16) {
  return FieldBatchCuda(ToolIndex::create(tool), FieldMethod{kVolumes}, 0, 0, max_staged);
}
FieldBatch on_cpu(const Tool& tool) {
  return FieldBatch(ToolIndex::create(tool), FieldMethod{kVolumes}, {});
}

/// Fields of a batch, each with a noise.
struct NoisyScenes {
  std::vector<test::FrozenField> fields = test::batch_scenes();
  std::array<FrameNoise, 4> kinds = test::kinds_of_noise();
  std::vector<SurfaceView> surfaces = test::surfaces_of(fields);

  NoisyScenes() {
    for (std::size_t k = 0; k < surfaces.size(); ++k) surfaces[k].field.noise = &kinds[k];
  }
};

bool is_same(const std::array<double, 7>& a, const std::array<double, 7>& b) {
  return std::memcmp(a.data(), b.data(), sizeof a) == 0;
}

TEST(BatchNoiseCuda, EqualsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  NoisyScenes scenes;
  std::vector<SurfaceView> surfaces = scenes.surfaces;
  surfaces.push_back({});
  for (const int num_spheres : {1, 33, 100, 4096}) {
    const Tool tool =
        num_spheres == 4096 ? test::grid_tool() : test::random_tool(num_spheres, 0.05, 3);
    const std::size_t num = num_spheres > 1000 ? 12 : 40;
    PoseArgument poses(static_cast<int>(num), static_cast<int>(surfaces.size()), 4);
    poses.X_WT[3].translation.x = NAN;
    poses.X_WT[5].translation.z = 1e300;
    poses.surface[8] = -1;
    for (std::size_t i = 9; i < num; ++i) {
      if (i % 3 != 0) poses.X_WT[i].translation.z = 0.55 + 0.004 * static_cast<double>(i % 20);
    }
    const Deviations want = answered(on_cpu(tool), surfaces, poses.batch());
    const Deviations got = answered(on_gpu(tool), surfaces, poses.batch());
    int num_touching = 0;
    for (std::size_t i = 0; i < num; ++i) {
      SCOPED_TRACE(testing::Message() << num_spheres << " spheres, pose " << i);
      if (i == 5) continue;
      test::expect_near(got.of(i), want.of(i));
      num_touching += want.of(i)[0] > 0;
    }
    EXPECT_TRUE(is_same(got.of(3), {})) << "not measured";
    EXPECT_TRUE(is_same(got.of(8), {})) << "no such surface";
    EXPECT_GT(num_touching, num_spheres > 1000 ? 1 : 8);
  }
}

TEST(BatchNoiseCuda, CamerasInTheWorldAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const NoisyScenes scenes;
  const Tool tool = test::random_tool(60, 0.05, 10);
  PoseArgument poses(30, 4, 11);
  Random random(12);
  std::vector<Pose> X_WC;
  for (int k = 0; k < 4; ++k) X_WC.push_back({random.in_box(2), random.rotation(3)});
  for (std::size_t i = 0; i < 30; ++i) {
    poses.X_WT[i].translation.z = 0.56 + 0.003 * static_cast<double>(i);
    poses.X_WT[i] = X_WC[static_cast<std::size_t>(poses.surface[i])] * poses.X_WT[i];
  }
  const PoseBatch requested{poses.X_WT, poses.surface, X_WC};
  const Deviations want = answered(on_cpu(tool), scenes.surfaces, requested);
  const Deviations got = answered(on_gpu(tool), scenes.surfaces, requested);
  int num_touching = 0;
  for (std::size_t i = 0; i < 30; ++i) {
    test::expect_near(got.of(i), want.of(i));
    num_touching += want.of(i)[0] > 0;
  }
  EXPECT_GT(num_touching, 10);
}

// In other batches and orders of threads, some poses at a time, and whatever else is asked.
TEST(BatchNoiseCuda, APoseIsAnsweredTheSameInAnyBatch) {
  PALPATE_GPU_OR_SKIP();
  const NoisyScenes scenes;
  const Tool tool = test::random_tool(200, 0.05, 7);
  constexpr std::size_t kNum = 16;
  PoseArgument poses(kNum, 4, 8);
  for (Pose& X_WT : poses.X_WT) X_WT.translation.z = 0.6;
  const FieldBatchCuda batches = on_gpu(tool), parts = on_gpu(tool, 5);
  const Deviations want = answered(batches, scenes.surfaces, poses.batch());
  PoseArgument reversed = poses;
  std::ranges::reverse(reversed.X_WT);
  std::ranges::reverse(reversed.surface);
  test::in_all_orders([&] {
    const Deviations got = answered(parts, scenes.surfaces, reversed.batch());
    for (std::size_t i = 0; i < kNum; ++i) {
      EXPECT_TRUE(is_same(got.of(i), want.of(kNum - 1 - i))) << i;
    }
  });
  test::Answers all(kNum), plain(kNum);
  Deviations beside(kNum);
  BatchAnswers requested = all.all();
  const BatchAnswers deviations = beside.answers();
  requested.volume_std = deviations.volume_std;
  requested.force_std = deviations.force_std;
  requested.torque_std = deviations.torque_std;
  ASSERT_TRUE(batches.measure(scenes.surfaces, poses.batch(), requested, {}));
  ASSERT_TRUE(batches.measure(scenes.surfaces, poses.batch(), plain.all(), {}));
  for (std::size_t i = 0; i < kNum; ++i) {
    EXPECT_TRUE(is_same(beside.of(i), want.of(i))) << i;
    EXPECT_TRUE(all.is_same(i, plain, i, true)) << i;
  }
}

// A noise that changes from frame to frame is read anew, and an unknown one is no number.
TEST(BatchNoiseCuda, NoiseChangesWithTheFrame) {
  PALPATE_GPU_OR_SKIP();
  NoisyScenes scenes;
  const Tool tool = test::random_tool(60, 0.05, 20);
  PoseArgument poses(6, 4, 21);
  for (std::size_t i = 0; i < 6; ++i) {
    poses.surface[i] = static_cast<std::int32_t>(i % 2);
    poses.X_WT[i].translation = {0, 0, 0.6};
  }
  const FieldBatchCuda batches = on_gpu(tool);
  const Deviations before = answered(batches, scenes.surfaces, poses.batch());
  for (float& base : scenes.kinds[0].base) base *= 2;
  scenes.surfaces[1].field.noise = nullptr;
  const Deviations after = answered(batches, scenes.surfaces, poses.batch());
  const Deviations on_host = answered(on_cpu(tool), scenes.surfaces, poses.batch());
  for (std::size_t i = 0; i < 6; i += 2) {
    EXPECT_GT(before.of(i)[0], 0);
    EXPECT_GT(after.of(i)[0], 1.5 * before.of(i)[0]);
    test::expect_near(after.of(i), on_host.of(i));
    EXPECT_TRUE(std::isnan(after.of(i + 1)[0]) && std::isnan(on_host.of(i + 1)[6]));
  }
}

// It does not become 0, which would say that the measure is exact.
TEST(BatchNoiseCuda, WhatIsNoNumberStaysNone) {
  PALPATE_GPU_OR_SKIP();
  NoisyScenes scenes;
  scenes.kinds[0].base[0] = NAN;
  const Tool tool = test::random_tool(60, 0.05, 20);
  const std::vector<Pose> poses{{{0, 0, 0.6}, {}}};
  const Deviations want = answered(on_cpu(tool), scenes.surfaces[0], {poses});
  const Deviations got = answered(on_gpu(tool), scenes.surfaces[0], {poses});
  for (std::size_t k = 0; k < 7; ++k) {
    EXPECT_TRUE(std::isnan(got.of(0)[k]) && std::isnan(want.of(0)[k])) << k;
  }
}

TEST(BatchNoiseCuda, CanBeRecordedOnceItsMemoryIsThere) {
  PALPATE_GPU_OR_SKIP();
  const NoisyScenes scenes;
  gpu::Stream caller(0, gpu::Priority::low);
  GpuFields copy(0);
  SurfaceView surface = scenes.surfaces[0];
  surface.field = copy.on_gpu(surface.field, caller);
  const Tool tool = test::random_tool(60, 0.05, 15);
  const FieldBatchCuda batches = on_gpu(tool);
  std::vector<Pose> poses(8);
  for (std::size_t i = 0; i < 8; ++i) poses[i].translation.z = 0.55 + 0.01 * static_cast<double>(i);
  gpu::Memory memory(0);
  auto* const numbers = memory.take<double>(7 * 8);
  const BatchAnswers there{
      .gpu = 0, .volume_std = numbers, .force_std = numbers + 8, .torque_std = numbers + 32};
  const PoseBatch requested{.X_WT = {memory.copy_of(poses), 8}, .gpu = 0};
  const CallerStream stream{caller.handle()};
  caller.begin_recording();
  const Status early = batches.measure(surface, requested, there, stream);
  caller.end_recording();
  ASSERT_FALSE(early);
  EXPECT_NE(early.error().message.find("measure them once before"), std::string::npos);
  const Deviations want = answered(batches, surface, {poses});
  caller.begin_recording();
  ASSERT_TRUE(batches.measure(surface, requested, there, stream));
  const gpu::Graph graph = caller.end_recording();
  caller.launch(graph);
  Deviations got(8);
  caller.copy(got.numbers.data(), numbers, 7 * 8 * sizeof(double));
  ASSERT_TRUE(caller.wait());
  EXPECT_EQ(got.numbers, want.numbers);
  EXPECT_GT(got.of(7)[0], 0);
}

#if defined(PALPATE_EMULATE_CUDA)
// A call waits for as long as its work may take, so much longer if few blocks share it.
TEST(BatchNoiseCuda, FewBlocksForWantOfMemoryHaveMoreTime) {
  const std::size_t of_block = 4 * rows_of_part(100, 4) * kNumNoiseRows * sizeof(float);
  BatchRows rows;
  ASSERT_TRUE(rows.take(0, 100, 4, 10));
  EXPECT_EQ(rows.num_blocks(), 10);
  EXPECT_EQ(rows.slowdown(), 1);
  const emulator::ShortMemory two_blocks(8 * 2 * of_block);
  ASSERT_TRUE(rows.take(0, 100, 4, 10));
  EXPECT_EQ(rows.num_blocks(), 2);
  EXPECT_EQ(rows.slowdown(), 5);
}
#endif

/// Compares poses in a scene; returns how many have a deviation.
int compare(const Scene& scene, const Tool& tool, const std::vector<Pose>& poses) {
  const Tool* const tools[] = {&tool};
  const test::Both both(tools);
  Deviations want(poses.size()), got(poses.size()), alone(1);
  EXPECT_TRUE(both.cpu.measure(scene, {poses}, {.contact = want.answers()}));
  const Status status = both.gpu.measure(scene, {poses}, {.contact = got.answers()});
  EXPECT_TRUE(status) << (status ? "" : status.error().message);
  int num_touching = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    SCOPED_TRACE(i);
    test::expect_near(got.of(i), want.of(i));
    num_touching += want.of(i)[0] > 0;
    if (i % 4 != 0) continue;
    EXPECT_TRUE(both.gpu.measure(scene, {{&poses[i], 1}}, {.contact = alone.answers()}));
    EXPECT_TRUE(is_same(alone.of(0), got.of(i)));
  }
  return num_touching;
}
std::vector<Pose> poses_of(int num, Random& random) {
  std::vector<Pose> poses;
  for (int i = 0; i < num; ++i) {
    const double x = random.uniform(-0.2, 0.2), y = random.uniform(-0.1, 0.1);
    poses.push_back({{x, y, random.uniform(0.9, 1.4)}, random.rotation(3)});
  }
  poses[1].translation.y = NAN;
  return poses;
}

TEST(BatchNoiseCuda, ScenesAsOnTheCpu) {
  PALPATE_GPU_OR_SKIP();
  Random random(31);
  const Tool tool = test::random_tool(60, 0.05, 3);
  const Tool box =
      Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 50}).value().with_solid_field();
  const std::vector<Body> bodies{Body(box, {{0, 0, 1.1}, {}})};
  const test::HullScene three = test::rough_scene(3, {}, random),
                        five = test::rough_scene(5, {}, random),
                        one = test::rough_scene(1, {}, random),
                        memory = test::rough_memories(1, random, false);
  int num_touching = 0;
  num_touching += compare({.surfaces = test::surfaces_of(three)}, tool, poses_of(12, random));
  num_touching +=
      compare({.surfaces = test::surfaces_of(five), .bodies = bodies}, tool, poses_of(12, random));
  num_touching +=
      compare({.surfaces = test::surfaces_of(one), .bodies = bodies}, tool, poses_of(12, random));
  num_touching += compare({.surfaces = test::surfaces_of(one)}, tool, poses_of(12, random));
  num_touching += compare({.surfaces = test::surfaces_of(memory)}, tool, poses_of(12, random));
  EXPECT_GT(num_touching, 25);
  EXPECT_EQ(compare({.bodies = bodies}, tool, poses_of(4, random)), 0) << "bodies have no noise";
}

// On a GPU the work of the first calls still runs when the last one has no stream.
TEST(BatchNoiseCuda, CallsWithAndWithoutAStreamDoNotDisturbEachOther) {
  PALPATE_GPU_OR_SKIP();
  Random random(35);
  const Tool tool = test::random_tool(60, 0.05, 3);
  const Tool* const tools[] = {&tool};
  const SceneContact contact = test::scenes_on_gpu(tools);
  const test::HullScene three = test::rough_scene(3, {}, random);
  const Scene scene{.surfaces = test::surfaces_of(three)};
  const std::vector<Pose> first = poses_of(12, random), last = poses_of(12, random);
  Deviations want_first(12), want_last(12), got_first(12), got_last(12);
  ASSERT_TRUE(contact.measure(scene, {first}, {.contact = want_first.answers()}));
  ASSERT_TRUE(contact.measure(scene, {last}, {.contact = want_last.answers()}));
  gpu::Stream stream(0, gpu::Priority::low);
  gpu::Memory memory(0);
  const Pose* const X_WT = memory.copy_of(first);
  auto* const numbers = memory.take<double>(7 * 12);
  const BatchAnswers there{
      .gpu = 0, .volume_std = numbers, .force_std = numbers + 12, .torque_std = numbers + 48};
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(contact.measure(scene, {.X_WT = {X_WT, 12}, .gpu = 0}, {.contact = there},
                                CallerStream{stream.handle()}));
  }
  ASSERT_TRUE(contact.measure(scene, {last}, {.contact = got_last.answers()}));
  stream.copy(got_first.numbers.data(), numbers, 7 * 12 * sizeof(double));
  ASSERT_TRUE(stream.wait());
  for (std::size_t i = 0; i < 12; ++i) {
    EXPECT_TRUE(is_same(got_first.of(i), want_first.of(i))) << i;
    EXPECT_TRUE(is_same(got_last.of(i), want_last.of(i))) << i;
  }
}

}  // namespace
}  // namespace palpate
