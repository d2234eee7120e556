// Runs with rigid objects beside the depth frames.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "palpate/io/atomic_file.h"
#include "palpate/session/record_run.h"
#include "palpate/session/recording.h"
#include "palpate/session/report.h"
#include "src/session/run_files.h"
#include "tests/session/synthetic_stream.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::SyntheticStream;

const PoseFunction kPath = [](std::size_t, double time) { return test::pressing_pose(time); };

class Objects : public ::testing::Test {
 protected:
  Objects() {
    const auto shape = std::make_shared<const Tool>(test::random_tool(150, 0.04, 9));
    settings_.num_threads = 1;
    settings_.objects = {{shape, {{0.05, 0, 0.45}, axis_angle({0, 1, 0}, 0.3)}},
                         {shape, {{-0.045, 0.03, 0.47}, {}}}};
  }
  fs::path run() const { return folder_.path() / "run"; }
  static std::string read(const fs::path& path) { return read_file(path).value(); }
  Result<RunOutcome> record(const fs::path& name) {
    SyntheticStream stream(5);
    return record_run(tool_, stream, kPath, settings_, name);
  }

  test::TemporaryFolder folder_;
  Tool tool_ = test::small_tool();
  RunSettings settings_;
};

TEST_F(Objects, AreFeltBesideTheCloud) {
  SyntheticStream stream(5), same_stream(5);
  const auto log = run_session(tool_, stream, kPath, settings_);
  ASSERT_TRUE(log) << log.error().message;
  RunSettings without = settings_;
  without.objects.clear();
  const auto cloud_log = run_session(tool_, same_stream, kPath, without);
  ASSERT_TRUE(cloud_log) << cloud_log.error().message;
  ASSERT_EQ(log->ticks.size(), cloud_log->ticks.size());
  BodyContact contact(tool_, *settings_.objects[0].shape);
  int num_both = 0;
  for (std::size_t k = 0; k < log->ticks.size(); ++k) {
    const TickRecord& tick = log->ticks[k];
    const Penetration& cloud = cloud_log->ticks[k].penetration;
    const BodyPenetration one = contact.measure(tick.X_WT, settings_.objects[0].X_WB);
    const BodyPenetration two = contact.measure(tick.X_WT, settings_.objects[1].X_WB);
    EXPECT_EQ(tick.objects.volume, one.on_a.volume + two.on_a.volume);
    EXPECT_EQ(tick.objects.measure_W.torque, one.on_a.measure_W.torque + two.on_a.measure_W.torque);
    EXPECT_EQ(tick.object_pairs, one.num_pairs + two.num_pairs);
    EXPECT_EQ(tick.penetration.volume, cloud.volume + tick.objects.volume);
    EXPECT_EQ(tick.penetration.measure_W.force,
              cloud.measure_W.force + tick.objects.measure_W.force);
    EXPECT_EQ(tick.penetration.num_boundary_spheres, cloud.num_boundary_spheres);
    num_both += cloud.volume > 0 && one.num_pairs > 0 && two.num_pairs > 0;
  }
  EXPECT_GT(num_both, 10);
}

TEST_F(Objects, FarAwayChangeNoBit) {
  for (SceneObject& object : settings_.objects) object.X_WB.translation.x += 10;
  SyntheticStream stream(5), same_stream(5);
  const auto log = run_session(tool_, stream, kPath, settings_);
  RunSettings without = settings_;
  without.objects.clear();
  const auto cloud_log = run_session(tool_, same_stream, kPath, without);
  ASSERT_TRUE(log && cloud_log);
  RunLog disguised = *log;
  disguised.settings.objects.clear();
  EXPECT_EQ(wrench_csv(tool_, disguised), wrench_csv(tool_, *cloud_log));
}

TEST_F(Objects, TicksDoNotAllocate) {
  SyntheticStream stream(1);
  auto session = Session::create(tool_, stream.info(), settings_);
  ASSERT_TRUE(session) << session.error().message;
  DepthFrame frame;
  ASSERT_TRUE(stream.next(frame));
  session->take_frame(frame, 0);
  (void)session->tick(0, test::pressing_pose(0));
  const test::AllocationCounter counter;
  const TickRecord tick = session->tick(0.001, test::pressing_pose(0.001));
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_GT(tick.object_pairs, 0);
}

TEST_F(Objects, RunsAreRecordedAndRepeatedIdentically) {
  const auto outcome = record(run());
  ASSERT_TRUE(outcome) << outcome.error().message;
  const std::string csv = read(run() / "wrench.csv");
  EXPECT_EQ(csv.substr(0, csv.find('\n')),
            "t,tx,ty,tz,qx,qy,qz,qw,volume,fraction,fx,fy,fz,mx,my,mz,boundary_spheres,"
            "inside_spheres,points,frame,status,objects_volume,objects_fx,objects_fy,objects_fz,"
            "objects_mx,objects_my,objects_mz,object_pairs");
  EXPECT_TRUE(fs::is_regular_file(run() / "recording/object-001.palp"));
  EXPECT_EQ(nlohmann::json::parse(read(run() / "recording/recording.json")).at("version"), 2);

  const auto summary = nlohmann::json::parse(read(run() / "summary.json"));
  ASSERT_EQ(summary.at("settings").at("objects").size(), 2u);
  EXPECT_EQ(summary.at("settings").at("objects").at(0).at("spheres"), 150);
  EXPECT_EQ(summary.at("settings").at("objects").at(1).at("pose").at(2), 0.47);
  EXPECT_GT(summary.at("objects").at("peak_volume"), 0);
  EXPECT_GT(summary.at("objects").at("ticks_in_contact"), 0);
  EXPECT_NE(read(run() / "report.html").find("150 spheres, at -0.045, 0.03, 0.47 m"),
            std::string::npos);

  ReplayOptions options;
  options.output = folder_.path() / "again";
  const auto replay = replay_run(run(), options);
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  EXPECT_EQ(read(*options.output / "wrench.csv"), csv);
  const auto third = replay_run(*options.output, {});
  ASSERT_TRUE(third) << third.error().message;
  EXPECT_EQ(third->difference, "");
  // A run with objects may be replaced by the next one, with or without.
  settings_.objects.pop_back();
  EXPECT_TRUE(record(run()));
  EXPECT_FALSE(fs::exists(run() / "recording/object-001.palp"));
}

TEST_F(Objects, RecordingsWithoutThemStayReadableByOlderPrograms) {
  settings_.objects.clear();
  ASSERT_TRUE(record(run()));
  const auto manifest = nlohmann::json::parse(read(run() / "recording/recording.json"));
  EXPECT_EQ(manifest.at("version"), 1);
  EXPECT_FALSE(manifest.at("settings").contains("objects"));
  EXPECT_EQ(read(run() / "wrench.csv").find("object"), std::string::npos);
}

TEST_F(Objects, DamagedOnesAreErrors) {
  ASSERT_TRUE(record(run()));
  const auto message = [&] {
    const auto replay = replay_run(run(), {});
    return replay ? std::string("no error") : replay.error().message;
  };
  const fs::path file = run() / "recording/object-001.palp";
  const std::string good = read(file);
  std::string bad = good;
  bad[bad.size() / 2] ^= 1;
  ASSERT_TRUE(write_file_atomically(file, bad));
  EXPECT_NE(message().find("object-001.palp"), std::string::npos) << message();
  fs::remove(file);
  EXPECT_NE(message().find("object-001.palp"), std::string::npos) << message();
  ASSERT_TRUE(write_file_atomically(file, good));
  EXPECT_EQ(message(), "no error");

  const fs::path manifest = run() / "recording/recording.json";
  const std::string text = read(manifest);
  const auto good_json = nlohmann::ordered_json::parse(text);
  for (const nlohmann::ordered_json& pose :
       {nlohmann::ordered_json(nullptr), nlohmann::ordered_json({1, 2, 3}),
        nlohmann::ordered_json({1, 2, 3, 0, 0, 0, "one"})}) {
    auto json = good_json;
    json["settings"]["objects"][0]["pose"] = pose;
    ASSERT_TRUE(write_file_atomically(manifest, json.dump()));
    EXPECT_NE(message().find("not a recording"), std::string::npos) << message();
  }
  auto more = good_json;
  more["settings"]["objects"].push_back(more["settings"]["objects"][0]);
  ASSERT_TRUE(write_file_atomically(manifest, more.dump()));
  EXPECT_NE(message().find("does not list object-002.palp"), std::string::npos) << message();
}

TEST_F(Objects, WithoutShapeOrPoseAreErrors) {
  const auto code = [&] {
    const auto outcome = record(run());
    return outcome ? Errc{} : outcome.error().code;
  };
  settings_.objects[1].X_WB.translation.x = NAN;
  EXPECT_EQ(code(), Errc::invalid_argument);
  settings_.objects[1].shape = nullptr;
  EXPECT_EQ(code(), Errc::invalid_argument);
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

}  // namespace
}  // namespace palpate
