// Runs with rigid objects beside the depth frames.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "palpate/contact/body_contact.h"
#include "palpate/session/run.h"
#include "src/io/internal/atomic_file.h"
#include "src/run/internal/pipeline.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"
#include "tests/session/path_run.h"
#include "tests/session/synthetic_stream.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::pressing_pose;
using test::run_path;
using test::SyntheticStream;

class Objects : public ::testing::Test {
 protected:
  Objects() {
    const auto shape = std::make_shared<const Tool>(test::random_tool(150, 0.04, 9));
    settings_.objects = {{shape, {{0.05, 0, 0.45}, axis_angle({0, 1, 0}, 0.3)}},
                         {shape, {{-0.045, 0.03, 0.47}, {}}}};
  }
  fs::path run() const { return folder_.path() / "run"; }
  static std::string read(const fs::path& path) { return read_file(path).value(); }
  Result<RunOutcome> record(const fs::path& name) {
    SyntheticStream stream(5);
    auto device = test::path_device(pressing_pose, settings_.contact_rate);
    return record_run(tool_, stream, **device, settings_, name);
  }

  test::TemporaryFolder folder_;
  Tool tool_ = test::small_tool();
  RunSettings settings_ = test::path_settings();
};

TEST_F(Objects, AreFeltBesideTheCloud) {
  SyntheticStream stream(5), same_stream(5);
  const auto log = run_path(tool_, stream, pressing_pose, settings_);
  ASSERT_TRUE(log) << log.error().message;
  RunSettings without = settings_;
  without.objects.clear();
  const auto cloud_log = run_path(tool_, same_stream, pressing_pose, without);
  ASSERT_TRUE(cloud_log) << cloud_log.error().message;
  ASSERT_EQ(log->ticks.size(), cloud_log->ticks.size());
  const auto contact =
      make_body_pair_query(Place::cpu(), tool_, *settings_.objects[0].shape).value();
  int num_both = 0;
  for (std::size_t k = 0; k < log->ticks.size(); ++k) {
    const TickRecord& tick = log->ticks[k];
    const Penetration& cloud = cloud_log->ticks[k].penetration;
    const BodyPenetration one = contact->measure(tick.step.X_WT, settings_.objects[0].X_WB);
    const BodyPenetration two = contact->measure(tick.step.X_WT, settings_.objects[1].X_WB);
    EXPECT_EQ(tick.objects.volume, one.on_a.volume + two.on_a.volume);
    EXPECT_EQ(tick.objects.measure_W.torque, one.on_a.measure_W.torque + two.on_a.measure_W.torque);
    EXPECT_EQ(tick.num_object_pairs, one.num_pairs + two.num_pairs);
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
  const auto log = run_path(tool_, stream, pressing_pose, settings_);
  RunSettings without = settings_;
  without.objects.clear();
  const auto cloud_log = run_path(tool_, same_stream, pressing_pose, without);
  ASSERT_TRUE(log && cloud_log);
  ASSERT_EQ(log->ticks.size(), cloud_log->ticks.size());
  for (std::size_t k = 0; k < log->ticks.size(); ++k) {
    ASSERT_EQ(difference(log->ticks[k], cloud_log->ticks[k]), "");
  }
}

TEST_F(Objects, TicksDoNotAllocate) {
  SyntheticStream stream(1);
  auto pipeline = Pipeline::create(tool_, stream.info(), DeviceInfo{}, settings_);
  ASSERT_TRUE(pipeline) << pipeline.error().message;
  DepthFrame frame;
  ASSERT_TRUE(stream.next(frame));
  pipeline->push(frame, 0);
  pipeline->measure(pressing_pose(0), 0);
  const test::AllocationCounter counter;
  EXPECT_GT(pipeline->measure(pressing_pose(0.001), 0.001).num_object_pairs, 0);
  EXPECT_EQ(counter.count(), 0u);
}

TEST_F(Objects, RunsAreRecordedAndRepeatedIdentically) {
  const auto outcome = record(run());
  ASSERT_TRUE(outcome) << outcome.error().message;
  const auto summary = nlohmann::json::parse(read(run() / "summary.json"));
  EXPECT_GT(summary.at("peaks").at("objects_volume_m3"), 0);
  EXPECT_GT(summary.at("ticks_in_objects"), 0);
  const auto& object = summary.at("objects").at(1);
  EXPECT_EQ(object.at("spheres"), 150);
  EXPECT_EQ(object.at("position_m"), (std::vector<double>{-0.045, 0.03, 0.47}));
  const auto replay = replay_run(run());
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->difference, "");
  const auto again =
      retry_run(run(), folder_.path() / "again", [](RunSettings&) -> Status { return Done{}; });
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->forces.max, 0);
  EXPECT_EQ(read(folder_.path() / "again" / "wrench.csv"), read(run() / "wrench.csv"));
}

TEST_F(Objects, DamagedOnesAreErrors) {
  ASSERT_TRUE(record(run()));
  const fs::path file = run() / kRecordingFile;
  std::string bytes = read(file);
  const std::size_t at = bytes.find("object-001.palp");
  ASSERT_NE(at, std::string::npos);
  bytes[at + 500] = static_cast<char>(bytes[at + 500] ^ 1);
  ASSERT_TRUE(write_file_atomically(file, bytes));
  const auto replay = replay_run(run());
  ASSERT_FALSE(replay);
  EXPECT_NE(replay.error().message.find("object-001.palp"), std::string::npos)
      << replay.error().message;
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
