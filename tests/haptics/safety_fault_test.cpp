// Faults of the safety filter: the force fades, and returns once all has been well for a while.
#include "palpate/haptics/safety.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "src/math/internal/matrix6.h"
#include "tests/haptics/safety_rig.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using namespace test::safety_rig;  // NOLINT: all of it

/// Brings a filter to a force, breaks something, and watches the fade.
template <class Break>
void expect_fade(Fault fault, Break break_it, int patience) {
  Rig rig;
  rig.hold(kPush);
  Wrench desired = kPush;
  break_it(rig.input, desired);
  int num = 0;
  Wrench out = kPush;
  while (rig.fault() == Fault::none && num <= patience) {
    out = rig.tick(desired);
    ++num;
  }
  ASSERT_EQ(rig.fault(), fault);
  EXPECT_LE(norm(out.force), norm(kPush.force));
  // Whole again: the fault stays.
  const double now = rig.input.time;
  rig.input = {};
  rig.input.time = now;
  rig.input.state.is_valid = true;
  const Wrench from = out;
  for (int i = 1; i <= 60; ++i) {
    const Wrench faded = rig.tick({{9, 9, 9}, {1, 1, 1}});
    const double rest = std::max(0.0, 1 - i * kTick / 0.05);
    EXPECT_LT(distance(faded, {from.force * rest, from.torque * rest}), 1e-9) << i;
    if (i >= 50) {
      EXPECT_EQ(norm(faded.force) + norm(faded.torque), 0);
    }
  }
  EXPECT_EQ(rig.fault(), fault);
  EXPECT_EQ(rig.filter.status().state, ForceState::off);
  EXPECT_EQ(rig.filter.status().num_faults, 1u);
  // It comes back by itself, but not into a hand that is in contact.
  for (int i = 0; i < 3000; ++i) EXPECT_EQ(norm(rig.tick(kPush).force), 0);
  EXPECT_EQ(rig.fault(), Fault::none);
  EXPECT_EQ(rig.filter.status().state, ForceState::waiting);
  EXPECT_EQ(distance(rig.hold(kPush), kPush), 0);
}

TEST(SafetyFilter, AHandWithoutTheToolSaysNothingAboutContact) {
  Rig rig;
  rig.hold(kPush);
  break_once(rig);
  // The clutch takes the contact from the hand, not from the tool.
  rig.input.is_clutched = true;
  EXPECT_EQ(ticks_until_engaged(rig, 3000), -1);
  rig.input.is_clutched = false;
  for (int i = 0; i < 3000; ++i) EXPECT_EQ(norm(rig.tick(kPush).force), 0);
  EXPECT_GE(ticks_until_engaged(rig, 3000), 0);
}

TEST(SafetyFilter, FadesOnEveryFault) {
  expect_fade(
      Fault::not_finite, [](auto&, auto& w) { w.force.y = kNan; }, 1);
  expect_fade(
      Fault::not_finite, [](auto&, auto& w) { w.torque.x = kInf; }, 1);
  expect_fade(
      Fault::not_finite, [](auto& in, auto&) { in.state.X_BH.rotation.w = kNan; }, 1);
  expect_fade(
      Fault::not_finite, [](auto& in, auto&) { in.state.V_BH.angular.y = kInf; }, 1);
  expect_fade(
      Fault::stale_contact, [](auto& in, auto&) { in.contact_age = 0.021; }, 1);
  expect_fade(
      Fault::stale_contact, [](auto& in, auto&) { in.contact_age = kNan; }, 1);
  expect_fade(
      Fault::stale_sensor, [](auto& in, auto&) { in.sensor_age = 0.51; }, 1);
  expect_fade(
      Fault::device, [](auto& in, auto&) { in.state.is_valid = false; }, 12);
  expect_fade(
      Fault::backend, [](auto& in, auto&) { in.backend_failed = true; }, 1);
  expect_fade(
      Fault::loop, [](auto& in, auto&) { in.time += 0.02; }, 1);
  expect_fade(
      Fault::loop, [](auto& in, auto&) { in.time -= 0.01; }, 1);
}

// Ages and times that are powers of two, so that they are met to the bit.
TEST(SafetyFilter, AtTheLimitsAllIsStillWell) {
  SafetyOptions options;
  options.max_contact_age = options.max_device_silence = 0.0078125;
  options.max_sensor_age = 0.25;
  options.max_tick = 0.015625;
  const auto fault_after = [&](auto change) {
    Rig rig(options);
    rig.input.time = 128;
    for (int i = 0; i < 600; ++i) rig.tick(kNothing, 0.0009765625);
    EXPECT_TRUE(rig.filter.status().is_engaged());
    change(rig);
    return rig.fault();
  };
  const double kMore = 1.0009765625;
  for (const double sign : {1.0, -1.0}) {  // a clock may be a little ahead
    EXPECT_EQ(fault_after([&](Rig& rig) {
                rig.input.contact_age = sign * options.max_contact_age;
                rig.tick(kPush);
              }),
              Fault::none);
    EXPECT_EQ(fault_after([&](Rig& rig) {
                rig.input.contact_age = sign * kMore * options.max_contact_age;
                rig.tick(kPush);
              }),
              Fault::stale_contact);
    EXPECT_EQ(fault_after([&](Rig& rig) {
                rig.input.sensor_age = sign * options.max_sensor_age;
                rig.tick(kPush);
              }),
              Fault::none);
    EXPECT_EQ(fault_after([&](Rig& rig) {
                rig.input.sensor_age = sign * kMore * options.max_sensor_age;
                rig.tick(kPush);
              }),
              Fault::stale_sensor);
  }
  EXPECT_EQ(fault_after([&](Rig& rig) { rig.tick(kPush, options.max_tick); }), Fault::none);
  EXPECT_EQ(fault_after([&](Rig& rig) { rig.tick(kPush, kMore * options.max_tick); }), Fault::loop);
  EXPECT_EQ(fault_after([&](Rig& rig) { rig.tick(kPush, 0); }), Fault::none);
  for (const int ticks : {8, 9}) {
    EXPECT_EQ(fault_after([&](Rig& rig) {
                rig.input.state.is_valid = false;
                for (int i = 0; i < ticks; ++i) rig.tick(kPush, 0.0009765625);
              }),
              ticks == 8 ? Fault::none : Fault::device);
  }
}

TEST(SafetyFilter, StopFadesToo) {
  Rig rig;
  rig.hold(kPush);
  rig.filter.stop();
  rig.tick(kPush);
  EXPECT_EQ(rig.fault(), Fault::stopped);
  for (int i = 0; i < 51; ++i) rig.tick(kPush);
  EXPECT_EQ(norm(rig.tick(kPush).force), 0);
  rig.input.is_requested = true;
  for (int i = 0; i < 2000; ++i) rig.tick(kNothing);
  EXPECT_EQ(rig.fault(), Fault::stopped);
  EXPECT_EQ(rig.filter.status().state, ForceState::ended);
}

TEST(SafetyFilter, WhatLastsTakesThePlaceOfWhatPasses) {
  Rig rig;
  rig.hold(kPush);
  rig.input.backend_failed = true;
  rig.tick(kPush);
  EXPECT_EQ(rig.fault(), Fault::backend);
  rig.input.sensor_failed = true;
  double last = norm(kPush.force);
  for (int i = 0; i < 52; ++i) {
    const double force = norm(rig.tick(kPush).force);
    EXPECT_LE(force, last);
    last = force;
  }
  EXPECT_EQ(last, 0);
  EXPECT_EQ(rig.fault(), Fault::sensor);
  EXPECT_EQ(rig.filter.status().state, ForceState::ended);
}

TEST(SafetyFilter, TooManyFaultsWithinAMinuteNeedSomebodyWhoAsks) {
  SafetyOptions options;
  options.max_recoveries = 3;
  options.recover_seconds = 0.1;
  Rig rig(options);
  rig.hold(kPush);
  for (int fault = 0; fault < 3; ++fault) {
    break_once(rig);
    EXPECT_NEAR(ticks_until_engaged(rig, 5000), 50 + 100 + 10, 2) << fault;
  }
  break_once(rig);
  EXPECT_EQ(ticks_until_engaged(rig, 120'000), -1);
  EXPECT_EQ(rig.filter.status().state, ForceState::held_off);
  EXPECT_EQ(rig.fault(), Fault::backend);
  // On request: also in contact, by the ramp.
  rig.input.is_requested = true;
  rig.tick(kPush);
  rig.input.is_requested = false;
  double last = 0;
  for (int i = 0; i < 1000; ++i) {
    const double force = norm(rig.tick(kPush).force);
    EXPECT_LE(force - last, norm(kPush.force) * kTick / options.ramp_seconds + 1e-9);
    last = force;
  }
  EXPECT_TRUE(rig.filter.status().is_engaged());
  EXPECT_NEAR(last, norm(kPush.force), 1e-9);
  // A press of button 0 is a request, too, unless it began before the fault.
  options.max_recoveries = 0;
  Rig pedal(options);
  pedal.input.state.buttons = 1;
  pedal.hold(kPush);
  break_once(pedal);
  EXPECT_EQ(ticks_until_engaged(pedal, 2000), -1);
  pedal.input.state.buttons = 0;
  pedal.tick(kNothing);
  pedal.input.state.buttons = 1;
  EXPECT_NE(ticks_until_engaged(pedal, 2000), -1);
}

// Faults that come less often than in a burst, but more often than allowed, and those that do not.
TEST(SafetyFilter, NoMinuteHasMoreReturnsThanAllowed) {
  SafetyOptions options;
  options.recover_seconds = 0.1;
  const auto returns = [&](int ticks_between, int most) {
    Rig rig(options);
    rig.hold(kPush);
    int num = 0;
    while (num < most) {
      break_once(rig);
      const int waited = ticks_until_engaged(rig, 1000);
      if (waited < 0) break;
      ++num;
      for (int i = waited + 1; i < ticks_between; ++i) rig.tick(kNothing);
    }
    return num;
  };
  EXPECT_EQ(returns(5000, 200), options.max_recoveries);  // 12 a minute
  EXPECT_EQ(returns(300, 200), options.max_recoveries);
  EXPECT_EQ(returns(7000, 60), 60);  // fewer than 9 in 60 s
}

// A request for the force in contact does not hold after the next fault.
TEST(SafetyFilter, ARequestDoesNotOutliveAFault) {
  Rig rig;
  rig.hold(kPush);
  break_once(rig);
  for (int i = 0; i < 700; ++i) rig.tick(kPush);
  ASSERT_EQ(rig.filter.status().state, ForceState::waiting);
  rig.input.is_requested = true;
  rig.input.contact_age = 1;  // so that it is not taken at once
  rig.tick(kPush);
  rig.input.is_requested = false;
  rig.input.contact_age = 0;
  break_once(rig);
  EXPECT_EQ(rig.filter.status().num_faults, 2u);
  for (int i = 0; i < 3000; ++i) ASSERT_EQ(norm(rig.tick(kPush).force), 0) << i;
  EXPECT_EQ(rig.filter.status().state, ForceState::waiting);
}

TEST(SafetyFilter, AFaultThatGoesOnIsOne) {
  SafetyOptions options;
  options.recover_seconds = 0;
  Rig rig(options);
  rig.hold(kPush);
  rig.input.backend_failed = true;
  for (int i = 0; i < 2000; ++i) rig.tick(kPush);
  EXPECT_EQ(rig.filter.status().num_faults, 1u);
  EXPECT_EQ(rig.filter.status().state, ForceState::off);
  rig.input.backend_failed = false;
  EXPECT_NE(ticks_until_engaged(rig, 20), -1);
}

// While the clock stands still, no measurement becomes too old, and no force comes down.
TEST(SafetyFilter, AClockThatStandsStillIsAFault) {
  Rig rig;
  rig.hold(kPush);
  for (int i = 0; i < 100; ++i) rig.tick(kPush, i % 3 == 0 ? kTick : 0);
  EXPECT_EQ(rig.fault(), Fault::none);
  for (int i = 0; i < 19; ++i) rig.tick(kPush, 0);
  EXPECT_EQ(rig.fault(), Fault::none);
  for (int i = 0; i < 2; ++i) rig.tick(kPush, 0);
  EXPECT_EQ(rig.fault(), Fault::loop);
  Wrench out;
  for (int i = 0; i < 1002; ++i) out = rig.tick(kPush, 0);
  EXPECT_EQ(norm(out.force) + norm(out.torque), 0);
  EXPECT_NE(ticks_until_engaged(rig, 1000), -1);
}

// A tool that is turned by its contact is in contact, whatever its force.
TEST(SafetyFilter, DoesNotComeBackIntoATorque) {
  Rig rig;
  rig.hold(kPush);
  break_once(rig);
  const double most = 0.2 / kLimits.max_force * kLimits.max_torque;  // engage_force
  for (int i = 0; i < 60; ++i) rig.tick(kPush);                      // it fades
  for (int i = 0; i < 3000; ++i) {
    ASSERT_EQ(norm(rig.tick({{}, {0, 0, 1.01 * most}}).torque), 0) << i;
  }
  EXPECT_EQ(rig.filter.status().state, ForceState::waiting);
  for (int i = 0; i < 11; ++i) rig.tick({{}, {0, 0, 0.99 * most}});
  EXPECT_TRUE(rig.filter.status().is_engaged());
  // A device without torque has none.
  Rig flat({}, {.max_force = 10, .max_damping = 20});
  flat.hold(kPush);
  break_once(flat);
  for (int i = 0; i < 700; ++i) flat.tick({{}, {0, 0, 1}});
  EXPECT_TRUE(flat.filter.status().is_engaged());
}

// Faults of every kind, for as long as they like, one after the other or several at once. Always:
// within the limits, no jump, zero in time; and back again after every one.
TEST(SafetyFilter, ComesBackAfterEveryPassingFault) {
  test::Random random(11);
  int num_by_fault[static_cast<int>(Fault::stopped) + 1] = {};
  for (int run = 0; run < 40; ++run) {
    SafetyOptions options;
    options.max_recoveries = 1000;
    options.recover_seconds = random.uniform(0, 0.3);
    options.fade_seconds = random.uniform(0.001, 0.1);
    options.ramp_seconds = random.uniform(0, 0.5);
    options.passivity_control = run % 2 == 0;
    Rig rig(options);
    Wrench last, faded_from;
    const auto tick = [&](const Wrench& desired, double dt) {
      const bool was_well = rig.fault() == Fault::none;
      const Wrench out = rig.tick(desired, dt);
      const double force = norm(out.force);
      ASSERT_TRUE(is_finite(out));
      ASSERT_LE(force, kLimits.max_force);
      ASSERT_LE(norm(out.torque), kLimits.max_torque);
      // Limit of the change per tick; a force that could empty the tank falls as fast as needed.
      const Vec3d step = out.force - last.force, twist = out.torque - last.torque;
      const bool is_exact = !options.passivity_control;
      if (rig.fault() == Fault::none) {
        const double most = options.max_slew * dt + 1e-9;
        const double max_torque_step = options.max_torque_slew * dt + 1e-9;
        ASSERT_LE(is_exact ? norm(step) : force - norm(last.force), most);
        ASSERT_LE(is_exact ? norm(twist) : norm(out.torque) - norm(last.torque), max_torque_step);
      } else {
        if (was_well) faded_from = last;
        const double share = std::max(dt, 0.0) / options.fade_seconds + 1e-3;
        if (is_exact) {
          ASSERT_LE(norm(step), share * norm(faded_from.force) + 1e-9);
          ASSERT_LE(norm(twist), share * norm(faded_from.torque) + 1e-9);
        }
        ASSERT_LE(force, norm(last.force) * (1 + 1e-12));
        ASSERT_LE(norm(out.torque), norm(last.torque) * (1 + 1e-12));
        const bool is_late =
            rig.input.time - rig.filter.status().fault_time > options.fade_seconds + dt + 1e-9;
        ASSERT_TRUE(was_well || !is_late || norm(out.force) + norm(out.torque) == 0);
      }
      last = out;
    };
    for (int round = 0; round < 20; ++round) {
      for (int i = 0; i < 50; ++i) tick(kNothing, kTick);
      const int num_pushes = static_cast<int>(random.uniform(0, 900));
      for (int i = 0; i < num_pushes; ++i) tick(kPush, kTick);
      const SafetyInput well = rig.input;
      const int kind = static_cast<int>(random.bits() % 8),
                kind2 = static_cast<int>(random.bits() % 8);
      Wrench desired = kPush;
      for (const int k : {kind, random.uniform() < 0.3 ? kind2 : kind}) {
        if (k == 0) desired.force.x = kNan;
        if (k == 1) rig.input.contact_age = 0.03;
        if (k == 2) rig.input.sensor_age = 3;
        if (k == 3) rig.input.state.is_valid = false;
        if (k == 4) rig.input.backend_failed = true;
        if (k == 5) rig.input.state.V_BH.angular.y = kInf;
        if (k == 6) tick(kPush, random.uniform(0.021, 3));
        if (k == 7) tick(kPush, -0.01);
      }
      const int num_bad = 20 + static_cast<int>(random.uniform(0, 400));
      tick(desired, kTick);
      const Fault first = rig.fault();
      for (int i = 1; i < num_bad; ++i) tick(desired, kTick);
      ++num_by_fault[static_cast<int>(first == Fault::none ? rig.fault() : first)];
      const double now = rig.input.time;
      rig.input = well;
      rig.input.time = now;
      const int most = static_cast<int>((options.fade_seconds + options.recover_seconds) / kTick) +
                       options.engage_ticks + 3;
      for (int i = 0; i < most; ++i) tick(kNothing, kTick);
      ASSERT_TRUE(rig.filter.status().is_engaged()) << run << " " << round << " " << kind;
    }
  }
  for (const Fault fault : {Fault::not_finite, Fault::stale_contact, Fault::stale_sensor,
                            Fault::device, Fault::loop, Fault::backend}) {
    EXPECT_GT(num_by_fault[static_cast<int>(fault)], 10) << name_of(fault);
  }
}

TEST(SafetyFilter, EnergyIsForgivenOnceThereIsNoForce) {
  Rig rig;
  rig.hold(kPush);
  // Somebody is pushed along by force: more than damping can take back.
  for (int i = 0; i < 200 && rig.fault() == Fault::none; ++i) {
    rig.input.state.X_BH.translation += kPush.force * 1e-2;
    rig.tick(kPush);
  }
  ASSERT_EQ(rig.fault(), Fault::energy);
  EXPECT_NE(ticks_until_engaged(rig, 1000), -1);
  EXPECT_EQ(distance(rig.hold(kPush), kPush), 0);
}

TEST(SafetyFilter, TheFadeEndsEvenIfTheClockStandsStill) {
  for (double time : {0.0, kNan, 100.5}) {
    Rig rig;
    rig.hold(kPush);
    rig.filter.stop();
    rig.input.time = time;
    Wrench out;
    for (int i = 0; i < 1002; ++i) out = rig.filter.filter(kPush, rig.input);
    EXPECT_EQ(norm(out.force), 0) << time;
  }
}

TEST(SafetyFilter, WaitsForContactAndDeviceBeforeItEngages) {
  Rig rig;
  rig.input.contact_age = kInf;
  rig.input.state.is_valid = false;
  for (int i = 0; i < 500; ++i) EXPECT_EQ(norm(rig.tick(kPush).force), 0);
  EXPECT_EQ(rig.fault(), Fault::none);
  rig.input.contact_age = 0;
  rig.input.state.is_valid = true;
  EXPECT_EQ(distance(rig.hold(kPush), kPush), 0);

  Rig never;
  never.input.contact_age = kInf;
  for (int i = 0; i < 2100; ++i) never.tick(kPush);
  EXPECT_EQ(never.fault(), Fault::stale_contact);
}

}  // namespace
}  // namespace palpate
