// Live runs that people look on and change: what is kept of it, and that it can be repeated.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "palpate/session/run.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/mcap_file.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"
#include "tests/session/live_hand.h"
#include "tests/session/recorded_messages.h"
#include "tests/session/repeated_run.h"
#include "tests/session/synthetic_stream.h"
#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

using test::expect_repeats;
using test::messages;
using Message = test::RecordedMessage;
using test::patient_settings;
using test::pressing_device;
using test::rewrite;
using test::small_tool;
using test::SyntheticStream;
using test::TemporaryFolder;
using test::wait_for;
using test::without_losses;

double depth_in_the_wall(double time) { return 0.07 + 0.02 * std::sin(7 * time); }

using Edit = void (*)(RunSettings&);
constexpr Edit kEdits[] = {
    [](auto& s) { s.contact.method = MethodKind::graph; },
    [](auto& s) { s.coupling.stiffness = 200; },
    [](auto& s) { s.time.mode = TimeMode::predict; },
    [](auto& s) { s.coupling.kind = CouplingKind::proxy; },
    [](auto& s) {
      s.contact.method = MethodKind::field;
      s.coupling.kind = CouplingKind::direct;
      s.coupling.force_at_eighth = 3;
    },
    [](auto& s) { s.surface.filter.enabled = false; },
};

/// Runs, makes the changes one after the other with so many ticks between them, and ends.
Result<RunOutcome> run_with_changes(const std::filesystem::path& folder, RunMonitor& monitor,
                                    const RecordingOptions& recording = {},
                                    std::uint64_t num_ticks = 120,
                                    const RunSettings& first = patient_settings(),
                                    std::span<const Edit> edits = kEdits) {
  const Tool tool = small_tool();
  SyntheticStream stream(100000);
  const auto device = pressing_device(depth_in_the_wall);
  std::atomic<bool> is_done = false;
  std::thread person;
  monitor.on_loop = [&](RunLoop* loop) {
    if (loop == nullptr) {
      person.join();
      return;
    }
    person = std::thread([&, loop] {
      const auto pause = [&] {
        const std::uint64_t end = loop->report().num_ticks + num_ticks;
        EXPECT_TRUE(wait_for([&] { return loop->report().num_ticks >= end; }));
      };
      EXPECT_TRUE(wait_for([&] { return loop->report().num_contacts > 0; }));  // changes need one
      pause();
      for (const Edit edit : edits) {
        RunSettings settings = loop->settings();
        edit(settings);
        const Status changed = loop->change(settings);
        EXPECT_TRUE(changed) << changed.error().message;
        monitor.marks.add("a change");
        pause();
      }
      loop->hold_frames(true);
      pause();
      loop->hold_frames(false);
      pause();
      is_done = true;
    });
  };
  RunOptions options;
  options.keep_going = [&] { return !is_done.load(); };
  options.monitor = &monitor;
  options.recording = recording;
  return record_run(tool, stream, *device, first, folder, options);
}

/// Puts settings of that revision in the place of those that were recorded.
void rewrite_settings(const std::filesystem::path& run, std::vector<Message> all,
                      std::uint32_t revision, const std::function<void(RunSettings&)>& edit) {
  for (Message& message : all) {
    if (message.channel.topic != kSettingsTopic) continue;
    RunSetup setup = *read_settings(message.data);
    if (setup.revision != revision) continue;
    edit(setup.settings);
    message.data = settings_message(setup);
  }
  rewrite(run, all);
}

TEST(HapticChange, RunsWithChangesAreRecordedAndRepeatedBitForBit) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  RunMonitor monitor;
  std::size_t num_ticks = 0, num_frames = 0, num_contacts = 0;
  std::vector<std::uint32_t> revisions;
  monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) { num_ticks += ticks.size(); };
  monitor.observer.on_frame = [&](const FrameRecord&, const DepthFrame&) { ++num_frames; };
  monitor.observer.on_contact = [&](const ContactRecord&) { ++num_contacts; };
  monitor.observer.on_settings = [&](std::uint32_t revision, const RunSettings&) {
    revisions.push_back(revision);
  };
  const auto outcome = without_losses([&] {
    num_ticks = num_frames = num_contacts = 0;
    revisions.clear();
    return run_with_changes(run, monitor);
  });
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->failure, "");
  EXPECT_EQ(num_ticks, outcome->loop.num_ticks);
  EXPECT_EQ(num_frames, outcome->loop.num_frames);
  EXPECT_EQ(num_contacts, outcome->loop.num_contacts);
  EXPECT_EQ(revisions, (std::vector<std::uint32_t>{1, 2, 3, 4, 5, 6}));

  expect_repeats(run, *outcome);

  // Settings before what was done with them, all there.
  const std::vector<Message> all = messages(run);
  std::uint32_t newest = 0, num_settings = 0, num_marks = 0;
  std::set<std::uint32_t> tick_revisions, contact_revisions;
  for (const Message& message : all) {
    const std::string& topic = message.channel.topic;
    if (topic == kSettingsTopic) {
      const auto setup = read_settings(message.data);
      ASSERT_TRUE(setup) << setup.error().message;
      EXPECT_EQ(setup->revision, num_settings++);
      newest = setup->revision;
    } else if (topic == kTickTopic) {
      tick_revisions.insert(read_tick(message.data)->revision);
    } else if (topic == kContactTopic) {
      contact_revisions.insert(read_contact(message.data)->revision);
    } else if (topic == kFrameTopic) {
      EXPECT_LE(read_frame(message.data)->revision, newest);
    } else if (topic == kNoteTopic && *read_note(message.data) == "a change") {
      ++num_marks;
    }
    for (const std::uint32_t revision : tick_revisions) EXPECT_LE(revision, newest);
    for (const std::uint32_t revision : contact_revisions) EXPECT_LE(revision, newest);
  }
  EXPECT_EQ(num_settings, 7u);
  EXPECT_EQ(num_marks, 6u);
  EXPECT_EQ(tick_revisions.size(), 7u);
  EXPECT_EQ(contact_revisions.size(), 7u);

  const auto summary = nlohmann::json::parse(*read_file(run / "summary.json"));
  EXPECT_EQ(summary["fault"], "none");
  EXPECT_NE(summary["fault_meaning"], "");
  EXPECT_GT(summary["microseconds"]["haptic_cpu"]["num"], 100);
  ASSERT_EQ(summary["changes"].size(), 6u);
  EXPECT_EQ(summary["changes"][0]["contact"]["method"], "graph");
  EXPECT_EQ(summary["changes"][1], nlohmann::json::parse(R"({"coupling":{"stiffness":200.0}})"));
  EXPECT_GT(summary["peaks"]["volume_m3"], 0.0);

  // The repetition depends on every one of them.
  for (std::uint32_t revision = 1; revision <= 6; ++revision) {
    rewrite_settings(run, all, revision, [](RunSettings& settings) {
      settings.coupling.tool_mass *= 1.25;
      settings.coupling.force_at_eighth += 0.5;
      settings.surface.filter.smoothing = Smoothing::bilateral;
      settings.surface.filter.enabled = true;
    });
    const auto differs = replay_run(run);
    ASSERT_TRUE(differs) << differs.error().message;
    EXPECT_NE(differs->difference, "") << revision;
  }
  std::vector<Message> without = all;
  std::erase_if(without, [](const Message& message) {
    return message.channel.topic == kSettingsTopic && read_settings(message.data)->revision == 2;
  });
  rewrite(run, without);
  const auto missing = replay_run(run);
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("revision 2"), std::string::npos);
}

TEST(HapticChange, OfTheFrictionOfAnObjectIsRecordedAndRepeatedBitForBit) {
  constexpr Edit kObjectEdits[] = {[](auto& s) { s.objects[0].friction = 0.6; },
                                   [](auto& s) {
                                     s.objects[1].friction = 0.2;
                                     s.objects[1].viscous = 0.05;
                                   },
                                   [](auto& s) {
                                     s.objects[0].friction.reset();
                                     s.objects[0].static_ratio = 1.5;
                                   }};
  const auto shape =
      std::make_shared<const Tool>(test::random_tool(150, 0.04, 9).with_solid_field());
  RunSettings settings = patient_settings();
  settings.coupling.friction.coefficient = 0.3;
  settings.objects = {{shape, {{0.05, 0, 0.47}, {}}}, {shape, {{-0.05, 0, 0.47}, {}}, 0.4}};
  settings.objects[0].name = "stone";
  settings.objects[1].name = "stone_2";
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  RunMonitor monitor;
  const auto outcome = without_losses(
      [&] { return run_with_changes(run, monitor, {}, 200, settings, kObjectEdits); });
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->failure, "");
  expect_repeats(run, *outcome);
  const auto summary = nlohmann::json::parse(*read_file(run / "summary.json"));
  EXPECT_EQ(summary["changes"], nlohmann::json::parse(R"([{"objects":{"stone.friction":0.6}},
      {"objects":{"stone_2.friction":0.2,"stone_2.viscous":0.05}},
      {"objects":{"stone.friction":"auto","stone.static_ratio":1.5}}])"));
  EXPECT_EQ(summary["settings"]["objects"]["stone_2.friction"], 0.4);

  // The repetition depends on every one of them.
  const std::vector<Message> all = messages(run);
  const auto expect_difference = [&](std::uint32_t revision, const auto& edit) {
    rewrite_settings(run, all, revision, edit);
    const auto differs = replay_run(run);
    ASSERT_TRUE(differs) << differs.error().message;
    EXPECT_NE(differs->difference.find("contact"), std::string::npos) << revision;
  };
  for (std::uint32_t revision = 0; revision <= 3; ++revision) {
    expect_difference(revision, [](RunSettings& other) { other.objects[0].friction = 1; });
  }
  expect_difference(3, [](RunSettings& other) { other.objects[0].static_ratio = 2; });
  expect_difference(3, [](RunSettings& other) { other.objects[1].viscous = 0.5; });
  rewrite_settings(run, all, 1, [](RunSettings& other) { other.objects.pop_back(); });
  const auto refused = replay_run(run);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("other objects"), std::string::npos);
}

// Whoever turns settings for weeks does not fill the memory: none of them is kept that nothing
// rests on any more.
TEST(HapticChange, LeavesNoSettingsBehind) {
  const auto shape =
      std::make_shared<const Tool>(test::random_tool(150, 0.04, 9).with_solid_field());
  RunSettings settings = patient_settings();
  settings.objects = {{shape, {{0.05, 0, 0.47}, {}}}};
  const std::vector<Edit> edits(60, [](auto& s) { s.coupling.stiffness += 1; });
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  // A busy computer writes late, so some are kept for a while.
  long early = std::numeric_limits<long>::max(), late = early;
  RunMonitor monitor;
  monitor.observer.on_settings = [&](std::uint32_t revision, const RunSettings&) {
    if (revision <= 20) early = std::min(early, shape.use_count());
    if (revision > 40) late = std::min(late, shape.use_count());
  };
  const auto outcome = run_with_changes(run, monitor, {}, 20, settings, edits);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_GT(early, 0);
  EXPECT_LT(late, early + 20);
  expect_repeats(run, *outcome);
}

TEST(LiveRun, InPartsIsRepeated) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  RunMonitor monitor;
  const auto outcome = run_with_changes(run, monitor, {.split_bytes = 1}, 500);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->not_kept, "");
  EXPECT_GE(recording_parts(run).size(), 2u);  // more, where the disk is not busy
  expect_repeats(run, *outcome);
}

// Contacts are felt one tick later, which is too late for a limit of a hundredth more: half of the
// limit is exceeded at every tick, and so it is for frames that come less often than they say.
TEST(LiveRun, LeavesOutWhatItHasNoTimeForAndIsRepeated) {
  class SlowStream final : public SyntheticStream {
   public:
    SlowStream() : SyntheticStream(100000, 100) {}
    Result<bool> next(DepthFrame& frame) override {
      std::this_thread::sleep_for(std::chrono::milliseconds(80));
      return SyntheticStream::next(frame);
    }
  };
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  RunSettings settings = patient_settings();
  settings.safety.max_contact_age = 0.00101;
  settings.safety.max_sensor_age = 0.1;
  std::atomic<int> num_settings = 0, num_notes = 0;
  RunMonitor monitor;
  monitor.observer.on_settings = [&](std::uint32_t, const RunSettings&) { ++num_settings; };
  monitor.observer.on_note = [&](std::string_view) { ++num_notes; };
  const Tool tool = small_tool();
  SlowStream stream;
  const auto device = pressing_device();
  const auto begin = std::chrono::steady_clock::now();
  RunOptions options;
  options.monitor = &monitor;
  options.keep_going = [&] {
    const bool is_late = std::chrono::steady_clock::now() - begin > std::chrono::minutes(5);
    return (num_settings < 2 || num_notes < 2) && !is_late;
  };
  const auto outcome = record_run(tool, stream, *device, settings, run, options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->failure, "");
  EXPECT_GE(num_settings, 2);
  EXPECT_GE(num_notes, num_settings);  // the run may end before a stage has taken the last ones
  EXPECT_LE(num_notes, num_settings + 1);

  std::vector<RunSettings> reported;
  int num_load_notes = 0;
  std::set<std::uint32_t> contact_revisions;
  for (const Message& message : messages(run)) {
    const std::string& topic = message.channel.topic;
    if (topic == kSettingsTopic) reported.push_back(read_settings(message.data)->settings);
    if (topic == kContactTopic) contact_revisions.insert(read_contact(message.data)->revision);
    if (topic == kNoteTopic)
      num_load_notes += read_note(message.data)->find("overloaded") != std::string::npos;
  }
  ASSERT_GE(reported.size(), 3u);
  EXPECT_EQ(reported[0].binning, 1);
  EXPECT_EQ(reported[0].num_spheres, 0);
  EXPECT_EQ(reported.back().binning, 2);  // no smaller: 96 x 72
  EXPECT_TRUE(reported.back().num_spheres == 100 || reported.back().num_spheres == 50);
  EXPECT_GE(contact_revisions.size(), 2u);
  EXPECT_GE(num_load_notes, 2);

  expect_repeats(run, *outcome);
  const auto summary = nlohmann::json::parse(*read_file(run / "summary.json"));
  EXPECT_GT(summary["image_thinned_s"], 0.0);
  EXPECT_GT(summary["spheres_thinned_s"], 0.0);

  // Nobody wants it: then it does not.
  settings.may_thin = false;
  num_settings = 0;
  SlowStream again;
  const auto other = pressing_device();
  ASSERT_TRUE(record_run(tool, again, *other, settings, folder.path() / "whole",
                         {.duration = 3, .monitor = &monitor}));
  EXPECT_EQ(num_settings, 0);
}

TEST(RunMarks, AnyThreadAddsAndNoneIsLost) {
  RunMarks marks;
  std::thread others[4];
  for (std::thread& other : others) {
    other = std::thread([&marks] {
      for (int i = 0; i < 100; ++i) marks.add(std::to_string(i));
    });
  }
  std::size_t num_taken = 0;
  for (int i = 0; i < 10; ++i) num_taken += marks.take().size();
  for (std::thread& other : others) other.join();
  double last = 0;
  const auto rest = marks.take();
  for (const auto& [time, text] : rest) {
    EXPECT_GE(time, last - 1);
    last = time;
  }
  EXPECT_EQ(num_taken + rest.size(), 400u);
  EXPECT_TRUE(marks.take().empty());
}

}  // namespace
}  // namespace palpate
