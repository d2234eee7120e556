// The live loop in real time: for a second at most, and without a word about how fast it is.
#include "palpate/run/run_loop.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "tests/run/live_loop_fixtures.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/sanitized.h"

namespace palpate {
namespace {

using test::box_tool;
using test::patient_settings;
using test::pressing_hand;
using test::query_of;
using test::ScriptedDevice;
using test::timeline_of;
using test::wait_for;
using test::WallSource;

/// Everything that an observer is told.
struct Seen {
  std::vector<std::pair<double, DepthFrame>> frames;
  std::vector<PixelWindow> requested;  // of each frame
  std::vector<ContactRecord> contacts;
  std::vector<TickRecord> ticks;
  // Meanwhile: frames with a smaller window, contacts outside of theirs, contacts with a force.
  std::atomic<int> num_small = 0, num_outside = 0, num_with_force = 0;

  RunObserver observer() {
    return {[this](const FrameRecord& record, const DepthFrame& frame) {
              EXPECT_EQ(record.number, frames.size());
              frames.emplace_back(record.capture_time, frame);
              requested.push_back(record.requested);
              num_small += record.requested.has_all(frame.width, frame.height) ? 0 : 1;
            },
            [this](const ContactRecord& contact) {
              contacts.push_back(contact);
              num_outside += contact.penetration.status.has(StepStatus::outside_window) ? 1 : 0;
              num_with_force += contact.penetration.volume > 0 ? 1 : 0;
            },
            [this](std::span<const TickRecord> records) {
              ticks.insert(ticks.end(), records.begin(), records.end());
            },
            {}};
  }
};

TEST(LiveLoop, RefusesRatesAtWhichEveryContactIsTooOld) {
  WallSource source({});
  ScriptedDevice device({});
  RunSettings settings;
  settings.contact_rate = 1 / settings.safety.max_contact_age;
  const auto loop = RunLoop::create(box_tool(), source, device, settings);
  ASSERT_FALSE(loop);
  for (const char* name : {"loop.contact_rate of 50 Hz", "safety.max_contact_age of 0.02 s"}) {
    EXPECT_NE(loop.error().message.find(name), std::string::npos) << loop.error().message;
  }
  settings.contact_rate *= 1.01;
  EXPECT_TRUE(RunLoop::create(box_tool(), source, device, settings));
}

// At its 30 Hz it would never be given a force, and the filter would say that ticks come too late.
TEST(LiveLoop, RefusesDevicesThatTickMoreSeldomThanTheSafetyFilterAllows) {
  WallSource source({});
  class Slow final : public HapticDevice {
   public:
    Slow(double rate, DeviceLimits limits) {
      info_.name = "my device";
      info_.limits = limits;
      info_.rate = rate;
    }
    const DeviceInfo& info() const override { return info_; }
    Status start(DeviceTick) override { return Done{}; }
    void stop() noexcept override {}
    Status status() const override { return Done{}; }

   private:
    DeviceInfo info_;
  };
  const DeviceLimits limits = ScriptedDevice({}).info().limits;
  Slow device(30, limits);
  RunSettings settings;
  const auto refused = RunLoop::create(box_tool(), source, device, settings);
  ASSERT_FALSE(refused);
  for (const char* words : {"my device ticks at 30 Hz", "safety.max_tick of 0.02 s"}) {
    EXPECT_NE(refused.error().message.find(words), std::string::npos) << refused.error().message;
  }
  settings.safety.max_tick = 0.1;
  const auto contacts = RunLoop::create(box_tool(), source, device, settings);
  ASSERT_FALSE(contacts);
  EXPECT_NE(contacts.error().message.find("safety.max_contact_age of 0.02 s"), std::string::npos);
  settings.safety.max_contact_age = 0.1;
  auto allowed = RunLoop::create(box_tool(), source, device, settings);
  ASSERT_TRUE(allowed) << allowed.error().message;
  // 10 mJ are what F gives a hand that it moves at 50 m/s2 from tick to tick: F = 10 mJ / (50 T^2).
  const auto notes = (*allowed)->report().notes;
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("at its 30 Hz my device gets no more than about 0.18 N at the first"),
            std::string::npos)
      << notes[0];
  settings.safety.energy_tank = 1;
  EXPECT_TRUE(
      RunLoop::create(box_tool(), source, device, settings).value()->report().notes.empty());
  // A robot gets no force.
  RunSettings without;
  without.coupling.kind = CouplingKind::none;
  EXPECT_TRUE(RunLoop::create(box_tool(), source, device, without));
  Slow usual(1000, limits);
  EXPECT_TRUE(RunLoop::create(box_tool(), source, usual, {}).value()->report().notes.empty());
}

TEST(LiveLoop, TheHandFeelsTheWallAndAllIsRecorded) {
  WallSource source({.depth = [](int k) { return 0.5 + 0.002 * std::sin(k); }});
  ScriptedDevice device({.hand = pressing_hand});
  const RunSettings settings = patient_settings();
  Seen seen;
  {
    auto loop = RunLoop::create(box_tool(), source, device, settings, seen.observer());
    ASSERT_TRUE(loop) << loop.error().message;
    ASSERT_TRUE((*loop)->start());
    EXPECT_TRUE((*loop)->is_running());
    TickRecord newest;
    EXPECT_TRUE(wait_for([&] {
      newest = (*loop)->latest().value_or(newest);
      return newest.F_H_B.force.z < -0.5 && (*loop)->report().num_frames > 8;
    })) << newest.F_H_B.force.z;
    EXPECT_GT(newest.penetration.volume, 0);
    (*loop)->stop();
    EXPECT_FALSE((*loop)->is_running());
    EXPECT_TRUE((*loop)->status());
    const LoopReport report = (*loop)->report();
    EXPECT_EQ(report.fault, Fault::stopped);
    EXPECT_EQ(report.num_lost_records, 0u);
    EXPECT_EQ(report.num_ticks, seen.ticks.size());
    EXPECT_EQ(report.num_contacts, seen.contacts.size());
    EXPECT_EQ(report.num_frames, seen.frames.size());
    EXPECT_GT(report.seconds, 0);
    EXPECT_EQ((*loop)->times().haptic_compute.summary().num, report.num_ticks);
    EXPECT_EQ((*loop)->times().contact_compute.summary().num, report.num_contacts);
  }
  for (std::size_t k = 1; k < seen.ticks.size(); ++k) {
    const TickRecord &last = seen.ticks[k - 1], &now = seen.ticks[k];
    ASSERT_GT(now.time, last.time);
    ASSERT_GE(now.contact_number, last.contact_number);
    ASSERT_GE(now.contact_age, 0);
    // A tick's frame was seen before it, or while its thread stood still: before the next one.
    ASSERT_LT(last.device.time - last.sensor_age, now.device.time);
  }
  // Faded out, not switched off.
  EXPECT_EQ(norm(seen.ticks.back().F_H_B.force), 0);
  std::size_t num_fading = 0;
  for (const TickRecord& tick : seen.ticks) {
    num_fading += tick.safety.fault == Fault::stopped && norm(tick.F_H_B.force) > 0 ? 1 : 0;
  }
  EXPECT_GT(num_fading, 0u);

  // Each contact can be repeated to the bit.
  ThreadPool pool(1);
  SurfaceTimeline timeline = timeline_of(source.info(), settings);
  const auto query = query_of(settings);
  std::size_t num_pushed = 0;
  ASSERT_FALSE(seen.contacts.empty());
  for (const ContactRecord& contact : seen.contacts) {
    for (; num_pushed <= contact.frame_number; ++num_pushed) {
      const auto& [time, frame] = seen.frames[num_pushed];
      timeline.push(frame, num_pushed == 0 ? 0 : time + 1, pool);
    }
    SurfaceBlend blend = timeline.at(1e9);
    blend.progress = contact.cameras.of[0].progress;
    const Penetration again = query->measure({&blend, 1}, contact.X_WT).penetration;
    ASSERT_EQ(again.volume, contact.penetration.volume) << contact.number;
    ASSERT_EQ(again.measure_W.force.z, contact.penetration.measure_W.force.z);
    ASSERT_EQ(again.measure_W.torque.x, contact.penetration.measure_W.torque.x);
  }
}

// Without room to move, a tool that starts to move leaves the windows of its surfaces again and
// again. That is no force without a word, and a repetition with the recorded windows does the same.
TEST(LiveLoop, AToolThatLeavesTheWindowIsReportedAndRepeated) {
  WallSource source({.width = 640, .height = 480});
  ScriptedDevice device({.hand = [](double time) {
    return Vec3d{0.03 * std::tanh(10 * std::sin(20 * time)), 0, 0.03};
  }});
  RunSettings settings = patient_settings();
  settings.window.speed = 0;
  settings.time.mode = TimeMode::latest;
  Seen seen;
  auto loop = RunLoop::create(box_tool(), source, device, settings, seen.observer());
  ASSERT_TRUE(loop) << loop.error().message;
  ASSERT_TRUE((*loop)->start());
  // The last frames may not be felt any more.
  EXPECT_TRUE(wait_for([&] {
    return (*loop)->report().num_frames > 20 && seen.num_small > 15 && seen.num_outside > 10 &&
           seen.num_with_force > 10;
  }));
  (*loop)->stop();
  const LoopReport report = (*loop)->report();
  ASSERT_EQ(report.num_lost_records, 0u);

  ThreadPool pool(1);
  SurfaceTimeline timeline = timeline_of(source.info(), settings);
  const auto query = query_of(settings);
  std::size_t num_pushed = 0, num_outside = 0, num_with_force = 0, num_small = 0;
  for (const ContactRecord& contact : seen.contacts) {
    for (; num_pushed <= contact.frame_number; ++num_pushed) {
      const auto& [time, frame] = seen.frames[num_pushed];
      const PixelWindow& requested = seen.requested[num_pushed];
      timeline.push(frame, time, pool, requested);
      num_small += requested.has_all(640, 480) ? 0 : 1;
    }
    const SurfaceBlend blend = timeline.at(1e9);
    const Penetration again = query->measure({&blend, 1}, contact.X_WT).penetration;
    ASSERT_EQ(again.status, contact.penetration.status);
    ASSERT_EQ(again.volume, contact.penetration.volume);
    ASSERT_EQ(again.measure_W.force.z, contact.penetration.measure_W.force.z);
    const bool is_outside = again.status.has(StepStatus::outside_window);
    num_outside += is_outside;
    num_with_force += again.volume > 0;
    EXPECT_EQ(again.status.is_unmeasured(), is_outside);
  }
  EXPECT_GT(num_outside, 10u);
  EXPECT_GT(num_with_force, 10u);
  EXPECT_GT(num_small, 10u);
  bool has_note = false;
  for (const std::string& note : report.notes) {
    has_note |= note.find("window.speed") != std::string::npos;
  }
  EXPECT_TRUE(has_note);
}

// A hand at 0.3 m/s moves the tool at 3 m/s: by 0.3 m until the next frames replace a surface.
// A hand that begins to move has given no sign of it.
TEST(LiveLoop, TheWindowHasRoomForAHandThatMovesTheToolTenTimesAsFar) {
  WallSource source({.width = 640, .height = 480});
  ScriptedDevice device({.hand = [](double) { return Vec3d{0, 0, -0.05}; }});
  RunSettings settings = patient_settings();
  settings.coupling.motion_scale = 0.1;
  Seen seen;
  std::atomic<int> last_width = 0;
  RunObserver observer = seen.observer();
  observer.on_frame = [&, others = observer.on_frame](const FrameRecord& record,
                                                      const DepthFrame& frame) {
    others(record, frame);
    last_width = record.requested.right - record.requested.left;
  };
  auto loop = RunLoop::create(box_tool(), source, device, settings, observer);
  ASSERT_TRUE(loop) << loop.error().message;
  ASSERT_TRUE((*loop)->start());
  // It is 0.45 m away.
  const double focal = source.info().intrinsics.fx;
  EXPECT_TRUE(wait_for([&] {
    return last_width > 0 && last_width < 2 * focal * 0.3 / 0.45 &&
           (*loop)->report().num_contacts > 0;
  }));
  settings.coupling.motion_scale = 10;
  ASSERT_TRUE((*loop)->change(settings));
  EXPECT_TRUE(wait_for([&] { return last_width >= 2 * focal * 0.3 / 0.45; })) << last_width;
  (*loop)->stop();
}

// The program is about to stand still, in contact, with limits that would let the force stay.
TEST(LiveLoop, TheForceIsAwayWhileItIsSuspendedAndReturnsToAFreeHand) {
  WallSource source({});
  std::atomic<bool> is_free = false;
  ScriptedDevice device({.hand = [&](double) { return Vec3d{0, 0, is_free ? 0.0 : 0.04}; }});
  RunSettings settings = patient_settings();
  settings.safety.recover_seconds = 0.02;
  Seen seen;
  auto loop = RunLoop::create(box_tool(), source, device, settings, seen.observer());
  ASSERT_TRUE(loop) << loop.error().message;
  ASSERT_TRUE((*loop)->start());
  ASSERT_TRUE(wait_for([&] { return device.last_force() > 0.5; }));
  (*loop)->suspend_force();
  EXPECT_EQ(device.last_force(), 0);
  std::optional<TickRecord> tick;
  const auto comes_to = [&](ForceState state) {
    return wait_for([&] { return (tick = (*loop)->latest()) && tick->safety.state == state; });
  };
  ASSERT_TRUE(comes_to(ForceState::off));
  EXPECT_EQ(tick->safety.fault, Fault::loop);
  (*loop)->resume_force();
  ASSERT_TRUE(comes_to(ForceState::waiting));
  const std::uint64_t waiting = tick->number;
  ASSERT_TRUE(wait_for([&] { return (tick = (*loop)->latest()) && tick->number > waiting + 100; }));
  EXPECT_EQ(tick->safety.state, ForceState::waiting);  // as after any fault: not into a contact
  is_free = true;
  EXPECT_TRUE(comes_to(ForceState::engaged));
  (*loop)->stop();
  EXPECT_EQ((*loop)->report().num_faults, 2u);
  // Faded, not switched off.
  EXPECT_TRUE(std::ranges::any_of(seen.ticks, [](const TickRecord& one) {
    return one.is_suspended && norm(one.F_H_B.force) > 0;
  }));
}

// Contacts that take a thousandth of the time between them: however busy the machine, most bring
// their stiffness.
TEST(LiveLoop, TheStiffnessIsLeftOutOnlyForWantOfTime) {
  WallSource source({});
  ScriptedDevice device({.hand = pressing_hand});
  RunSettings settings = patient_settings();
  settings.contact_rate = 50;
  Seen seen;
  auto loop = RunLoop::create(box_tool(), source, device, settings, seen.observer());
  ASSERT_TRUE(loop) << loop.error().message;
  ASSERT_TRUE((*loop)->start());
  EXPECT_TRUE(wait_for([&] { return (*loop)->report().num_contacts > 80; }));
  (*loop)->stop();
  std::size_t num_with_force = 0, num_new = 0;
  for (const ContactRecord& contact : seen.contacts) {
    num_with_force += contact.penetration.volume > 0;
    num_new += contact.penetration.volume > 0 && contact.has_new_stiffness;
  }
  EXPECT_GT(num_with_force, 30u);
  EXPECT_GT(num_new, num_with_force / 16);  // the first may have taken long
  EXPECT_EQ((*loop)->report().num_spared_stiffnesses, num_with_force - num_new);
}

TEST(LiveLoop, NothingIsAllocatedWhileItRuns) {
  for (const TimeMode mode : {TimeMode::interpolate, TimeMode::latest}) {
    WallSource source({});
    ScriptedDevice device({.hand = pressing_hand});
    RunSettings settings = patient_settings();
    settings.time.mode = mode;
    auto loop = RunLoop::create(box_tool(), source, device, settings);
    ASSERT_TRUE(loop);
    ASSERT_TRUE((*loop)->start());
    const test::AllocationCounter counter;
    EXPECT_TRUE(wait_for([&] {
      return device.num_ticks() > 300 && (*loop)->times().surface_compute.summary().num > 6;
    }));
    EXPECT_EQ(counter.count(), 0u);
  }
}

TEST(LiveLoop, AForceThatStaysAwayComesWhenItIsAskedFor) {
  WallSource source({.stalls_at = 12, .stall_seconds = 0.6});
  ScriptedDevice device({});
  RunSettings settings = patient_settings();
  settings.safety.max_sensor_age = 0.3;
  settings.safety.max_recoveries = 0;
  settings.safety.recover_seconds = 0.02;
  auto loop = RunLoop::create(box_tool(), source, device, settings);
  ASSERT_TRUE(loop);
  ASSERT_TRUE((*loop)->start());
  std::optional<TickRecord> tick;
  const auto comes_to = [&](ForceState state) {
    return wait_for([&] { return (tick = (*loop)->latest()) && tick->safety.state == state; });
  };
  ASSERT_TRUE(comes_to(ForceState::held_off));
  EXPECT_EQ(tick->safety.fault, Fault::stale_sensor);
  EXPECT_EQ(device.last_force(), 0);
  (*loop)->request_force();
  EXPECT_TRUE(comes_to(ForceState::engaged));
  EXPECT_TRUE((*loop)->is_running());
  EXPECT_TRUE((*loop)->status());
}

TEST(LiveLoop, RealTimeIsAskedForAndRefusalsAreNoted) {
  WallSource source({});
  ScriptedDevice device({});
  RunSettings settings = patient_settings();
  settings.wants_real_time = true;
  std::atomic<bool> has_recorder_begun = false;
  RunObserver observer;
  observer.on_ticks = [&](std::span<const TickRecord>) { has_recorder_begun = true; };
  auto loop = RunLoop::create(box_tool(), source, device, settings, observer);
  ASSERT_TRUE(loop);
  ASSERT_TRUE((*loop)->start());
  EXPECT_TRUE(wait_for([&] { return has_recorder_begun && device.num_ticks() > 20; }));
  const LoopReport report = (*loop)->report();
  for (const std::string& note : report.notes) {
    EXPECT_NE(note.find(';'), std::string::npos) << note;  // what, and what to do
  }
  // Each thread either has what it requested, or there is a note that it was refused.
  std::map<std::string, std::string> how(report.scheduling.begin(), report.scheduling.end());
  for (const std::string thread : {"haptic", "contact"}) {
    const bool is_refused =
        std::any_of(report.notes.begin(), report.notes.end(), [&](const std::string& note) {
          return note.find("the " + thread + " thread") != std::string::npos;
        });
    EXPECT_EQ(how[thread], is_refused ? "as other programs" : "real time") << thread;
  }
  // Surfaces come before the recorder.
  const auto nice_of = [&](const char* thread) { return std::stoi(how[thread].substr(5)); };
  EXPECT_LT(nice_of("surface"), nice_of("recorder"));
}

int num_threads_of_process() {
  using Entries = std::filesystem::directory_iterator;
  return static_cast<int>(std::distance(Entries("/proc/self/task"), Entries()));
}

TEST(LiveLoop, NoMoreThreadsComputeThanThereAreCores) {
  WallSource source({});
  ScriptedDevice device({});
  RunSettings settings = patient_settings();
  settings.num_threads = 256;
  const int before = num_threads_of_process();
  const auto loop = RunLoop::create(box_tool(), source, device, settings);
  ASSERT_TRUE(loop);
  const int num_cores = static_cast<int>(std::thread::hardware_concurrency());
  // Those of surfaces; a query of so few spheres needs none but its own. A sanitizer has one that
  // begins with the first of them.
  const int num_others = test::kIsSanitized ? 1 : 0;
  EXPECT_LE(num_threads_of_process() - before, num_cores - 1 + num_others);
}

TEST(LiveLoop, SaysWhatIsWrongAtTheStart) {
  WallSource source({});
  ScriptedDevice device({});
  const auto message = [&](auto change) {
    RunSettings settings = patient_settings();
    change(settings);
    auto loop = RunLoop::create(box_tool(), source, device, settings);
    return loop ? std::string() : loop.error().message;
  };
  EXPECT_NE(message([](auto& s) { s.contact_rate = NAN; }).find("loop.contact_rate"),
            std::string::npos);
  EXPECT_NE(message([](auto& s) { s.num_threads = -1; }).find("threads"), std::string::npos);
  EXPECT_NE(message([](auto& s) { s.safety.force_share = 2; }), "");
  EXPECT_NE(message([](auto& s) { s.coupling.damping_ratio = NAN; }), "");
  EXPECT_NE(message([](auto& s) { s.time.max_jump = -1; }), "");

  WallSource empty({.num_frames = 0});
  auto loop = RunLoop::create(box_tool(), empty, device, patient_settings());
  ASSERT_TRUE(loop);
  const Status no_frame = (*loop)->start();
  ASSERT_FALSE(no_frame);
  EXPECT_NE(no_frame.error().message.find("no frame"), std::string::npos);
  EXPECT_FALSE((*loop)->is_running());

  ScriptedDevice refusing({.refuses = Error{Errc::unavailable, "not today"}});
  auto refused = RunLoop::create(box_tool(), source, refusing, patient_settings());
  ASSERT_TRUE(refused);
  const Status no_device = (*refused)->start();
  ASSERT_FALSE(no_device);
  EXPECT_EQ(no_device.error().message, "not today");
  EXPECT_FALSE((*refused)->is_running());
  const Status again = (*refused)->start();
  ASSERT_FALSE(again);
  EXPECT_NE(again.error().message.find("once"), std::string::npos);
}

}  // namespace
}  // namespace palpate
