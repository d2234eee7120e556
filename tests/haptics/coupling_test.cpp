#include "palpate/haptics/coupling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "src/math/internal/matrix6.h"
#include "src/math/internal/rotation_vector.h"
#include "tests/haptics/coupled_box.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using namespace test::coupled_box;  // NOLINT: all of it

CouplingOptions checked(CouplingOptions options, const DeviceLimits& limits = kLimits) {
  const auto result = check_coupling(options, limits, kTick, box_tool());
  EXPECT_TRUE(result.has_value()) << result.error().message;
  return result->options;
}

DeviceState hand_at(const Pose& X_BH, const Twist& V_BH = {}) {
  DeviceState state;
  state.X_BH = X_BH;
  state.V_BH = V_BH;
  state.is_valid = true;
  return state;
}

/// Hinges: point p_T of the tool is pushed along n_W with k times its depth below a plane.
struct Hinge {
  Vec3d p_T, n_W;
  double offset = 0, k = 0;
  double depth(const Pose& X_WT) const { return std::max(0.0, offset - dot(n_W, X_WT * p_T)); }
};

struct HingeScene {
  std::vector<Hinge> hinges;
  Vec3d c_T = box_tool().center_of_mass;

  double potential(const Pose& X_WT) const {
    double u = 0;
    for (const Hinge& h : hinges) u += h.k * h.depth(X_WT) * h.depth(X_WT) / 2;
    return u;
  }
  LocalContact contact(const Pose& X_WT, double time) const {
    LocalContact contact;
    contact.is_valid = true;
    contact.time = time;
    contact.X_WT = X_WT;
    contact.p_WC = X_WT * c_T;
    for (const Hinge& h : hinges) {
      const double depth = h.depth(X_WT);
      if (depth == 0) continue;
      const Vec3d lever = rotate(X_WT.rotation, h.p_T - c_T);
      const Vec6 along{h.n_W, cross(lever, h.n_W)};
      contact.F_C_W.force += h.k * depth * along.linear;
      contact.F_C_W.torque += h.k * depth * along.angular;
      for (int i = 0; i < 6; ++i) {
        for (int j = 0; j < 6; ++j) contact.stiffness.m[i][j] += h.k * along[i] * along[j];
      }
      contact.max_stiffness += h.k;
      contact.volume += 1e-4 * depth;
    }
    return contact;
  }
};

/// The floor z = 0 for the tool's center of mass.
HingeScene floor_scene(double k) { return {{{box_tool().center_of_mass, {0, 0, 1}, 0, k}}}; }

/// The handle's pose that puts the tool's center of mass at p.
DeviceState hand_for(const Vec3d& p) { return hand_at({p - box_tool().center_of_mass, {}}); }

TEST(VirtualCoupling, FollowsABackwardEulerOscillator) {
  CouplingOptions options = checked({});
  options.stiffness = 500;
  const auto coupling = make_coupling(options, kLimits, box_tool());
  coupling->reset(hand_for({0, 0, 0}));
  const double m = options.tool_mass, k = 500, d = 2 * std::sqrt(m * k), goal = 0.005;
  double x = 0, v = 0;
  for (int i = 0; i < 200; ++i) {
    const CouplingStep step = coupling->step(hand_for({goal, 0, 0}), {}, kTick);
    v = (m * v + kTick * k * (goal - x)) / (m + kTick * d + kTick * kTick * k);
    x += kTick * v;
    ASSERT_NEAR((step.X_WT * box_tool().center_of_mass).x, x, 1e-12);
    ASSERT_NEAR(step.desired_F_H_B.force.x, -(k * (goal - x) - d * v), 1e-9);
    ASSERT_NEAR(step.stretch, std::abs(goal - x), 1e-12);
    ASSERT_NEAR(step.energy, k * (goal - x) * (goal - x) / 2, 1e-12);
  }
  EXPECT_LT(std::abs(goal - x), 1e-4);
}

// The same on a contact of force F - k (z - z_F), with the coupling's damping of it, 0.7 of the
// critical one, and that of the options, c times the force but no more than stops the tool.
TEST(VirtualCoupling, FollowsABackwardEulerOscillatorOnAContact) {
  for (const double kc : {0.0, 500.0, 5000.0}) {
    for (const double c : {0.0, 5.0, 100.0}) {
      CouplingOptions options = checked({});
      options.stiffness = 500;
      options.friction.contact_damping = c;
      const double m = options.tool_mass, k = 500, d = 2 * std::sqrt(m * k);
      const double dc = 2 * 0.7 * std::sqrt(m * kc), h = kTick;
      LocalContact contact;
      contact.is_valid = true;
      contact.time = 1;
      contact.X_WT = hand_for({0, 0, -1e-3}).X_BH;
      contact.p_WC = {0, 0, -1e-3};
      contact.F_C_W.force.z = 2;
      contact.stiffness.m[2][2] = contact.max_stiffness = kc;
      const auto force = [&](double z) { return 2 - kc * (z + 1e-3); };
      const auto coupling = make_coupling(options, kLimits, box_tool());
      coupling->reset(hand_for({0, 0, -1e-3}));
      double z = -1e-3, v = 0;
      for (int i = 0; i < 200; ++i) {
        const double goal = i < 100 ? -1e-3 : -3e-3;
        const CouplingStep step = coupling->step(hand_for({0, 0, goal}), contact, h);
        const double f = force(z), damping = v > 0 && c * v > 1 ? f / v : c * f;
        v = (m * v + h * (k * (goal - z) + f)) / (m + h * (d + dc + damping) + h * h * (k + kc));
        z += h * v;
        ASSERT_NEAR((step.X_WT * box_tool().center_of_mass).z, z, 1e-12) << kc << " " << c;
        ASSERT_GT(force(z), 0);
        ASSERT_NEAR(step.contact_W.force.z, force(z) + std::max(-damping * v, -force(z)), 1e-8);
      }
    }
  }
}

TEST(VirtualCoupling, NoForceInFreeMotionAtConstantSpeed) {
  const auto coupling = make_coupling(checked({}), kLimits, box_tool());
  coupling->reset(hand_at({}));
  CouplingStep step;
  for (int i = 0; i < 500; ++i) {
    step = coupling->step(hand_at({{2e-4 * i, 0, 0}, {}}, {{0.2, 0, 0}, {}}), {}, kTick);
  }
  EXPECT_LT(norm(step.desired_F_H_B.force), 1e-3);
}

TEST(Couplings, RestOnAFloorWhereSpringAndContactBalance) {
  for (double kc : {200.0, 5e3, 1e6}) {
    for (CouplingKind kind :
         {CouplingKind::virtual_coupling, CouplingKind::proxy, CouplingKind::direct}) {
      CouplingOptions options;
      options.kind = kind;
      options.stiffness = 800;
      options = checked(options);
      const auto coupling = make_coupling(options, kLimits, box_tool());
      const HingeScene scene = floor_scene(kc);
      const double depth = 0.004, k = options.stiffness;
      coupling->reset(hand_for({0, 0, 1e-3}));
      CouplingStep step;
      Pose X_WT = hand_for({0, 0, 1e-3}).X_BH;
      for (int i = 0; i < 1500; ++i) {
        // Every third tick a new query.
        const LocalContact contact = scene.contact(X_WT, i / 3);
        step = coupling->step(hand_for({0, 0, -depth}), contact, kTick);
        if (i % 3 == 2) X_WT = step.X_WT;
      }
      const double series = k * kc / (k + kc);
      const double want = kind == CouplingKind::direct ? kc * depth : series * depth;
      EXPECT_NEAR(step.desired_F_H_B.force.z, want, 1e-3 * want)
          << kc << " " << static_cast<int>(kind);
      EXPECT_NEAR(step.contact_W.force.z, want, 1e-3 * want);
      const double sunk = kind == CouplingKind::direct ? depth : k / (k + kc) * depth;
      EXPECT_NEAR((step.X_WT * box_tool().center_of_mass).z, -sunk, 1e-3 * sunk + 1e-12);
      // At the handle: the lever is the center of mass in the hand.
      const Vec3d torque = cross(box_tool().center_of_mass, Vec3d{0, 0, want});
      EXPECT_LT(norm(step.desired_F_H_B.torque - torque), 1e-3 * norm(torque));
    }
  }
}

TEST(ProxyCoupling, IsAtBalanceAtOnceAndAtTheHandInTheAir) {
  CouplingOptions options;
  options.kind = CouplingKind::proxy;
  options = checked(options);
  const auto coupling = make_coupling(options, kLimits, box_tool());
  coupling->reset(hand_for({0, 0, 0}));
  const HingeScene scene = floor_scene(1e5);
  const LocalContact touch = scene.contact(hand_for({0, 0, -1e-4}).X_BH, 1);
  CouplingStep step = coupling->step(hand_for({0.01, 0, -0.002}), touch, kTick);
  EXPECT_NEAR((step.X_WT * box_tool().center_of_mass).z, -0.002 * 2000 / (2000 + 1e5), 1e-9);
  EXPECT_NEAR((step.X_WT * box_tool().center_of_mass).x, 0.01, 1e-9);
  step = coupling->step(hand_for({0.01, 0, 0.002}), touch, kTick);
  EXPECT_LT(norm(step.desired_F_H_B.force), 1e-9);
  EXPECT_EQ(step.stretch, 0);
}

TEST(Couplings, TheSpringSaturatesAtTheDevicesLimits) {
  for (CouplingKind kind : {CouplingKind::virtual_coupling, CouplingKind::proxy}) {
    CouplingOptions options;
    options.kind = kind;
    options = checked(options);
    const auto coupling = make_coupling(options, kLimits, box_tool());
    coupling->reset(hand_at({}));
    // A vice that lets nothing move.
    HingeScene scene;
    const Vec3d c = box_tool().center_of_mass;
    for (int axis = 0; axis < 3; ++axis) {
      for (double sign : {1.0, -1.0}) {
        for (double side : {0.05, -0.05}) {
          Vec3d n, lever;
          n[axis] = sign;
          lever[(axis + 1) % 3] = side;
          scene.hinges.push_back({c + lever, n, dot(n, c) + 0.01, 1e6});
        }
      }
    }
    const Vec3d away = 0.05 * normalized(Vec3d{1, -2, 3});
    const Pose X{away, axis_angle({0, 1, 0}, 1.5)};
    DeviceState state = hand_at({});
    const LocalContact contact = scene.contact({}, 1);
    CouplingStep step;
    for (int i = 0; i < 300; ++i) {
      state.X_BH = interpolate({}, X, std::min(1.0, i / 100.0));
      step = coupling->step(state, contact, kTick);
    }
    (void)step;
    // With a vice of no net force the linear model must not pull: what is held is at most F.
    EXPECT_LE(norm(step.desired_F_H_B.force), kLimits.max_force * (1 + 1e-9));
  }
  // In the air the tool is on its way: the force is the largest one, along the way.
  const auto coupling = make_coupling(checked({}), kLimits, box_tool());
  coupling->reset(hand_at({}));
  const Vec3d way = normalized(Vec3d{1, -2, 3});
  const CouplingStep step = coupling->step(hand_at({0.08 * way, {}}), {}, 1e-6);
  EXPECT_LT(norm(step.desired_F_H_B.force + kLimits.max_force * way), 1e-3 * kLimits.max_force);
  const double elastic = kLimits.max_force / 2000;
  EXPECT_NEAR(step.energy, kLimits.max_force * (0.08 - elastic / 2), 1e-5);
}

TEST(VirtualCoupling, TurnsTheShortWay) {
  test::Random random(2);
  for (double degrees : {10.0, 90.0, 170.0, 179.0, 181.0, 190.0}) {
    const auto coupling = make_coupling(checked({}), kLimits, box_tool());
    coupling->reset(hand_at({}));
    const Vec3d axis = random.direction();
    const Pose goal{{}, axis_angle(axis, degrees * kPi / 180)};
    const double angle = std::min(degrees, 360 - degrees) * kPi / 180;
    double last = angle, largest = 0;
    for (int i = 0; i < 3000; ++i) {
      const CouplingStep step = coupling->step(hand_at(goal), {}, kTick);
      const Vec3d rest = rotation_between(step.X_WT.rotation, goal.rotation);
      if (i < 20) {
        EXPECT_LE(norm(rest), last + 1e-12) << degrees << " " << i;
        EXPECT_GT(std::abs(dot(rest, axis)), 0.9 * norm(rest));
      }
      last = norm(rest);
      largest = std::max(largest, norm(step.desired_F_H_B.torque));
    }
    EXPECT_LT(last, 1e-3) << degrees;
  }
}

/// Mass, spring and contact together.
double total_energy(const CouplingOptions& options, const CouplingStep& before,
                    const CouplingStep& after, double dt, double potential) {
  const MassProperties tool = box_tool();
  const Vec3d v = (after.X_WT * tool.center_of_mass - before.X_WT * tool.center_of_mass) / dt;
  const Vec3d w_T = rotate(conjugate(after.X_WT.rotation),
                           rotation_between(before.X_WT.rotation, after.X_WT.rotation) / dt);
  return options.tool_mass * (dot(v, v) + dot(w_T, tool.inertia * w_T) / tool.volume) / 2 +
         after.energy + potential;
}

// A wall that the local model knows all along: leaving, coming back, hitting again. No step may add
// energy, for any stiffness and step.
TEST(VirtualCoupling, NoStepAddsEnergyOnOneWall) {
  test::Random random(3);
  for (int n = 0; n < 200; ++n) {
    CouplingOptions options;
    options.damping_ratio = n % 2 ? 1 : 0;
    options.stiffness = std::exp(random.uniform(std::log(50.0), std::log(1999.0)));
    options = checked(options);
    const double dt = random.uniform(2.5e-4, 1e-3);
    const HingeScene scene = floor_scene(std::exp(random.uniform(std::log(10.0), std::log(1e6))));
    const auto coupling = make_coupling(options, kLimits, box_tool());
    coupling->reset(hand_for({0, 0, -0.003}));
    const LocalContact contact = scene.contact(hand_for({0, 0, -0.003}).X_BH, 1);
    // The local model is the wall down to four times the depth at which it was measured.
    Pose hand{{}, random.rotation(1)};
    hand.translation = random.in_box(0.003) - rotate(hand.rotation, scene.c_T);
    CouplingStep before = coupling->step(hand_at(hand), contact, dt);
    double last = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 300; ++i) {
      const CouplingStep step = coupling->step(hand_at(hand), contact, dt);
      const double energy = total_energy(options, before, step, dt, scene.potential(step.X_WT));
      ASSERT_LE(energy, last * (1 + 1e-9) + 1e-12) << n << " " << i;
      last = energy;
      before = step;
    }
  }
}

// A contact that was measured before and that the tool has left does not hold it back.
TEST(VirtualCoupling, LeavesAContactAsIfThereWereNone) {
  const LocalContact old = floor_scene(1e5).contact(hand_for({0, 0, -1e-4}).X_BH, 1);
  const auto held = make_coupling(checked({}), kLimits, box_tool());
  const auto free = make_coupling(checked({}), kLimits, box_tool());
  held->reset(hand_for({0, 0, 1e-3}));
  free->reset(hand_for({0, 0, 1e-3}));
  for (int i = 0; i < 100; ++i) {
    const DeviceState state = hand_for({0, 0, 1e-3 + 1e-5 * i});
    const Pose with = held->step(state, old, kTick).X_WT,
               without = free->step(state, {}, kTick).X_WT;
    ASSERT_EQ(with.translation.z, without.translation.z) << i;
  }
}

// Many hard points with levers, seen anew at every tick or only at some. What a step cannot know is
// a point that it meets for the first time; in the end all comes to rest.
TEST(VirtualCoupling, ComesToRestAmongManyHardContacts) {
  test::Random random(4);
  for (int n = 0; n < 60; ++n) {
    CouplingOptions options;
    options.stiffness = random.uniform(100, 1999);
    options = checked(options);
    const double dt = random.uniform(2.5e-4, 1e-3);
    const int ticks_per_query = 1 + n % 3;
    HingeScene scene;
    for (int i = 0; i < 8; ++i) {
      scene.hinges.push_back({scene.c_T + random.in_box(0.03), random.direction(), 0,
                              std::exp(random.uniform(std::log(100.0), std::log(1e6)))});
      Hinge& h = scene.hinges.back();
      h.offset = dot(h.n_W, h.p_T) - random.uniform(0, 0.002);
    }
    const auto coupling = make_coupling(options, kLimits, box_tool());
    coupling->reset(hand_at({}));
    const Pose hand{random.in_box(0.004), random.rotation(0.2)};
    LocalContact contact = scene.contact({}, 0);
    CouplingStep step;
    double early = 0, late = 0;
    Vec3d last = scene.c_T;
    for (int i = 0; i < 4000; ++i) {
      step = coupling->step(hand_at(hand), contact, dt);
      if (i % ticks_per_query == 0) contact = scene.contact(step.X_WT, i * dt);
      const double speed = norm(step.X_WT * scene.c_T - last) / dt;
      last = step.X_WT * scene.c_T;
      (i < 100 ? early : late) =
          std::max(i < 3500 && i >= 100 ? 0.0 : (i < 100 ? early : late), speed);
    }
    EXPECT_LT(early, 20) << n;
    EXPECT_LT(late, 0.02) << n << " dt " << dt << " per query " << ticks_per_query;
    EXPECT_LT(step.stretch, 0.02);
  }
}

/// Computes the growth, in 1.5 s, of the oscillation of a device of mass m and damping b, pressed
/// into a hard wall, which feels the force for a whole tick (exact between ticks).
double growth_on_a_wall(double stiffness, double damping_ratio, double b) {
  CouplingOptions options;
  options.stiffness = stiffness;
  options.damping_ratio = damping_ratio;
  options.angular_stiffness = 1;
  DeviceLimits limits = kLimits;
  limits.max_force = 1e4;  // no saturation
  const auto coupling = make_coupling(options, limits, box_tool());
  const HingeScene scene = floor_scene(1e6);
  const double m = 0.1, e = std::exp(-b / m * kTick), push = -5;
  const double rest = push * (1 / stiffness + 1e-6);
  double x = 0.99 * rest, v = 0;
  coupling->reset(hand_for({0, 0, -5e-6}));
  Pose X_WT = hand_for({0, 0, -5e-6}).X_BH;
  double early = 0, late = 0;
  for (int i = 0; i < 2000; ++i) {
    DeviceState state = hand_for({0, 0, x});
    state.V_BH.linear.z = v;
    const CouplingStep step = coupling->step(state, scene.contact(X_WT, i), kTick);
    X_WT = step.X_WT;
    const double v_end = (step.desired_F_H_B.force.z + push) / b;
    x += v_end * kTick + (v - v_end) * m / b * (1 - e);
    v = v_end + (v - v_end) * e;
    if (i >= 200 && i < 500) early = std::max(early, std::abs(x - rest));
    if (i >= 1700) late = std::max(late, std::abs(x - rest));
  }
  return late / early;
}

// The bound that check_coupling goes by, against a simulated device: K < 2 b / T for the spring
// alone (Colgate and Schenkel), and the coupling's damping adds to b.
TEST(VirtualCoupling, IsStableOnAWallBelowThePassivityBound) {
  for (double b : {0.2, 0.5, 1.0}) {
    const double bound = 2 * b / kTick;
    EXPECT_LT(growth_on_a_wall(0.8 * bound, 0, b), 0.9) << b;
    EXPECT_GT(growth_on_a_wall(1.2 * bound, 0, b), 1.1) << b;
    EXPECT_LT(growth_on_a_wall(1.2 * bound, 0.5, b), 0.01) << b;
  }
}

TEST(DirectCoupling, DoesTheWorkOfTheContactAtTheHandle) {
  test::Random random(5);
  for (int n = 0; n < 200; ++n) {
    CouplingOptions options;
    options.kind = CouplingKind::direct;
    options.motion_scale = n % 2 ? random.uniform(0.1, 5) : 1;
    options.X_WB = {random.in_box(1), random.rotation(3)};
    options.X_HT = {random.in_box(0.1), random.rotation(3)};
    options = checked(options);
    const auto coupling = make_coupling(options, kLimits, box_tool());
    const Pose X_BH{random.in_box(0.1), random.rotation(3)};
    const Pose X_WT = coupling->step(hand_at(X_BH), {}, kTick).X_WT;
    HingeScene scene;
    const Vec3d p_T = random.in_box(0.05), n_W = random.direction();
    scene.hinges.push_back({p_T, n_W, dot(n_W, X_WT * p_T) + 0.002, 1000});
    const CouplingStep step = coupling->step(hand_at(X_BH), scene.contact(X_WT, 1), kTick);
    EXPECT_NEAR(norm(step.desired_F_H_B.force), 2, 1e-9);  // the same on both sides of any scale

    const Vec3d shift = random.direction(), turn = 20 * random.direction();
    const auto potential = [&](double s) {
      const Pose moved{X_BH.translation + s * shift, rotated(X_BH.rotation, s * turn)};
      return scene.potential(coupling->step(hand_at(moved), {}, kTick).X_WT);
    };
    const double slope = (potential(1e-6) - potential(-1e-6)) / 2e-6;
    const double work = dot(step.desired_F_H_B.force, shift) + dot(step.desired_F_H_B.torque, turn);
    EXPECT_NEAR(options.motion_scale * work, -slope, 1e-4 * (1 + std::abs(slope)));
  }
}

TEST(ContactHold, InterpolatesOverTheIntervalOfTheQueries) {
  CouplingOptions options;
  options.kind = CouplingKind::direct;
  options.hold = ContactHold::interpolation;
  const auto coupling = make_coupling(checked(options), kLimits, box_tool());
  const HingeScene scene = floor_scene(1000);
  const DeviceState state = hand_for({0, 0, -1e-3});
  coupling->reset(state);
  const LocalContact first = scene.contact(hand_for({0, 0, -1e-3}).X_BH, 5.00);
  const LocalContact second = scene.contact(hand_for({0, 0, -3e-3}).X_BH, 5.01);
  CouplingStep step;
  for (int i = 0; i < 10; ++i) step = coupling->step(state, first, kTick);
  EXPECT_NEAR(step.desired_F_H_B.force.z, 1, 1e-12);
  for (int i = 0; i < 20; ++i) {
    step = coupling->step(state, second, kTick);
    EXPECT_NEAR(step.desired_F_H_B.force.z, 1 + 2 * std::min(1.0, i / 10.0), 1e-9);
  }
}

// A measure without derivatives, as those of the thesis: the tool still rests, and does not ring.
TEST(Couplings, RestOnAContactWithoutStiffness) {
  for (CouplingKind kind : {CouplingKind::virtual_coupling, CouplingKind::proxy}) {
    for (ContactHold hold : {ContactHold::local_model, ContactHold::interpolation}) {
      CouplingOptions options;
      options.kind = kind;
      options.hold = hold;
      options.stiffness = 800;
      options = checked(options);
      const auto coupling = make_coupling(options, kLimits, box_tool());
      const double area = 8e-4, gain = 10 / (box_tool().volume / 8);  // of the box's face
      const HingeScene scene = floor_scene(gain * area);
      coupling->reset(hand_for({0, 0, 1e-3}));
      CouplingStep step;
      Pose X_WT = hand_for({0, 0, 1e-3}).X_BH;
      double low = 1e9, high = -1e9;
      for (int i = 0; i < 3000; ++i) {
        LocalContact contact = scene.contact(X_WT, i / 2 * 2 * kTick);
        contact.volume = norm(contact.F_C_W.force) / gain;
        contact.stiffness = {};
        contact.max_stiffness = 0;
        step = coupling->step(hand_for({0, 0, -0.003}), contact, kTick);
        if (i % 2 == 1) X_WT = step.X_WT;
        if (i > 2500) {
          low = std::min(low, step.desired_F_H_B.force.z);
          high = std::max(high, step.desired_F_H_B.force.z);
        }
      }
      const double series = 1 / (1 / 800.0 + 1 / (gain * area));
      EXPECT_NEAR(low, series * 0.003, 0.02) << static_cast<int>(kind) << static_cast<int>(hold);
      EXPECT_NEAR(high, series * 0.003, 0.02);
    }
  }
}

// Whatever comes in: numbers come out, and no memory is allocated.
TEST(Couplings, SurviveAnyInput) {
  test::Random random(6);
  const auto strange = [&](double usual) { return strange_number(random, usual); };
  for (CouplingKind kind :
       {CouplingKind::virtual_coupling, CouplingKind::proxy, CouplingKind::direct}) {
    for (ContactHold hold : {ContactHold::local_model, ContactHold::interpolation}) {
      CouplingOptions options;
      options.kind = kind;
      options.hold = hold;
      const auto coupling = make_coupling(checked(options), kLimits, box_tool());
      coupling->reset(hand_at({}));
      const test::AllocationCounter counter;
      for (int i = 0; i < 30'000; ++i) {
        DeviceState state = hand_at({random.in_box(0.1), random.rotation(3)});
        state.X_BH.translation.x = strange(0.1);
        state.X_BH.rotation.w = strange(1);
        state.V_BH = {{strange(1), 0, 0}, {0, strange(10), 0}};
        state.is_valid = random.uniform() > 0.1;
        LocalContact contact;
        contact.is_valid = random.uniform() > 0.2;
        contact.time = strange(1);
        contact.volume = strange(1e-5);
        contact.p_WC = {strange(0.1), strange(0.1), 0};
        contact.F_C_W = {{strange(10), strange(1), strange(1)}, {strange(1), 0, strange(1)}};
        contact.max_stiffness = strange(1e6);
        for (auto& row : contact.stiffness.m) {
          for (double& x : row) x = strange(random.uniform() < 0.1 ? 1e6 : 100);
        }
        const CouplingStep step = coupling->step(state, contact, i % 7 ? kTick : strange(1e-3));
        ASSERT_TRUE(is_finite(step.desired_F_H_B) && is_finite(step.contact_W)) << i;
        ASSERT_TRUE(is_finite(step.X_WT) && is_finite(step.X_WT_hand)) << i;
        ASSERT_TRUE(std::isfinite(step.energy) && std::isfinite(step.stretch)) << i;
      }
      EXPECT_EQ(counter.count(), 0u);
    }
  }
}

}  // namespace
}  // namespace palpate
