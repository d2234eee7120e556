// Recordings in parts: each and all together are repeated to the bit, old ones go, a full disk
// interrupts.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <sstream>

#include "src/io/internal/atomic_file.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_reader.h"
#include "src/session/recording/run_recorder.h"
#include "tests/session/parted_run.h"
#include "tests/session/recorded_messages.h"
#include "tests/session/repeated_run.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using namespace test::parted_run;  // NOLINT: all of it
using test::expect_parts_repeat;
using test::path_settings;
using test::pressing_pose;
using test::small_tool;
using test::SyntheticStream;
using test::TemporaryFolder;

TEST(RecordingParts, AreRepeatedEachAndAllForEveryCouplingAndTime) {
  for (const TimeMode mode : {TimeMode::latest, TimeMode::interpolate, TimeMode::predict}) {
    for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling,
                                    CouplingKind::direct, CouplingKind::proxy}) {
      const TemporaryFolder folder;
      const auto run = folder.path() / "run";
      const auto outcome = record(run, settings_with(mode, kind), {.split_bytes = 1});
      ASSERT_TRUE(outcome) << outcome.error().message;
      EXPECT_EQ(recording_parts(run).size(), 6u);  // every second
      EXPECT_GT(outcome->peaks.volume, 0);
      expect_parts_repeat(run, *outcome);
    }
  }
}

TEST(RecordingParts, MovingAveragesAreRepeatedAndWhatIsEndlessSaysThatItIsNot) {
  RunSettings settings = settings_with(TimeMode::interpolate, CouplingKind::virtual_coupling);
  settings.time.average = {DepthAverage::moving, 4, 0.5, 0.02, 1};
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  const auto outcome = record(run, settings, {.split_bytes = 1});
  ASSERT_TRUE(outcome) << outcome.error().message;
  expect_parts_repeat(run, *outcome);

  RunSettings exponential = settings, memory = settings;
  exponential.time.average.kind = DepthAverage::exponential;
  memory.time.average = {};
  memory.time.memory.kind = DepthMemory::on;
  for (const RunSettings& without_end : {exponential, memory}) {
    const auto folder_of = folder.path() / (std::string(name_of(without_end.time.average.kind)) +
                                            name_of(without_end.time.memory.kind));
    const auto endless = record(folder_of, without_end, {.split_bytes = 1});
    ASSERT_TRUE(endless) << endless.error().message;
    const auto replay = replay_run(folder_of);
    ASSERT_TRUE(replay) << replay.error().message;
    EXPECT_EQ(replay->difference, "");
    EXPECT_EQ(replay->num_contacts, endless->loop.num_contacts);  // from the beginning on they are
    const auto alone = replay_run(recording_parts(folder_of)[2]);
    ASSERT_TRUE(alone) << alone.error().message;
    EXPECT_EQ(alone->difference, "");
    EXPECT_EQ(alone->num_contacts, 0u);
    EXPECT_GT(alone->num_ticks, 100u);
    EXPECT_NE(alone->note.find("averages"), std::string::npos);
  }
}

// A tick may be recorded before the contact that it rests on, which is of older settings.
TEST(RecordingParts, HoldTheSettingsOfContactsThatComeLate) {
  const TemporaryFolder folder;
  const Tool tool = small_tool();
  RunSetup setup;
  setup.settings = settings_with(TimeMode::latest, CouplingKind::none);
  setup.streams.resize(1);
  setup.device.rate = kRate;
  auto recorder =
      RunRecorder::create(folder.path() / kRecordingFile, tool, setup, true, {.split_bytes = 1});
  ASSERT_TRUE(recorder) << recorder.error().message;
  ContactRecord contact;
  contact.number = 1;
  recorder->add_contact(contact);
  recorder->add_settings(1, setup.settings);
  TickRecord tick;
  tick.revision = 1;
  tick.contact_number = 2;
  recorder->add_tick(tick);
  HandSnapshot snapshot;
  snapshot.tick = snapshot.revision = 1;
  recorder->add_hand_snapshot(snapshot);
  contact.number = 2;
  recorder->add_contact(contact);
  recorder->finish();
  const auto part = RunReader::open(folder.path() / part_file(2));
  ASSERT_TRUE(part) << part.error().message;
  ASSERT_TRUE(part->start());
  EXPECT_EQ(part->start()->revision, 0u);
  EXPECT_EQ(part->setup().revision, 0u);
}

// A contact of the settings before looks back at a frame that the next ones do not need.
TEST(RecordingParts, HoldTheFramesThatContactsOfEarlierSettingsRestOn) {
  const TemporaryFolder folder;
  const Tool tool = small_tool();
  SyntheticStream stream(4);
  RunSetup setup;
  setup.settings = settings_with(TimeMode::interpolate, CouplingKind::none);
  setup.streams = {stream.info()};
  setup.device.rate = kRate;
  auto recorder =
      RunRecorder::create(folder.path() / kRecordingFile, tool, setup, true, {.split_bytes = 1});
  ASSERT_TRUE(recorder) << recorder.error().message;
  DepthFrame frame;
  FrameRecord record;
  for (record.number = 0; record.number < 4; ++record.number) {
    ASSERT_TRUE(stream.next(frame).value());
    if (record.number == 3) {
      setup.settings.time.mode = TimeMode::latest;
      recorder->add_settings(1, setup.settings);
      record.revision = 1;
    }
    record.camera_frame = record.number;
    recorder->add_frame(record, frame);
  }
  ContactRecord contact;
  contact.number = 1;
  contact.cameras.of[0].camera_frame = 2;
  recorder->add_contact(contact);
  TickRecord tick;
  tick.contact_number = 1;
  recorder->add_tick(tick);
  HandSnapshot snapshot;
  snapshot.tick = 1;
  recorder->add_hand_snapshot(snapshot);
  recorder->finish();
  auto part = RunReader::open(folder.path() / part_file(2));
  ASSERT_TRUE(part) << part.error().message;
  RecordedDepth first;
  ASSERT_TRUE(part->next_frame(first).value());
  EXPECT_EQ(first.record.camera_frame, 1u);
}

// Settings that no record refers to any more are not kept, however long a part is.
TEST(RecordingParts, KeepNoSettingsThatNothingHasAnyMore) {
  const TemporaryFolder folder;
  const Tool tool = small_tool();
  RunSetup setup;
  setup.settings = settings_with(TimeMode::interpolate, CouplingKind::none);
  setup.settings.regions = {std::make_shared<const MaterialRegions>()};
  setup.streams = {SyntheticStream(1).info()};
  setup.device.rate = kRate;
  const auto& regions = setup.settings.regions[0];
  auto recorder = RunRecorder::create(folder.path() / kRecordingFile, tool, setup, true);
  ASSERT_TRUE(recorder) << recorder.error().message;
  ContactRecord contact;
  TickRecord tick;
  FrameRecord record;
  SyntheticStream stream(100);
  DepthFrame frame;
  for (std::uint32_t i = 1; i <= 100; ++i) {
    recorder->add_settings(i, setup.settings);
    ASSERT_TRUE(stream.next(frame).value());
    record.number = record.camera_frame = i - 1;
    record.revision = contact.revision = tick.revision = i;
    recorder->add_frame(record, frame);
    contact.number = tick.contact_number = i;
    contact.cameras.of[0].camera_frame = i - 1;
    recorder->add_contact(contact);
    recorder->add_tick(tick);
  }
  EXPECT_LE(regions.use_count(), 8);
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
    HandSnapshot snapshot;
    snapshot.tick = tick.number;
    recorder->add_hand_snapshot(snapshot);
    recorder->finish();
    auto reader = RunReader::open(path);
    std::uint64_t num_ticks = 0;
    while (reader && reader->next_tick(tick).value()) ++num_ticks;
    const bool is_lost = num_ticks < snapshot.tick;
    const bool is_told = recorder->trouble().find("nothing was recorded") != std::string::npos;
    _exit(!is_lost ? 4 : is_told ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

// A change of any state of the hand is found: place where it took the tool along, pose, velocity.
TEST(RecordingParts, TheStateOfTheHandDecides) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  ASSERT_TRUE(record(run, settings_with(TimeMode::latest, CouplingKind::virtual_coupling),
                     {.split_bytes = 1}, 3));
  const fs::path part = recording_parts(run)[1], other = folder.path() / "other" / kRecordingFile;
  fs::create_directories(other.parent_path());
  int num_found = 0;
  for (const std::size_t changed : {40, 177, 180, 183}) {
    fs::copy_file(part, other, fs::copy_options::overwrite_existing);
    auto all = test::messages(other.parent_path());
    for (auto& message : all) {
      if (message.channel.topic != kPartTopic) continue;
      PartStart start = *read_part(message.data);
      std::vector<double> numbers(start.hand.numbers.numbers().begin(),
                                  start.hand.numbers.numbers().end());
      numbers.at(changed) += 1e-3;
      start.hand.numbers = StateNumbers(numbers);
      message.data = part_message(start);
    }
    test::rewrite(other.parent_path(), all);
    const auto replay = replay_run(other.parent_path());
    num_found += !replay || !replay->difference.empty();
  }
  EXPECT_EQ(num_found, 4);
  // In its run it is not what the part before has ended with.
  fs::copy_file(other, part, fs::copy_options::overwrite_existing);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_NE(replay->difference.find("the state of the hand"), std::string::npos);
}

TEST(RecordingParts, WhatIsOlderGoesAndTheRestIsWhole) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  const auto outcome = record(run, settings_with(TimeMode::interpolate, CouplingKind::proxy),
                              {.keep_seconds = 4, .split_bytes = 1e9}, 15);
  ASSERT_TRUE(outcome) << outcome.error().message;
  const auto parts = recording_parts(run);
  EXPECT_FALSE(fs::exists(run / kRecordingFile));
  ASSERT_GE(parts.size(), 3u);
  ASSERT_LE(parts.size(), 5u);
  EXPECT_TRUE(is_run(run));
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_GE(replay->num_ticks, 4 * kRate);
  EXPECT_LE(replay->num_ticks, 7 * kRate);
  // One row for each of them.
  std::istringstream csv(*read_file(run / "wrench.csv"));
  std::string line;
  std::size_t num_lines = 0;
  double first = 0;
  for (; std::getline(csv, line); ++num_lines) {
    if (num_lines == 1) first = std::stod(line);
  }
  EXPECT_EQ(num_lines, replay->num_ticks + 1);
  EXPECT_GE(first, 8);
  EXPECT_LE(first, 11);
  // Other settings, and a page.
  const auto retry = retry_run(run, folder.path() / "retry", [](RunSettings&) { return Done{}; });
  ASSERT_TRUE(retry) << retry.error().message;
  EXPECT_EQ(retry->forces.num_ticks, replay->num_ticks);
  // A new run takes its place.
  ASSERT_TRUE(record(run, settings_with(TimeMode::latest, CouplingKind::none), {}, 1));
  EXPECT_EQ(recording_parts(run).size(), 1u);
}

TEST(RecordingParts, AGapIsToldAndBothSidesOfItAreRepeated) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  const auto outcome =
      record(run, settings_with(TimeMode::interpolate, CouplingKind::virtual_coupling),
             {.split_bytes = 1});
  ASSERT_TRUE(outcome) << outcome.error().message;
  fs::remove(recording_parts(run)[2]);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_EQ(replay->num_ticks, outcome->loop.num_ticks - static_cast<std::size_t>(kRate));
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
