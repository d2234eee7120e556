#include "palpate/session/run.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "src/io/internal/atomic_file.h"
#include "src/io/internal/mcap_file.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"
#include "tests/session/flowing_stream.h"
#include "tests/session/live_hand.h"
#include "tests/session/recorded_messages.h"
#include "tests/session/repeated_run.h"
#include "tests/session/synthetic_stream.h"
#include "tests/test_util/report_data.h"
#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

using test::messages;
using Message = test::RecordedMessage;
using test::patient_settings;
using test::pressing_device;
using test::rewrite;
using test::small_tool;
using test::SyntheticStream;
using test::TemporaryFolder;
using test::wait_for;

Result<RunOutcome> run_for(double duration, const std::filesystem::path& folder,
                           const RunSettings& settings = patient_settings(),
                           int num_frames = 1000) {
  const Tool tool = small_tool();
  SyntheticStream stream(num_frames);
  const auto device = pressing_device();
  return record_run(tool, stream, *device, settings, folder, {.duration = duration});
}

/// For so long, and until the hand has felt the wall for a while.
Result<RunOutcome> press_for(double duration, DepthSource& stream,
                             const std::filesystem::path& folder, const RunSettings& settings) {
  constexpr int kEnough = 150;
  std::atomic<int> num_ticks = 0, num_contacts = 0;  // with a force
  std::atomic<double> time = 0;
  RunMonitor monitor;
  monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    for (const TickRecord& tick : ticks) num_ticks += norm(tick.F_H_B.force) > 0 ? 1 : 0;
    time = ticks.back().time;
  };
  monitor.observer.on_contact = [&](const ContactRecord& contact) {
    num_contacts += contact.penetration.volume > 0 ? 1 : 0;
  };
  RunOptions options;
  options.monitor = &monitor;
  options.duration = 120;
  options.keep_going = [&] {
    return time < duration || num_ticks < kEnough || num_contacts < kEnough;
  };
  const auto device = pressing_device();
  return record_run(small_tool(), stream, *device, settings, folder, options);
}

std::string read(const std::filesystem::path& path) { return *read_file(path); }

TEST(LiveRun, AFlowIsFeltAndRepeated) {
  TemporaryFolder folder;
  RunSettings settings = patient_settings();
  settings.coupling.friction.coefficient = 0.4;
  test::FlowingStream stream(100000);
  const auto run = press_for(1.5, stream, folder / "run", settings);
  ASSERT_TRUE(run) << run.error().message;
  const auto replay = replay_run(folder / "run");
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  int num_dragged = 0;
  for (const Message& message : messages(folder / "run")) {
    if (message.channel.topic != kContactTopic) continue;
    const auto contact = read_contact(message.data);
    ASSERT_TRUE(contact);
    num_dragged += norm(contact->contact.patch.ground.velocity_W) > 0.01 ? 1 : 0;
  }
  EXPECT_GT(num_dragged, 10);
}

TEST(LiveRun, IsRecordedAndRepeatedBitForBit) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  for (const CouplingKind kind :
       {CouplingKind::virtual_coupling, CouplingKind::direct, CouplingKind::proxy}) {
    RunSettings settings = patient_settings();
    settings.coupling.kind = kind;
    const auto outcome = test::without_losses([&] {
      SyntheticStream stream(100000);
      return press_for(1.2, stream, run, settings);  // replaces the run before
    });
    ASSERT_TRUE(outcome) << outcome.error().message;
    EXPECT_EQ(outcome->failure, "");
    EXPECT_GT(outcome->loop.num_ticks, 100u);
    EXPECT_TRUE(is_run(run));
    for (const char* file : {"recording.mcap", "summary.json", "wrench.csv"}) {
      EXPECT_TRUE(std::filesystem::is_regular_file(run / file)) << file;
    }
    EXPECT_EQ(std::filesystem::is_regular_file(run / "report.html"), !report_template().empty());
    ASSERT_EQ(outcome->loop.num_lost_records, 0u);
    test::expect_repeats(run, *outcome);
    const std::string csv = read(run / "wrench.csv");
    EXPECT_EQ(static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n')),
              outcome->loop.num_ticks + 1);
    const auto summary = nlohmann::json::parse(read(run / "summary.json"));
    EXPECT_EQ(summary["ticks"], outcome->loop.num_ticks);
    EXPECT_GT(summary["peaks"]["volume_m3"], 0.0);
    EXPECT_GT(summary["peaks"]["desired_force_N"], 0.0);
  }
}

TEST(LiveRun, PointMethodsAndPredictionAreRepeatedToo) {
  const TemporaryFolder folder;
  RunSettings settings = patient_settings();
  settings.contact.method = MethodKind::graph;
  settings.time.mode = TimeMode::predict;
  settings.coupling.hold = ContactHold::interpolation;
  SyntheticStream stream(100000);
  const auto outcome = press_for(1, stream, folder.path() / "run", settings);
  ASSERT_TRUE(outcome) << outcome.error().message;
  const auto replay = replay_run(folder.path() / "run");
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_GT(replay->num_contacts, 10u);
}

TEST(LiveRun, ReplayFindsWhatWasChanged) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  SyntheticStream stream(100000);
  ASSERT_TRUE(press_for(0.6, stream, run, patient_settings()));
  const std::vector<Message> recorded = messages(run);

  const auto replay_changed = [&](const char* topic, int number, auto change) {
    std::vector<Message> changed = recorded;
    for (Message& message : changed) {
      if (message.channel.topic == topic && number-- == 0) change(message.data);
    }
    rewrite(run, changed);
    return replay_run(run);
  };
  const auto tick = replay_changed(kTickTopic, 40, [](std::string& text) {
    TickRecord record = *read_tick(text);
    record.F_H_B.force.x += 1e-12;
    text = tick_message(record);
  });
  ASSERT_TRUE(tick) << tick.error().message;
  EXPECT_NE(tick->difference.find("tick 40, wrench_on_hand/force/x: recorded "), std::string::npos)
      << tick->difference;
  const auto contact = replay_changed(kContactTopic, 3, [](std::string& text) {
    ContactRecord record = *read_contact(text);
    record.penetration.potential += 1e-12;
    text = contact_message(record);
  });
  ASSERT_TRUE(contact) << contact.error().message;
  EXPECT_NE(contact->difference.find("contact 4, penetration/potential"), std::string::npos)
      << contact->difference;
  const auto damaged = replay_changed(kTickTopic, 5, [](std::string& text) { text.resize(40); });
  ASSERT_FALSE(damaged);
  EXPECT_NE(damaged.error().message.find("no palpate_msgs/Tick"), std::string::npos);

  // A missing tick ends the repetition without a difference.
  std::vector<Message> without = recorded;
  int ticks = 0;
  std::erase_if(without, [&](const Message& message) {
    return message.channel.topic == kTickTopic && ticks++ == 30;
  });
  rewrite(run, without);
  const auto shorter = replay_run(run);
  ASSERT_TRUE(shorter) << shorter.error().message;
  EXPECT_EQ(shorter->difference, "");
  EXPECT_LE(shorter->num_ticks, 30u);
  EXPECT_NE(shorter->note, "");

  // A recording without ticks has nothing to compare: it is no success.
  std::erase_if(without,
                [](const Message& message) { return message.channel.topic == kTickTopic; });
  rewrite(run, without);
  const auto nothing = replay_run(run);
  ASSERT_FALSE(nothing);
  EXPECT_NE(nothing.error().message.find("has no tick"), std::string::npos);
}

TEST(LiveRun, EndsWithTheSource) {
  const TemporaryFolder folder;
  const auto outcome = run_for(60, folder.path() / "run", patient_settings(), 6);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->failure, "");
  EXPECT_EQ(outcome->loop.ending, "the depth frames have ended");
  EXPECT_EQ(nlohmann::json::parse(outcome->summary_json)["fault"], "none");
  EXPECT_LT(outcome->loop.seconds, 30);
  const auto replay = replay_run(folder.path() / "run");
  ASSERT_TRUE(replay);
  EXPECT_EQ(replay->difference, "");
}

TEST(LiveRun, LeavesNothingWhenItCannotBegin) {
  const TemporaryFolder folder;
  RunSettings settings = patient_settings();
  settings.contact_rate = -1;
  EXPECT_FALSE(run_for(1, folder.path() / "run", settings));
  EXPECT_FALSE(run_for(0, folder.path() / "run"));
  EXPECT_FALSE(run_for(1, folder.path() / "run", patient_settings(), 0));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  EXPECT_FALSE(is_run(folder.path()));
  std::ofstream(folder.path() / "precious.txt") << "mine";
  EXPECT_FALSE(run_for(1, folder.path()));
}

double monotonic_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

TEST(LiveRun, KilledLosesNoMoreThanTheLastHalfSecond) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  const pid_t child = fork();
  if (child == 0) {
    (void)run_for(120, run, patient_settings(), 100000);
    _exit(0);
  }
  int num_ticks = 0;
  double newest = 0;  // tick in the file, s
  const auto look = [&] {
    num_ticks = 0;
    auto reader = McapReader::open(run / kRecordingFile);
    for (bool goes_on = reader.has_value(); goes_on;) {
      const auto message = reader->next();
      goes_on = message && *message;
      if (!goes_on || reader->channels().at((*message)->channel).topic != kTickTopic) continue;
      newest = read_tick((*message)->data)->device.time;
      ++num_ticks;
    }
  };
  // Age of the newest tick on disk: the loss in a crash. On a busy machine it is larger at some
  // moments, and on a disk that stands still at all moments of a second or two: hence repeated.
  std::vector<double> ages;
  const auto is_mostly_young = [&] {  // at the last 20 moments
    if (ages.size() < 20) return false;
    constexpr double kMost = 0.75;  // s: half a second, and a busy disk
    return std::count_if(ages.end() - 20, ages.end(), [](double a) { return a < kMost; }) > 15;
  };
  const double begin = monotonic_now();
  while ((!is_mostly_young() || num_ticks <= 400) && monotonic_now() - begin < 60) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    const double now = monotonic_now();
    look();
    if (num_ticks > 0) ages.push_back(now - newest);
  }
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  EXPECT_TRUE(is_mostly_young());

  bool was_cut_off = false;
  double last = 0;
  for (const Message& message : messages(run, &was_cut_off)) {
    if (message.channel.topic == kTickTopic) last = read_tick(message.data)->device.time;
  }
  EXPECT_TRUE(was_cut_off);
  EXPECT_GE(last, newest);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_GT(replay->num_ticks, 100u);
  EXPECT_NE(replay->note.find("cut off"), std::string::npos);
}

/// A stream that stalls until that is noticed, as a camera with a loose plug.
class StallingStream final : public SyntheticStream {
 public:
  StallingStream(int num_frames, const std::atomic<bool>& is_noticed)
      : SyntheticStream(num_frames), is_noticed_(is_noticed) {}
  Result<bool> next(DepthFrame& frame) override {
    if (++num_ == 15) wait_for([&] { return is_noticed_.load(); });
    return SyntheticStream::next(frame);
  }

 private:
  const std::atomic<bool>& is_noticed_;
  int num_ = 0;
};

TEST(LiveRun, GoesOnAfterAFaultThatPassesAndIsRepeated) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  RunSettings settings = patient_settings();
  settings.safety.max_sensor_age = 0.5;
  settings.safety.recover_seconds = 0.1;
  settings.safety.max_recoveries = 60;  // frames are late on a busy machine, too
  std::atomic<bool> has_fault = false, is_back = false;
  StallingStream stream(100000, has_fault);
  const auto device = pressing_device();
  std::vector<std::string> said;
  RunMonitor monitor;
  std::atomic<RunLoop*> loop = nullptr;
  monitor.on_loop = [&](RunLoop* now) { loop = now; };
  monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    for (const TickRecord& tick : ticks) {
      // The hand is still in contact, so it has to query.
      if (has_fault && tick.safety.state == ForceState::waiting && loop) {
        loop.load()->request_force();
      }
      has_fault = has_fault || tick.safety.fault == Fault::stale_sensor;
      is_back = is_back || (has_fault && tick.safety.is_engaged() && tick.safety.gain > 0.5);
    }
  };
  RunOptions options;
  options.monitor = &monitor;
  options.say = [&](double, std::string_view text) { said.emplace_back(text); };
  const double deadline = monotonic_now() + 300;
  options.keep_going = [&] { return !is_back && monotonic_now() < deadline; };
  const auto outcome = record_run(small_tool(), stream, *device, settings, run, options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_TRUE(is_back);
  EXPECT_EQ(outcome->failure, "");
  EXPECT_GT(outcome->loop.num_faults, 0u);
  ASSERT_GE(said.size(), 3u);
  const auto fault = std::ranges::find(said, describe(Fault::stale_sensor));
  ASSERT_NE(fault, said.end());
  EXPECT_NE(std::find(fault, said.end(), "the force comes up"), said.end());
  const auto summary = nlohmann::json::parse(outcome->summary_json);
  EXPECT_EQ(summary["fault"], "none");
  ASSERT_FALSE(summary["faults"].empty());
  EXPECT_EQ(summary["faults"][0]["fault"], "stale_sensor");
  EXPECT_GT(summary["faults"][0]["seconds"], 0.1);
  EXPECT_EQ(summary["faults"][0]["meaning"], describe(Fault::stale_sensor));
  test::expect_repeats(run, *outcome);
}

TEST(LiveRun, NoOtherRunTakesItsFolder) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  std::string refused;
  RunOptions options;
  options.keep_going = [&] {
    const auto other = run_for(0.1, run);
    refused = other ? "it was not refused" : other.error().message;
    return false;
  };
  SyntheticStream stream(100000);
  const auto device = pressing_device();
  const auto outcome = record_run(small_tool(), stream, *device, patient_settings(), run, options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_NE(refused.find("another program is writing a run to"), std::string::npos) << refused;
  EXPECT_EQ(outcome->not_kept, "");
  EXPECT_EQ(replay_run(run)->difference, "");
  EXPECT_TRUE(run_for(0.1, run));  // now it may be replaced
}

// A disk that stands still for longer than the queue of frames holds: losses are reported in the
// terminal, the summary and the replay, and the rest is the same to the bit.
TEST(LiveRun, WhatIsLostIsCountedAndTold) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  std::atomic<std::uint64_t> num_frames = 0;
  std::atomic<RunLoop*> loop = nullptr;
  RunMonitor monitor;
  monitor.on_loop = [&](RunLoop* now) { loop = now; };
  monitor.observer.on_frame = [&](const FrameRecord& frame, const DepthFrame&) {
    num_frames = frame.number;
    if (frame.number != 20) return;
    wait_for([&] {  // for twice as many as the queue holds
      RunLoop* const now = loop;
      return now != nullptr && now->report().num_frames > 20 + 64;
    });
  };
  RunOptions options;
  options.monitor = &monitor;
  options.keep_going = [&] { return num_frames < 150; };
  SyntheticStream stream(100000, 100);
  const auto device = pressing_device();
  const auto outcome = record_run(small_tool(), stream, *device, patient_settings(), run, options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->failure, "");
  EXPECT_GT(outcome->loop.num_lost_records, 0u);
  const std::string told = std::to_string(outcome->loop.num_lost_records) + " records were lost";
  EXPECT_TRUE(std::ranges::any_of(outcome->warnings, [&](const std::string& warning) {
    return warning.find(told) != std::string::npos;
  }));
  const auto summary = nlohmann::json::parse(read(run / "summary.json"));
  EXPECT_EQ(summary["lost_records"], outcome->loop.num_lost_records);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_NE(replay->note.find("was not recorded"), std::string::npos) << replay->note;
  EXPECT_GT(replay->num_contacts, 10u);
}

TEST(LiveRun, GoesOnWhenTheDiskIsFull) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  const pid_t child = fork();
  if (child == 0) {
    signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{800'000, 800'000};  // a second of ticks
    setrlimit(RLIMIT_FSIZE, &limit);
    // Until the recording has paused, and half a second of ticks more.
    std::atomic<double> paused = 0, now = 0;
    RunMonitor monitor;
    monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) { now = ticks.back().time; };
    RunOptions options;
    options.monitor = &monitor;
    options.duration = 120;
    options.say = [&](double time, std::string_view text) {
      if (text.find("the recording pauses") != std::string_view::npos) paused = time;
    };
    options.keep_going = [&] { return paused == 0 || now < paused + 0.5; };
    SyntheticStream stream(100000);
    const auto device = pressing_device();
    const auto outcome =
        record_run(small_tool(), stream, *device, patient_settings(), run, options);
    const bool has_reported =
        outcome && outcome->not_kept.find("nothing was recorded from") != std::string::npos;
    const bool has_gone_on = outcome && outcome->loop.seconds > paused && paused > 0;
    _exit(has_reported && has_gone_on && outcome->failure.empty() ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
}

}  // namespace
}  // namespace palpate
