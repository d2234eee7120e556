// Live runs that people look on and change: what is kept of it, and that it can be repeated.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "palpate/io/atomic_file.h"
#include "palpate/io/mcap_file.h"
#include "palpate/session/run.h"
#include "palpate/session/run_folder.h"
#include "src/session/run_messages.h"
#include "tests/session/live_hand.h"
#include "tests/session/recorded_messages.h"
#include "tests/session/synthetic_stream.h"

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

double depth_in_the_wall(double time) { return 0.07 + 0.02 * std::sin(7 * time); }

using Edit = void (*)(RunSettings&);
constexpr Edit kEdits[] = {
    [](auto& s) { s.contact.method = InsideMethod::graph; },
    [](auto& s) { s.coupling.stiffness = 200; },
    [](auto& s) { s.time.mode = TimeMode::predict; },
    [](auto& s) { s.coupling.kind = CouplingKind::proxy; },
    [](auto& s) {
      s.contact.method = InsideMethod::field;
      s.coupling.kind = CouplingKind::direct;
      s.coupling.force_at_eighth = 3;
    },
    [](auto& s) { s.surface.filter.enabled = false; },
};

/// Runs, makes the changes one after the other, and ends.
Result<RunOutcome> run_with_changes(const std::filesystem::path& folder, RunMonitor& monitor) {
  const Tool tool = small_tool();
  SyntheticStream stream(1000);
  const auto device = pressing_device(depth_in_the_wall);
  std::atomic<bool> is_done = false;
  std::thread person;
  monitor.on_loop = [&](RunLoop* loop) {
    if (loop == nullptr) {
      person.join();
      return;
    }
    person = std::thread([&, loop] {
      const auto pause = [] { std::this_thread::sleep_for(std::chrono::milliseconds(120)); };
      pause();
      for (const Edit edit : kEdits) {
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
  options.duration = 60;
  options.keep_going = [&] { return !is_done.load(); };
  options.monitor = &monitor;
  return record_run(tool, stream, *device, patient_settings(), folder, options);
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
  const auto outcome = run_with_changes(run, monitor);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->failure, "");
  EXPECT_EQ(num_ticks, outcome->loop.num_ticks);
  EXPECT_EQ(num_frames, outcome->loop.num_frames);
  EXPECT_EQ(num_contacts, outcome->loop.num_contacts);
  EXPECT_EQ(revisions, (std::vector<std::uint32_t>{1, 2, 3, 4, 5, 6}));

  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_EQ(replay->note, "");
  EXPECT_EQ(replay->num_ticks, outcome->loop.num_ticks);
  EXPECT_EQ(replay->num_contacts, outcome->loop.num_contacts);

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
    std::vector<Message> changed = all;
    for (Message& message : changed) {
      if (message.channel.topic != kSettingsTopic) continue;
      RunSetup setup = *read_settings(message.data);
      if (setup.revision != revision) continue;
      setup.settings.coupling.tool_mass *= 1.25;
      setup.settings.coupling.force_at_eighth += 0.5;
      setup.settings.surface.filter.radius = 4;
      setup.settings.surface.filter.enabled = true;
      message.data = settings_message(setup);
    }
    rewrite(run, changed);
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
