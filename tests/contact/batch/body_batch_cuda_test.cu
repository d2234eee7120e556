// Batches of poses against bodies on the GPU: what the CPU answers.
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/packing/packing.h"
#include "src/contact/batch/scene_batch.h"
#include "tests/contact/batch/batch_cases.h"
#include "tests/test_util/body_motion.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::Answers;
using test::Random;
using test::random_body_pose;

TEST(BodyBatchCuda, IsThatOfTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const auto packed = [](const TriangleMesh& mesh, int num) {
    return Tool::pack(mesh, {.max_spheres = num}).value().with_solid_field();
  };
  const Tool finger = packed(make_box({0.02, 0.016, 0.08}), 60);
  const Tool torus = packed(make_torus(0.05, 0.02, 24, 16), 100);
  const auto index = ToolIndex::create(finger), shape = ToolIndex::create(torus);
  Random random(5);
  std::vector<PlacedBody> bodies{{shape, random_body_pose(random, 0.2)},
                                 {index, random_body_pose(random, 0.2)}};
  std::vector<Pose> X_WT;
  std::vector<std::int32_t> body_of_pose;
  for (int i = 0; i < 20; ++i) {
    body_of_pose.push_back(i % 2);
    X_WT.push_back(bodies[static_cast<std::size_t>(i % 2)].X_WB * random_body_pose(random, 0.05));
  }
  X_WT[3].translation.y = NAN;
  body_of_pose[4] = 2;
  const auto cpu = make_body_batch_query(Place::cpu(), index, bodies).value();
  const auto gpu = make_body_batch_query_cuda(index, bodies, 0).value();
  Answers want(20), got(20);
  ASSERT_TRUE(cpu->measure(X_WT, body_of_pose, want.all()));
  ASSERT_TRUE(gpu->measure(X_WT, body_of_pose, got.all()));
  const double volume = finger.mesh_mass().volume, reach = 0.05;
  int num_touching = 0;
  for (std::size_t i = 0; i < 20; ++i) {
    SCOPED_TRACE(i);
    EXPECT_EQ(got.status[i], want.status[i]);
    EXPECT_NEAR(got.volume[i], want.volume[i], 1e-5 * volume);
    EXPECT_NEAR(got.potential[i], want.potential[i], 1e-5 * volume * reach);
    EXPECT_LT(norm(got.force_of(i) - want.force_of(i)), 1e-5 * volume);
    EXPECT_LT(norm(got.torque_of(i) - want.torque_of(i)), 1e-5 * volume * reach);
    double largest = 1e-9;
    for (std::size_t k = 36 * i; k < 36 * i + 36; ++k) {
      largest = std::max(largest, std::abs(want.stiffness[k]));
    }
    for (std::size_t k = 36 * i; k < 36 * i + 36; ++k) {
      EXPECT_NEAR(got.stiffness[k], want.stiffness[k], 2e-3 * largest);
    }
    num_touching += want.volume[i] > 0;
  }
  EXPECT_GT(num_touching, 8);
  EXPECT_EQ(got.status[3], static_cast<std::uint32_t>(StepStatus::non_finite_pose));
  EXPECT_EQ(got.status[4], static_cast<std::uint32_t>(StepStatus::no_surface));
  // One body for each pose, without numbers.
  Answers first(2);
  const std::vector<Pose> two{X_WT[0], X_WT[1]};
  ASSERT_TRUE(gpu->measure(two, {}, first.all()));
  EXPECT_EQ(first.volume[0], got.volume[0]);
  EXPECT_EQ(first.volume[1], got.volume[1]);
  const Status none = gpu->measure(X_WT, {}, got.all());
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("20 poses was given 2 bodies"), std::string::npos);
  BatchAnswers elsewhere = got.all();
  elsewhere.gpu = 7;
  const Status refused = gpu->measure(X_WT, body_of_pose, elsewhere);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("memory of GPU 7"), std::string::npos);
}

}  // namespace
}  // namespace palpate
