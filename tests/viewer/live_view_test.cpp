// Runs that a page sees while they go on, and their recordings.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "palpate/viewer/viewer.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/mcap_file.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"
#include "src/viewer/sources/repetition.h"
#include "tests/viewer/path_view.h"
#include "tests/viewer/watcher.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using namespace test::path_view;  // NOLINT: all of it
using Json = nlohmann::ordered_json;
using test::patient_settings;
using test::pressing_device;
using test::pressing_pose;
using test::small_tool;
using test::SyntheticStream;
using test::TemporaryFolder;
using test::Watcher;

TEST(LiveView, ARunOnASimulatedClockKeepsPaceAndCanBeHeldAndTurned) {
  const Tool tool = small_tool();
  constexpr int kNumFrames = 900;  // 30 s, in which even a busy machine comes to hold it
  SyntheticStream stream(kNumFrames);
  const TemporaryFolder folder;
  const auto view = LiveView::create(tool, {stream.info()}, "path");
  Watcher watcher(*view);
  RunOptions options;
  options.monitor = &view->monitor();
  options.keep_going = [&] { return !view->wants_end(); };
  options.clock.keeps_pace = true;
  auto device = test::path_device(pressing_pose, kRate);
  std::optional<Result<RunOutcome>> outcome;
  const auto start = std::chrono::steady_clock::now();
  std::thread run([&] {
    outcome = record_run(tool, stream, **device, path_settings(), folder.path() / "run", options);
  });
  ASSERT_TRUE(watcher.until([&] { return watcher.state()["running"] == true; }));
  ASSERT_TRUE(watcher.until([&] { return watcher.contact && watcher.frame && watcher.surface; }));
  watcher.execute({{"command", "pause"}});
  const int held = watcher.state()["frame_number"];
  watcher.execute({{"command", "step"}, {"frames", 2}});
  ASSERT_TRUE(watcher.until([&] { return watcher.state()["frame_number"] == held + 2; }));
  const double time = watcher.state()["time"];
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(watcher.state()["time"], time);
  ASSERT_TRUE(watcher.until([&] { return watcher.contact->time == time; }));
  play_to(static_cast<std::size_t>(std::lround(time * kRate)), path_settings(), kNumFrames,
          [&](Pipeline& pipeline) { expect_same(*watcher.contact, pipeline); });
  watcher.execute({{"command", "set"}, {"key", "contact.method"}, {"value", "graph"}});
  EXPECT_EQ(watcher.state()["settings"]["contact.method"], "graph");
  watcher.execute({{"command", "resume"}});
  EXPECT_TRUE(watcher.until([&] { return watcher.state()["time"] > time + 1; }));
  watcher.execute({{"command", "end"}});
  run.join();
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  ASSERT_TRUE(*outcome) << outcome->error().message;
  EXPECT_GE(took.count(), static_cast<double>((*outcome)->loop.num_ticks) / kRate + 0.05 - 0.01);
  watcher.poll();
  EXPECT_EQ(watcher.samples.size(), (*outcome)->loop.num_ticks);
  EXPECT_EQ(watcher.state()["running"], false);
  EXPECT_NE(watcher.state()["note"].get<std::string>().find("ended"), std::string::npos);
  const auto replay = replay_run(folder.path() / "run");
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
}

/// Every message of the recording in this folder.
template <class Take>
void read_messages(const fs::path& folder, Take take) {
  auto reader = McapReader::open(folder / kRecordingFile);
  ASSERT_TRUE(reader);
  for (;;) {
    const auto message = reader->next();
    if (!message || !*message) return;
    take(reader->channels().at((*message)->channel).topic, std::string((*message)->data));
  }
}

/// A live run in a thread, with a view that can end it.
class LiveRunTest : public testing::Test {
 protected:
  LiveRunTest()
      : tool_(small_tool()),
        stream_(100000),
        view_(LiveView::create(tool_, {stream_.info()}, "hand")),
        watcher_(*view_) {}

  void start(double duration = 120) {
    run_ = std::thread([this, duration] {
      const auto device = pressing_device();
      RunOptions options;
      options.duration = duration;
      options.keep_going = [this] { return !view_->wants_end(); };
      options.monitor = &view_->monitor();
      outcome_ = record_run(tool_, stream_, *device, patient_settings(), folder(), options);
    });
  }
  void join() {
    if (run_.joinable()) run_.join();
  }
  ~LiveRunTest() override { join(); }
  fs::path folder() const { return where_.path() / "live"; }

  TemporaryFolder where_;
  Tool tool_;
  SyntheticStream stream_;
  std::unique_ptr<LiveView> view_;
  Watcher watcher_;
  std::optional<Result<RunOutcome>> outcome_;
  std::thread run_;
};

TEST_F(LiveRunTest, IsSeenAndSeenAgain) {
  EXPECT_EQ(watcher_.state()["running"], false);
  EXPECT_FALSE(watcher_.command({{"command", "pause"}}));
  start();
  // A contact somewhere within the run, and one that is told at once: its time is that of the last
  // ticks that were published, and a busy disk may hold them up.
  double zero = std::numeric_limits<double>::infinity();  // of the run, s, monotonic
  ASSERT_TRUE(watcher_.until([&] {
    if (!watcher_.contact) return false;
    const double begun = monotonic_now() - watcher_.contact->time;
    zero = std::min(zero, begun);
    return watcher_.frame && watcher_.surface && watcher_.contact->time > 0.4 &&
           begun < zero + 0.3 &&
           std::count(watcher_.contact->spheres.states.begin(),
                      watcher_.contact->spheres.states.end(), SphereState::outside) < 190;
  }));
  const auto seen = watcher_.contact;
  const Json state = watcher_.state();
  EXPECT_EQ(state["running"], true);
  EXPECT_EQ(state["fault"], nullptr);
  EXPECT_EQ(state["paused"], false);
  EXPECT_GT(state["ticks"], 0);
  EXPECT_GT(state["frames"], 0);
  EXPECT_EQ(state["settings"]["contact.method"], "field");
  EXPECT_EQ(state["stages"].size(), 7u);
  EXPECT_EQ(watcher_.frame->frame.width, 96);
  EXPECT_EQ(watcher_.surface->points.size(), 96u * 72u);
  watcher_.execute({{"command", "mark"}, {"text", "here"}});
  watcher_.execute({{"command", "end"}});
  join();
  ASSERT_TRUE(*outcome_) << outcome_->error().message;
  const Json end = watcher_.state();
  EXPECT_EQ(end["running"], false);
  EXPECT_GE(end["ticks"], state["ticks"]);
  EXPECT_NE(end["note"].get<std::string>().find("ended"), std::string::npos);
  EXPECT_FALSE(watcher_.command({{"command", "pause"}}));
  watcher_.poll();

  auto view = view_run(folder());
  ASSERT_TRUE(view) << view.error().message;
  double time = -1;
  read_messages(folder(), [&](const std::string& topic, const std::string& message) {
    if (topic != kContactTopic) return;
    const ContactRecord contact = *read_contact(message);
    if (contact.X_WT == seen->X_WT) time = contact.time;
  });
  // The last ticks that were published may have been a little older.
  EXPECT_NEAR(time, seen->time, 0.5);
  Watcher again(**view);
  again.execute({{"command", "pause"}});
  again.execute({{"command", "seek"}, {"time", time}});
  ASSERT_TRUE(again.until([&] { return again.contact && again.contact->time == time; }));
  EXPECT_EQ(again.contact->X_WT, seen->X_WT);
  EXPECT_EQ(again.contact->frame_number, seen->frame_number);
  EXPECT_EQ(again.contact->spheres.states, seen->spheres.states);
  EXPECT_TRUE(same_planes(again.contact->spheres.planes, seen->spheres.planes));
  const auto marks = again.marks();
  EXPECT_TRUE(std::ranges::any_of(marks, [](const Json& mark) { return mark["text"] == "here"; }))
      << marks;
  // The samples are those that were seen, too.
  const auto sample = std::find_if(watcher_.samples.begin(), watcher_.samples.end(),
                                   [](const ViewSample& s) { return s.time > 0.2; });
  ASSERT_NE(sample, watcher_.samples.end());
  const auto same = std::find_if(again.samples.begin(), again.samples.end(),
                                 [&](const ViewSample& s) { return s.time == sample->time; });
  ASSERT_NE(same, again.samples.end());
  EXPECT_EQ(same->F_H_B.force, sample->F_H_B.force);
  EXPECT_EQ(same->X_WT, sample->X_WT);
}

TEST_F(LiveRunTest, IsTurnedAndHeld) {
  start();
  ASSERT_TRUE(watcher_.until([&] { return watcher_.contact && watcher_.frame; }));
  for (const char* method : {"graph", "field", "weighted"}) {
    watcher_.execute({{"command", "set"}, {"key", "contact.method"}, {"value", method}});
    EXPECT_EQ(watcher_.state()["settings"]["contact.method"], method);
  }
  watcher_.execute({{"command", "set"}, {"key", "coupling.damping_ratio"}, {"value", 0.7}});
  EXPECT_EQ(watcher_.state()["revision"], 4);
  EXPECT_FALSE(watcher_.command({{"command", "set"}, {"key", "contact.method"}, {"value", 1}}));
  EXPECT_FALSE(
      watcher_.command({{"command", "set"}, {"key", "surface.min_depth"}, {"value", 900}}));
  EXPECT_FALSE(watcher_.command({{"command", "set"}, {"key", "loop.threads"}, {"value", 1}}));
  EXPECT_FALSE(watcher_.command({{"command", "seek"}, {"time", 1}}));
  EXPECT_FALSE(watcher_.command({{"command", "mark"}}));
  EXPECT_EQ(watcher_.state()["revision"], 4);
  watcher_.execute({{"command", "pause"}});
  EXPECT_EQ(watcher_.state()["paused"], true);
  // Other things may come first for a moment.
  EXPECT_TRUE(watcher_.until(
      [&] { return watcher_.state()["note"].dump().find("held") != std::string::npos; }));
  watcher_.execute({{"command", "step"}, {"frames", 2}});
  EXPECT_EQ(watcher_.state()["paused"], true);
  watcher_.execute({{"command", "resume"}});
  EXPECT_EQ(watcher_.state()["paused"], false);
  watcher_.execute({{"command", "end"}});
  join();
  ASSERT_TRUE(*outcome_) << outcome_->error().message;
  auto run = open_recorded_run(folder());
  ASSERT_TRUE(run) << run.error().message;
  const auto last = (*run)->query_at(1e9);
  ASSERT_TRUE(last);
  EXPECT_EQ(last->revision, 4u);
  EXPECT_EQ((*run)->settings(last->revision).contact.method, MethodKind::weighted);
  EXPECT_EQ((*run)->settings(last->revision).coupling.damping_ratio, 0.7);
}

TEST_F(LiveRunTest, EveryQueryIsFoundAndRepeated) {
  start(1.2);
  join();
  ASSERT_TRUE(*outcome_) << outcome_->error().message;
  std::vector<ContactRecord> contacts;
  std::size_t num_ticks = 0;
  read_messages(folder(), [&](const std::string& topic, const std::string& message) {
    if (topic == kContactTopic) contacts.push_back(*read_contact(message));
    num_ticks += topic == kTickTopic;
  });
  auto run = open_recorded_run(folder());
  ASSERT_TRUE(run) << run.error().message;
  Repetition repetition(**run);
  const auto always = [] { return true; };
  const std::size_t n = contacts.size();
  ASSERT_GT(n, 10u);
  for (const std::size_t i : {n - 1, n / 2, n / 2 + 1, std::size_t(0), n / 3, n - 2, n / 4}) {
    const ContactRecord& recorded = contacts[i];
    const auto query = (*run)->query_at(recorded.time);
    ASSERT_TRUE(query);
    EXPECT_EQ(query->time, recorded.time);
    EXPECT_EQ(query->X_WT, recorded.X_WT);
    ASSERT_TRUE(*repetition.go_to(*query, (*run)->settings(query->revision), always));
    const Penetration repeated = repetition.measure();
    EXPECT_EQ(repeated.volume, recorded.penetration.volume) << i;
    EXPECT_EQ(repeated.measure_W.torque, recorded.penetration.measure_W.torque) << i;
  }
  const auto samples = (*run)->samples(-1, 1e9);
  ASSERT_TRUE(samples);
  EXPECT_EQ(samples->size(), num_ticks);
  for (std::size_t i = 1; i < samples->size(); ++i) {
    ASSERT_GT((*samples)[i].time, (*samples)[i - 1].time);
  }
  for (std::size_t i = 0; i < (*run)->num_frames(); ++i) {
    const auto query = (*run)->query_at((*run)->needed_from(i));
    ASSERT_TRUE(query);
    // The last ones may have come too late to be felt.
    if ((*run)->frame_number(i) <= contacts.back().frame_number) {
      EXPECT_GE(query->frame, i);
    }
    const auto frame = (*run)->read_frame(i);
    ASSERT_TRUE(frame) << frame.error().message;
    EXPECT_EQ(frame->shown.number, (*run)->frame_number(i));
  }
}

TEST_F(LiveRunTest, WhatWasCutOffIsShownAsFarAsItGoes) {
  start(2);
  join();
  ASSERT_TRUE(*outcome_) << outcome_->error().message;
  const fs::path file = folder() / kRecordingFile;
  const auto size = fs::file_size(file);
  fs::resize_file(file, size * 6 / 10);
  auto cut = view_run(folder());
  ASSERT_TRUE(cut) << cut.error().message;
  Watcher watcher(**cut);
  EXPECT_TRUE(watcher.until([&] { return watcher.contact && watcher.frame; }));
  Json state;
  EXPECT_TRUE(watcher.until([&] {  // it is read to its end
    state = watcher.state();
    return state["note"].dump().find("cut off") != std::string::npos;
  })) << state["note"];
  EXPECT_GT(state["duration"], 0.4);
  EXPECT_LT(state["duration"], (*outcome_)->loop.seconds - 0.1);
  watcher.execute({{"command", "seek"}, {"time", 100}});
  EXPECT_TRUE(watcher.until([&] { return watcher.state()["paused"] == true; }));

  // A bit has flipped.
  auto bytes = *read_file(file);
  bytes[bytes.size() - 1000] = static_cast<char>(bytes[bytes.size() - 1000] ^ 4);
  ASSERT_TRUE(write_file_atomically(file, bytes));
  auto damaged = view_run(folder());
  ASSERT_TRUE(damaged) << damaged.error().message;
  Watcher other(**damaged);
  EXPECT_TRUE(other.until([&] { return other.contact && other.frame; }));

  // Nothing is left to be seen.
  fs::resize_file(file, 2000);
  EXPECT_FALSE(view_run(folder()));
  fs::resize_file(file, 0);
  EXPECT_FALSE(view_run(folder()));
}

}  // namespace
}  // namespace palpate
