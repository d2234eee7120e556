// Energy that the safety filter gives to a hand: its observation, and the force taken away for
// it.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "src/math/internal/matrix6.h"
#include "tests/haptics/safety_rig.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using namespace test::safety_rig;  // NOLINT: all of it

// The observer against the exact work of a force that is constant over each tick. A hand that jumps
// counts as the fastest hand there is: 10 m/s and 100 rad/s. Of the energy that it gives, only the
// stored part counts.
TEST(SafetyFilter, CountsTheEnergyThatTheHandIsGiven) {
  SafetyOptions options;
  options.passivity_control = false;
  options.ramp_seconds = 0;
  options.max_slew = 1e6;
  options.max_torque_slew = 1e6;
  Rig rig(options);
  for (int i = 0; i < 20; ++i) rig.tick(kNothing);
  test::Random random(1);
  Wrench out;
  double work = 0, angle = 0;
  int num_lost = 0;
  for (int i = 0; i < 1000; ++i) {
    const bool jumps = i % 10 == 9;
    const Vec3d way = jumps ? random.uniform(0.02, 1) * random.direction()
                            : random.in_box(1e-3) - 2e-4 * out.force;  // mostly against it
    const double turn = jumps ? random.uniform(0.2, 2) : random.uniform(-0.01, 0.01);
    angle += turn;
    rig.input.state.X_BH.translation += way;
    rig.input.state.X_BH.rotation = axis_angle({0, 0, 1}, angle);
    work += dot(out.force, jumps ? 10 * kTick * normalized(way) : way) +
            out.torque.z * (jumps ? 100 * kTick : turn);
    rig.input.stored = random.uniform(0, 0.1);
    num_lost += work < -rig.input.stored;
    work = std::max(work, -rig.input.stored);
    out = rig.tick({random.in_box(4), {0, 0, random.uniform(-0.2, 0.2)}});
    ASSERT_NEAR(rig.filter.status().energy, work, 1e-9);
  }
  EXPECT_GT(num_lost, 100);
}

// Energy lost to friction is no credit: a hand that has rubbed for long is pushed no farther.
TEST(SafetyFilter, WhatTheHandHasLostIsNotGivenBack) {
  for (const double stored : {0.0, 0.004, 0.02}) {
    Rig rig;
    for (int i = 0; i < 600; ++i) rig.tick(kNothing);
    rig.input.stored = stored;
    for (int i = 0; i < 10'000; ++i) {  // 1 m against 1 N
      rig.input.state.X_BH.translation.x -= 1e-4;
      rig.tick({{1, 0, 0}, {}});
    }
    ASSERT_EQ(rig.filter.status().energy, -stored);
    double work = 0, most = 0, force = 1;
    for (int i = 0; i < 3000; ++i) {  // along with 5 N
      rig.input.state.X_BH.translation.x += 1e-4;
      work += 1e-4 * force;
      most = std::max(most, work);
      force = rig.tick({{5, 0, 0}, {}}).force.x;
    }
    EXPECT_LE(most, SafetyOptions{}.energy_tank + stored);
    EXPECT_GT(most, 0.004 + stored);
  }
}

// A reported stored energy that is no number, or negative, is no credit.
TEST(SafetyFilter, NothingIsStoredWhereThatIsNoNumber) {
  for (const double stored : {kNan, kInf, -kInf, -1.0}) {
    Rig rig;
    rig.hold({{1, 0, 0}, {}});
    rig.input.stored = stored;
    for (int i = 0; i < 100; ++i) {
      rig.input.state.X_BH.translation.x -= 1e-4;
      rig.tick({{1, 0, 0}, {}});
    }
    EXPECT_EQ(rig.filter.status().energy, 0) << stored;
  }
}

// A position so far away that the way there is no number.
TEST(SafetyFilter, AWayThatIsNoNumberIsNoWork) {
  Rig rig;
  rig.hold({{1, 0, 0}, {}});
  rig.input.state.X_BH.translation.x = 1e308;
  rig.tick({{1, 0, 0}, {}});
  rig.input.state.X_BH.translation.x = -1e308;
  rig.tick({{1, 0, 0}, {}});
  EXPECT_TRUE(std::isfinite(rig.filter.status().energy));
}

TEST(SafetyFilter, AForceThatPushesTheHandAlongStopsAtTheTank) {
  for (double speed : {0.02, 0.1, 0.5}) {
    Rig rig;
    for (int i = 0; i < 20; ++i) rig.tick(kNothing);
    double largest = 0;
    for (int i = 0; i < 3000; ++i) {
      rig.input.state.X_BH.translation.x += speed * kTick;  // the hand gives way
      rig.tick({{5, 3, 0}, {}});
      largest = std::max(largest, rig.filter.status().energy);
    }
    EXPECT_EQ(rig.fault(), Fault::none) << speed;
    EXPECT_LT(largest, 0.0051) << speed;  // half the tank; the rest is for surprises
    EXPECT_GT(largest, 0.004);
    rig.input.state.X_BH.translation.x += speed * kTick;
    const Wrench out = rig.tick({{5, 3, 0}, {}});
    EXPECT_LT(std::abs(out.force.x), 0.2);
    EXPECT_NEAR(out.force.y, 3, 1e-6);  // across the motion nothing is lost
  }
}

// A light hand that the force itself makes faster, against which the slew limit is slow.
TEST(SafetyFilter, AForceThatThrowsTheHandStopsAtTheTank) {
  for (const double mass : {0.2, 0.5, 1.0}) {
    for (const double slew : {20.0, 100.0, 500.0}) {
      SafetyOptions options;
      options.max_slew = slew;
      Rig rig(options);
      for (int i = 0; i < 600; ++i) rig.tick(kNothing);
      double v = 0, work = 0, largest = 0;
      Wrench out;
      for (int i = 0; i < 3000; ++i) {
        // It holds still until there is a force, and then lets go.
        v = i < 500 ? 0 : v + (out.force.x - 0.5 * v) / mass * kTick;
        rig.input.state.X_BH.translation.x += v * kTick;
        work += out.force.x * v * kTick;
        largest = std::max(largest, work);
        out = rig.tick({{8, 0, 0}, {}});
      }
      EXPECT_LE(largest, SafetyOptions{}.energy_tank) << mass << " kg, " << slew << " N/s";
      EXPECT_GT(largest, 0.004);
    }
  }
}

TEST(SafetyFilter, GivesBackWhatTheHandHasStored) {
  Rig rig;
  for (int i = 0; i < 600; ++i) rig.tick(kNothing);
  // Into a spring wall of 500 N/m and out again, slowly: nothing is taken away.
  for (int i = 0; i <= 400; ++i) {
    const double depth = 0.01 * std::sin(kPi * i / 400);
    rig.input.state.X_BH.translation.z = -depth;
    rig.input.stored = 500 * depth * depth / 2;
    const Wrench out = rig.tick({{0, 0, 500 * depth}, {}});
    ASSERT_NEAR(out.force.z, 500 * depth, 1e-9) << i;
  }
  EXPECT_LT(rig.filter.status().energy, 1e-3);
  EXPECT_EQ(rig.filter.status().num_limited, 0u);
}

// A wall stiffer than device and rate bear, a hand that leans on it. Without the controller it
// shakes; with it the energy given stays at the tank, or the force is shut off.
TEST(SafetyFilter, TamesAWallThatWouldShake) {
  for (bool is_controlled : {false, true}) {
    SafetyOptions options;
    options.passivity_control = is_controlled;
    Rig rig(options);
    for (int i = 0; i < 600; ++i) rig.tick(kNothing);
    const double m = 0.1, b = 0.3, k = 3000, push = -2;
    double z = 0.002, v = 0, largest = -1e9, swing = 0;
    for (int i = 0; i < 5000; ++i) {
      rig.input.state.X_BH.translation.z = z;
      rig.input.state.V_BH.linear.z = v;
      rig.input.stored = z < 0 ? k * z * z / 2 : 0;
      const Wrench out = rig.tick({{0, 0, k * std::max(0.0, -z)}, {}});
      for (int sub = 0; sub < 10; ++sub) {
        v += (out.force.z + push - b * v) / m * kTick / 10;
        z += v * kTick / 10;
      }
      largest = std::max(largest, rig.filter.status().energy);
      if (i > 4000) swing = std::max(swing, std::abs(v));
      if (rig.fault() != Fault::none) break;
    }
    if (is_controlled) {
      EXPECT_LE(largest, 0.03);
      EXPECT_TRUE(rig.fault() == Fault::energy || swing < 0.5) << swing;
    } else {
      EXPECT_GT(largest, 0.1);
    }
  }
}
/// A hand that moves at a steady speed, from the pose at which it is.
struct Moving {
  Vec3d velocity, spin;  ///< m/s, rad/s
  double angle = 0;

  Wrench tick(Rig& rig, const Wrench& desired, double dt = kTick) {
    angle += norm(spin) * dt;
    rig.input.state.X_BH.translation += velocity * dt;
    if (norm(spin) > 0) rig.input.state.X_BH.rotation = axis_angle(spin, angle);
    return rig.tick(desired, dt);
  }
};

Vec3d across(const Vec3d& v, const Vec3d& direction) {
  const Vec3d e = normalized(direction);
  return v - dot(v, e) * e;
}

// While a force f goes down to zero at the slew limit S, a hand that goes along at v is given
// v (f T + f^2 / (2 S)). As long as half of the tank holds that, and what a torque gives meanwhile,
// nothing is taken away; else all of the torque that turns the hand, and of the force along the
// motion so much that the rest holds it. Nothing of what is across, or against, the motion.
TEST(SafetyEnergy, TakesWhatHalfTheTankDoesNotHoldAndNoMore) {
  test::Random random(21);
  int num_left_alone = 0, num_lowered = 0, num_only_torque = 0, num_still = 0;
  for (int run = 0; run < 200; ++run) {
    SafetyOptions options;
    options.ramp_seconds = 0;
    options.max_slew = run % 3 == 0 ? 2000 : 500;
    options.energy_tank = random.uniform(0.002, 0.02);
    Rig rig(options);
    // No torque that the slew limit holds back: it goes to nothing within a tick.
    Wrench desired{random.uniform(0.5, 6) * random.direction(),
                   random.uniform(0, 0.009) * random.direction()};
    Moving hand{random.uniform(0, 0.3) * random.direction(),
                random.uniform(0, 10) * random.direction()};
    if (run % 5 == 0) hand.velocity = {};  // it only turns
    if (run % 5 == 1) hand.spin = {};
    if (run % 7 == 0) desired.torque = {};
    rig.hold(desired);
    const double S = options.max_slew, T = kTick, v = norm(hand.velocity);
    const double f_desired = v > 0 ? dot(desired.force, hand.velocity) / v : 0;
    const double turning = std::max(dot(desired.torque, hand.spin), 0.0);
    const auto given = [&](double f) { return f > 0 ? v * f * (T + f / (2 * S)) : 0; };
    double f_out = f_desired;
    for (int i = 0; i < 2000; ++i) {
      const double f_last = f_out;
      const Wrench out = hand.tick(rig, desired);
      f_out = v > 0 ? dot(out.force, hand.velocity) / v : 0;
      ASSERT_EQ(rig.fault(), Fault::none);
      ASSERT_TRUE(is_finite(out));
      const double rest = options.energy_tank / 2 - rig.filter.status().energy;
      const double all = given(f_desired) + turning * T;
      if (std::abs(all - rest) < 1e-9 * options.energy_tank) continue;
      if (all < rest && f_desired - f_last > S * T) continue;  // on its way back
      if (all < rest) {
        ASSERT_EQ(out.force, desired.force);
        ASSERT_EQ(out.torque, desired.torque);
        ASSERT_EQ(rig.filter.status().damping, 0);
        ++num_left_alone;
        continue;
      }
      const Vec3d torque = turning > 0 ? across(desired.torque, hand.spin) : desired.torque;
      ASSERT_LT(norm(out.torque - torque), 1e-9);
      if (v == 0) {
        ASSERT_EQ(out.force, desired.force);
        ++num_still;
        continue;
      }
      ASSERT_LT(norm(across(out.force - desired.force, hand.velocity)), 1e-9);
      const double f = f_desired - rig.filter.status().damping * v;
      ASSERT_NEAR(f_out, std::clamp(f, f_last - S * T, f_last + S * T), 1e-9);
      if (given(f_desired) < rest) {
        ASSERT_NEAR(f, f_desired, 1e-9);
        ++num_only_torque;
      } else if (rest > 0) {
        ASSERT_NEAR(given(f), rest, 1e-9 * options.energy_tank);
        ++num_lowered;
      } else {  // the slew limit was too slow
        ASSERT_NEAR(f, -std::min(kLimits.max_damping * v, -rest / (v * T)), 1e-9);
      }
    }
  }
  EXPECT_GT(num_left_alone, 10000);
  EXPECT_GT(num_lowered, 10000);
  EXPECT_GT(num_only_torque, 20);
  EXPECT_GT(num_still, 100);
}

// Half of the tank overdrawn, by a hand that is faster all at once: damping takes it back within a
// tick, or as much of it as the device can bear.
TEST(SafetyEnergy, DampingTakesBackWhatIsOverdrawn) {
  for (const double max_damping : {1.0, 20.0, 500.0}) {
    for (const double speed : {0.3, 0.6}) {
      SafetyOptions options;
      options.ramp_seconds = 0;
      options.max_slew = 1e5;  // far more than is needed here
      DeviceLimits limits = kLimits;
      limits.max_damping = max_damping;
      limits.max_force = 1000;
      Rig rig(options, limits);
      const Wrench desired{{4, 3, 0}, {}};
      rig.hold(desired);
      Moving hand{{0.02, 0, 0}, {}};
      for (int i = 0; i < 60; ++i) hand.tick(rig, desired);
      ASSERT_LT(rig.filter.status().energy, options.energy_tank / 2);
      hand.velocity.x = speed;
      const Wrench out = hand.tick(rig, desired);
      const double over = rig.filter.status().energy - options.energy_tank / 2;
      ASSERT_GT(over, 0);
      const double f = std::min(max_damping * speed, over / (speed * kTick));
      EXPECT_NEAR(out.force.x, -f, 1e-9);
      EXPECT_NEAR(out.force.y, 3, 1e-9);
      EXPECT_NEAR(rig.filter.status().damping, (4 + f) / speed, 1e-9);
      if (max_damping == 500) {
        hand.tick(rig, desired);
        EXPECT_NEAR(rig.filter.status().energy, options.energy_tank / 2, 1e-9);
      }
    }
  }
}

/// J, at most, that a force gives within `dt` to a hand that gets faster at the rate `rise`.
double max_given(const Vec3d& force, const Vec3d& velocity, double rise, double dt) {
  return std::max(dot(force, velocity) + rise * dt * norm(force), 0.0) * dt;
}

/// `out` is `before` if the tank's rest holds that; else it has so much less along the motion; and
/// if that was not enough it is shorter, too. Returns whether something was taken.
bool expect_within(const Vec3d& out, const Vec3d& before, const Vec3d& velocity, double rise,
                   double dt, double rest) {
  EXPECT_LE(max_given(out, velocity, rise, dt), rest * (1 + 1e-6) + 1e-15);
  if (max_given(before, velocity, rise, dt) <= rest) {
    EXPECT_LT(norm(out - before), 1e-9 * (1 + norm(before)));
    return false;
  }
  const double power = std::max(rest / dt - rise * dt * norm(before), 0.0);
  Vec3d kept = before;
  if (norm(velocity) > 1e-12 && dot(before, velocity) > power) {
    kept = across(before, velocity) + power / dot(velocity, velocity) * velocity;
  }
  const double given = max_given(kept, velocity, rise, dt);
  const Vec3d want = given > rest ? rest / given * kept : kept;
  EXPECT_LT(norm(out - want), 1e-9 * (1 + norm(before)));
  return true;
}

// The last limit of the energy: of a force that fades, whose size at each tick is known, and a hand
// that is torn this way and that.
TEST(SafetyEnergy, WhatGoesOutNeverEmptiesTheTank) {
  test::Random random(22);
  int num = 0, num_less_force = 0, num_less_torque = 0, num_silent = 0;
  for (int run = 0; run < 3000; ++run) {
    SafetyOptions options;
    options.fade_seconds = 0.2;
    options.ramp_seconds = 0;
    options.engage_ticks = 1;
    options.energy_tank = 1e-4 * std::pow(100, random.uniform());
    Rig rig(options);
    const Wrench desired{random.uniform(0, 6) * random.direction(),
                         random.uniform(0, 0.15) * random.direction()};
    Wrench last;
    for (int i = 0; i < 60; ++i) last = rig.tick(i < 10 ? kNothing : desired);
    ASSERT_EQ(rig.filter.status().energy, 0);
    rig.input.backend_failed = true;
    double fade = 1, work = 0;
    Moving hand;
    double silence = 0;
    for (int i = 0; i < 12; ++i) {
      const double dt = random.uniform(5e-4, 4e-3);
      rig.input.state.is_valid = random.uniform() > 0.15;
      if (rig.input.state.is_valid) {
        silence = 0;
        hand.velocity = std::pow(10, random.uniform(-3, 0.5)) * random.direction();
        hand.spin = {0, 0, std::pow(10, random.uniform(-2, 1))};
        if (random.uniform() < 0.1) hand.velocity = {};
      }
      if (!rig.input.state.is_valid) silence += dt, ++num_silent;
      if (rig.input.state.is_valid) {
        work += (dot(last.force, hand.velocity) + last.torque.z * hand.spin.z) * dt;
      }
      rig.input.stored = random.uniform(0, 0.005);
      const Wrench out =
          rig.input.state.is_valid ? hand.tick(rig, desired, dt) : rig.tick(desired, dt);
      work = std::max(work, -rig.input.stored);
      ASSERT_EQ(rig.filter.status().state, ForceState::fading);
      ASSERT_NEAR(rig.filter.status().energy, work, 1e-9);
      const double next_fade = i == 0 ? 1 : fade - dt / options.fade_seconds;
      const Vec3d force = next_fade / fade * last.force, torque = next_fade / fade * last.torque;
      fade = next_fade;
      const double rest = std::max(options.energy_tank - rig.filter.status().energy, 0.0);
      const double unseen = dt + silence;
      num_less_force += expect_within(out.force, force, hand.velocity, 50, unseen, rest);
      const double left = std::max(rest - max_given(out.force, hand.velocity, 50, unseen), 0.0);
      num_less_torque += expect_within(out.torque, torque, hand.spin, 1000, unseen, left);
      ++num;
      last = out;
      if (testing::Test::HasFailure()) FAIL() << run << " " << i;
    }
  }
  EXPECT_GT(num_less_force, num / 20);
  EXPECT_GT(num_less_torque, num / 20);
  EXPECT_LT(num_less_force, num / 2);
  EXPECT_GT(num_silent, num / 20);
}

}  // namespace
}  // namespace palpate
