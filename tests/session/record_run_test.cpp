// Runs along a path with all that is kept of them: recorded, repeated, and tried with other
// settings.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <nlohmann/json.hpp>

#include "palpate/session/run.h"
#include "src/io/internal/atomic_file.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_reader.h"
#include "tests/session/path_run.h"
#include "tests/session/repeated_run.h"
#include "tests/session/synthetic_stream.h"
#include "tests/session/wrench_csv.h"
#include "tests/test_util/report_data.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::columns_of;
using test::path_settings;
using test::pressing_pose;
using test::SyntheticStream;

std::string read(const fs::path& path) { return read_file(path).value(); }

class RecordRun : public ::testing::Test {
 protected:
  RecordRun() {
    settings_.contact.method = MethodKind::graph;
    settings_.contact.inside = InsideVolume::cap;
    settings_.contact.volumes = SphereVolumes::represented;
    settings_.contact.edges = Edges::cut;
    settings_.surface.depth_change.enabled = true;
    settings_.contact.continuity = Continuity::both;
    settings_.surface.normals.radius = 2;
    settings_.time.mode = TimeMode::predict;
    settings_.time.average = {DepthAverage::moving, 5, 0.5, 0.02, 4};
  }
  fs::path run() const { return folder_.path() / "run"; }

  Result<RunOutcome> record(const fs::path& name, SyntheticStream stream = SyntheticStream(5),
                            RunOptions options = {}) {
    auto device = test::path_device(pressing_pose, settings_.contact_rate);
    return record_run(tool_, stream, **device, settings_, name, options);
  }

  test::TemporaryFolder folder_;
  Tool tool_ = test::small_tool();
  RunSettings settings_ = path_settings();
};

TEST_F(RecordRun, WritesEverythingAndReplaysIdentically) {
  RunOptions options;
  options.time_origin = 1000.25;
  const auto outcome = record(run(), SyntheticStream(5), options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  const bool has_pages = !report_template().empty();
  for (const char* file : {"recording.mcap", "wrench.csv", "summary.json"}) {
    EXPECT_TRUE(fs::is_regular_file(run() / file)) << file;
  }
  EXPECT_EQ(fs::is_regular_file(run() / "report.html"), has_pages);
  EXPECT_EQ(std::distance(fs::directory_iterator(run()), {}), has_pages ? 4 : 3);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), {}), 1);
  EXPECT_TRUE(is_run(run()));
  auto columns = columns_of(run() / "wrench.csv");
  const std::size_t num_ticks = outcome->loop.num_ticks;
  EXPECT_EQ(columns["time_s"].size(), num_ticks);
  EXPECT_EQ(columns["timestamp_s"][7], 1000.25 + columns["time_s"][7]);
  const double scale = 12 / (full_volume(tool_, settings_.contact) / 8);  // a sigma.7: 12 N
  double most = 0;
  for (std::size_t k = 0; k < num_ticks; ++k) {
    const Pose X_WT = pressing_pose(columns["time_s"][k]);
    EXPECT_EQ(columns["tool_z_m"][k], X_WT.translation.z);
    EXPECT_NEAR(columns["force_z_N"][k], scale * columns["measure_z_m3"][k],
                1e-12 * scale * std::abs(columns["measure_z_m3"][k]));
    most = std::max(most, columns["volume_m3"][k]);
  }
  const auto summary = nlohmann::json::parse(read(run() / "summary.json"));
  EXPECT_EQ(summary.at("ticks"), num_ticks);
  EXPECT_EQ(summary.at("frames"), 5);
  EXPECT_EQ(summary.at("fault"), "none");
  EXPECT_EQ(summary.at("ending"), "the depth frames have ended");
  EXPECT_EQ(summary.at("peaks").at("volume_m3"), most);
  EXPECT_GT(most, 0);
  EXPECT_NEAR(summary.at("newtons_per_m3").get<double>() / scale, 1, 1e-12);
  EXPECT_EQ(summary.at("settings").at("contact").at("method"), "graph");
  EXPECT_EQ(summary.at("settings").at("coupling").at("force_at_eighth"), 12);

  for (const int num_threads : {1, 2}) {
    ReplayOptions replay_options;
    replay_options.num_threads = num_threads;
    const ReplayOutcome replay = test::repeated(run(), replay_options);
    EXPECT_EQ(replay.num_ticks, num_ticks);
    EXPECT_EQ(replay.num_contacts, num_ticks);
  }
  // The same run again, byte for byte.
  const std::string csv = read(run() / "wrench.csv");
  ASSERT_TRUE(record(run(), SyntheticStream(5), options));
  EXPECT_EQ(read(run() / "wrench.csv"), csv);
}

TEST_F(RecordRun, RepeatsWithACouplingToo) {
  for (const CouplingKind kind :
       {CouplingKind::virtual_coupling, CouplingKind::direct, CouplingKind::proxy}) {
    settings_.coupling.kind = kind;
    settings_.contact = {.method = MethodKind::field};
    const auto outcome = record(run());
    ASSERT_TRUE(outcome) << outcome.error().message;
    EXPECT_EQ(outcome->failure, "");
    EXPECT_GT(outcome->peaks.volume, 0);
    const auto replay = replay_run(run());
    ASSERT_TRUE(replay) << replay.error().message;
    EXPECT_EQ(replay->difference, "");
  }
}

// A retry with other settings equals a run with them.
TEST_F(RecordRun, RetriesWithOtherSettings) {
  ASSERT_TRUE(record(run()));
  const fs::path again = folder_.path() / "again", other = folder_.path() / "other";
  const auto same = retry_run(run(), again, [](RunSettings&) -> Status { return Done{}; });
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_EQ(same->forces.max, 0);
  EXPECT_GT(same->forces.peak_before, 0);
  EXPECT_EQ(same->forces.peak_before, same->forces.peak_after);
  EXPECT_EQ(read(again / "wrench.csv"), read(run() / "wrench.csv"));

  const auto edit = [](RunSettings& settings) -> Status {
    settings.contact = {.method = MethodKind::weighted};
    settings.time.mode = TimeMode::latest;
    settings.time.average.kind = DepthAverage::none;
    return Done{};
  };
  const auto changed = retry_run(run(), again, edit);
  ASSERT_TRUE(changed) << changed.error().message;
  ASSERT_TRUE(edit(settings_));
  ASSERT_TRUE(record(other));
  EXPECT_EQ(read(again / "wrench.csv"), read(other / "wrench.csv"));
  auto before = columns_of(run() / "wrench.csv"), after = columns_of(other / "wrench.csv");
  double most = 0;
  for (std::size_t k = 0; k < before["time_s"].size(); ++k) {
    const auto force = [k](auto& columns) {
      return Vec3d{columns["force_x_N"][k], columns["force_y_N"][k], columns["force_z_N"][k]};
    };
    most = std::max(most, norm(force(after) - force(before)));
  }
  EXPECT_DOUBLE_EQ(changed->forces.max, most);
  EXPECT_GT(most, 0);
}

TEST_F(RecordRun, InterruptedRunIsWholeAndReplays) {
  RunOptions options;
  std::atomic<bool> has_begun = false;
  RunMonitor monitor;
  monitor.observer.on_ticks = [&](std::span<const TickRecord>) { has_begun = true; };
  options.monitor = &monitor;
  options.keep_going = [&] { return !has_begun; };
  options.clock.keeps_pace = true;  // so that there is something to interrupt
  const auto outcome = record(run(), SyntheticStream(60), options);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_TRUE(outcome->was_interrupted);
  EXPECT_LT(outcome->loop.num_ticks, 1900u);
  EXPECT_EQ(nlohmann::json::parse(read(run() / "summary.json")).at("interrupted"), true);
  const auto replay = replay_run(run());
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
}

TEST_F(RecordRun, DamagedRecordingsAreErrors) {
  ASSERT_TRUE(record(run()));
  const fs::path file = run() / kRecordingFile;
  const std::string good = read(file);
  int num_found = 0;
  for (std::size_t at = 100; at < good.size(); at += good.size() / 40) {
    std::string bad = good;
    bad[at] = static_cast<char>(bad[at] ^ 1);
    ASSERT_TRUE(write_file_atomically(file, bad));
    const auto replay = replay_run(run());
    // The summary at the end is not needed, and bits of its index neither.
    num_found += !replay || !replay->difference.empty() || !replay->note.empty();
  }
  EXPECT_GT(num_found, 30);
  for (const std::string& text : {std::string("x"), std::string(), good.substr(0, 200)}) {
    ASSERT_TRUE(write_file_atomically(file, text));
    EXPECT_FALSE(replay_run(run()));
    EXPECT_FALSE(is_run(run()));
  }
}

TEST_F(RecordRun, WarnsOfFramesWithoutASurface) {
  settings_.surface.max_depth = 0.2;  // nearer than everything
  const auto outcome = record(run());
  ASSERT_TRUE(outcome) << outcome.error().message;
  ASSERT_EQ(outcome->warnings.size(), 1u);
  EXPECT_EQ(outcome->warnings[0].substr(0, 51),
            "0 of 6912 pixels are usable (0.1 to 0.2 m, with a s");
}

TEST_F(RecordRun, NothingIsLeftBehindIfItCannotBegin) {
  EXPECT_FALSE(record(run(), SyntheticStream(0)));
  settings_.surface.normals.radius = 1000;
  EXPECT_FALSE(record(run()));
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

TEST_F(RecordRun, AFrameThatCannotBeReadEndsTheRun) {
  SyntheticStream stream(6);
  stream.fail_at = 3;
  const auto outcome = record(run(), stream);
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_NE(outcome->failure.find("frame 3"), std::string::npos) << outcome->failure;
  EXPECT_EQ(replay_run(run())->difference, "");
}

TEST_F(RecordRun, ReplacesAnEarlierRunOnly) {
  ASSERT_TRUE(record(run()));
  const fs::path other = folder_.path() / "other";
  fs::create_directory(other);
  ASSERT_TRUE(record(other));
  fs::remove_all(other);
  fs::create_directory(other);
  ASSERT_TRUE(write_file_atomically(other / "precious.txt", "data"));
  EXPECT_FALSE(record(other));
  EXPECT_EQ(read(other / "precious.txt"), "data");
}

TEST_F(RecordRun, SettingsFramesAndPosesSurviveTheRecording) {
  ASSERT_TRUE(record(run()));
  auto reader = RunReader::open(run() / kRecordingFile);
  ASSERT_TRUE(reader) << reader.error().message;
  const RunSetup& setup = reader->setup();
  EXPECT_EQ(setup.settings.contact.method, MethodKind::graph);
  EXPECT_EQ(setup.settings.contact.edges, Edges::cut);
  EXPECT_EQ(setup.settings.time.average.frames, 5);
  EXPECT_EQ(setup.settings.time.average.max_jump, 0.02);
  EXPECT_EQ(setup.settings.coupling.kind, CouplingKind::none);
  EXPECT_EQ(setup.streams.front().intrinsics, SyntheticStream(1).info().intrinsics);
  EXPECT_EQ(setup.device.kind, "path");
  const auto tool = reader->load_tools();
  ASSERT_TRUE(tool) << tool.error().message;
  EXPECT_EQ(tool->spheres().size(), tool_.spheres().size());
  TickRecord tick;
  for (int k = 0; *reader->next_tick(tick); ++k) {
    EXPECT_EQ(tick.device.X_BH, pressing_pose(k / 1000.0)) << k;
  }
  auto frames = RunReader::open(run() / kRecordingFile);
  SyntheticStream stream(5);
  RecordedDepth recorded;
  DepthFrame frame;
  while (*stream.next(frame)) {
    ASSERT_TRUE(*frames->next_frame(recorded));
    EXPECT_EQ(recorded.frame.pixels, frame.pixels);
    EXPECT_EQ(recorded.frame.timestamp, frame.timestamp);
    EXPECT_EQ(recorded.frame.unit, frame.unit);
  }
  EXPECT_FALSE(*frames->next_frame(recorded));
}

TEST_F(RecordRun, AFrameThatIsNotItsCamerasIsAnError) {
  ASSERT_TRUE(record(run()));
  DepthStreamInfo taller = SyntheticStream(1).info();
  taller.height += 8;
  const std::vector<DepthStreamInfo> other{taller}, none;
  for (const auto& streams : {other, none}) {
    auto reader = RunReader::open(run() / kRecordingFile);
    FrameJoiner joiner(streams);
    std::string error;
    for (auto message = reader->next(); *message && error.empty(); message = reader->next()) {
      const auto joined = joiner.take((*message)->topic, (*message)->data);
      if (!joined) error = joined.error().message;
    }
    EXPECT_NE(error.find("depth frame of a"), std::string::npos) << error;
  }
}

#if !defined(PALPATE_CUDA)
TEST_F(RecordRun, AutoSaysWhyItIsTheCpu) {
  settings_.backend = std::nullopt;
  const auto outcome = record(run());
  ASSERT_TRUE(outcome) << outcome.error().message;
  EXPECT_EQ(outcome->settings.backend, Backend::cpu);
  EXPECT_NE(outcome->why_not_cuda.find("no CUDA backend"), std::string::npos);
  settings_.backend = Backend::cuda;
  EXPECT_FALSE(record(run()));
}
#endif

}  // namespace
}  // namespace palpate
