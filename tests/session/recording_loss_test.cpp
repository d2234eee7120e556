// Parts of a recording that lack settings, frames or contacts: what rests on them is not repeated.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"
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

/// The settings that a part begins with are of this revision.
void rename_settings(std::vector<test::RecordedMessage>& all, std::uint32_t revision) {
  for (auto& message : all) {
    if (message.channel.topic == kPartTopic) {
      PartStart start = *read_part(message.data);
      start.revision = revision;
      message.data = part_message(start);
    } else if (message.channel.topic == kSettingsTopic) {
      RunSetup setup = *read_settings(message.data);
      setup.revision = revision;
      message.data = settings_message(setup);
    }
  }
}

/// A recording of one part of another, whose settings have another revision.
fs::path renamed_part(const fs::path& part, const fs::path& folder, std::uint32_t revision) {
  fs::create_directories(folder);
  fs::copy_file(part, folder / kRecordingFile);
  auto all = test::messages(folder);
  rename_settings(all, revision);
  test::rewrite(folder, all);
  return folder / kRecordingFile;
}

// Also where another part came before.
TEST(RecordingParts, ContactsOfSettingsThatAreMissingAfterAGapAreNotRepeated) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  ASSERT_TRUE(
      record(run, settings_with(TimeMode::latest, CouplingKind::none), {.split_bytes = 1}, 3));
  const fs::path other = renamed_part(recording_parts(run)[2], folder.path() / "other", 1);
  fs::copy_file(other, recording_parts(run)[2], fs::copy_options::overwrite_existing);
  fs::remove(recording_parts(run)[1]);
  const auto replay = replay_run(run);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_NE(replay->note.find("is not repeated: its settings"), std::string::npos) << replay->note;
}

TEST(RecordingParts, ContactsOfFramesThatWereLostBeforeItAreNotRepeated) {
  RunSettings latest = settings_with(TimeMode::latest, CouplingKind::none), averaged = latest;
  averaged.time.average = {DepthAverage::moving, 4, 0.5, 0.02, 1};
  RunSettings estimated = settings_with(TimeMode::interpolate, CouplingKind::none);
  estimated.time.average.kind = DepthAverage::kalman;
  estimated.time.average.noise = 0.02;
  int number = 0;
  for (const RunSettings& settings :
       {latest, settings_with(TimeMode::interpolate, CouplingKind::none),
        settings_with(TimeMode::predict, CouplingKind::none), averaged, estimated}) {
    SCOPED_TRACE(number++);
    const TemporaryFolder folder;
    const auto run = folder.path() / "run", part = folder.path() / "part";
    ASSERT_TRUE(record(run, settings, {.split_bytes = 1}, 3));
    fs::create_directories(part);
    fs::copy_file(recording_parts(run)[1], part / kRecordingFile);
    const auto whole = replay_run(part);
    ASSERT_TRUE(whole) << whole.error().message;
    EXPECT_EQ(whole->difference + whole->note, "");
    // The state of an estimate before the lost frame is of no use after it.
    const bool is_estimate = settings.time.average.kind == DepthAverage::kalman;
    auto all = test::messages(part);
    for (int num_lost = 1; num_lost < 4; ++num_lost) {
      all.erase(std::ranges::find(all, std::string_view(kFrameTopic),
                                  [](const auto& each) { return each.channel.topic; }));
      test::rewrite(part, all);
      const auto replay = replay_run(part);
      ASSERT_TRUE(replay) << replay.error().message;
      EXPECT_EQ(replay->difference, "");
      EXPECT_NE(replay->note.find(is_estimate ? "repeated up to number 0 only: a depth frame"
                                              : "is not repeated: its depth frames"),
                std::string::npos)
          << num_lost << ' ' << replay->note;
      EXPECT_EQ(replay->num_contacts > 0, !is_estimate);
      EXPECT_LT(replay->num_contacts, whole->num_contacts);
    }
  }
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

TEST(RecordingParts, ContactsOfSettingsThatAreNotThereAreNotRepeated) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  ASSERT_TRUE(
      record(run, settings_with(TimeMode::latest, CouplingKind::none), {.split_bytes = 1}, 3));
  const fs::path other = renamed_part(recording_parts(run)[1], folder.path() / "other", 1);
  const auto replay = replay_run(other.parent_path());
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->num_contacts, 0u);
  EXPECT_NE(replay->note.find("is not repeated: its settings"), std::string::npos) << replay->note;
}

}  // namespace
}  // namespace palpate
