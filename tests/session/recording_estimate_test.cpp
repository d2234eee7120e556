// Parts of a recording and the estimate of depth that each begins with.
#include <gtest/gtest.h>

#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_reader.h"
#include "src/session/recording/run_recorder.h"
#include "src/session/replay/lead_estimate.h"
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

// A Kalman filter never forgets: each part begins with what it knew.
TEST(RecordingParts, EstimatesAreRepeatedFromEveryPartOn) {
  for (const TimeMode mode : {TimeMode::latest, TimeMode::interpolate, TimeMode::predict}) {
    for (const int binning : {1, 2}) {
      const TemporaryFolder folder;
      const auto run = folder.path() / "run";
      RunSettings settings = settings_with(mode, CouplingKind::virtual_coupling);
      settings.time.average.kind = DepthAverage::kalman;
      settings.time.average.noise = 0.02;  // so that all frames count
      settings.binning = binning;
      const auto outcome = record(run, settings, {.split_bytes = 1});
      ASSERT_TRUE(outcome) << outcome.error().message;
      EXPECT_GT(outcome->peaks.volume, 0);
      ASSERT_NO_FATAL_FAILURE(expect_parts_repeat(run, *outcome)) << name_of(mode) << binning;
      // Without the estimate the depth is another one, so it makes a difference.
      const fs::path other = folder.path() / "other" / kRecordingFile;
      fs::create_directories(other.parent_path());
      fs::copy_file(recording_parts(run)[3], other);
      auto all = test::messages(other.parent_path());
      std::erase_if(all,
                    [](const auto& message) { return message.channel.topic == kEstimateTopic; });
      test::rewrite(other.parent_path(), all);
      const auto replay = replay_run(other.parent_path());
      ASSERT_TRUE(replay) << replay.error().message;
      EXPECT_NE(replay->difference, "");
    }
  }
}

// An estimate is unknown after frames that were not recorded.
TEST(LeadEstimate, IsUnknownAfterAGapUntilItBeginsAnew) {
  SyntheticStream stream(6);
  RunSettings settings;
  settings.time.average.kind = DepthAverage::kalman;
  LeadEstimate lead(stream.info());
  lead.begin(0, settings);
  lead.begin(2, settings);
  RecordedDepth depth;
  const auto take = [&](std::uint64_t number, std::uint32_t revision) {
    depth.record.camera_frame = number;
    depth.record.revision = revision;
    lead.take(depth);
  };
  EXPECT_TRUE(lead.is_known_before(0, 0));
  ASSERT_TRUE(stream.next(depth.frame).value());
  take(0, 0);
  EXPECT_TRUE(lead.has_estimate(1));
  EXPECT_TRUE(lead.is_known_before(1, 0));
  EXPECT_FALSE(lead.is_known_before(2, 0));
  take(2, 1);
  EXPECT_FALSE(lead.is_known_before(3, 1));
  // It begins anew with the next one, which may be the first of a part.
  EXPECT_TRUE(lead.is_known_before(3, 2));
  EXPECT_FALSE(lead.is_known_before(4, 2));
  EXPECT_FALSE(lead.has_estimate(2));
  take(3, 2);
  EXPECT_TRUE(lead.is_known_before(4, 2));
  EXPECT_TRUE(lead.has_estimate(2));
  EXPECT_EQ(lead.revision(), 2u);
}

// If surfaces are made anew with the very frame that a part begins with, the part begins without
// the estimate before.
TEST(RecordingParts, BeginWithTheEstimateOfTheirFirstFrame) {
  const Tool tool = small_tool();
  for (const bool is_anew : {false, true}) {
    const TemporaryFolder folder;
    SyntheticStream stream(3);
    RunSetup setup;
    setup.settings = settings_with(TimeMode::latest, CouplingKind::none);
    setup.settings.time.average.kind = DepthAverage::kalman;
    setup.streams = {stream.info()};
    setup.device.rate = kRate;
    auto recorder =
        RunRecorder::create(folder.path() / kRecordingFile, tool, setup, true, {.split_bytes = 1});
    ASSERT_TRUE(recorder) << recorder.error().message;
    FrameRecord record;
    ContactRecord contact;
    TickRecord tick;
    DepthFrame frame;
    for (int i = 0; i < 3; ++i) {
      ASSERT_TRUE(stream.next(frame).value());
      if (i == 2) {
        if (is_anew) setup.settings.binning = 2;
        recorder->add_settings(1, setup.settings);
        record.revision = contact.revision = tick.revision = 1;
      }
      record.number = record.camera_frame = static_cast<std::uint64_t>(i);
      recorder->add_frame(record, frame);
      contact.number = tick.contact_number = static_cast<std::uint64_t>(i) + 1;
      contact.cameras.of[0].camera_frame = i;
      recorder->add_contact(contact);
      recorder->add_tick(tick);
    }
    HandSnapshot snapshot;
    snapshot.tick = 3;
    snapshot.revision = 1;
    recorder->add_hand_snapshot(snapshot);
    recorder->finish();
    auto part = RunReader::open(folder.path() / part_file(2));
    ASSERT_TRUE(part) << part.error().message;
    ASSERT_TRUE(part->start());
    EXPECT_TRUE(part->start()->has_surfaces);
    EXPECT_EQ(part->setup().revision, 1u);
    int num_estimates = 0;
    for (auto message = part->next(); message && *message; message = part->next()) {
      num_estimates += (*message)->topic == kEstimateTopic;
    }
    EXPECT_EQ(num_estimates, is_anew ? 0 : 1);
  }
}

// The state of an estimate is not taken over by another run.
TEST(RecordingParts, KeptOnesAreFeltAnewWithoutTheEstimate) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  RunSettings settings = settings_with(TimeMode::latest, CouplingKind::none);
  settings.time.average.kind = DepthAverage::kalman;
  ASSERT_TRUE(record(run, settings, {.split_bytes = 1}, 3));
  ASSERT_TRUE(retry_run(run, folder.path() / "all", [](RunSettings&) { return Done{}; }));
  fs::remove(run / kRecordingFile);
  const auto retry = retry_run(run, folder.path() / "kept", [](RunSettings&) { return Done{}; });
  ASSERT_FALSE(retry);
  EXPECT_NE(retry.error().message.find("(--average none)"), std::string::npos)
      << retry.error().message;
  EXPECT_FALSE(fs::exists(folder.path() / "kept"));
  EXPECT_TRUE(retry_run(run, folder.path() / "kept", [](RunSettings& changed) {
    changed.time.average.kind = DepthAverage::none;
    return Done{};
  }));
}

}  // namespace
}  // namespace palpate
