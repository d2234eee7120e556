// Rigid bodies against closed forms: they fall, spin, slide, swing, bump and stand.
#include "src/bodies/internal/body_solver.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstring>
#include <functional>

#include "src/math/internal/rotation_vector.h"
#include "tests/bodies/plate_contacts.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using test::box_shape;
using test::end_points;
using test::HalfSpace;
using test::touch_of;

constexpr double kTick = 1e-3, kG = 9.81;
const Vec3d kSize{0.06, 0.05, 0.04};
const Vec3d kDown{0, 0, -kG};

RigidBody box(const Pose& X_WB, double mass = 0.3) {
  return rigid_body(mass, box_shape(kSize), {}, X_WB);
}

double height_energy(const RigidBody& body) { return body.mass * kG * body.center_W().z; }

/// Bodies on a plate, and their contacts.
struct OnPlate {
  explicit OnPlate(std::vector<RigidBody> boxes, double mu = 0.5)
      : bodies(std::move(boxes)),
        friction(mu),
        solver(static_cast<int>(bodies.size()),
               std::vector<double>(bodies.size() * bodies.size() + bodies.size(), bodies[0].mass)) {
  }
  /// Steps all bodies, each on the plate, and on each of the others from above.
  void step(double dt = kTick) {
    touches.clear();
    in_springs = 0;
    const int n = static_cast<int>(bodies.size());
    for (int a = 0; a < n; ++a) {
      add(touch_of(a, body(a), points, plate, k, in_springs), BodyTouch::kNoBody, a);
      for (int b = 0; b < a; ++b) {
        if (norm(body(a).center_W() - body(b).center_W()) > 1.2 * kSize.z) continue;
        const Vec3d n_W = rotate(body(b).X_WB.rotation, {0, 0, 1});
        const double top = dot(n_W, body(b).center_W()) + kSize.z / 2;
        add(touch_of(a, body(a), points, {n_W, top}, k, in_springs), b, n + a * n + b);
      }
    }
    solver.step(bodies, touches, {gravity, 0}, dt);
  }
  void add(BodyTouch touch, int b, int place) {
    if (!(norm(touch.F_A_W.force) > 0)) return;
    touch.b = b;
    touch.friction = friction;
    touch.place = place;
    touches.push_back(touch);
  }
  RigidBody& body(int i) { return bodies[static_cast<std::size_t>(i)]; }

  std::vector<RigidBody> bodies;
  std::vector<Vec3d> points = end_points(kSize, 4);
  HalfSpace plate;
  double k = 2000, friction, in_springs = 0;
  Vec3d gravity = kDown;
  std::vector<BodyTouch> touches;
  BodySolver solver;
};

TEST(BodySolver, FallsAsGalileoSays) {
  std::vector<RigidBody> bodies{box({{1, 2, 3}, axis_angle({1, 2, 3}, 0.4)})};
  bodies[0].V_W.linear = {0.5, 0, 2};
  BodySolver solver(1, {});
  for (int i = 0; i < 1000; ++i) solver.step(bodies, {}, {kDown, 0}, kTick);
  const Vec3d fallen = bodies[0].center_W() - Vec3d{1.5, 2, 5 - kG / 2};
  EXPECT_LT(norm(fallen), 1e-10);
  EXPECT_NEAR(bodies[0].V_W.linear.z, 2 - kG, 1e-11);
}

TEST(BodySolver, DampingTakesSpeedEvenly) {
  std::vector<RigidBody> bodies{box({})};
  bodies[0].V_W.linear = {1, 0, 0};
  BodySolver solver(1, {});
  for (int i = 0; i < 2000; ++i) solver.step(bodies, {}, {{}, 0.5}, kTick);
  EXPECT_NEAR(bodies[0].V_W.linear.x, std::exp(-1), 2e-4);
}

TEST(RigidBody, SpinsWithItsMomentumAndEnergy) {
  // About the middle axis, which tumbles.
  RigidBody body = box({{}, axis_angle({1, 1, 0}, 0.7)});
  body.V_W.angular = rotate(body.X_WB.rotation, Vec3d{0.02, 20, 0.01});
  const Vec3d momentum = angular_momentum(body);
  const double energy = kinetic_energy(body);
  double least = 1;
  for (int i = 0; i < 20000; ++i) {
    move(body, {}, kTick);
    least = std::min(least,
                     dot(normalized(rotate(body.X_WB.rotation, {0, 1, 0})), normalized(momentum)));
  }
  EXPECT_LT(least, -0.9) << "it has not tumbled";
  EXPECT_LT(norm(angular_momentum(body) - momentum), 1e-11 * norm(momentum));
  EXPECT_NEAR(kinetic_energy(body), energy, 1e-11 * energy);
}

TEST(RigidBody, SymmetricTopPrecessesAsEulerSays) {
  const double side = 0.05, height = 0.02;
  RigidBody top = rigid_body(0.2, box_shape({side, side, height}), {}, {});
  top.V_W.angular = {3, 0, 20};
  const double i1 = top.inertia_B.m[0][0], i3 = top.inertia_B.m[2][2];
  const Vec3d momentum = angular_momentum(top);
  // Its axis goes round the momentum at |L| / I1.
  const double rate = norm(momentum) / i1, time = 1.5;
  const Vec3d desired = rotate(axis_angle(momentum, rate * time), {0, 0, 1});
  const auto error = [&](double dt) {
    RigidBody body = top;
    for (int i = 0; i < std::lround(time / dt); ++i) move(body, {}, dt);
    return norm(rotate(body.X_WB.rotation, {0, 0, 1}) - desired);
  };
  EXPECT_GT(i3, i1);
  EXPECT_LT(error(1e-3), 2e-3);
  EXPECT_NEAR(error(1e-3) / error(5e-4), 4, 0.1) << "of second order";
}

TEST(RigidBody, OffsetCenterOfMassStaysWhereItIs) {
  RigidBody body = rigid_body(0.2, box_shape(kSize), {0.03, -0.02, 0.01}, {{0.1, 0.2, 0.3}, {}});
  body.V_W.angular = {1, 9, -4};
  const Vec3d center = body.center_W();
  for (int i = 0; i < 1000; ++i) move(body, {}, kTick);
  EXPECT_LT(norm(body.center_W() - center), 1e-13);
  EXPECT_GT(norm(body.X_WB.translation - Vec3d{0.1, 0.2, 0.3}), 1e-3);
}

/// A plate at `angle`, with the box flat on it.
OnPlate on_incline(double angle, double friction) {
  const Quaternion tilt = axis_angle({0, 1, 0}, angle);
  OnPlate world({box({rotate(tilt, {0, 0, kSize.z / 2 - 4e-5}), tilt})}, friction);
  world.plate.n_W = rotate(tilt, {0, 0, 1});
  return world;
}

TEST(BodySolver, StaysOnAnInclineBelowTheAngleOfFriction) {
  OnPlate world = on_incline(std::atan(0.5) - 0.02, 0.5);
  for (int i = 0; i < 1000; ++i) world.step();
  const Pose after_a_second = world.body(0).X_WB;
  for (int i = 0; i < 60000; ++i) world.step();
  EXPECT_LT(norm(world.body(0).X_WB.translation - after_a_second.translation), 1e-9);
  EXPECT_LT(norm(rotation_between(after_a_second.rotation, world.body(0).X_WB.rotation)), 1e-9);
}

TEST(BodySolver, SlidesDownAnInclineAboveIt) {
  const double angle = std::atan(0.5) + 0.1;
  OnPlate world = on_incline(angle, 0.5);
  for (int i = 0; i < 200; ++i) world.step();
  const double before = norm(world.body(0).V_W.linear);
  for (int i = 0; i < 500; ++i) world.step();
  const double desired = kG * (std::sin(angle) - 0.5 * std::cos(angle));
  EXPECT_NEAR((norm(world.body(0).V_W.linear) - before) / 0.5, desired, 0.005 * desired);
}

TEST(BodySolver, SpinsOnAPlateUntilFrictionHasStoppedIt) {
  OnPlate world({box({{0, 0, kSize.z / 2 - 4e-5}, {}})}, 0.5);
  for (int i = 0; i < 500; ++i) world.step();
  world.body(0).V_W.angular = {0, 0, 10};
  world.step();
  const double radius = world.touches[0].patch.torsion_radius, before = world.body(0).V_W.angular.z;
  for (int i = 0; i < 50; ++i) world.step();
  const double desired = 0.5 * 0.3 * kG * radius / world.body(0).inertia_B.m[2][2];
  EXPECT_NEAR((before - world.body(0).V_W.angular.z) / 0.05, desired, 0.01 * desired);
  for (int i = 0; i < 1000; ++i) world.step();
  EXPECT_LT(norm(world.body(0).V_W.angular), 1e-6);
}

TEST(BodySolver, SwingsInABowlAsAPendulum) {
  // A small body without friction in a bowl of radius R is a pendulum of length R.
  const double length = 0.5, k = 1e5, amplitude = 0.2;
  std::vector<RigidBody> bodies{
      box({{length * std::sin(amplitude), 0, -length * std::cos(amplitude)}, {}})};
  BodySolver solver(1, std::vector<double>{0.3});
  double last_crossing = 0, period = 0, energy = height_energy(bodies[0]);
  for (int i = 1; i <= 10000; ++i) {
    const double x = bodies[0].center_W().x;
    const Vec3d p = bodies[0].center_W(), n = normalized(p) * -1.0;
    BodyTouch touch;
    const double depth = norm(p) - length + bodies[0].mass * kG / k;
    touch.F_A_W.force = std::max(k * depth, 0.0) * n;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) touch.stiffness.m[r][c] = k * n[r] * n[c];
    }
    solver.step(bodies, {&touch, 1}, {kDown, 0}, kTick);
    const double now = bodies[0].center_W().x;
    if (x < 0 && now >= 0) {
      const double crossing = kTick * (i - now / (now - x));
      if (last_crossing > 0) period = crossing - last_crossing;
      last_crossing = crossing;
    }
    const double total = height_energy(bodies[0]) + kinetic_energy(bodies[0]);
    EXPECT_LT(total, energy + 1e-4 * 0.3 * kG * length);
  }
  const double desired = 2 * kPi * std::sqrt(length / kG);
  EXPECT_NEAR(period, desired, 0.01 * desired);
  EXPECT_LT(height_energy(bodies[0]) + kinetic_energy(bodies[0]), energy);
}

TEST(BodySolver, WhatFallsDoesNotBounce) {
  for (const double tilt : {0.0, 0.3, 0.8}) {
    const double height = 0.1;
    OnPlate world({box({{0, 0, height + 0.04}, axis_angle({0, 1, 0}, tilt)})});
    double highest = 0, lowest = 1;
    const double before = height_energy(world.body(0));
    double most = 0;
    for (int i = 0; i < 3000; ++i) {
      world.step();
      const double energy = height_energy(world.body(0)) + kinetic_energy(world.body(0));
      most = std::max(most, energy);
      double nearest = 1;
      for (const Vec3d& p_B : world.points) {
        nearest = std::min(nearest, (world.body(0).X_WB * p_B).z);
      }
      lowest = std::min(lowest, nearest);
      if (i > 400) highest = std::max(highest, nearest);
    }
    EXPECT_LE(most, before * (1 + 1e-9)) << tilt;
    EXPECT_LT(highest, 0.02 * height) << tilt;
    EXPECT_GT(lowest, -0.01) << tilt;
    EXPECT_LT(kinetic_energy(world.body(0)), 1e-9) << tilt;
    EXPECT_NEAR(world.body(0).center_W().z, kSize.z / 2, 5e-4) << tilt;
  }
}

TEST(BodySolver, CollisionsKeepMomentum) {
  OnPlate world({box({{0, 0, 0}, {}}, 0.3), box({{0.01, 0.02, 0.06}, axis_angle({1, 0, 0}, 0.3)})});
  world.plate.offset = -10;
  world.gravity = {};
  world.body(0).mass = 0.7;
  world.body(1).V_W.linear = {0.1, 0, -1};
  const auto momentum = [&] {
    return 0.7 * world.body(0).V_W.linear + 0.3 * world.body(1).V_W.linear;
  };
  const auto turning = [&] {
    Vec3d sum;
    for (const RigidBody& b : world.bodies) {
      sum += angular_momentum(b) + b.mass * cross(b.center_W(), b.V_W.linear);
    }
    return sum;
  };
  const Vec3d before = momentum(), turning_before = turning();
  const double energy = kinetic_energy(world.body(0)) + kinetic_energy(world.body(1));
  int num_touching = 0;
  for (int i = 0; i < 200; ++i) {
    world.step();
    num_touching += world.touches.empty() ? 0 : 1;
  }
  EXPECT_GT(num_touching, 3);
  EXPECT_LT(norm(momentum() - before), 1e-14);
  // To first order in the step: bodies move while they push.
  EXPECT_LT(norm(turning() - turning_before), 0.02 * norm(turning_before));
  EXPECT_GT(norm(world.body(0).V_W.linear), 0.1);
  EXPECT_LT(kinetic_energy(world.body(0)) + kinetic_energy(world.body(1)), energy);
}

std::vector<RigidBody> stack(int num) {
  std::vector<RigidBody> boxes;
  for (int i = 0; i < num; ++i) {
    boxes.push_back(box({{1e-3 * i, 0, kSize.z * (i + 0.5)}, axis_angle({0, 0, 1}, 0.1 * i)}));
  }
  return boxes;
}

TEST(BodySolver, StackOfFiveStands) {
  OnPlate world(stack(5));
  for (int i = 0; i < 30000; ++i) world.step();
  const std::vector<RigidBody> settled = world.bodies;
  for (int i = 0; i < 60000; ++i) world.step();
  for (int i = 0; i < 5; ++i) {
    const Pose &now = world.body(i).X_WB, &then = settled[static_cast<std::size_t>(i)].X_WB;
    EXPECT_LT(norm(now.translation - then.translation), 1e-8) << i;
    EXPECT_LT(norm(rotation_between(then.rotation, now.rotation)), 1e-8) << i;
    EXPECT_NEAR(now.translation.z, kSize.z * (i + 0.5), 2e-3) << i;
  }
  // The plate carries the weight of all five.
  EXPECT_NEAR(world.touches[0].F_A_W.force.z, 5 * 0.3 * kG, 1e-4);
}

TEST(BodySolver, IsCarriedByWhatMoves) {
  OnPlate world({box({{0, 0, kSize.z / 2}, {}})});
  for (int i = 0; i < 1000; ++i) {
    world.touches.clear();
    world.in_springs = 0;
    world.add(touch_of(0, world.body(0), world.points, world.plate, world.k, world.in_springs),
              BodyTouch::kNoBody, 0);
    for (BodyTouch& touch : world.touches) touch.V_W.linear = {0.2, 0, 0};  // a belt
    world.solver.step(world.bodies, world.touches, {kDown, 0}, kTick);
  }
  EXPECT_NEAR(world.body(0).V_W.linear.x, 0.2, 1e-6);
  // mu g until it goes along.
  EXPECT_NEAR(world.body(0).X_WB.translation.x, 0.2 - 0.04 / (2 * 0.5 * kG), 1e-3);
}

TEST(BodySolver, SleepersAreAsIfFixed) {
  OnPlate world(stack(3));
  world.body(1).is_asleep = true;
  world.body(2).V_W.linear = {0, 0, -0.5};
  const Pose before = world.body(1).X_WB;
  for (int i = 0; i < 1000; ++i) world.step();
  EXPECT_EQ(world.body(1).X_WB, before);
  EXPECT_NEAR(world.body(2).X_WB.translation.z, kSize.z * 2.5, 1e-3);
  EXPECT_LT(kinetic_energy(world.body(2)), 1e-9);
}

TEST(BodySolver, SameInputGivesTheSameBitsWithoutMemory) {
  const auto run = [] {
    OnPlate world(stack(4));
    world.body(3).V_W = {{0.4, 0.1, 0}, {0, 3, 1}};
    world.touches.reserve(100);
    for (int i = 0; i < 500; ++i) world.step();
    return world.bodies;
  };
  const auto a = run(), b = run();
  for (std::size_t i = 0; i < a.size(); ++i) {  // without what pads the last member
    EXPECT_EQ(std::memcmp(&a[i], &b[i], offsetof(RigidBody, is_asleep)), 0);
    EXPECT_EQ(a[i].is_asleep, b[i].is_asleep);
  }
  OnPlate world(stack(4));
  world.step();
  const test::AllocationCounter counter;
  world.solver.step(world.bodies, world.touches, {kDown, 0}, kTick);
  EXPECT_EQ(counter.count(), 0u);
}

TEST(BodySolver, NumbersThatAreNoneStopABody) {
  OnPlate world({box({{0, 0, 1}, {}}), box({{0, 0, 2}, {}})});
  BodyTouch touch;
  touch.F_A_W.force = {0, 0, NAN};
  world.solver.step(world.bodies, {&touch, 1}, {kDown, 0}, kTick);
  EXPECT_TRUE(is_finite(world.body(0).X_WB));
  EXPECT_NEAR(world.body(1).V_W.linear.z, -kG * kTick, 1e-12);
}

// One that cannot be solved stops, with what it touches; the others go on as if alone.
TEST(BodySolver, WhatCannotBeSolvedStopsNobodyElse) {
  OnPlate world({box({{0, 0, kSize.z / 2 - 1e-4}, {}}), box({{1, 0, kSize.z / 2 - 1e-4}, {}})});
  OnPlate alone({box({{0, 0, kSize.z / 2 - 1e-4}, {}})});
  for (OnPlate* plate : {&world, &alone}) plate->body(0).V_W.linear = {0.5, 0, 0};
  world.body(1).V_W.linear = {0.5, 0, 0};
  world.body(1).mass = -1e6;
  const Pose before = world.body(1).X_WB;
  for (int i = 0; i < 100; ++i) {
    world.step();
    alone.step();
  }
  EXPECT_EQ(world.body(0).X_WB, alone.body(0).X_WB);
  EXPECT_GT(world.body(0).X_WB.translation.x, 0.01);
  EXPECT_EQ(world.body(1).X_WB, before);
  EXPECT_EQ(world.body(1).V_W.linear, Vec3d{});
}

TEST(SymmetricBlocks, SolveAsTheWholeMatrix) {
  constexpr int kRows = 5;
  SymmetricBlocks blocks(8);
  // Two that do not touch the other three.
  double a[30][30] = {};
  const auto fill = [&](int r, int c) {
    Mat6& block = blocks.at(r, c);
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        double v = r == c ? (i == j ? 9.0 + r : 0.1 * (i + j))
                          : std::sin(1.0 * (7 * r + 3 * c + 5 * i + j));
        block.m[i][j] = v;
        a[6 * r + i][6 * c + j] = a[6 * c + j][6 * r + i] = v;
      }
    }
  };
  blocks.begin(kRows);
  for (int r = 0; r < kRows; ++r) fill(r, r);
  fill(3, 0);
  fill(2, 0);
  fill(4, 1);
  std::vector<Vec6> x(kRows);
  std::vector<double> b(30);
  for (int i = 0; i < 30; ++i) b[static_cast<std::size_t>(i)] = std::cos(i);
  for (int i = 0; i < 30; ++i) x[static_cast<std::size_t>(i / 6)][i % 6] = std::cos(i);
  ASSERT_TRUE(blocks.factor());
  blocks.solve(x);
  for (int i = 0; i < 30; ++i) {
    double sum = 0;
    for (int j = 0; j < 30; ++j) sum += a[i][j] * x[static_cast<std::size_t>(j / 6)][j % 6];
    EXPECT_NEAR(sum, b[static_cast<std::size_t>(i)], 1e-12) << i;
  }
  blocks.begin(1);
  blocks.at(0, 0).m[0][0] = -1;
  EXPECT_FALSE(blocks.factor());
}

}  // namespace
}  // namespace palpate
