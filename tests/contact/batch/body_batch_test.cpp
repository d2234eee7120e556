// Batches of poses against bodies: what single queries of pairs answer, to the bit.
#include <cstring>

#include <gtest/gtest.h>

#include "palpate/contact/body_contact.h"
#include "palpate/packing/packing.h"
#include "tests/contact/batch/batch_cases.h"
#include "tests/test_util/body_motion.h"

namespace palpate {
namespace {

using test::Answers;
using test::Random;
using test::random_body_pose;

Tool packed(const TriangleMesh& mesh, int num_spheres) {
  return Tool::pack(mesh, {.max_spheres = num_spheres}).value().with_solid_field();
}

/// Made once: their fields take a second each.
const Tool& finger() {
  static const Tool tool = packed(make_box({0.02, 0.016, 0.08}), 100);
  return tool;
}
const Tool& torus() {
  static const Tool tool = packed(make_torus(0.05, 0.02, 24, 16), 300);
  return tool;
}
const Tool& box() {
  static const Tool tool = packed(make_box({0.09, 0.07, 0.05}), 200);
  return tool;
}

/// A tool, and two shapes at three places.
struct Bodies {
  std::shared_ptr<const ToolIndex> index = ToolIndex::create(finger());
  std::vector<PlacedBody> placed;
  std::vector<Pose> X_WT;
  std::vector<std::int32_t> body_of_pose;

  explicit Bodies(int num_poses) {
    Random random(5);
    const auto of_torus = ToolIndex::create(torus()), of_box = ToolIndex::create(box());
    for (const auto& shape : {of_torus, of_box, of_torus}) {
      placed.push_back({shape, random_body_pose(random, 0.2)});
    }
    for (int i = 0; i < num_poses; ++i) {
      body_of_pose.push_back(i % 3);
      X_WT.push_back(placed[static_cast<std::size_t>(i % 3)].X_WB * random_body_pose(random, 0.07));
    }
  }
};

TEST(BodyBatch, IsManyMeasurementsToTheBit) {
  const Bodies bodies(200);
  ThreadPool two(2);
  for (const BodyMethod method : {BodyMethod::field, BodyMethod::spheres}) {
    for (ThreadPool* const pool : {static_cast<ThreadPool*>(nullptr), &two}) {
      const auto batch =
          make_body_batch_query(Place::cpu(), bodies.index, bodies.placed, {.method = method}, pool)
              .value();
      Answers got(200);
      BatchAnswers answers = got.all();
      if (method == BodyMethod::spheres) answers.stiffness = nullptr;
      ASSERT_TRUE(batch->measure(bodies.X_WT, bodies.body_of_pose, answers));
      int num_touching = 0;
      for (std::size_t i = 0; i < 200; ++i) {
        const PlacedBody& body = bodies.placed[i % 3];
        const BodyPenetration want =
            make_body_pair_query(Place::cpu(), bodies.index, body.shape, {.method = method})
                .value()
                ->measure(bodies.X_WT[i], body.X_WB, answers.stiffness != nullptr);
        EXPECT_EQ(got.volume[i], want.on_a.volume);
        EXPECT_EQ(got.potential[i], want.on_a.potential);
        for (int axis = 0; axis < 3; ++axis) {
          EXPECT_EQ(got.force_of(i)[axis], want.on_a.measure_W.force[axis]);
          EXPECT_EQ(got.torque_of(i)[axis], want.on_a.measure_W.torque[axis]);
        }
        EXPECT_EQ(got.status[i], want.on_a.status.bits);
        if (answers.stiffness != nullptr) {
          EXPECT_EQ(std::memcmp(&got.stiffness[36 * i], want.stiffness_a->m, 36 * sizeof(double)),
                    0);
        }
        num_touching += want.on_a.volume > 0;
      }
      EXPECT_GT(num_touching, 60);
      EXPECT_LT(num_touching, 195);
    }
  }
}

// A small box with a face 5 mm deep in a large one.
TEST(BodyBatch, FindsTheSharedVolumeOfTwoBoxes) {
  const Tool tool = packed(make_box({0.02, 0.02, 0.02}), 1000);
  const Tool block = packed(make_box({0.1, 0.1, 0.1}), 50);
  const auto batch = make_body_batch_query(Place::cpu(), ToolIndex::create(tool),
                                           {{ToolIndex::create(block), {{1, 0, 0}, {}}}})
                         .value();
  const std::vector<Pose> X_WT{{{1, 0, 0.055}, {}}, {{1, 0, 0.1}, {}}};
  Answers got(2);
  ASSERT_TRUE(batch->measure(X_WT, {}, got.all()));
  const double want = 0.02 * 0.02 * 0.005;
  EXPECT_NEAR(got.volume[0], want, 0.02 * want);
  EXPECT_NEAR(got.force_of(0).z, want, 0.02 * want);
  EXPECT_EQ(got.volume[1], 0);
}

TEST(BodyBatch, WhatCannotBeMeasuredIsZeroAndSaysWhy) {
  const Bodies bodies(3);
  const auto batch = make_body_batch_query(Place::cpu(), bodies.index, bodies.placed).value();
  std::vector<Pose> X_WT = bodies.X_WT;
  X_WT[1].translation.x = std::numeric_limits<double>::quiet_NaN();
  Answers got(3);
  ASSERT_TRUE(batch->measure(X_WT, std::vector<std::int32_t>{3, 1, 2}, got.all()));
  EXPECT_EQ(got.status[0], static_cast<std::uint32_t>(StepStatus::no_surface));
  EXPECT_EQ(got.status[1], static_cast<std::uint32_t>(StepStatus::non_finite_pose));
  EXPECT_EQ(got.status[2], 0u);
  for (const std::size_t i : {0u, 1u}) {
    EXPECT_EQ(got.volume[i], 0);
    for (std::size_t k = 0; k < 36; ++k) EXPECT_EQ(got.stiffness[36 * i + k], 0);
  }
}

TEST(BodyBatch, WhatDoesNotFitIsRefusedInOneSentence) {
  const Bodies bodies(4);
  const auto refuses = [](const auto& result, const char* why) {
    ASSERT_FALSE(result);
    EXPECT_NE(result.error().message.find(why), std::string::npos) << result.error().message;
  };
  refuses(make_body_batch_query(Place::cuda(), bodies.index, bodies.placed,
                                {.method = BodyMethod::spheres}),
          "on the CPU alone");
  refuses(make_body_batch_query(Place::cpu(), bodies.index, {}), "no body");
  refuses(make_body_batch_query(Place::cpu(), bodies.index, {{nullptr, {}}}), "has no shape");
  const auto batch = make_body_batch_query(Place::cpu(), bodies.index, bodies.placed).value();
  Answers got(4);
  refuses(batch->measure(bodies.X_WT, {}, got.all()), "4 poses was given 3 bodies");
  refuses(batch->measure(bodies.X_WT, std::vector<std::int32_t>{0}, got.all()),
          "body_of_pose of 1");
  BatchAnswers on_gpu = got.all();
  on_gpu.gpu = 0;
  refuses(batch->measure(bodies.X_WT, bodies.body_of_pose, on_gpu), "measured on the CPU");
}

}  // namespace
}  // namespace palpate
