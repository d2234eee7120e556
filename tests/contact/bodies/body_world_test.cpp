// Several tools and objects around one cloud, against the queries of each alone.
#include "palpate/contact/body_contact.h"

#include <gtest/gtest.h>

#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

std::unique_ptr<ContactQuery> make_query(const Tool& tool) {
  return make_contact_query(Place::cpu(), tool, SimplifiedMethod{}).value();
}

std::unique_ptr<BodyPairQuery> pair_query(const Tool& a, const Tool& b,
                                          BodyMethod method = BodyMethod::field) {
  return make_body_pair_query(Place::cpu(), a, b, {.method = method}).value();
}

void expect_same(const Penetration& got, const Penetration& want) {
  EXPECT_EQ(got.volume, want.volume);
  EXPECT_EQ(got.measure_W.force, want.measure_W.force);
  EXPECT_EQ(got.measure_W.torque, want.measure_W.torque);
  EXPECT_EQ(got.num_boundary_spheres, want.num_boundary_spheres);
}

class SeveralBodies : public testing::Test {
 protected:
  Tool first_ = test::random_tool(120, 0.05, 1), second_ = test::random_tool(150, 0.05, 2),
       object_ = test::random_tool(200, 0.06, 3);
  PointCloud cloud_ = test::noisy_wall(160, 120, 140, 0.6, 0.001, 5);
  SurfaceView surface() const { return {cloud_.view(), {}}; }
  Pose X_WF_{{-0.03, 0, 0.57}, axis_angle({0, 0, 1}, 0.4)},
      X_WS_{{0.04, 0.01, 0.58}, axis_angle({1, 0, 1}, 0.2)}, X_WO_{{0, 0.07, 0.55}, {}};
};

TEST_F(SeveralBodies, EachFeelsTheCloudTheOthersAndTheObjects) {
  BodyWorld world;
  const int first = world.add_tool(first_, make_query(first_));
  const int object = world.add_object(object_, X_WO_);
  const int second = world.add_tool(second_, make_query(second_));
  world.set_pose(first, X_WF_);
  world.set_pose(second, X_WS_);
  world.measure(surface());
  ASSERT_EQ(world.num_bodies(), 3);

  const BodyPenetration fo = pair_query(first_, object_)->measure(X_WF_, X_WO_);
  const BodyPenetration fs = pair_query(first_, second_)->measure(X_WF_, X_WS_);
  const BodyPenetration os = pair_query(object_, second_)->measure(X_WO_, X_WS_);
  for (const BodyPenetration* pair : {&fo, &fs, &os}) ASSERT_GT(pair->num_pairs, 0);
  const auto sum = [](const Penetration& a, const Penetration& b) {
    Penetration both = a;
    both.volume += b.volume;
    both.measure_W.force += b.measure_W.force;
    both.measure_W.torque += b.measure_W.torque;
    both.num_boundary_spheres += b.num_boundary_spheres;
    return both;
  };
  expect_same(world.measured(first).bodies, sum(fo.on_a, fs.on_a));
  expect_same(world.measured(object).bodies, sum(fo.on_b, os.on_a));
  expect_same(world.measured(second).bodies, sum(fs.on_b, os.on_b));
  EXPECT_EQ(world.measured(first).num_pairs, fo.num_pairs + fs.num_pairs);

  const auto alone = make_query(second_);
  const Penetration cloud = alone->measure(surface(), X_WS_).penetration;
  ASSERT_GT(cloud.volume, 0);
  expect_same(world.measured(second).cloud, cloud);
  EXPECT_EQ(world.measured(object).cloud.volume, 0);
  const Penetration total = world.measured(second).total();
  EXPECT_EQ(total.volume, cloud.volume + world.measured(second).bodies.volume);
  EXPECT_EQ(total.measure_W.force,
            cloud.measure_W.force + world.measured(second).bodies.measure_W.force);
  EXPECT_EQ(total.num_boundary_spheres, cloud.num_boundary_spheres);
}

TEST_F(SeveralBodies, PairsAreMeasuredByWhatIsAskedFor) {
  BodyWorld world;
  const int first = world.add_tool(first_, nullptr);
  world.add_object(object_, X_WO_);
  world.add_tool(second_, nullptr);
  world.set_pose(first, X_WF_);
  world.set_pose(2, X_WS_);
  world.measure(surface());
  const BodyMeasure before = world.measured(first);
  ASSERT_GT(before.num_pairs, 0);
  int num_made = 0;
  const auto make = [&](const auto& a, const auto& b) -> Result<std::unique_ptr<BodyPairQuery>> {
    ++num_made;
    if (num_made == 2) return Error{Errc::unavailable, "only one"};
    return make_body_pair_query(Place::cpu(), a, b);
  };
  for (const bool works : {false, true}) {
    EXPECT_EQ(world.measure_pairs_by(make).has_value(), works);
    world.measure(surface());
    expect_same(world.measured(first).bodies, before.bodies);
  }
  EXPECT_EQ(num_made, 2 + 3);
#if !defined(PALPATE_CUDA)
  EXPECT_EQ(make_body_pair_query(Place::cuda(), first_, second_).error().code, Errc::unavailable);
#endif
}

TEST_F(SeveralBodies, ObjectsDoNotFeelEachOther) {
  BodyWorld world;
  const int one = world.add_object(first_, {});
  const int other = world.add_object(second_, {});
  const int tool = world.add_tool(object_, nullptr);
  world.set_pose(tool, {{1, 0, 0}, {}});
  world.measure(surface());
  EXPECT_EQ(world.measured(one).bodies.volume, 0);
  world.set_pose(tool, {});
  world.measure(surface());
  EXPECT_GT(world.measured(one).bodies.volume, 0);
  EXPECT_GT(world.measured(other).bodies.volume, 0);
  EXPECT_EQ(world.measured(tool).cloud.volume, 0);
}

TEST_F(SeveralBodies, NonFinitePoseOfOneLeavesTheOthersValid) {
  BodyWorld world;
  const int first = world.add_tool(first_, make_query(first_));
  const int second = world.add_tool(second_, make_query(second_));
  const int object = world.add_object(object_, X_WO_);
  world.set_pose(first, {{std::nan(""), 0, 0}, {}});
  world.set_pose(second, X_WS_);
  world.measure(surface());
  EXPECT_EQ(world.measured(first).total().status, StepStatus::non_finite_pose);
  EXPECT_EQ(world.measured(first).total().volume, 0);
  EXPECT_FALSE(world.measured(second).cloud.status.has(StepStatus::non_finite_pose));
  EXPECT_FALSE(world.measured(second).bodies.status.has(StepStatus::non_finite_pose));
  EXPECT_FALSE(world.measured(object).bodies.status.has(StepStatus::non_finite_pose));
  EXPECT_GT(world.measured(second).bodies.volume, 0);
}

TEST_F(SeveralBodies, SameBitsWithoutAllocation) {
  BodyWorld world;
  const int first = world.add_tool(first_, make_query(first_));
  const int second = world.add_tool(second_, make_query(second_));
  world.add_object(object_, X_WO_);
  world.set_pose(first, X_WF_);
  world.set_pose(second, X_WS_);
  world.measure(surface());
  const BodyMeasure before = world.measured(first);
  const test::AllocationCounter counter;
  world.set_pose(first, X_WS_);
  world.measure(surface());
  world.set_pose(first, X_WF_);
  world.measure(surface());
  EXPECT_EQ(counter.count(), 0u);
  expect_same(world.measured(first).total(), before.total());
}

}  // namespace
}  // namespace palpate
