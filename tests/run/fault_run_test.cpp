// Faults of every kind at random, with every coupling, friction, objects and bodies: what the
// device is told stays within its limits, falls to zero in time, and comes back from there.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>

#include "palpate/mesh/mesh.h"
#include "src/run/internal/pipeline.h"
#include "tests/run/live_loop_fixtures.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using test::device_info;
using test::WallSource;

constexpr double kTick = 1e-3, kFrame = 1.0 / 30;

RunSettings settings_with(CouplingKind kind) {
  RunSettings settings;
  settings.num_threads = 1;
  settings.coupling.X_WB.translation = {0, 0, 0.45};
  settings.coupling.kind = kind;
  settings.coupling.clutch_button = 1;  // which is also the one that asks for the force
  settings.safety.ramp_seconds = 0.1;
  settings.safety.recover_seconds = 0.1;
  settings.safety.engage_timeout = 0.1;
  settings.safety.energy_tank = 0.1;
  settings.safety.max_recoveries = 1000;
  return settings;
}

/// One block that stands beside the place where the tool is pressed in, and one that can be moved.
void add_objects(RunSettings& settings) {
  static const auto block =
      std::make_shared<const Tool>(test::packed(make_box({0.06, 0.06, 0.03}), 100));
  settings.objects = {{block, {{0.05, 0, 0.47}, {}}, 0.5},
                      {block, {{-0.05, 0, 0.47}, {}}, {}, true, 0.1}};
  settings.bodies.gravity_y = 0;
}

/// The parts of a live loop in one thread, each of which can stall.
class Loop {
 public:
  explicit Loop(const RunSettings& settings)
      : settings_(settings), index_(ToolIndex::create(test::box_tool())) {
    const DeviceInfo device = device_info();
    auto parts = make_run_parts(index_, {&source_.info(), 1}, device, settings).value();
    timeline_ = std::make_unique<SurfaceTimeline>(std::move(parts.timelines[0]));
    contact_part_ = std::move(parts.contact);
    hand_ = std::make_unique<HandPart>(std::move(parts.coupling),
                                       SafetyFilter::create(device.limits, settings.safety).value(),
                                       kTick);
  }

  const TickRecord& tick(const DeviceState& state, const TickFlags& flags, bool has_frames,
                         bool has_contacts) {
    if (has_frames && (num_frames_ == 0 || state.time >= last_frame_ + kFrame)) {
      EXPECT_TRUE(source_.next(frame_).value());
      last_frame_ = state.time;
      timeline_->push(frame_, state.time, pool_);
      ++num_frames_;
    }
    hand_->tick(state, contact_, flags, record_);
    if (has_contacts && hand_->has_tool()) measure(state.time);
    return record_;
  }
  void change(CouplingKind kind) {
    RunSettings after = settings_;
    after.coupling.kind = kind;
    RunPartsOptions options;
    options.before = &settings_;
    auto parts =
        make_run_parts(index_, {&source_.info(), 1}, device_info(), after, options).value();
    hand_->change(++revision_, parts.coupling);
    settings_ = after;
  }
  CouplingKind kind() const { return settings_.coupling.kind; }
  /// Sets if queries report from now on that they could not measure.
  void be_blind(bool is_blind) { is_blind_ = is_blind; }

 private:
  void measure(double time) {
    views_.begin();
    views_.show(0, {}, timeline_->at(time), {});
    ContactRecord contact;
    contact.number = contact_.number + 1;
    contact.X_WT = record_.step.X_WT;
    contact.capture_time = last_frame_;
    contact.contact.time = time;
    contact_part_->measure(views_.all(), true, contact);
    if (is_blind_) {
      contact.penetration = {};
      contact.penetration.status = StepStatus::outside_window;
      contact.contact = local_contact(contact.penetration, {}, contact.X_WT, {}, {1}, time, 0);
    }
    contact_ = contact;
  }

  RunSettings settings_;
  std::shared_ptr<const ToolIndex> index_;
  WallSource source_{WallSource::Options()};
  ThreadPool pool_{1};
  std::unique_ptr<SurfaceTimeline> timeline_;
  std::unique_ptr<ContactPart> contact_part_;
  std::unique_ptr<HandPart> hand_;
  CameraViews views_{1};
  DepthFrame frame_;
  ContactRecord contact_;
  TickRecord record_;
  double last_frame_ = 0;
  int num_frames_ = 0;
  bool is_blind_ = false;
  std::uint32_t revision_ = 0;
};

/// Motion of the hand, which a fault may change.
struct HeldHandle {
  double time = 1000;
  double depth = -0.03;  // of the handle, m; the tool touches the wall at 0.025
  Vec3d pushed;          // along with a force
  bool has_clutch = false;

  DeviceState state() const {
    DeviceState state;
    state.time = time;
    state.X_BH = {Vec3d{0.003 * std::sin(9 * time), 0.002 * std::sin(7 * time), depth} + pushed,
                  axis_angle({1, 2, 3}, 0.05 * std::sin(5 * time))};
    state.V_BH.linear = {0.027 * std::cos(9 * time), 0.014 * std::cos(7 * time), 0};
    state.buttons = has_clutch ? 1 : 0;
    state.is_valid = true;
    return state;
  }
};

/// s from the last good tick before a fault to the tick that must find it, at the most.
double found_within(Fault fault, const SafetyOptions& safety) {
  switch (fault) {
    case Fault::stale_contact: return safety.max_contact_age + kTick;
    case Fault::stale_sensor: return safety.max_sensor_age + kTick;
    case Fault::device: return safety.max_device_silence + kTick;
    default: return kTick;
  }
}

/// Checks every wrench as it comes.
class Watch {
 public:
  explicit Watch(const SafetyOptions& safety) : safety_(safety), limits_(device_info().limits) {}

  void look(const TickRecord& tick, bool is_driven, bool is_requested) {
    const double force = norm(tick.F_H_B.force), torque = norm(tick.F_H_B.torque);
    const SafetyStatus& now = tick.safety;
    ASSERT_TRUE(is_finite(tick.F_H_B));
    ASSERT_LE(force, limits_.max_force);
    ASSERT_LE(torque, limits_.max_torque);
    const double dt = std::clamp(tick.device.time - time_, 0.0, 0.005);
    time_ = tick.device.time;
    const bool is_off = now.fault != Fault::none || !is_driven;
    // It rises no faster than it may, by the ramp, and never while there is a fault.
    const double rise = is_off ? 0 : safety_.max_slew * dt;
    ASSERT_LE(force, last_force_ + rise + 1e-9);
    const double torque_rise = is_off ? 0 : safety_.max_torque_slew * dt;
    ASSERT_LE(torque, last_torque_ + torque_rise + 1e-9);
    if (!is_off) {
      ASSERT_LE(force, std::max(last_force_, now.gain * limits_.max_force) + 1e-9);
      ASSERT_LE(torque, std::max(last_torque_, now.gain * limits_.max_torque) + 1e-9);
      ASSERT_TRUE(!was_engaged_ || now.gain <= last_gain_ + dt / safety_.ramp_seconds + 1e-9);
      ASSERT_TRUE(!tick.step.is_clutched || now.gain == 0);
    }
    // Zero in time, by the clock or by ticks of which it says nothing.
    num_off_ = is_off ? num_off_ + 1 : 0;
    ASSERT_TRUE(num_off_ <= 1002 || force + torque == 0);
    if (is_driven && is_off && tick.device.time > now.fault_time + safety_.fade_seconds + 0.002) {
      ASSERT_EQ(force + torque, 0);
    }
    has_ended_ = has_ended_ || (is_driven && is_lasting(now.fault) && force + torque == 0);
    ASSERT_TRUE(!has_ended_ || force + torque == 0);
    // After a fault into a free hand only, unless somebody has asked since.
    if (now.num_faults > num_faults_) was_asked_ = false;
    num_faults_ = std::max(num_faults_, now.num_faults);
    was_asked_ = was_asked_ || is_requested;
    const bool is_back = is_driven && now.is_engaged() && !was_engaged_;
    if (is_back && num_faults_ > num_faults_then_) {
      ++num_returns_;
      ASSERT_LE(last_force_ + last_torque_, 0);
      // Neither the force on a hand without the tool nor a contact that could not be measured shows
      // that the tool is free.
      const bool is_free =
          !tick.step.is_clutched && !tick.penetration.status.is_unmeasured() &&
          (tick.penetration.volume == 0 || norm(tick.step.F_H_B.force) < safety_.engage_force);
      ASSERT_TRUE(is_free || was_asked_);
      num_returns_into_contact_ += !is_free;
    }
    if (is_back) num_faults_then_ = num_faults_;
    was_engaged_ = is_driven && now.is_engaged();
    last_force_ = force;
    last_torque_ = torque;
    last_gain_ = now.gain;
  }
  double last_force() const { return last_force_; }
  int num_returns() const { return num_returns_; }
  int num_returns_into_contact() const { return num_returns_into_contact_; }
  bool has_ended() const { return has_ended_; }

 private:
  SafetyOptions safety_;
  DeviceLimits limits_;
  double time_ = 0, last_force_ = 0, last_torque_ = 0, last_gain_ = 0;
  std::uint32_t num_faults_ = 0, num_faults_then_ = 0;
  int num_off_ = 0, num_returns_ = 0, num_returns_into_contact_ = 0;
  bool was_engaged_ = false, has_ended_ = false, was_asked_ = false;
};

constexpr int kNumFaults = static_cast<int>(Fault::stopped);
struct Counts {
  std::array<int, kNumFaults + 1> faults{}, forces_taken{};
  int num_clutched_faults = 0, num_let_go_in_contact = 0;
  int num_returns = 0, num_into_contact = 0, num_forces = 0, num_object_ticks = 0;
};

void run(CouplingKind kind, bool with_friction, bool with_objects, unsigned seed, Counts& counts) {
  test::Random random(seed);
  RunSettings settings = settings_with(kind);
  if (with_friction) settings.coupling.friction.coefficient = 0.4;
  if (with_objects) add_objects(settings);
  const bool is_limited = seed % 4 == 0;  // nobody asks for the force then
  if (is_limited) settings.safety.max_recoveries = 3;
  Loop loop(settings);
  Watch watch(settings.safety);
  HeldHandle hand;
  TickFlags flags;
  bool has_frames = true, has_contacts = true;
  TickRecord last;
  const auto tick = [&](DeviceState state) {
    last = loop.tick(state, flags, has_frames, has_contacts);
    const bool is_driven = loop.kind() != CouplingKind::none;
    watch.look(last, is_driven, flags.is_force_requested);
    counts.num_forces += norm(last.F_H_B.force) > 0.1;
    counts.num_object_ticks += last.num_object_pairs > 0;
    flags.is_force_requested = false;
  };
  const auto tick_well = [&](int num) {
    for (int i = 0; i < num && !testing::Test::HasFatalFailure(); ++i) {
      hand.time += kTick;
      tick(hand.state());
    }
  };
  int num_recovered = 0;
  for (int round = 0; round < 13 && !testing::Test::HasFatalFailure(); ++round) {
    hand.depth = -0.03;
    hand.pushed = {};
    tick_well(300);
    const bool was_engaged = last.safety.is_engaged() && loop.kind() != CouplingKind::none;
    if (!is_limited && !watch.has_ended() && loop.kind() != CouplingKind::none) {
      ASSERT_TRUE(was_engaged) << "round " << round << ", " << name_of(last.safety.state) << ", "
                               << name_of(last.safety.fault);
    }
    hand.depth = random.uniform() < 0.8 ? 0.035 : 0.02;
    tick_well(150);
    // Lasting faults come once, at the end.
    const auto fault = static_cast<Fault>(
        round == 12 ? static_cast<int>(Fault::sensor) + static_cast<int>(random.bits() % 2)
                    : 1 + static_cast<int>(random.bits() % (static_cast<int>(Fault::sensor) - 1)));
    const bool is_engaged = last.safety.is_engaged() && loop.kind() != CouplingKind::none;
    const std::uint32_t num_faults = last.safety.num_faults;
    const int num_ticks =
        (fault == Fault::stale_sensor ? 500 : 0) + 60 + static_cast<int>(random.bits() % 700);
    // A hand that is pushed along would be somewhere else with the clutch.
    const bool uses_clutch = fault != Fault::energy && random.uniform() < 0.4;
    const int clutch_begin = static_cast<int>(random.bits() % static_cast<unsigned>(num_ticks));
    // From here on there is no force, until all is well again: by the clock, not by what is told.
    const double zero_after = hand.time + found_within(fault, settings.safety) +
                              settings.safety.fade_seconds - 0.5 * kTick;
    const bool has_force = watch.last_force() > 0.1;
    bool is_zero_seen = false;
    std::optional<Fault> found;
    const int what = static_cast<int>(random.bits() % 3);
    for (int i = 0; i < num_ticks && !testing::Test::HasFatalFailure(); ++i) {
      hand.time += kTick;
      if (fault == Fault::loop) {
        if (what == 0 && i == 0) hand.time += random.uniform(0.021, 2);
        if (what == 1 && i == 0) hand.time -= 0.02;
        if (what == 2 && i < 40) hand.time -= kTick;  // stands still
      }
      if (fault == Fault::energy && norm(last.F_H_B.force) > 0.1) {
        hand.pushed += 2e-3 * normalized(last.F_H_B.force);
      }
      if (uses_clutch && i == clutch_begin) hand.has_clutch = true;
      DeviceState state = hand.state();
      if (fault == Fault::not_finite) state.X_BH.translation.y = std::nan("");
      if (fault == Fault::device) state.is_valid = false;
      has_contacts = fault != Fault::stale_contact;
      has_frames = fault != Fault::stale_sensor;
      flags.has_backend_failed = fault == Fault::backend;
      flags.has_sensor_failed = fault == Fault::sensor;
      flags.is_stopping = fault == Fault::stopped;
      if (!is_limited && i % 200 == 100 && random.uniform() < 0.3) flags.is_force_requested = true;
      tick(state);
      if (!found && last.safety.num_faults > num_faults) found = last.safety.fault;
      const bool lasts = fault != Fault::loop && fault != Fault::energy;
      if (lasts && hand.time > zero_after) {
        ASSERT_EQ(norm(last.F_H_B.force) + norm(last.F_H_B.torque), 0)
            << name_of(fault) << ", tick " << i << ", round " << round;
        is_zero_seen = true;
      }
    }
    counts.forces_taken[static_cast<std::size_t>(fault)] += has_force && is_zero_seen;
    has_contacts = has_frames = true;
    flags = {};
    if (found && is_engaged) {
      // It is told by its name. Where there is no frame, a contact may be too old, too.
      EXPECT_TRUE(*found == fault || fault == Fault::energy)
          << name_of(*found) << " instead of " << name_of(fault);
      ++counts.faults[static_cast<std::size_t>(*found)];
    }
    num_recovered = watch.num_returns();
    // All is well, and the clutch is let go of, maybe in contact.
    if (hand.has_clutch) {
      ++counts.num_clutched_faults;
      tick_well(static_cast<int>(random.bits() % 300));
      hand.has_clutch = false;
      tick_well(static_cast<int>(random.bits() % 200));
      counts.num_let_go_in_contact += last.penetration.volume > 0;
    }
    // Another coupling, or none for a while, whatever there is.
    if (round % 3 == 1) {
      tick_well(static_cast<int>(random.bits() % 400));
      loop.change(loop.kind() == CouplingKind::none ? kind : CouplingKind::none);
      tick_well(static_cast<int>(random.bits() % 100));
    } else if (round % 3 == 2) {
      loop.change(static_cast<CouplingKind>(random.bits() % 3));
    }
  }
  // A lasting fault, with any coupling.
  flags.has_sensor_failed = seed % 2 == 0;
  flags.is_stopping = !flags.has_sensor_failed;
  loop.change(kind);
  tick_well(200);
  EXPECT_TRUE(watch.has_ended());
  EXPECT_TRUE(!is_limited || num_recovered <= 3);  // a minute
  counts.num_returns += watch.num_returns();
  counts.num_into_contact += watch.num_returns_into_contact();
}

TEST(FaultRun, AnyFaultsWithAnyCouplingFrictionObjectsAndBodies) {
  Counts counts;
  unsigned seed = 1;
  for (int repeat = 0; repeat < 2; ++repeat) {
    for (const CouplingKind kind :
         {CouplingKind::virtual_coupling, CouplingKind::direct, CouplingKind::proxy}) {
      for (const bool with_friction : {false, true}) {
        for (const bool with_objects : {false, true}) {
          run(kind, with_friction, with_objects, seed, counts);
          if (HasFailure()) {
            FAIL() << name_of(kind) << ", friction " << with_friction << ", objects "
                   << with_objects << ", seed " << seed;
          }
          ++seed;
        }
      }
    }
  }
  for (int i = 1; i <= kNumFaults; ++i) {
    const auto fault = static_cast<Fault>(i);
    EXPECT_GT(counts.faults[static_cast<std::size_t>(i)], 2) << name_of(fault);
    if (fault == Fault::loop || fault == Fault::energy) continue;  // Watch and SafetyEnergy.*
    EXPECT_GT(counts.forces_taken[static_cast<std::size_t>(i)], 2) << name_of(fault);
  }
  EXPECT_GT(counts.num_clutched_faults, 30);
  EXPECT_GT(counts.num_let_go_in_contact, 10);
  EXPECT_GT(counts.num_returns, 100);
  EXPECT_GT(counts.num_into_contact, 3);  // somebody has asked for it
  EXPECT_GT(counts.num_forces, 10'000);
  EXPECT_GT(counts.num_object_ticks, 1000);
}

/// A loop and the hand of one.
struct HeldLoop {
  explicit HeldLoop(const RunSettings& settings) : loop(settings) {}
  const TickRecord& tick(int num, const TickFlags& flags = {}) {
    const TickRecord* record = nullptr;
    for (int i = 0; i < num; ++i) {
      hand.time += kTick;
      record = &loop.tick(hand.state(), flags, true, true);
    }
    return *record;
  }
  Loop loop;
  HeldHandle hand;
};

// The force does not come back into a contact that is not measured.
TEST(FaultRun, AContactThatIsNotMeasuredIsNotFree) {
  HeldLoop held(settings_with(CouplingKind::virtual_coupling));
  held.tick(300);
  held.hand.depth = 0.035;
  ASSERT_GT(norm(held.tick(300).F_H_B.force), 0.5);
  held.loop.be_blind(true);
  held.tick(1, {.has_backend_failed = true});
  EXPECT_EQ(held.tick(1000).safety.state, ForceState::waiting);
  held.loop.be_blind(false);
  EXPECT_EQ(held.tick(1000).safety.state, ForceState::waiting);
  held.hand.depth = -0.03;
  EXPECT_TRUE(held.tick(100).safety.is_engaged());
}

// With and without a coupling that gives a force, faults are counted on.
TEST(FaultRun, FaultsAreCountedOverChangesOfTheCoupling) {
  HeldLoop held(settings_with(CouplingKind::virtual_coupling));
  held.tick(300);
  const auto break_once = [&] {
    return held.tick(1, {.has_backend_failed = true}).safety.num_faults;
  };
  EXPECT_EQ(break_once(), 1u);
  EXPECT_EQ(held.tick(300).safety.num_faults, 1u);
  held.loop.change(CouplingKind::none);
  EXPECT_EQ(held.tick(300).safety.num_faults, 1u);
  EXPECT_EQ(break_once(), 2u);
  EXPECT_EQ(held.tick(300).safety.num_faults, 2u);
  held.loop.change(CouplingKind::proxy);
  EXPECT_EQ(held.tick(300).safety.num_faults, 2u);
  EXPECT_EQ(break_once(), 3u);
}

// After a while without a coupling, the force of the last one does not come back at once.
TEST(FaultRun, TheForceOfACouplingThatWasLeftDoesNotComeBackAtOnce) {
  const RunSettings settings = settings_with(CouplingKind::virtual_coupling);
  Loop loop(settings);
  HeldHandle hand;
  const auto tick = [&] {
    hand.time += kTick;
    const TickRecord& record = loop.tick(hand.state(), {}, true, true);
    return norm(record.F_H_B.force);
  };
  for (int i = 0; i < 300; ++i) tick();
  hand.depth = 0.035;
  double force = 0;
  for (int i = 0; i < 300; ++i) force = tick();
  ASSERT_GT(force, 0.5);
  loop.change(CouplingKind::none);
  const double most = settings.safety.max_slew * kTick + 1e-9;
  for (int i = 0; i < 500; ++i) {
    const double now = tick();
    ASSERT_LE(std::abs(now - force), most) << i;
    force = now;
  }
  EXPECT_EQ(force, 0);
  loop.change(CouplingKind::virtual_coupling);
  for (int i = 0; i < 1000; ++i) {
    const double now = tick();
    ASSERT_LE(now, std::max(force, 8 * kTick * std::max(i - 90, 0) / settings.safety.ramp_seconds))
        << i;
    force = std::max(force, now);
  }
  EXPECT_GT(force, 0.5);
}

}  // namespace
}  // namespace palpate
