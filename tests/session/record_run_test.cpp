#include "palpate/session/record_run.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "palpate/io/atomic_file.h"
#include "palpate/session/recording.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::SyntheticStream;

const PoseFunction kPath = [](std::size_t, double time) { return test::pressing_pose(time); };

class RecordRun : public ::testing::Test {
 protected:
  fs::path run() const { return folder_.path() / "run"; }
  fs::path recording() const { return run() / "recording"; }

  Result<RunOutcome> record(const fs::path& name, int num_threads = 1) {
    SyntheticStream stream(5);
    RunSettings settings;
    settings.num_threads = num_threads;
    settings.contact.method = InsideMethod::graph;
    settings.contact.inside = InsideVolume::cap;
    settings.contact.volumes = SphereVolumes::represented;
    settings.contact.edges = Edges::cut;
    settings.contact.continuity = Continuity::both;
    settings.surface.normals.radius = 2;
    settings.time.mode = TimeMode::predict;
    settings.time.average = {DepthAverage::moving, 5, 0.5, 0.02, 4};
    return record_run(tool_, stream, kPath, settings, name);
  }

  static std::string read(const fs::path& path) { return read_file(path).value(); }
  static void write(const fs::path& path, const std::string& text) {
    ASSERT_TRUE(write_file_atomically(path, text));
  }

  test::TemporaryFolder folder_;
  Tool tool_ = test::small_tool();
};

TEST_F(RecordRun, WritesEverythingAndReplaysIdentically) {
  const auto outcome = record(run());
  ASSERT_TRUE(outcome) << outcome.error().message;
  for (const char* file : {"wrench.csv", "timing.csv", "summary.json", "report.html",
                           "recording/recording.json", "recording/tool.palp", "recording/path.txt",
                           "recording/depth.txt", "recording/depth/000004.png"}) {
    EXPECT_TRUE(fs::is_regular_file(run() / file)) << file;
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), {}), 1);
  EXPECT_EQ(outcome->warning, "");
  const std::string csv = read(run() / "wrench.csv");
  EXPECT_EQ(csv.substr(0, csv.find('\n')),
            "t,tx,ty,tz,qx,qy,qz,qw,volume,fraction,fx,fy,fz,mx,my,mz,boundary_spheres,"
            "inside_spheres,points,frame,status");
  EXPECT_EQ(static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n')),
            outcome->log.ticks.size() + 1);
  const auto summary = nlohmann::json::parse(read(run() / "summary.json"));
  EXPECT_EQ(summary.at("ticks"), outcome->log.ticks.size());
  EXPECT_EQ(summary.at("frames"), 5);
  EXPECT_EQ(summary.at("interrupted"), false);
  EXPECT_GT(summary.at("peak").at("volume").get<double>(), 0);

  ReplayOptions options;
  options.output = folder_.path() / "again";
  options.num_threads = 2;
  const auto replay = replay_run(run(), options);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_EQ(replay->num_ticks, outcome->log.ticks.size());
  EXPECT_EQ(read(*options.output / "wrench.csv"), csv);
  const auto third = replay_run(*options.output, {});
  ASSERT_TRUE(third) << third.error().message;
  EXPECT_EQ(third->difference, "");
}

TEST_F(RecordRun, InterruptedRunIsWholeAndReplays) {
  SyntheticStream stream(5);
  const auto outcome = record_run(tool_, stream, kPath, {}, run(),
                                  [](const TickRecord& tick) { return tick.time < 0.05; });
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_TRUE(outcome->log.interrupted);
  EXPECT_EQ(nlohmann::json::parse(read(run() / "summary.json")).at("interrupted"), true);
  const auto replay = replay_run(run(), {});
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
}

TEST_F(RecordRun, ReplayNamesTheFirstLineThatDiffers) {
  ASSERT_TRUE(record(run()));
  std::string csv = read(run() / "wrench.csv");
  const std::size_t line = csv.find("\n0.002,") + 1;
  csv[csv.find(',', line) + 1] ^= 1;
  write(run() / "wrench.csv", csv);
  const auto replay = replay_run(run(), {});
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference.substr(0, 7), "line 4:") << replay->difference;
  write(run() / "wrench.csv", csv.substr(0, 200));
  EXPECT_NE(replay_run(run(), {})->difference, "");
}

TEST_F(RecordRun, DamagedRecordingsAreErrors) {
  ASSERT_TRUE(record(run()));
  const std::string manifest = read(recording() / "recording.json");
  const auto message = [&] {
    const auto replay = replay_run(run(), {});
    return replay ? std::string("no error") : replay.error().message;
  };
  for (const char* file : {"tool.palp", "path.txt", "depth.txt", "depth/000002.png"}) {
    const std::string good = read(recording() / file);
    std::string bad = good;
    bad[bad.size() / 2] ^= 1;
    write(recording() / file, bad);
    EXPECT_NE(message().find(file), std::string::npos) << message();
    fs::remove(recording() / file);
    EXPECT_NE(message().find(file), std::string::npos) << message();
    write(recording() / file, good);
  }
  const auto replace = [&](const std::string& from, const std::string& to) {
    std::string text = manifest;
    text.replace(text.find(from), from.size(), to);
    write(recording() / "recording.json", text);
  };
  for (const auto& [from, to] : std::initializer_list<std::pair<const char*, const char*>>{
           {"\"version\": 1", "\"version\": 99"},
           {"palpate recording", "something else"},
           {"\"graph\"", "\"granite\""},
           {"\"contact_rate\": 1000.0", "\"contact_rate\": \"fast\""},
           {"\"contact_rate\": 1000.0", "\"contact_rate\": -1.0"},
           {"\"files\"", "\"piles\""},
           {"\"tool.palp\"", "\"path.txt\""},
           {"{", "["}}) {
    replace(from, to);
    EXPECT_NE(message(), "no error") << from;
  }
  write(recording() / "recording.json", manifest);
  EXPECT_EQ(message(), "no error");
}

TEST_F(RecordRun, OtherJsonIsNamedInPlainWords) {
  ASSERT_TRUE(record(run()));
  for (const auto& [text, words] : std::initializer_list<std::pair<const char*, const char*>>{
           {"{}", "it has no \"format\""}, {"x", "it is not JSON"}}) {
    write(recording() / "recording.json", text);
    const auto replay = replay_run(run(), {});
    ASSERT_FALSE(replay);
    const std::string& message = replay.error().message;
    EXPECT_NE(message.find("recording.json is not a recording of palpate"), std::string::npos);
    EXPECT_NE(message.find(words), std::string::npos) << message;
    EXPECT_EQ(message.find("exception"), std::string::npos) << message;
  }
}

TEST_F(RecordRun, WarnsOfFramesWithoutASurface) {
  SyntheticStream stream(5);
  RunSettings settings;
  settings.surface.max_depth = 0.2;  // nearer than everything
  const auto outcome = record_run(tool_, stream, kPath, settings, run());
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->warning.substr(0, 51), "0 of 6912 pixels are usable (0.1 to 0.2 m, with a s");
  EXPECT_EQ(nlohmann::json::parse(read(run() / "summary.json")).at("warning"), outcome->warning);
}

TEST_F(RecordRun, NothingIsLeftBehindByAFault) {
  SyntheticStream stream(6);
  stream.fail_at = 3;
  const auto outcome = record_run(tool_, stream, kPath, {}, run());
  ASSERT_FALSE(outcome);
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

TEST_F(RecordRun, ReplacesAnEarlierRunOnly) {
  ASSERT_TRUE(record(run()));
  const std::string first = read(run() / "wrench.csv");
  ASSERT_TRUE(record(run(), 2));
  EXPECT_EQ(read(run() / "wrench.csv"), first);
  const fs::path other = folder_.path() / "other";
  fs::create_directory(other);
  ASSERT_TRUE(record(other));
  fs::remove_all(other);
  fs::create_directory(other);
  write(other / "precious.txt", "data");
  EXPECT_FALSE(record(other));
  EXPECT_EQ(read(other / "precious.txt"), "data");
}

TEST_F(RecordRun, SettingsSurviveTheRecording) {
  ASSERT_TRUE(record(run()));
  const auto recording = load_recording(run() / "recording");
  ASSERT_TRUE(recording) << recording.error().message;
  EXPECT_EQ(recording->settings.contact.method, InsideMethod::graph);
  EXPECT_EQ(recording->settings.contact.inside, InsideVolume::cap);
  EXPECT_EQ(recording->settings.contact.volumes, SphereVolumes::represented);
  EXPECT_EQ(recording->settings.contact.edges, Edges::cut);
  EXPECT_EQ(recording->settings.contact.continuity, Continuity::both);
  EXPECT_EQ(recording->settings.surface.normals.radius, 2);
  const TimeOptions& time = recording->settings.time;
  EXPECT_EQ(time.mode, TimeMode::predict);
  EXPECT_EQ(time.average.kind, DepthAverage::moving);
  EXPECT_EQ(time.average.frames, 5);
  EXPECT_EQ(time.average.weight, 0.5);
  EXPECT_EQ(time.average.max_jump, 0.02);
  EXPECT_EQ(time.average.keep_frames, 4);
  EXPECT_EQ(recording->frames->info().intrinsics, SyntheticStream(1).info().intrinsics);
  EXPECT_EQ(recording->frames->info().unit, 0.0005);
  for (std::size_t k = 0; k < recording->poses.size(); ++k) {
    EXPECT_EQ(recording->poses[k], test::pressing_pose(static_cast<double>(k) / 1000)) << k;
  }
}

}  // namespace
}  // namespace palpate
