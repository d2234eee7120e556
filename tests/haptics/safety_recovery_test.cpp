// Return of the force with devices that leave out ticks, take their force away or have a clock
// that stands still, and where the contact is unknown.
#include <gtest/gtest.h>

#include "tests/haptics/safety_rig.h"

namespace palpate {
namespace {

using namespace test::safety_rig;  // NOLINT: all of it

/// Fades, and waits until all has been well for a while; in contact.
void wait_after_fault(Rig& rig) {
  rig.hold(kPush);
  break_once(rig);
  for (int i = 0; i < 700; ++i) rig.tick(kPush);
  ASSERT_EQ(rig.filter.status().state, ForceState::waiting);
}

// A device that answers every second tick, or has gaps of nearly the silence that is allowed.
TEST(SafetyRecovery, TheForceReturnsToADeviceThatLeavesOutTicks) {
  for (const int period : {2, 3, 5, 10}) {
    Rig rig;
    wait_after_fault(rig);
    int num_valid = 0, i = 0;
    for (; i < 1000 && !rig.filter.status().is_engaged(); ++i) {
      rig.input.state.is_valid = i % period == 0;
      num_valid += rig.input.state.is_valid;
      rig.tick(kNothing);
    }
    EXPECT_TRUE(rig.filter.status().is_engaged()) << period;
    EXPECT_EQ(num_valid, SafetyOptions{}.engage_ticks) << period;
    EXPECT_EQ(rig.filter.status().num_faults, 1u);
  }
}

// States that such a device gives in between still count, and states that are too rare do not.
TEST(SafetyRecovery, ADeviceThatLeavesOutTicksIsNotLetIntoAContact) {
  Rig rig;
  wait_after_fault(rig);
  for (int i = 0; i < 3000; ++i) {
    rig.input.state.is_valid = i % 2 == 0;
    // Free at every tick of which it says nothing, and for nine of those in a row that it knows.
    ASSERT_EQ(norm(rig.tick(i % 2 == 1 || i % 20 != 0 ? kNothing : kPush).force), 0) << i;
  }
  EXPECT_EQ(rig.filter.status().state, ForceState::waiting);
  Rig seldom;
  wait_after_fault(seldom);
  for (int i = 0; i < 1900; ++i) {
    seldom.input.state.is_valid = i % 12 == 0;
    seldom.tick(kNothing);
  }
  EXPECT_EQ(seldom.filter.status().state, ForceState::waiting);
}

// A tool that could not be measured is not free of contact.
TEST(SafetyRecovery, AContactThatIsNotMeasuredIsNone) {
  Rig rig;
  wait_after_fault(rig);
  rig.input.is_measured = false;
  for (const bool is_free : {false, true}) {
    rig.input.is_free = is_free;
    EXPECT_EQ(ticks_until_engaged(rig, 3000), -1);
  }
  rig.input.is_free = false;
  rig.input.is_measured = true;
  EXPECT_EQ(ticks_until_engaged(rig, 100), SafetyOptions{}.engage_ticks);
}

// Motors that are off do no work, whatever was meant for them; and it is a fault like others.
TEST(SafetyRecovery, ADeviceWithoutForceIsGivenNoneAndDoesNoWork) {
  Rig rig;
  rig.hold({{0, 0, 3}, {}});
  rig.input.stored = 1;
  rig.input.state.has_force = false;
  for (int i = 0; i < 2000; ++i) {  // the hand sinks in
    if (i > 0) rig.input.state.X_BH.translation.z -= 1e-4;
    ASSERT_EQ(norm(rig.tick({{0, 0, 3}, {}}).force), 0) << i;
    ASSERT_EQ(rig.filter.status().energy, 0);
    ASSERT_EQ(rig.fault(), Fault::device);
  }
  EXPECT_EQ(rig.filter.status().num_faults, 1u);
  EXPECT_EQ(rig.filter.status().state, ForceState::off);
  rig.input.state.has_force = true;
  for (int i = 0; i < 3000; ++i) ASSERT_EQ(norm(rig.tick({{0, 0, 3}, {}}).force), 0) << i;
  EXPECT_EQ(rig.filter.status().state, ForceState::waiting);
  EXPECT_EQ(ticks_until_engaged(rig, 100), SafetyOptions{}.engage_ticks);
  EXPECT_LT(norm(rig.tick({{0, 0, 3}, {}}).force), 0.01);  // by the ramp
}

TEST(SafetyRecovery, NothingEngagesBeforeTheDeviceHasItsForce) {
  Rig rig;
  rig.input.state.has_force = false;
  EXPECT_EQ(ticks_until_engaged(rig, 5000), -1);
  EXPECT_EQ(rig.filter.status().num_faults, 0u);
  EXPECT_EQ(rig.filter.status().state, ForceState::waiting);
  rig.input.state.has_force = true;
  EXPECT_NE(ticks_until_engaged(rig, 20), -1);
}

// A force without permission, or without a driver, ends also if no time passes.
TEST(SafetyRecovery, AForceThatWasLetGoEndsEvenIfTheClockStandsStill) {
  for (const bool is_dead_man : {true, false}) {
    SafetyOptions options;
    options.dead_man = is_dead_man;
    Rig rig(options);
    rig.input.state.buttons = 1;
    rig.hold(kPush);
    if (is_dead_man) rig.input.state.buttons = 0;
    rig.input.is_driven = is_dead_man;
    Wrench last = kPush;
    for (int i = 0; i < 20; ++i) {
      const Wrench out = rig.tick(kPush, 0);
      EXPECT_LE(norm(last.force - out.force), options.max_slew * kTick + 1e-9);
      last = out;
    }
    EXPECT_EQ(norm(last.force) + norm(last.torque), 0) << is_dead_man;
    EXPECT_EQ(rig.filter.status().energy, 0);
  }
}

}  // namespace
}  // namespace palpate
