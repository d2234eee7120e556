// Batches on the CPU: against single measurements to the bit, against the definition in double, and
// against themselves in other orders and sizes.
#include "palpate/contact/contact.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <gtest/gtest.h>

#include "palpate/packing/packing.h"
#include "tests/contact/batch/batch_cases.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/field_truth.h"

namespace palpate {
namespace {

using test::Answers;
using test::PoseArgument;
using test::Random;

std::unique_ptr<BatchQuery> batches_of(const Tool& tool, SphereVolumes volumes = {},
                                       ThreadPool* pool = nullptr, Isa isa = best_isa()) {
  return make_batch_query(Place::cpu(), ToolIndex::create(tool), FieldMethod{volumes}, {isa, pool})
      .value();
}

void expect_measured(const Answers& got, std::size_t i, const ContactResult& want) {
  const Penetration& measured = want.penetration;
  EXPECT_EQ(got.status[i], measured.status.bits);
  EXPECT_EQ(got.volume[i], measured.volume);
  EXPECT_EQ(got.potential[i], measured.potential);
  EXPECT_EQ(got.force_of(i), measured.measure_W.force);
  EXPECT_EQ(got.torque_of(i), measured.measure_W.torque);
  EXPECT_EQ(std::memcmp(&got.stiffness[36 * i], want.stiffness->m, 36 * sizeof(double)), 0);
}

// 1 and 33: padding, and spheres so large that they are felt in parts; 1500: several groups.
TEST(ContactBatch, IsManyMeasurementsToTheBit) {
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  for (const int num_spheres : {1, 33, 100, 1500}) {
    const Tool tool = test::random_tool(num_spheres, 0.05, 3);
    const PoseArgument poses(150, static_cast<int>(surfaces.size()), 4);
    for (const SphereVolumes volumes : {SphereVolumes::own, SphereVolumes::represented}) {
      for (const Isa isa : {Isa::baseline, best_isa()}) {
        Answers got(150);
        ASSERT_TRUE(
            batches_of(tool, volumes, nullptr, isa)->measure(surfaces, poses.batch(), got.all()));
        const auto query = make_contact_query(Place::cpu(), tool, FieldMethod{volumes}).value();
        int num_touching = 0;
        for (std::size_t i = 0; i < 150; ++i) {
          const auto surface = static_cast<std::size_t>(poses.surface[i]);
          const ContactResult want =
              query->measure(surfaces[surface], poses.X_WT[i], {.stiffness = true});
          expect_measured(got, i, want);
          num_touching += want.penetration.volume > 0;
        }
        EXPECT_GT(num_touching, 20);
        EXPECT_LT(num_touching, 140);
      }
    }
  }
}

// Its origin is 0.3 m in front of everything while its spheres are in it.
TEST(ContactBatch, AToolMayLieFarFromItsOrigin) {
  const auto scenes = test::batch_scenes();
  const SurfaceView surface{{}, scenes[0].field.view()};
  TriangleMesh mesh = make_box({0.02, 0.016, 0.08});
  for (Vec3d& vertex : mesh.vertices) vertex.z += 0.3;
  const Tool tool = Tool::pack(std::move(mesh), {.max_spheres = 50}).value();
  std::vector<Pose> X_WT;
  for (int i = 0; i < 64; ++i) X_WT.push_back({{0, 0, 0.2 + 0.002 * i}, {}});
  Answers got(64);
  ASSERT_TRUE(batches_of(tool, SphereVolumes::represented)->measure(surface, {X_WT}, got.all()));
  const auto query = make_contact_query(Place::cpu(), tool).value();
  int num_touching = 0;
  for (std::size_t i = 0; i < 64; ++i) {
    const ContactResult want = query->measure(surface, X_WT[i], {.stiffness = true});
    expect_measured(got, i, want);
    num_touching += want.penetration.volume > 0;
  }
  EXPECT_GT(num_touching, 10);
  EXPECT_LT(num_touching, 60);
}

TEST(ContactBatch, IsTheDefinition) {
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(200, 0.05, 5);
  const PoseArgument poses(100, static_cast<int>(surfaces.size()), 6);
  Answers got(100);
  ASSERT_TRUE(batches_of(tool, SphereVolumes::represented)
                  ->measure(surfaces, poses.batch(), got.without_stiffness()));
  const double scale = full_volume(tool, SphereVolumes::represented);
  for (std::size_t i = 0; i < 100; ++i) {
    const auto& field = surfaces[static_cast<std::size_t>(poses.surface[i])].field;
    const Penetration want =
        test::field_truth(tool, field, poses.X_WT[i], SphereVolumes::represented);
    EXPECT_NEAR(got.volume[i], want.volume, 2e-5 * scale);
    EXPECT_NEAR(got.potential[i], want.potential, 2e-6 * scale);
    EXPECT_LT(norm(got.force_of(i) - want.measure_W.force), 1e-4 * scale);
    EXPECT_LT(norm(got.torque_of(i) - want.measure_W.torque), 1e-5 * scale);
    EXPECT_EQ(got.stiffness[36 * i], -7) << "was not wanted";
  }
}

TEST(ContactBatch, APoseIsAnsweredTheSameInAnyBatch) {
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(100, 0.05, 7);
  constexpr std::size_t kNum = 500;
  const PoseArgument poses(kNum, static_cast<int>(surfaces.size()), 8);
  Answers want(kNum);
  ASSERT_TRUE(batches_of(tool)->measure(surfaces, poses.batch(), want.all()));
  std::vector<std::size_t> order(kNum);
  std::iota(order.begin(), order.end(), 0);
  Random random(9);
  for (std::size_t i = kNum - 1; i > 0; --i) std::swap(order[i], order[random.bits() % (i + 1)]);
  for (const int num_threads : {1, 2, 5}) {
    ThreadPool pool(num_threads);
    const auto batches = batches_of(tool, {}, &pool);
    for (const std::size_t size : {std::size_t{1}, std::size_t{63}, std::size_t{65}, kNum}) {
      PoseArgument some;
      for (std::size_t i = 0; i < size; ++i) {
        some.X_WT.push_back(poses.X_WT[order[i]]);
        some.surface.push_back(poses.surface[order[i]]);
      }
      Answers got(size);
      ASSERT_TRUE(batches->measure(surfaces, some.batch(), got.all()));
      for (std::size_t i = 0; i < size; ++i) EXPECT_TRUE(got.is_same(i, want, order[i], true)) << i;
    }
  }
}

TEST(ContactBatch, WithCamerasInTheWorldItIsTheSameInTheirFrames) {
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(100, 0.05, 10);
  PoseArgument poses(200, static_cast<int>(surfaces.size()), 11);
  Answers in_camera(200), in_world(200);
  const auto batches = batches_of(tool);
  ASSERT_TRUE(batches->measure(surfaces, poses.batch(), in_camera.all()));
  Random random(12);
  std::vector<Pose> X_WC;
  for (std::size_t k = 0; k < surfaces.size(); ++k) {
    X_WC.push_back({random.in_box(2), random.rotation(3)});
  }
  const auto camera = [&](std::size_t i) {
    return X_WC[static_cast<std::size_t>(poses.surface[i])];
  };
  for (std::size_t i = 0; i < 200; ++i) poses.X_WT[i] = camera(i) * poses.X_WT[i];
  ASSERT_TRUE(batches->measure(surfaces, {poses.X_WT, poses.surface, X_WC}, in_world.all()));
  const double scale = full_volume(tool, SphereVolumes::own);
  const auto rotated = [&](std::size_t i, const Vec3d& v) { return rotate(camera(i).rotation, v); };
  for (std::size_t i = 0; i < 200; ++i) {
    EXPECT_NEAR(in_world.volume[i], in_camera.volume[i], 1e-6 * scale);
    EXPECT_LT(norm(in_world.force_of(i) - rotated(i, in_camera.force_of(i))), 1e-5 * scale);
    EXPECT_LT(norm(in_world.torque_of(i) - rotated(i, in_camera.torque_of(i))), 1e-6 * scale);
    // The wrench that a motion changes: turned before or after.
    for (int part = 0; part < 4; ++part) {
      const Vec3d along{0.3, -0.5, 0.8}, along_C = rotate(conjugate(camera(i).rotation), along);
      const auto block = [&](const Answers& a, const Vec3d& v) {
        Vec3d sum;
        for (int row = 0; row < 3; ++row) {
          for (int column = 0; column < 3; ++column) {
            const int at = 6 * (row + 3 * (part / 2)) + column + 3 * (part % 2);
            sum[row] += a.stiffness[36 * i + static_cast<std::size_t>(at)] * v[column];
          }
        }
        return sum;
      };
      const Vec3d want = rotated(i, block(in_camera, along_C));
      // Second derivatives jump between pixels.
      EXPECT_LT(norm(block(in_world, along) - want), 2e-2 * norm(want) + 1e-4 * scale);
    }
  }
}

TEST(ContactBatch, WhatCannotBeMeasuredIsZeroAndSaysWhy) {
  auto scenes = test::batch_scenes();
  std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  surfaces.push_back({});  // without a field
  ThreadPool pool(1);
  scenes[0].field.update(scenes[0].cloud.view(), pool, {0, 0, 40, 40});
  surfaces[0].field = scenes[0].field.view();
  const Tool tool = test::random_tool(50, 0.05, 13);
  const Pose inside{{0, 0, 0.62}, {}};
  Pose none = inside, none_turned = inside;
  none.translation.y = std::numeric_limits<double>::infinity();
  none_turned.rotation.w = std::numeric_limits<double>::quiet_NaN();
  const struct {
    Pose pose;
    std::int32_t surface;
    StepStatus want;
  } cases[] = {{inside, 1, StepStatus::ok},
               {none, 1, StepStatus::non_finite_pose},
               {none_turned, 1, StepStatus::non_finite_pose},
               {inside, 4, StepStatus::no_surface},
               {inside, 5, StepStatus::no_surface},
               {inside, -1, StepStatus::no_surface},
               {inside, 0, StepStatus::outside_window},
               {inside, 2, StepStatus::ok}};
  PoseArgument poses;
  for (const auto& c : cases) {
    poses.X_WT.push_back(c.pose);
    poses.surface.push_back(c.surface);
  }
  Answers got(std::size(cases));
  ASSERT_TRUE(batches_of(tool)->measure(surfaces, poses.batch(), got.all()));
  for (std::size_t i = 0; i < std::size(cases); ++i) {
    SCOPED_TRACE(i);
    EXPECT_EQ(got.status[i], ContactStatus(cases[i].want).bits);
    EXPECT_EQ(got.volume[i] > 0, cases[i].want == StepStatus::ok);
    EXPECT_EQ(norm(got.force_of(i)) > 0, cases[i].want == StepStatus::ok);
    EXPECT_EQ(got.stiffness[36 * i + 14] != 0, cases[i].want == StepStatus::ok);
    if (cases[i].want != StepStatus::ok) {
      EXPECT_EQ(got.potential[i], 0);
      EXPECT_EQ(norm(got.torque_of(i)), 0);
    }
  }
}

// Poses far in front are sorted out before they are measured, if there are many.
TEST(ContactBatch, UnknownNoiseIsNoNumberInAnyBatch) {
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(20, 0.05, 3);
  const auto batches = batches_of(tool);
  for (const std::size_t num : {2, 200}) {
    const std::vector<Pose> poses(num, {{0, 0, 0.3}, {}});
    std::vector<double> said(num);
    ASSERT_TRUE(batches->measure(surfaces[0], {poses}, {.volume_std = said.data()}));
    EXPECT_TRUE(std::ranges::all_of(said, [](double std) { return std::isnan(std); })) << num;
  }
}

TEST(ContactBatch, SurfacesAreOneOrEachPoseItsOwnOrNumbered) {
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(50, 0.05, 14);
  const Contact contact = std::move(Contact::create(tool)).value();
  const std::vector<Pose> poses(surfaces.size(), Pose{{0, 0, 0.62}, {}});
  Answers own(poses.size()), first(poses.size());
  ASSERT_TRUE(contact.measure_batch(surfaces, {poses, {}, {}}, own.all()));
  ASSERT_TRUE(contact.measure_batch(surfaces[0], {poses, {}, {}}, first.all()));
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ(own.volume[i], contact.measure(surfaces[i], poses[i]).penetration.volume);
    EXPECT_EQ(first.volume[i], contact.measure(surfaces[0], poses[i]).penetration.volume);
  }
  EXPECT_NE(own.volume[1], own.volume[0]);
  // One after the other in one memory.
  const DepthFieldLevel &a = surfaces[0].field.levels[0], &b = surfaces[1].field.levels[0];
  DepthFieldView both = surfaces[0].field;
  ASSERT_EQ(a.stride, b.stride);
  const SurfaceBatch even(both, 1, 0, 0);
  EXPECT_TRUE(even.is_even());
  Answers even_first(poses.size());
  ASSERT_TRUE(contact.measure_batch(even, {poses, {}, {}}, even_first.all()));
  for (std::size_t i = 0; i < poses.size(); ++i) EXPECT_TRUE(even_first.is_same(i, first, i, true));
  // No pose at all.
  EXPECT_TRUE(contact.measure_batch(surfaces, {}, own.all()));
}

TEST(ContactBatch, WhatDoesNotFitIsRefusedInOneSentence) {
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(20, 0.05, 15);
  const Contact contact = std::move(Contact::create(tool)).value();
  const PoseArgument poses(7, 4, 16);
  Answers got(7);
  const auto expect_refused = [&](const SurfaceBatch& requested, const PoseBatch& batch,
                                  const BatchAnswers& answers, const char* words) {
    const Status status = contact.measure_batch(requested, batch, answers);
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().code, Errc::invalid_argument);
    EXPECT_NE(status.error().message.find(words), std::string::npos) << status.error().message;
    EXPECT_EQ(got.volume[0], -7);
    EXPECT_EQ(got.status[6], 77u);
  };
  expect_refused(surfaces, {poses.X_WT, {}, {}}, got.all(), "7 poses was given 4 surfaces");
  expect_refused(SurfaceBatch(), {poses.X_WT, {}, {}}, got.all(), "given 0 surfaces");
  expect_refused(surfaces, {poses.X_WT, std::span(poses.surface).first(6), {}}, got.all(), "of 6");
  expect_refused(surfaces, {poses.X_WT, poses.surface, poses.X_WT}, got.all(), "7 poses X_WC");
  expect_refused(surfaces, {poses.X_WT, poses.surface, {}, 2}, got.all(), "GPU 2");
  BatchAnswers elsewhere = got.all();
  elsewhere.gpu = 0;
  expect_refused(surfaces, poses.batch(), elsewhere, "GPU 0");
  std::vector<SurfaceView> on_gpu = surfaces;
  on_gpu[2].field.gpu = 1;
  expect_refused(on_gpu, poses.batch(), got.all(), "surface in the memory of GPU 1");
  std::vector<SurfaceView> remembered = surfaces;
  remembered[1].role = SurfaceRole::with_memory;
  remembered[1].in_front = remembered[1].field;
  expect_refused(remembered, poses.batch(), got.all(),
                 "surface 1 of a batch is one of a camera with");

  const Contact by_points = std::move(Contact::create(tool, GraphMethod{})).value();
  const Status status = by_points.measure_batch(surfaces, poses.batch(), got.all());
  ASSERT_FALSE(status);
  EXPECT_NE(status.error().message.find("not by graph"), std::string::npos);
}

TEST(ContactBatch, OnlyTheFirstOneAllocates) {
  const auto scenes = test::batch_scenes();
  const std::vector<SurfaceView> surfaces = test::surfaces_of(scenes);
  const Tool tool = test::random_tool(100, 0.05, 17);
  const Contact contact = std::move(Contact::create(tool)).value();
  ASSERT_TRUE(contact.reserve_batch(4));
  const PoseArgument poses(300, 4, 18);
  Answers got(300);
  const test::AllocationCounter counter;
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(contact.measure_batch(surfaces, poses.batch(), got.all()));
  }
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_GT(*std::max_element(got.volume.begin(), got.volume.end()), 0);
}

}  // namespace
}  // namespace palpate
