// Objects that move among what a simulated depth camera sees.
#include "src/bodies/internal/moving_bodies.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "src/math/internal/rotation_vector.h"
#include "tests/bodies/camera_table.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using test::CameraTable;
using test::kTable;
using test::packed_shape;
using test::TableTop;

const Vec3d kSize{0.06, 0.05, 0.04};

const std::shared_ptr<const Tool>& box() {
  static const auto shape = packed_shape(make_box(kSize), 400);
  return shape;
}

/// Returns a box whose lowest side is `height` over the table, m.
SceneObject box_at(double x, double height, double mass = 0.3) {
  return {box(), {{x, 0, kTable - kSize.z / 2 - height}, {}}, {}, true, mass};
}

BodyOptions awake() {
  BodyOptions options;
  options.may_sleep = false;
  return options;
}

void go_on(TableTop& world, double seconds) {
  for (int i = 0; i < std::lround(seconds / world.tick); ++i) world.step();
}

double carried(const TableTop& world) {
  double force = 0;
  for (const BodyTouch& touch : world.bodies->touches()) {
    if (touch.b == BodyTouch::kNoBody) force -= touch.F_A_W.force.z;
  }
  return force;
}

TEST(MovingBodies, FallOnTheTableThatTheCameraSees) {
  TableTop world({box_at(0.01, 0.03)}, {}, awake());
  double most = 0, before = world.bodies->energy();
  for (int i = 0; i < 1000; ++i) {
    world.step();
    const RigidBody& body = world.body(0);
    most = std::max(most, kinetic_energy(body) - 0.3 * 9.81 * body.center_W().z - before);
  }
  const RigidBody& body = world.body(0);
  EXPECT_LT(most, 1e-9 * std::abs(before)) << "energy out of nothing";
  EXPECT_NEAR(body.X_WB.translation.z, kTable - kSize.z / 2, 6e-4);
  EXPECT_LT(norm(rotation_vector(body.X_WB.rotation)), 0.01);
  EXPECT_NEAR(carried(world), 0.3 * 9.81, 1e-3);
  EXPECT_FALSE(body.is_asleep);
}

// A falling body stores nothing; a lifted one stores its weight times the height, and gives that
// back on the way down.
TEST(MovingBodies, StoreWhatTheyAreLiftedBy) {
  TableTop world({box_at(0.01, 0.03)}, {}, awake());
  for (int i = 0; i < 1000; ++i) {
    world.step();
    EXPECT_LT(world.bodies->stored(), 1e-5) << i;
  }
  const double weight = 0.3 * 9.81, begin = world.body(0).center_W().z;
  MovingBodies::Push push;
  double most = 0;
  for (const double force : {1.5 * weight, 0.5 * weight}) {  // faster and slower again
    push.F_B_W.force = {0, 0, -force};
    for (int i = 0; i < 100; ++i) {
      world.step({&push, 1});
      const double way = begin - world.body(0).center_W().z;
      const double moved = kinetic_energy(world.body(0));
      most = std::max(most, weight * way);
      // stored() is that at the beginning of the last step.
      EXPECT_NEAR(world.bodies->stored(), weight * way + moved, 0.005) << i;
    }
  }
  EXPECT_GT(most, 0.1);
  const double stored = world.bodies->stored();
  BodyOptions other = awake();
  other.gravity_y = 0;
  other.gravity_z = 9.81;
  other.friction = 0.1;
  world.bodies->use(other, {{}});
  EXPECT_NEAR(world.bodies->stored(), stored, 0.005);
  for (int i = 0; i < 2000; ++i) world.step();
  EXPECT_LT(world.bodies->stored(), 0.01 * most) << "it lies again";
  other.gravity_z = 20;
  world.bodies->use(other, {{}});
  EXPECT_EQ(world.bodies->stored(), 0) << "another gravity is no lift";
}

// A body that begins inside the table rises without storing energy; a body that the tool drags
// along stores the work of the tool's friction.
TEST(MovingBodies, StoreOnlyWhatTheToolDoes) {
  TableTop sunk({box_at(0.01, -0.01)}, {}, awake());
  double highest = 0;
  for (int i = 0; i < 500; ++i) {
    sunk.step();
    EXPECT_EQ(sunk.bodies->stored(), 0) << i;
    highest = std::max(highest, kTable - kSize.z / 2 - sunk.body(0).center_W().z);
  }
  EXPECT_GT(highest, -1e-3);

  BodyOptions smooth = awake();
  smooth.friction = 0;
  TableTop world({box_at(0.01, 0)}, {}, smooth);
  for (int i = 0; i < 500; ++i) world.step();
  MovingBodies::Push push;
  push.F_B_W.force = {0, 0, 1};
  push.friction = 0.5;
  push.grip = 1000;
  push.V_W.linear = {0.3, 0, 0};
  double moved = 0;
  for (int i = 0; i < 300; ++i) {
    world.step({&push, 1});
    if (i < 100) continue;
    moved = kinetic_energy(world.body(0));
    EXPECT_NEAR(world.bodies->stored(), moved, 0.1 * moved + 1e-4) << i;
  }
  EXPECT_NEAR(moved, 0.3 * 0.09 / 2, 1e-3) << "it goes along";
}

// A second body that falls past the table, and loses its energy by damping, takes nothing from the
// stored energy of the first one.
TEST(MovingBodies, StoreWhatEachIsLiftedBy) {
  SceneObject lost = box_at(0, 0);
  lost.X_WB.translation = {3, 0, 0};
  BodyOptions damped = awake();
  damped.damping = 2;
  TableTop world({box_at(0.01, 0), lost}, {}, damped);
  const double weight = 0.3 * 9.81, begin = world.body(0).center_W().z;
  MovingBodies::Push push;
  for (int i = 0; i < 700; ++i) {
    const RigidBody& held = world.body(0);
    push.F_B_W.force = {0, 0, -weight + 10 * (-0.2 - held.V_W.linear.z)};  // 0.2 m/s up
    world.step({&push, 1});
  }
  const double way = begin - world.body(0).center_W().z;
  EXPECT_GT(way, 0.1);
  EXPECT_GT(world.body(1).center_W().z, 1) << "it has fallen";
  EXPECT_NEAR(world.bodies->stored(), weight * way, 0.03 * weight * way);
}

// Work lost to friction under a pushed body is not stored, even if another body has risen.
TEST(MovingBodies, StoreNothingOfWhatFrictionTakes) {
  SceneObject sunk = box_at(0, -0.01);
  sunk.X_WB.translation.x = -0.15;
  BodyOptions rough = awake();
  rough.friction = 0.5;
  TableTop world({box_at(0.01, 0), sunk}, {}, rough);
  for (int i = 0; i < 500; ++i) world.step();
  const double begin = world.body(0).center_W().x, up = world.body(1).center_W().z;
  EXPECT_LT(up, sunk.X_WB.translation.z - 0.005) << "it has come up";
  MovingBodies::Push push;
  double work = 0;
  for (int i = 0; i < 1500; ++i) {
    const RigidBody& pushed = world.body(0);
    push.F_B_W.force = {1.5 + 20 * (0.1 - pushed.V_W.linear.x), 0, 0};
    work += push.F_B_W.force.x * 1e-3 * pushed.V_W.linear.x;
    world.step({&push, 1});
    EXPECT_LT(world.bodies->stored(), 0.005) << i;
  }
  EXPECT_GT(world.body(0).center_W().x - begin, 0.1);
  EXPECT_GT(work, 0.15);
}

// Corners, edges and faces, on the table and on each other: what contacts hold counts as well.
TEST(MovingBodies, NeverHaveMoreEnergyThanBefore) {
  const double fallen = 3 * 0.3 * 9.81 * 0.1;  // J, about
  for (int run = 0; run < 4; ++run) {
    std::vector<SceneObject> boxes;
    for (int i = 0; i < 3; ++i) {
      boxes.push_back(box_at(0.01 * i, 0.03 + 0.08 * i));
      boxes.back().X_WB.rotation = axis_angle({1, 0.4 * run, 0.3 * i}, 0.5 + run + i);
    }
    BodyOptions options = awake();
    options.damping = 0;
    TableTop world(boxes, {}, options);
    double least = world.bodies->energy(), max_held = 0, most = 0;
    for (int i = 0; i < 1000; ++i) {
      world.step();
      const double now = world.bodies->energy();
      most = std::max(most, now - least);
      least = std::min(least, now);
      for (const BodyTouch& touch : world.bodies->touches()) {
        max_held = std::max(max_held, touch.potential);
      }
    }
    EXPECT_LT(most, 2e-6 * fallen) << "places are single precision: some 6e-8 m times the weight";
    EXPECT_GT(max_held, 0.01 * fallen);
  }
}

TEST(MovingBodies, SleepUntilSomethingChanges) {
  TableTop world({box_at(0, 0.005), box_at(0.01, 0.09)}, {});
  const auto is_asleep = [&](int i) { return world.body(i).is_asleep; };
  go_on(world, 2);
  EXPECT_TRUE(is_asleep(0));
  EXPECT_TRUE(is_asleep(1));
  const Pose before = world.body(1).X_WB;
  go_on(world, 1);
  EXPECT_EQ(world.body(1).X_WB, before);
  // The tool touches the upper one, and both wake up.
  std::vector<MovingBodies::Push> pushes(2);
  pushes[1].F_B_W.force = {0.05, 0, 0.5};
  world.step(pushes);
  EXPECT_FALSE(is_asleep(1));
  world.step(pushes);
  EXPECT_FALSE(is_asleep(0));
}

TEST(MovingBodies, LieDeeperAndSlideWhenMaterialsChange) {
  BodyOptions options;
  options.gravity_y = 0;
  options.gravity_z = 9.81;
  SceneObject rough = box_at(0, 0.001);
  rough.X_WB.translation.y = 0.12;
  rough.friction = 0.5;
  TableTop world({box_at(0, 0.001), rough}, {}, options);
  const auto use_for = [&](double seconds) {
    world.bodies->use(options, ObjectFrictions{{}, {0.5}});
    go_on(world, seconds);
    return world.body(0).X_WB.translation;
  };
  const Vec3d before = use_for(1.5);
  EXPECT_TRUE(world.body(0).is_asleep);
  options.sink += 5e-4;
  const Vec3d deeper = use_for(1);
  // The lowest balls reach out of the face a little: a light touch is softer than the rest.
  EXPECT_GT(deeper.z, before.z + 2e-4);
  EXPECT_LT(deeper.z, before.z + 1.2e-3);
  options.gravity_x = 0.3 * 9.81;
  const Vec3d held = use_for(0.5);
  EXPECT_NEAR(held.x, deeper.x, 1e-3);
  // On ice it gives way to the slope; the other one has a coefficient of its own.
  options.friction = 0.1;
  const Vec3d slid = use_for(0.5);
  EXPECT_NEAR(slid.x, held.x + 0.5 * (0.3 - 0.1) * 9.81 * 0.25, 0.03);
  EXPECT_NEAR(world.body(1).X_WB.translation.x, 0, 2e-3);
}

// On a slope: the body that loses its grip slides, and the other one sleeps on.
TEST(MovingBodies, WakeUpWhenTheirOwnFrictionChanges) {
  BodyOptions options;
  options.gravity_x = 0.3 * 9.81;
  options.gravity_y = 0;
  options.gravity_z = 9.81;
  SceneObject other = box_at(0, 0.001);
  other.X_WB.translation.y = 0.12;
  TableTop world({box_at(0, 0.001), other}, {}, options);
  go_on(world, 1.5);
  ASSERT_TRUE(world.body(0).is_asleep && world.body(1).is_asleep);
  const Pose one = world.body(0).X_WB, two = world.body(1).X_WB;
  world.bodies->use(options, ObjectFrictions(2));
  go_on(world, 0.1);
  EXPECT_EQ(world.body(0).X_WB, one) << "nothing has changed";
  world.bodies->use(options, ObjectFrictions{{0.1}, {}});
  go_on(world, 0.5);
  EXPECT_NEAR(world.body(0).X_WB.translation.x, one.translation.x + 0.5 * (0.3 - 0.1) * 9.81 * 0.25,
              0.03);
  EXPECT_TRUE(world.body(1).is_asleep);
  EXPECT_EQ(world.body(1).X_WB, two);
}

// As when settings change that make new queries.
TEST(MovingBodies, WakeUpInQueriesWithAnotherGravity) {
  const std::vector<SceneObject> objects{box_at(0, 0.005)};
  TableTop world(objects, {});
  go_on(world, 2);
  ASSERT_TRUE(world.body(0).is_asleep);
  BodyOptions options;
  options.gravity_y = 0;
  options.gravity_z = 9.81;
  const auto next = [&] {
    auto made = MovingBodies::create(objects, options, Place::cpu(), nullptr).value();
    made->take_over(*world.bodies);
    world.bodies = std::move(made);
  };
  const double before = world.body(0).X_WB.translation.z;
  next();
  go_on(world, 0.1);
  EXPECT_TRUE(world.body(0).is_asleep);
  EXPECT_EQ(world.body(0).X_WB.translation.z, before);
  options.gravity_z = -1;  // up
  next();
  go_on(world, 0.1);
  EXPECT_FALSE(world.body(0).is_asleep);
  // At least as far as in free fall: the contact that held it pushes it.
  EXPECT_LT(world.body(0).X_WB.translation.z, before - 0.99 * 0.5 * 0.1 * 0.1);
}

TEST(MovingBodies, StandOnEachOther) {
  TableTop world({box_at(0, 0), box_at(0.002, 0.041), box_at(-0.002, 0.082)}, {}, awake());
  go_on(world, 3);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(world.body(i).X_WB.translation.z, kTable - kSize.z * (i + 0.5), 2e-3) << i;
    EXPECT_LT(norm(world.body(i).V_W.linear), 5e-3) << i;
  }
  EXPECT_NEAR(carried(world), 3 * 0.3 * 9.81, 0.1);
}

TEST(MovingBodies, LieOnObjectsThatStay) {
  const auto slab = packed_shape(make_box({0.2, 0.2, 0.05}), 300);
  const SceneObject fixture{slab, {{0, 0, 0.5}, {}}, 0.1};
  SceneObject moving = box_at(0, 0);
  moving.X_WB.translation.z = 0.5 - 0.025 - kSize.z / 2 - 0.01;
  TableTop world({fixture, moving}, {}, awake());
  ASSERT_EQ(world.bodies->num_bodies(), 1);
  EXPECT_EQ(world.bodies->object(0), 1u);
  go_on(world, 1);
  EXPECT_NEAR(world.body(0).X_WB.translation.z, 0.475 - kSize.z / 2, 6e-4);
  ASSERT_EQ(world.bodies->touches().size(), 1u);
  EXPECT_EQ(world.bodies->touches()[0].friction, (0.5 + 0.1) / 2);
  // A face on a face: mean distance from the middle of a 6 x 5 cm rectangle.
  EXPECT_NEAR(world.bodies->touches()[0].patch.torsion_radius, 0.0211, 0.002);
}

/// A hand that comes from the left, 0.2 m/s.
Pose hand_motion(double t) { return {{-0.15 + 0.2 * std::min(t, 0.75), 0, kTable - 0.03}, {}}; }

TEST(MovingBodies, ArePushedByWhatMovesInTheStream) {
  CameraTable::Options seen;
  seen.width = 320;
  seen.others.push_back({"hand", make_box({0.06, 0.12, 0.06}), hand_motion, hand_motion(0)});
  TableTop world({box_at(-0.01, 0.002)}, seen);
  go_on(world, 0.3);
  EXPECT_NEAR(world.body(0).X_WB.translation.x, -0.01, 2e-3) << "before";
  go_on(world, 0.9);
  // The hand's side ends at x = 0.03.
  EXPECT_GT(world.body(0).X_WB.translation.x, 0.03 + kSize.x / 2 - 0.012);
  EXPECT_LT(world.body(0).X_WB.translation.x, 0.1);
  EXPECT_NEAR(world.body(0).X_WB.translation.z, kTable - kSize.z / 2, 5e-3);
}

/// A hand between camera and object, from 0.5 s to 1 s.
Vec3d cover_place;
Pose cover_motion(double t) {
  return {t > 0.5 && t < 1 ? cover_place : Vec3d{0, 0.5, kTable - 0.2}, {}};
}

TEST(MovingBodies, StayWhileSomethingHidesThem) {
  for (const double x : {-0.03, 0.0, 0.02}) {
    for (const double y : {-0.02, 0.0, 0.03}) {
      cover_place = {x, y, kTable - 0.2};
      CameraTable::Options seen;
      seen.others.push_back({"cover", make_box({0.2, 0.2, 0.02}), cover_motion, cover_motion(0)});
      TableTop world({box_at(0, 0)}, seen);
      go_on(world, 0.9);
      EXPECT_TRUE(world.body(0).is_asleep);
      EXPECT_NEAR(world.body(0).X_WB.translation.z, kTable - kSize.z / 2, 0.02);
      go_on(world, 1.5);
      const Vec3d place = world.body(0).X_WB.translation;
      EXPECT_NEAR(place.z, kTable - kSize.z / 2, 1e-3) << x << ", " << y;
      EXPECT_LT(std::hypot(place.x, place.y), 0.02) << x << ", " << y;
    }
  }
}

TEST(MovingBodies, DoNotTunnelAtAMeterPerSecond) {
  const auto plate = packed_shape(make_box({0.1, 0.08, 0.012}), 400);
  for (const double tilt : {0.0, 0.4, 1.5708}) {
    // On the table, and on another plate that lies there.
    SceneObject lying{plate, {{0, 0, kTable - 0.006}, {}}, {}, true, 0};
    SceneObject falling{
        plate, {{0.005, 0, kTable - 0.1}, axis_angle({0, 1, 0}, tilt)}, {}, true, 0};
    // A fall of 5 cm gives 1 m/s.
    TableTop world({lying, falling}, {}, awake());
    go_on(world, 1.5);
    EXPECT_LT(world.body(1).center_W().z, kTable - 0.006) << tilt;
    EXPECT_NEAR(world.body(0).center_W().z, kTable - 0.006, 3e-3) << tilt;
    EXPECT_GT(world.body(1).center_W().z, kTable - 0.06) << tilt;
  }
}

TEST(MovingBodies, SameBitsFromAnyMomentOnWithoutMemory) {
  const std::vector<SceneObject> objects{box_at(0, 0.01), box_at(0.02, 0.07)};
  TableTop one(objects, {}), other(objects, {}), again(objects, {});
  go_on(one, 0.3);
  go_on(again, 0.5);
  go_on(other, 0.3);
  const auto after = TableTop::made(objects, {});
  after->take_over(*other.bodies);
  for (int i = 0; i < 200; ++i) {
    one.step();
    const SurfaceBlend seen = other.table.at(other.time);
    const test::AllocationCounter counter;
    after->step({&seen, 1}, {}, other.tick);
    EXPECT_EQ(counter.count(), 0u);
    other.time += other.tick;
  }
  const auto same = [](std::span<const RigidBody> a, std::span<const RigidBody> b) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      EXPECT_EQ(a[i].X_WB, b[i].X_WB);
      EXPECT_EQ(a[i].V_W.angular, b[i].V_W.angular);
    }
  };
  same(one.bodies->bodies(), after->bodies());
  same(one.bodies->bodies(), again.bodies->bodies());
  EXPECT_GT(std::abs(one.body(1).X_WB.translation.x - 0.02), 1e-6);
}

TEST(MovingBodies, WhatCannotBeIsRefused) {
  const auto message = [](std::vector<SceneObject> objects) {
    const auto made = MovingBodies::create(objects, {}, Place::cpu(), nullptr);
    return made ? std::string() : made.error().message;
  };
  EXPECT_NE(message({box_at(0, 0, -1)}).find("mass"), std::string::npos);
  EXPECT_NE(message({box_at(0, 0, NAN)}).find("mass"), std::string::npos);
  const std::vector<SceneObject> many(kMaxMovingBodies + 1, box_at(0, 0));
  EXPECT_NE(message(many).find("at most 32"), std::string::npos);
}

}  // namespace
}  // namespace palpate
