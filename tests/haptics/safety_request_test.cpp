// Button 0 after a fault: when its press asks for the force, and when it does not.
#include <gtest/gtest.h>

#include "tests/haptics/safety_rig.h"

namespace palpate {
namespace {

using namespace test::safety_rig;  // NOLINT: all of it

void set_button(Rig& rig, bool is_pressed) { rig.input.state.buttons = is_pressed ? 1 : 0; }

/// Has had a fault and waits in contact for the hand to leave it.
void wait_in_contact(Rig& rig) {
  rig.hold(kPush);
  break_once(rig);
  for (int i = 0; i < 700; ++i) rig.tick(kPush);
  ASSERT_EQ(rig.filter.status().state, ForceState::waiting);
}

void expect_no_force(Rig& rig, int num_ticks) {
  for (int i = 0; i < num_ticks; ++i) ASSERT_EQ(norm(rig.tick(kPush).force), 0) << i;
}

/// It comes in contact, by the ramp.
void expect_ramp(Rig& rig) {
  const double most = norm(kPush.force) * kTick / SafetyOptions().ramp_seconds + 1e-9;
  double last = 0;
  for (int i = 0; i < 1200; ++i) {
    const double force = norm(rig.tick(kPush).force);
    ASSERT_LE(force - last, most) << i;
    last = force;
  }
  EXPECT_EQ(last, norm(kPush.force));
}

TEST(SafetyRequest, APressAfterAFaultBringsTheForceBackInContact) {
  for (const int wait : {100, 400, 700, 3000}) {  // ticks: off until 550, then waiting
    Rig rig;
    rig.hold(kPush);
    break_once(rig);
    for (int i = 0; i < wait; ++i) rig.tick(kPush);
    ASSERT_FALSE(rig.filter.status().is_engaged());
    set_button(rig, true);
    expect_ramp(rig);
  }
}

TEST(SafetyRequest, APressThatBeganBeforeTheFaultAsksForNothing) {
  Rig rig;
  set_button(rig, true);
  wait_in_contact(rig);
  expect_no_force(rig, 3000);
  set_button(rig, false);
  expect_no_force(rig, 100);
  set_button(rig, true);
  expect_ramp(rig);
}

// At the start nobody has lost a force: the hand waits as long as any.
TEST(SafetyRequest, APressBeforeAnyFaultAsksForNothing) {
  Rig rig;
  expect_no_force(rig, 100);
  set_button(rig, true);
  expect_no_force(rig, 1800);
  EXPECT_EQ(rig.filter.status().state, ForceState::waiting);
}

TEST(SafetyRequest, ADeadManSwitchPermitsAndDoesNotAsk) {
  SafetyOptions options;
  options.dead_man = true;
  Rig rig(options);
  set_button(rig, true);
  wait_in_contact(rig);
  set_button(rig, false);
  expect_no_force(rig, 10);
  set_button(rig, true);
  expect_no_force(rig, 3000);
  EXPECT_NE(ticks_until_engaged(rig, 20), -1);
}

// Not while the force is away, nor while it waits: the tool may be in contact when it is taken hold
// of again.
TEST(SafetyRequest, ThePressOfTheClutchAsksForNothing) {
  for (const int wait : {100, 700}) {
    Rig rig;
    rig.hold(kPush);
    break_once(rig);
    for (int i = 0; i < wait; ++i) rig.tick(kPush);
    set_button(rig, true);
    rig.input.is_clutched = true;
    for (int i = 0; i < 1000; ++i) ASSERT_EQ(norm(rig.tick(kNothing).force), 0);
    set_button(rig, false);
    rig.input.is_clutched = false;
    expect_no_force(rig, 3000);
    EXPECT_NE(ticks_until_engaged(rig, 20), -1);
  }
}

// Whoever waits for another reason than a fault waits as at the start.
TEST(SafetyRequest, APressAfterAFaultThatIsOverAsksForNothing) {
  Rig rig;
  wait_in_contact(rig);
  ASSERT_NE(ticks_until_engaged(rig, 1000), -1);
  rig.input.is_driven = false;
  for (int i = 0; i < 1000; ++i) rig.tick(kPush);
  rig.input.is_driven = true;
  expect_no_force(rig, 100);
  ASSERT_EQ(rig.filter.status().state, ForceState::waiting);
  set_button(rig, true);
  expect_no_force(rig, 1800);
}

TEST(SafetyRequest, APressWhileNothingDrivesTheHandAsksForNothing) {
  Rig rig;
  wait_in_contact(rig);
  break_once(rig);
  expect_no_force(rig, 100);
  rig.input.is_driven = false;
  set_button(rig, true);
  expect_no_force(rig, 700);
  rig.input.is_driven = true;
  expect_no_force(rig, 3000);
}

TEST(SafetyRequest, AButtonThatTheDeviceDoesNotReportForAMomentIsNotPressedAnew) {
  Rig rig;
  set_button(rig, true);
  rig.hold(kPush);
  for (const bool is_valid : {false, true}) {
    if (!is_valid) rig.input.state.is_valid = false;
    if (is_valid) rig.input.state.X_BH.translation.x = kNan;
    set_button(rig, false);
    for (int i = 0; i < 100; ++i) rig.tick(kPush);
    EXPECT_EQ(rig.fault(), is_valid ? Fault::not_finite : Fault::device);
    rig.input.state.is_valid = true;
    rig.input.state.X_BH = {};
    set_button(rig, true);
    expect_no_force(rig, 3000);
    EXPECT_EQ(rig.filter.status().state, ForceState::waiting);
  }
}

}  // namespace
}  // namespace palpate
