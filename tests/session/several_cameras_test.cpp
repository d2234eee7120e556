// Recordings of runs with several cameras, of which one moves: repeated to the bit, in parts, with
// other settings.
#include <gtest/gtest.h>

#include <limits>
#include <map>

#include "palpate/session/run.h"
#include "src/io/internal/ros_messages.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_reader.h"
#include "tests/session/function_stream.h"
#include "tests/session/path_run.h"
#include "tests/session/recorded_messages.h"
#include "tests/session/wrench_csv.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/posed_wall.h"
#include "tests/test_util/report_data.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::beside_wall;
using test::PosedWall;
using test::TemporaryFolder;

constexpr double kRate = 200;     // of ticks, 1/s
constexpr double kSeconds = 2.5;  // of a run

/// A tool that goes into the wall at z = 0.5 and out again.
Pose pressing(double time) {
  return {{0.01 * time, 0.005, 0.47 + 0.03 * std::sin(3 * time)},
          axis_angle({1, 2, 3}, 0.3 * time)};
}
Pose orbit(double time) { return beside_wall(0.3 * std::sin(2 * time)); }

/// 30, 12 and 20 Hz; the last one moves.
struct Walls {
  PosedWall left{[](double) { return beside_wall(0.5); }, 30, 0.5, int(30 * kSeconds)};
  PosedWall right{[](double) { return beside_wall(-0.4); }, 12, 0.5, int(12 * kSeconds)};
  PosedWall moving{orbit, 20, 0.5, int(20 * kSeconds)};

  DepthSources sources() { return DepthSources({&left, &right, &moving}); }
};

const Tool& tool() {
  static const Tool made = test::random_tool(200, 0.03, 7);
  return made;
}

Result<RunOutcome> record(const std::filesystem::path& run, const RunSettings& settings,
                          const RecordingOptions& recording = {}) {
  Walls walls;
  auto device = test::path_device(pressing, kRate);
  RunOptions options;
  options.recording = recording;
  return record_run(tool(), walls.sources(), **device, settings, run, options);
}

TEST(RunsOfSeveralCameras, AreRepeatedToTheBit) {
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling}) {
    const TemporaryFolder folder;
    RunSettings settings = test::path_settings(kRate);
    settings.coupling.kind = kind;
    settings.safety.max_contact_age = settings.safety.max_sensor_age = 60;
    const auto outcome = record(folder.path() / "run", settings);
    ASSERT_TRUE(outcome) << outcome.error().message;
    EXPECT_EQ(outcome->failure, "");
    EXPECT_GT(outcome->peaks.volume, 1e-6);
    EXPECT_GT(outcome->loop.num_frames, 140u);
    const auto replay = replay_run(folder.path() / "run", {.num_threads = 2});
    ASSERT_TRUE(replay) << replay.error().message;
    EXPECT_EQ(replay->difference, "");
    EXPECT_EQ(replay->note, "");
    EXPECT_EQ(replay->num_ticks, outcome->loop.num_ticks);
    EXPECT_EQ(replay->num_contacts, outcome->loop.num_contacts);
  }
}

TEST(RunsOfSeveralCameras, ThatRememberAreRepeatedToTheBit) {
  const TemporaryFolder folder;
  PosedWall left([](double) { return beside_wall(0.5); }, 30, 0.5, int(30 * kSeconds)),
      right([](double) { return beside_wall(-0.4); }, 12, 0.5, int(12 * kSeconds));
  // Something comes before the third one, and goes.
  test::FunctionStream middle(
      [](double time, int u, int) { return u < 60 && std::sin(9 * time) > 0 ? 0.3 : 0.5; },
      test::every(1.0 / 30, int(30 * kSeconds)));
  RunSettings settings = test::path_settings(kRate);
  settings.time.memory.kind = DepthMemory::on;
  auto device = test::path_device(pressing, kRate);
  const auto outcome = record_run(tool(), DepthSources({&left, &middle, &right}), **device,
                                  settings, folder.path() / "run", {});
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_GT(outcome->peaks.volume, 1e-6);
  const auto replay = replay_run(folder.path() / "run", {.num_threads = 2});
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_EQ(replay->num_contacts, outcome->loop.num_contacts);
}

TEST(RunsOfSeveralCameras, AreRepeatedInParts) {
  const TemporaryFolder folder;
  const auto run = folder.path() / "run";
  const auto outcome = record(run, test::path_settings(kRate), {.split_bytes = 1});
  ASSERT_TRUE(outcome) << outcome.error().message;
  ASSERT_EQ(recording_parts(run).size(), 3u);
  const auto all = replay_run(run);
  ASSERT_TRUE(all) << all.error().message;
  EXPECT_EQ(all->difference, "");
  EXPECT_EQ(all->num_contacts, outcome->loop.num_contacts);
}

TEST(RunsOfSeveralCameras, HoldEveryFrameAndWhereItsCameraWas) {
  const TemporaryFolder folder;
  ASSERT_TRUE(record(folder.path() / "run", test::path_settings(kRate)));
  auto reader = RunReader::open(folder.path() / "run");
  ASSERT_TRUE(reader) << reader.error().message;
  ASSERT_EQ(reader->setup().streams.size(), 3u);
  EXPECT_EQ(reader->setup().streams[1].rate, 12);
  EXPECT_FALSE(reader->setup().streams[1].is_moving);
  EXPECT_TRUE(reader->setup().streams[2].is_moving);
  Walls again;
  PosedWall* const sources[] = {&again.left, &again.right, &again.moving};
  RecordedDepth recorded;
  DepthFrame frame;
  std::map<std::uint32_t, int> num;
  while (*reader->next_frame(recorded)) {
    ASSERT_LT(recorded.record.camera, 3u);
    EXPECT_EQ(recorded.record.camera_frame, num[recorded.record.camera]++);
    ASSERT_TRUE(sources[recorded.record.camera]->next(frame).value());
    EXPECT_EQ(recorded.frame.pixels, frame.pixels);
    EXPECT_EQ(recorded.frame.X_WC, frame.X_WC);
    EXPECT_EQ(recorded.frame.timestamp, frame.timestamp);
  }
  EXPECT_EQ(num[0], int(30 * kSeconds));
  EXPECT_EQ(num[1], int(12 * kSeconds));
  EXPECT_EQ(num[2], int(20 * kSeconds));
}

/// Beside the images, behind the wall, and back.
Pose away(double time) {
  const bool is_away = time > 0.8 && time < 1.8;
  return {{0, 0, is_away ? 0.6 : 0.4}, {}};
}

TEST(RunsOfSeveralCameras, SayWhatNobodySees) {
  const TemporaryFolder folder;
  Walls walls;
  auto device = test::path_device(away, kRate);
  std::vector<std::string> said;
  RunOptions options;
  options.say = [&](double, std::string_view text) { said.emplace_back(text); };
  const auto outcome = record_run(tool(), walls.sources(), **device, test::path_settings(kRate),
                                  folder.path() / "run", options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  const auto columns = test::columns_of(folder.path() / "run" / "wrench.csv");
  EXPECT_EQ(columns.at("unseen").front(), 0);
  EXPECT_NEAR(columns.at("unseen").at(300), 1, 0.02);  // 10 cm behind a wall nobody looks
  EXPECT_EQ(columns.at("unseen").back(), 0);
  ASSERT_EQ(said.size(), 2u);
  EXPECT_NE(said[0].find("in unobserved space"), std::string::npos) << said[0];
  EXPECT_NE(said[1].find("again"), std::string::npos) << said[1];
  EXPECT_NE(outcome->summary_json.find("\"unseen\""), std::string::npos);
  PALPATE_PAGES_OR_SKIP();
  const auto page = test::report_data_of(folder.path() / "run" / "report.html");
  const auto& plotted = page.at("series").at("unseen");
  ASSERT_EQ(plotted.size(), columns.at("unseen").size());
  for (std::size_t i = 0; i < plotted.size(); ++i) {
    EXPECT_NEAR(plotted[i].get<double>(), columns.at("unseen")[i], 1e-4);
  }
}

// The report has the images of all, each where its camera was.
TEST(RunsOfSeveralCameras, AreAllInTheReport) {
  PALPATE_PAGES_OR_SKIP();
  const TemporaryFolder folder;
  ASSERT_TRUE(record(folder.path() / "run", test::path_settings(kRate)));
  const auto page = test::report_data_of(folder.path() / "run" / "report.html");
  const auto& moment = page.at("moment");
  Walls walls;
  const auto streams = walls.sources().infos();
  ASSERT_EQ(moment.at("cameras").size(), 3u);
  for (std::size_t k = 0; k < 3; ++k) {
    const auto& camera = moment.at("cameras")[k];
    EXPECT_EQ(camera.at("name"), streams[k].name);
    EXPECT_EQ(camera.at("width"), streams[k].width);
  }
  const auto expect_at = [&](std::size_t k, const Pose& X_WC, double tolerance) {
    for (std::size_t i = 0; i < 7; ++i) {
      EXPECT_NEAR(moment.at("cameras")[k].at("X_WC")[i], seven_numbers(X_WC)[i], tolerance) << k;
    }
  };
  expect_at(0, beside_wall(0.5), 1e-8);
  expect_at(1, beside_wall(-0.4), 1e-8);
  expect_at(2, orbit(moment.at("time_s")), 0.1);  // the newest image is of a moment before
}

// A lost frame of one camera ends the part of the run that can be repeated, with a note.
TEST(RunsOfSeveralCameras, MissAFrame) {
  const TemporaryFolder folder;
  ASSERT_TRUE(record(folder.path() / "run", test::path_settings(kRate)));
  auto messages = test::messages(folder.path() / "run");
  const auto is_lost = [](const auto& message) {
    if (message.channel.topic != kFrameTopic) return false;
    const auto frame = read_frame(message.data);
    return frame && frame->camera == 1 && frame->camera_frame == 7;
  };
  const auto lost = std::find_if(messages.begin(), messages.end(), is_lost);
  ASSERT_NE(lost, messages.end());
  messages.erase(lost);
  test::rewrite(folder.path() / "run", messages);
  const auto replay = replay_run(folder.path() / "run");
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_NE(replay->note.find("a depth frame after it was not recorded"), std::string::npos)
      << replay->note;
}

// Otherwise such an image would give no force, by other settings too.
TEST(RunsOfSeveralCameras, WithFramesThatCannotBeAreRefused) {
  const TemporaryFolder folder;
  ASSERT_TRUE(record(folder.path() / "run", test::path_settings(kRate)));
  const auto good = test::messages(folder.path() / "run");
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const auto expect = [&](auto spoil, const char* words) {
    auto messages = good;
    for (auto& message : messages) {
      if (message.channel.topic != kFrameTopic) continue;
      FrameRecord frame = read_frame(message.data).value();
      spoil(frame);
      message.data = frame_message(frame);
      break;
    }
    test::rewrite(folder.path() / "run", messages);
    const auto replay = replay_run(folder.path() / "run");
    ASSERT_FALSE(replay) << words;
    EXPECT_NE(replay.error().message.find(words), std::string::npos) << replay.error().message;
    const auto other = retry_run(folder.path() / "run", folder.path() / "other",
                                 [](RunSettings&) { return Done{}; });
    ASSERT_FALSE(other) << words;
    EXPECT_NE(other.error().message.find(words), std::string::npos) << other.error().message;
  };
  for (const double unit : {0.0, -0.001, 1e300, kNone}) {
    expect([&](FrameRecord& frame) { frame.unit = unit; }, "has a unit that is no length");
  }
  expect([&](FrameRecord& frame) { frame.X_WC.translation.x = kNone; }, "is nowhere");
  expect([&](FrameRecord& frame) { frame.X_WC.rotation = {0, 0, 0, 0}; }, "is nowhere");
}

TEST(RunsOfSeveralCameras, AreTriedWithOtherSettings) {
  const TemporaryFolder folder;
  const auto outcome = record(folder.path() / "run", test::path_settings(kRate));
  ASSERT_TRUE(outcome);
  const auto same =
      retry_run(folder.path() / "run", folder.path() / "same", [](RunSettings&) { return Done{}; });
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_EQ(same->run.loop.num_frames, outcome->loop.num_frames);
  EXPECT_LT(same->forces.max, 1e-9);
  const auto other =
      retry_run(folder.path() / "run", folder.path() / "other", [](RunSettings& settings) {
        settings.binning = 2;
        return Done{};
      });
  ASSERT_TRUE(other) << other.error().message;
  EXPECT_GT(other->forces.max, 1e-6);
  EXPECT_LT(other->forces.max, 0.1 * other->forces.peak_before);
}

}  // namespace
}  // namespace palpate
