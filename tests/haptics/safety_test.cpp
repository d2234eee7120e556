#include "palpate/haptics/safety.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "src/math/internal/matrix6.h"
#include "tests/haptics/safety_rig.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using namespace test::safety_rig;  // NOLINT: all of it

TEST(SafetyFilter, LetsThroughWhatIsHarmless) {
  Rig rig;
  EXPECT_EQ(distance(rig.hold(kPush), kPush), 0);
  EXPECT_TRUE(rig.filter.status().is_engaged());
  EXPECT_EQ(rig.filter.status().gain, 1);
  EXPECT_EQ(rig.fault(), Fault::none);
}

TEST(SafetyFilter, RefusesOptionsOutOfRange) {
  const auto is_refused = [](auto change) {
    SafetyOptions options;
    DeviceLimits limits = kLimits;
    change(options, limits);
    return !SafetyFilter::create(limits, options).has_value();
  };
  EXPECT_TRUE(is_refused([](auto&, auto& l) { l.max_force = -1; }));
  EXPECT_TRUE(is_refused([](auto&, auto& l) { l.max_force = kInf; }));
  EXPECT_TRUE(is_refused([](auto&, auto& l) { l.max_torque = kNan; }));
  EXPECT_TRUE(is_refused([](auto& o, auto&) { o.force_share = 1.1; }));
  EXPECT_TRUE(is_refused([](auto& o, auto&) { o.max_slew = 0; }));
  EXPECT_TRUE(is_refused([](auto& o, auto&) { o.fade_seconds = kNan; }));
  EXPECT_TRUE(is_refused([](auto& o, auto&) { o.max_contact_age = -1; }));
  EXPECT_TRUE(is_refused([](auto& o, auto&) { o.energy_tank = 0; }));
  EXPECT_FALSE(is_refused([](auto&, auto&) {}));
}

TEST(SafetyFilter, LimitsForceAndTorqueEachAlongItsDirection) {
  SafetyOptions options;
  options.force_share = 0.5;
  Rig rig(options);
  const Wrench out = rig.hold({{30, 0, 40}, {0, -3, 0}});
  EXPECT_LT(norm(out.force - Vec3d{3, 0, 4}), 1e-9);
  EXPECT_LT(norm(out.torque - Vec3d{0, -0.1, 0}), 1e-9);
  EXPECT_GT(rig.filter.status().num_limited, 900u);

  Rig no_torque({}, {.max_force = 10});
  EXPECT_EQ(norm(no_torque.hold(kPush).torque), 0);
}

TEST(SafetyFilter, DoesNotJump) {
  SafetyOptions options;
  options.ramp_seconds = 0;
  Rig rig(options);
  for (int i = 0; i < 20; ++i) rig.tick(kNothing);
  for (int i = 1; i <= 20; ++i) {
    const Wrench out = rig.tick({{8, 0, 0}, {0, 0, 0.1}});
    EXPECT_NEAR(out.force.x, std::min(8.0, 0.5 * i), 1e-9);
    EXPECT_NEAR(out.torque.z, std::min(0.1, 0.01 * i), 1e-9);
  }
}

TEST(SafetyFilter, EngagesAfterQuietTicksAndRampsUp) {
  Rig rig;
  rig.tick(kNothing);
  for (int i = 0; i < 50; ++i) {
    EXPECT_EQ(norm(rig.tick(kPush).force), 0);
    EXPECT_FALSE(rig.filter.status().is_engaged());
  }
  for (int i = 0; i < 9; ++i) rig.tick(kNothing);
  EXPECT_FALSE(rig.filter.status().is_engaged());
  rig.tick(kNothing);
  EXPECT_TRUE(rig.filter.status().is_engaged());
  for (int i = 1; i <= 600; ++i) {
    const Wrench out = rig.tick(kPush);
    const double gain = std::min(1.0, i * kTick / 0.5);
    EXPECT_NEAR(rig.filter.status().gain, gain, 1e-9);
    EXPECT_NEAR(norm(out.force), gain * norm(kPush.force), 1e-6);
  }
}

TEST(SafetyFilter, LetsAHandThatBeginsInsideInAfterATime) {
  Rig rig;
  rig.tick(kPush);
  for (int i = 0; i < 1998; ++i) rig.tick(kPush);
  EXPECT_FALSE(rig.filter.status().is_engaged());
  for (int i = 0; i < 3; ++i) rig.tick(kPush);
  EXPECT_TRUE(rig.filter.status().is_engaged());
  EXPECT_LT(norm(rig.tick(kPush).force), 0.05);
}

TEST(SafetyFilter, DeadMan) {
  SafetyOptions options;
  options.dead_man = true;
  Rig rig(options);
  EXPECT_EQ(norm(rig.hold(kPush).force), 0);
  rig.input.state.buttons = 1;
  EXPECT_EQ(distance(rig.hold(kPush), kPush), 0);
  rig.input.state.buttons = 2;
  double last = norm(kPush.force);
  for (int i = 0; i < 10; ++i) {
    const double force = norm(rig.tick(kPush).force);
    EXPECT_LE(last - force, 500 * kTick + 1e-9);
    last = force;
  }
  EXPECT_EQ(last, 0);
  EXPECT_EQ(rig.fault(), Fault::none);
  // Pressed again inside: it waits and ramps as at the start, also after a fault that has passed.
  rig.input.state.buttons = 1;
  EXPECT_EQ(norm(rig.tick(kPush).force), 0);
  break_once(rig);
  EXPECT_NE(ticks_until_engaged(rig, 1000), -1);
  rig.input.state.buttons = 0;
  rig.tick(kPush);
  rig.input.state.buttons = 1;
  for (int i = 0; i < 1900; ++i) EXPECT_EQ(norm(rig.tick(kPush).force), 0);
  for (int i = 0; i < 700; ++i) rig.tick(kPush);
  EXPECT_EQ(distance(rig.tick(kPush), kPush), 0);
}

// A hand that was given energy is not held back once it has let go of the switch.
TEST(SafetyFilter, AReleasedDeadManSwitchEndsDampingToo) {
  SafetyOptions options;
  options.dead_man = true;
  options.energy_tank = 0.02;
  Rig rig(options);
  rig.input.state.buttons = 1;
  rig.hold(kPush);
  for (int i = 0; i < 4; ++i) {  // along with the force: more than half of the tank
    rig.input.state.X_BH.translation += 1e-3 * normalized(kPush.force);
    rig.tick(kPush);
  }
  ASSERT_EQ(rig.fault(), Fault::none);
  EXPECT_GT(rig.filter.status().damping, 0);
  rig.input.state.buttons = 0;
  for (int i = 0; i < 200; ++i) {
    rig.input.state.X_BH.translation += 2e-5 * normalized(kPush.force);
    const Wrench out = rig.tick(kPush);
    ASSERT_TRUE(i < 20 || norm(out.force) + norm(out.torque) == 0) << i;
  }
  EXPECT_EQ(rig.filter.status().energy, 0);
}

TEST(SafetyFilter, EveryFaultIsDescribed) {
  for (int i = 0; i <= static_cast<int>(Fault::stopped); ++i) {
    EXPECT_GT(describe(static_cast<Fault>(i)).size(), 7u);
  }
}

// A fault once, when it comes; else what the state has become.
TEST(SafetyFilter, EveryChangeIsDescribedOnce) {
  const auto change = [](ForceState from, Fault before, ForceState to, Fault after) {
    SafetyStatus a, b;
    a.state = from, a.fault = before;
    b.state = to, b.fault = after;
    return describe_change(a, b);
  };
  using enum ForceState;
  for (int i = 1; i <= static_cast<int>(Fault::stopped); ++i) {
    const auto fault = static_cast<Fault>(i);
    EXPECT_EQ(change(engaged, Fault::none, fading, fault), describe(fault));
    EXPECT_EQ(change(fading, fault, off, fault), "");
    EXPECT_NE(change(off, fault, waiting, Fault::none).find("well again"), std::string::npos);
    EXPECT_NE(change(off, fault, held_off, fault).find("too many faults"), std::string::npos);
  }
  EXPECT_EQ(change(fading, Fault::backend, fading, Fault::sensor), describe(Fault::sensor));
  EXPECT_NE(change(engaged, Fault::none, waiting, Fault::none).find("let go"), std::string::npos);
  EXPECT_NE(change(waiting, Fault::none, engaged, Fault::none).find("comes up"), std::string::npos);
  EXPECT_EQ(change(engaged, Fault::none, engaged, Fault::none), "");
}

// A million hostile ticks. Always: numbers, within the limits, no jump; a fault only ever lets the
// force fall, to exactly zero in time, and what comes after it begins at zero.
TEST(SafetyFilter, HoldsWhateverComesIn) {
  test::Random random(7);
  const double bad[] = {kNan, kInf, -kInf, 1e308, -1e308, 5e-324, 0, -0.0, 1e9, -1e9};
  const auto strange = [&](double usual, double share) {
    return random.uniform() < share ? bad[random.bits() % 10] : usual;
  };
  std::uint64_t num_ticks = 0, num_faults = 0, num_engaged = 0, num_forces = 0;
  int num_by_fault[names_of(Fault{}).size()] = {};
  for (int run = 0; run < 500; ++run) {
    SafetyOptions options;
    options.force_share = random.uniform();
    options.max_slew = std::exp(random.uniform(1, 9));
    options.max_torque_slew = std::exp(random.uniform(-2, 5));
    options.ramp_seconds = run % 3 ? random.uniform(0, 0.1) : 0;
    options.fade_seconds = run % 7 ? random.uniform(0, 0.1) : 0;
    options.dead_man = run % 5 == 0;
    options.passivity_control = run % 4 != 0;
    options.engage_ticks = 1 + run % 10;
    options.engage_timeout = 0.02;
    options.recover_seconds = random.uniform(0, 0.03);
    options.max_recoveries = run % 6 ? 1000 : 2;
    // From quite tame to hostile.
    const double share = std::pow(10, random.uniform(-5, -1.5));
    SafetyFilter filter = make_filter(options);
    const double max_force = options.force_share * kLimits.max_force * (1 + 1e-12);
    const double max_torque = options.force_share * kLimits.max_torque * (1 + 1e-12);

    double time = random.uniform(0, 1e6), last_time = time, fault_time = 0;
    int num_still = 0;
    bool is_fading = false, is_new = true;
    Wrench last;
    SafetyInput input;
    const test::AllocationCounter counter;
    for (int i = 0; i < 2000; ++i, ++num_ticks) {
      const double dt =
          random.uniform() < 0.01 ? random.uniform(-0.01, 0.05) : random.uniform(1e-4, 2e-3);
      time += share > 1e-4 ? dt : kTick;
      input.time = strange(time, share / 5);
      input.state.is_valid = random.uniform() > share;
      input.state.buttons = random.uniform() > share;
      input.state.X_BH.translation += random.in_box(1e-3);
      const Vec3d kept = input.state.X_BH.translation;
      input.state.X_BH.translation.x = strange(kept.x, share / 5);
      input.state.X_BH.rotation = random.rotation(3);
      input.state.V_BH.linear.y = strange(0.1, share / 5);
      input.contact_age = strange(random.uniform(0, 0.019), share / 5);
      input.sensor_age = strange(random.uniform(0, 0.4), share / 5);
      input.backend_failed = random.uniform() < share / 10;
      input.sensor_failed = random.uniform() < share / 200;
      input.is_requested = random.uniform() < 0.01;
      const double size = std::exp(random.uniform(-3, 4));
      Wrench desired{size * random.direction(), 0.1 * size * random.direction()};
      desired.force.x = strange(desired.force.x, share / 5);
      desired.torque.z = strange(desired.torque.z, share / 5);
      const Fault before = filter.status().fault;
      const double last_gain = filter.status().gain;

      const Wrench out = filter.filter(i % 50 < 12 ? Wrench{} : desired, input);
      const SafetyStatus& status = filter.status();
      ASSERT_TRUE(is_finite(out));
      ASSERT_LE(norm(out.force), max_force);
      ASSERT_LE(norm(out.torque), max_torque);
      const double step = is_new ? 0 : input.time - last_time;
      is_new = false;
      if (status.fault == Fault::none) {
        if (is_fading) {
          ASSERT_EQ(norm(last.force) + norm(last.torque), 0);
        }
        is_fading = false;
        if (!options.passivity_control) {
          ASSERT_LE(norm(out.force - last.force), options.max_slew * step + 1e-12);
          ASSERT_LE(norm(out.torque - last.torque), options.max_torque_slew * step + 1e-12);
        }
        // A force that empties the tank falls as fast as it has to.
        ASSERT_LE(norm(out.force), norm(last.force) + options.max_slew * step + 1e-12);
        ASSERT_LE(norm(out.torque), norm(last.torque) + options.max_torque_slew * step + 1e-12);
        num_engaged += status.is_engaged();
        num_forces += norm(out.force) > 0.01;
      } else {
        ASSERT_LE(norm(out.force), norm(last.force) * (1 + 1e-12));
        ASSERT_LE(norm(out.torque), norm(last.torque) * (1 + 1e-12));
        ASSERT_LE(status.gain, last_gain);
        if (!is_fading) {
          is_fading = true;
          fault_time = 0;
          num_still = 0;
          ++num_faults;
          ++num_by_fault[static_cast<int>(status.fault)];
        } else {
          ASSERT_TRUE(status.fault == before || is_lasting(status.fault));
          if (step > 0) {
            fault_time += step;
          } else {
            ++num_still;
          }
        }
        if (fault_time >= options.fade_seconds * (1 + 1e-6) || num_still > 1000) {
          ASSERT_EQ(norm(out.force) + norm(out.torque), 0);
        }
      }
      if (std::isfinite(input.time)) last_time = input.time;
      last = out;
      input.state.X_BH.translation = kept;
      if (random.uniform() < 3e-5) filter.stop();
    }
    ASSERT_EQ(counter.count(), 0u);
  }
  EXPECT_EQ(num_ticks, 1'000'000u);
  EXPECT_GT(num_faults, 1000u);
  EXPECT_GT(num_engaged, 100'000u);
  EXPECT_GT(num_forces, 50'000u);
  for (int i = 1; i <= static_cast<int>(Fault::stopped); ++i) {
    EXPECT_GT(num_by_fault[i], 5) << name_of(static_cast<Fault>(i));
  }
}

}  // namespace
}  // namespace palpate
