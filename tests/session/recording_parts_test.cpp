// Recordings in parts: all together are repeated to the bit, each can be viewed alone, old ones go,
// a full disk interrupts.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <map>
#include <sstream>

#include "palpate/session/run.h"
#include "src/io/internal/atomic_file.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_reader.h"
#include "src/session/recording/run_recorder.h"
#include "tests/session/live_hand.h"
#include "tests/session/path_run.h"
#include "tests/session/recorded_messages.h"
#include "tests/session/repeated_run.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::expect_repeats;
using test::path_settings;
using test::pressing_pose;
using test::small_tool;
using test::SyntheticStream;
using test::TemporaryFolder;

constexpr double kRate = 200;  // of ticks, 1/s
constexpr int kFrameRate = 10;

/// The wall comes nearer by 2 cm a second.
Result<RunOutcome> record(const fs::path& run, const RunSettings& settings,
                          const RecordingOptions& recording, double seconds = 6) {
  static const Tool tool = small_tool();
  SyntheticStream stream(static_cast<int>(seconds * kFrameRate), kFrameRate);
  auto device = test::path_device(pressing_pose, kRate);
  RunOptions options;
  options.recording = recording;
  return record_run(tool, stream, **device, settings, run, options);
}

RunSettings settings_with(TimeMode mode, CouplingKind kind) {
  RunSettings settings = path_settings(kRate);
  settings.time.mode = mode;
  settings.coupling.kind = kind;
  test::be_patient(settings.safety);
  return settings;
}

/// Numbers of messages by topic.
std::map<std::string, int> count(const fs::path& recording) {
  std::map<std::string, int> num;
  auto reader = RunReader::open(recording);
  EXPECT_TRUE(reader) << reader.error().message;
  for (auto message = reader->next(); message && *message; message = reader->next()) {
    ++num[std::string((*message)->topic)];
  }
  return num;
}

TEST(RecordingParts, AreRepeatedForEveryCouplingAndTime) {
  std::vector<RunSettings> all;
  for (const TimeMode mode : {TimeMode::latest, TimeMode::interpolate, TimeMode::predict}) {
    for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling,
                                    CouplingKind::direct, CouplingKind::proxy}) {
      all.push_back(settings_with(mode, kind));
    }
  }
  for (const DepthAverage average :
       {DepthAverage::moving, DepthAverage::exponential, DepthAverage::kalman}) {
    all.push_back(settings_with(TimeMode::interpolate, CouplingKind::virtual_coupling));
    all.back().time.average.kind = average;
    all.back().time.average.noise = 0.02;  // so that all frames count
  }
  all.push_back(settings_with(TimeMode::interpolate, CouplingKind::virtual_coupling));
  all.back().time.memory.kind = DepthMemory::on;
  for (const RunSettings& settings : all) {
    const TemporaryFolder folder;
    const auto run = folder.path() / "run";
    const auto outcome = record(run, settings, {.split_bytes = 1});
    ASSERT_TRUE(outcome) << outcome.error().message;
    EXPECT_EQ(recording_parts(run).size(), 6u);  // every second
    EXPECT_GT(outcome->peaks.volume, 0);
    expect_repeats(run, *outcome);
  }
}

TEST(RecordingParts, HoldEveryRecordOnceAndCanBeReadAlone) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  const auto outcome =
      record(run, settings_with(TimeMode::interpolate, CouplingKind::virtual_coupling),
             {.split_bytes = 1});
  ASSERT_TRUE(outcome) << outcome.error().message;
  std::map<std::string, int> sum;
  for (const fs::path& part : recording_parts(run)) {
    auto reader = RunReader::open(part);
    ASSERT_TRUE(reader) << reader.error().message;
    EXPECT_TRUE(reader->load_tools());
    for (const auto& [topic, num] : count(part)) sum[topic] += num;
    TickRecord tick;
    ASSERT_TRUE(reader->next_tick(tick).value());
    EXPECT_EQ(tick.time, std::floor(tick.time));
  }
  EXPECT_EQ(sum[kTickTopic], static_cast<int>(outcome->loop.num_ticks));
  EXPECT_EQ(sum[kContactTopic], static_cast<int>(outcome->loop.num_contacts));
  EXPECT_EQ(sum[kFrameTopic], static_cast<int>(outcome->loop.num_frames));
}

// A part that cannot write its end, as the file has reached the largest size, reports it.
TEST(RecordingParts, TellWhatIsLostAtTheEndOfAPart) {
  const TemporaryFolder folder;
  const pid_t child = fork();
  if (child == 0) {
    signal(SIGXFSZ, SIG_IGN);
    const Tool tool = small_tool();
    SyntheticStream stream(400);
    RunSetup setup;
    setup.settings = settings_with(TimeMode::latest, CouplingKind::none);
    setup.streams = {stream.info()};
    setup.device.rate = kRate;
    const fs::path path = folder.path() / kRecordingFile;
    auto recorder =
        RunRecorder::create(path, tool, setup, true, {.split_bytes = 1, .reserve_bytes = 0});
    if (!recorder) _exit(2);
    DepthFrame frame;
    FrameRecord record;
    ContactRecord contact;
    TickRecord tick;
    const auto add = [&] {
      (void)stream.next(frame);
      recorder->add_frame(record, frame);
      contact.cameras.of[0].camera_frame = static_cast<std::int64_t>(record.camera_frame);
      record.number = ++record.camera_frame;
      tick.contact_number = ++contact.number;
      recorder->add_contact(contact);
      recorder->add_tick(tick);
      ++tick.number;
    };
    const std::uintmax_t empty = fs::file_size(path);
    for (int i = 0; i < 390 && fs::file_size(path) < 3 * empty; ++i) add();
    if (fs::file_size(path) < 3 * empty) _exit(3);
    for (int i = 0; i < 3; ++i) add();
    const rlimit limit{fs::file_size(path), fs::file_size(path)};
    setrlimit(RLIMIT_FSIZE, &limit);
    const std::uint64_t num_added = tick.number;
    tick.time = 1;
    add();  // in another part
    recorder->finish();
    auto reader = RunReader::open(path);
    std::uint64_t num_ticks = 0;
    while (reader && reader->next_tick(tick).value()) ++num_ticks;
    const bool is_lost = num_ticks < num_added;
    const bool is_told = recorder->trouble().find("nothing was recorded") != std::string::npos;
    _exit(!is_lost ? 4 : is_told ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(RecordingParts, LostContactsAreTold) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  ASSERT_TRUE(record(run, settings_with(TimeMode::latest, CouplingKind::none), {}, 1));
  auto all = test::messages(run);
  std::erase_if(all, [](const auto& message) {
    if (message.channel.topic != kContactTopic) return false;
    const std::uint64_t number = read_contact(message.data)->number;
    return number == 30 || number == 40 || number == 41;
  });
  test::rewrite(run, all);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_NE(replay->note.find("3 contacts were not recorded"), std::string::npos) << replay->note;
}

TEST(RecordingParts, WhatIsOlderGoesAndTheRestIsNotRepeated) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  ASSERT_TRUE(record(run, settings_with(TimeMode::interpolate, CouplingKind::proxy),
                     {.keep_seconds = 4, .split_bytes = 1e9}, 15));
  const auto parts = recording_parts(run);
  EXPECT_FALSE(fs::exists(run / kRecordingFile));
  ASSERT_GE(parts.size(), 3u);
  ASSERT_LE(parts.size(), 5u);
  EXPECT_TRUE(is_run(run));
  const int num_ticks = count(run)[kTickTopic];
  EXPECT_GE(num_ticks, 4 * kRate);
  EXPECT_LE(num_ticks, 7 * kRate);
  // One row for each of them.
  std::istringstream csv(*read_file(run / "wrench.csv"));
  std::string line;
  int num_lines = 0;
  double first = 0;
  for (; std::getline(csv, line); ++num_lines) {
    if (num_lines == 1) first = std::stod(line);
  }
  EXPECT_EQ(num_lines, num_ticks + 1);
  EXPECT_GE(first, 8);
  EXPECT_LE(first, 11);

  const auto refusal = [](const fs::path& recording) {
    const auto replay = replay_run(recording);
    EXPECT_FALSE(replay);
    return replay ? "" : replay.error().message;
  };
  const std::string name = parts.front().filename();
  EXPECT_EQ(refusal(run), parts.front().string() + " is part " +
                              std::to_string(std::stoi(name.substr(name.find('-') + 1))) +
                              " of its run, and only a recording from the run's start can be "
                              "repeated; look at it with palpate view, or record the run again "
                              "without --record-keep");
  EXPECT_NE(refusal(parts.back()).find("palpate view"), std::string::npos);
  const auto retry = retry_run(run, folder.path() / "retry", [](RunSettings&) { return Done{}; });
  ASSERT_FALSE(retry);
  EXPECT_EQ(retry.error().message, refusal(run));
  EXPECT_FALSE(fs::exists(folder.path() / "retry"));
  // A new run takes its place.
  ASSERT_TRUE(record(run, settings_with(TimeMode::latest, CouplingKind::none), {}, 1));
  EXPECT_EQ(recording_parts(run).size(), 1u);
}

TEST(RecordingParts, AreRepeatedUpToAGapThatIsTold) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  ASSERT_TRUE(record(run, settings_with(TimeMode::interpolate, CouplingKind::virtual_coupling),
                     {.split_bytes = 1}));
  fs::remove(recording_parts(run)[2]);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_EQ(replay->num_ticks, static_cast<std::size_t>(2 * kRate));
  EXPECT_EQ(replay->note,
            "what comes from part 4 on is not repeated: ticks before it were not "
            "recorded; look at it with palpate view");
}

// Writing to a file that has been removed or cut never fails: the run checks at its end.
TEST(RecordingParts, ThatSomebodyElseRemovesOrCutsAreMissed) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  RunMonitor monitor;
  bool is_done = false;
  monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    if (is_done || ticks.back().time < 3.5) return;
    is_done = true;
    fs::remove(run / part_file(2));
    fs::resize_file(run / part_file(3), 1000);
    fs::remove(run / part_file(4));  // which is being written
  };
  RunOptions options;
  options.recording.split_bytes = 1;
  options.monitor = &monitor;
  const Tool tool = small_tool();
  SyntheticStream stream(6 * kFrameRate, kFrameRate);
  auto device = test::path_device(pressing_pose, kRate);
  const auto outcome = record_run(
      tool, stream, **device, settings_with(TimeMode::latest, CouplingKind::none), run, options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  ASSERT_TRUE(is_done);
  std::string expected;
  for (const int part : {2, 3, 4}) {
    expected += (expected.empty() ? "" : "; ") + part_file(part) +
                " was removed or changed by another program";
  }
  EXPECT_EQ(outcome->not_kept, expected);
}

TEST(RecordingParts, PauseBeforeTheDiskIsFull) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  std::vector<std::string> said;
  RunOptions options;
  options.recording.reserve_bytes = 1e18;
  options.say = [&](double, std::string_view text) {
    if (text.find("the recording") != std::string_view::npos) said.emplace_back(text);
  };
  const Tool tool = small_tool();
  SyntheticStream stream(30, kFrameRate);
  auto device = test::path_device(pressing_pose, kRate);
  const auto outcome = record_run(
      tool, stream, **device, settings_with(TimeMode::latest, CouplingKind::none), run, options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->loop.num_ticks, 3 * kRate);
  EXPECT_NE(outcome->not_kept.find("nothing was recorded from 0.99 s on: only "), std::string::npos)
      << outcome->not_kept;
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("the recording pauses: only "), std::string::npos) << said[0];
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_EQ(replay->num_ticks, static_cast<std::size_t>(kRate));
}

}  // namespace
}  // namespace palpate
