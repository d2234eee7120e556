// A recording of several cameras, of which one moves, looked at anywhere.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "palpate/session/run.h"
#include "palpate/viewer/viewer.h"
#include "src/viewer/sources/repetition.h"
#include "tests/session/path_run.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/posed_wall.h"
#include "tests/test_util/temporary_folder.h"
#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

using test::beside_wall;
using test::PosedWall;

constexpr double kRate = 200;  // of ticks, 1/s

Pose pressing(double time) {
  return {{0.01 * time, 0.005, 0.47 + 0.03 * std::sin(3 * time)},
          axis_angle({1, 2, 3}, 0.3 * time)};
}

TEST(RepetitionOfSeveralCameras, GivesTheSameBitsFromAnywhere) {
  const test::TemporaryFolder folder;
  const Tool tool = test::random_tool(200, 0.03, 7);
  PosedWall still([](double) { return beside_wall(0.5); }, 12, 0.5, 36);
  PosedWall moving([](double time) { return beside_wall(0.3 * std::sin(2 * time)); }, 30, 0.5, 90);
  auto device = test::path_device(pressing, kRate);
  std::vector<ContactRecord> contacts;
  RunMonitor monitor;
  monitor.observer.on_contact = [&](const ContactRecord& contact) { contacts.push_back(contact); };
  RunOptions options;
  options.monitor = &monitor;
  ASSERT_TRUE(record_run(tool, DepthSources({&still, &moving}), **device,
                         test::path_settings(kRate), folder.path() / "run", options));
  auto run = open_recorded_run(folder.path() / "run");
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_EQ((*run)->streams().size(), 2u);
  Repetition repetition(**run);
  int num_with_force = 0;
  // Forwards, near and far, and back.
  for (const std::size_t number : {0u, 70u, 71u, 72u, 90u, 400u, 401u, 50u, 500u, 499u}) {
    const ContactRecord& recorded = contacts[number];
    const auto query = (*run)->query_at(recorded.time + 1e-4);
    ASSERT_TRUE(query) << query.error().message;
    const auto there = repetition.go_to(*query, (*run)->settings(0), [] { return true; });
    ASSERT_TRUE(there) << there.error().message;
    ASSERT_TRUE(*there);
    const Penetration& repeated = repetition.measure();
    EXPECT_EQ(repeated.volume, recorded.penetration.volume) << number;
    EXPECT_EQ(repeated.potential, recorded.penetration.potential) << number;
    EXPECT_EQ(repeated.measure_W.force, recorded.penetration.measure_W.force) << number;
    num_with_force += repeated.volume > 0;
  }
  EXPECT_GT(num_with_force, 5);
}

/// The newest frame of each camera.
void poll_frames(ViewSource& view, std::vector<std::shared_ptr<const ViewFrame>>& frames) {
  const ViewUpdate update = view.poll({.frames = true});
  std::vector<bool> has_one(frames.size());
  for (const auto& frame : update.frames) {
    ASSERT_LT(frame->camera, frames.size());
    EXPECT_FALSE(has_one[frame->camera]) << "two of one camera at once";
    has_one[frame->camera] = true;
    frames[frame->camera] = frame;
  }
}

TEST(ViewsOfSeveralCameras, ShowEachCamerasFramesWhereItWasLiveAndFromTheRecording) {
  const test::TemporaryFolder folder;
  const Tool tool = test::random_tool(20, 0.03, 7);
  const auto still_pose = [](double) { return beside_wall(0.5); };
  const auto moving_pose = [](double time) { return beside_wall(0.3 * std::sin(2 * time)); };
  PosedWall still(still_pose, 12, 0.5, 36), moving(moving_pose, 30, 0.5, 90);
  const DepthSources sources({&still, &moving});
  const auto live = LiveView::create(tool, sources.infos(), "two cameras");
  ASSERT_EQ(live->content().streams.size(), 2u);
  auto device = test::path_device(pressing, kRate);
  RunOptions options;
  options.monitor = &live->monitor();
  options.clock.keeps_pace = true;
  std::optional<Result<RunOutcome>> outcome;
  std::thread run_thread([&] {
    outcome = record_run(tool, sources, **device, test::path_settings(kRate), folder.path() / "run",
                         options);
  });
  std::vector<std::shared_ptr<const ViewFrame>> seen(2);
  EXPECT_TRUE(test::wait_for([&] {
    poll_frames(*live, seen);
    return seen[0] && seen[1] && seen[0]->frame.timestamp > 0.5 && seen[1]->frame.timestamp > 0.5;
  }));
  EXPECT_EQ(seen[0]->frame.X_WC, still_pose(0));
  EXPECT_EQ(seen[1]->frame.X_WC, moving_pose(seen[1]->frame.timestamp));
  run_thread.join();
  ASSERT_TRUE(*outcome) << outcome->error().message;

  const auto played = view_run(folder.path() / "run");
  ASSERT_TRUE(played) << played.error().message;
  ASSERT_EQ((*played)->content().streams.size(), 2u);
  EXPECT_TRUE((*played)->content().streams[1].is_moving);
  auto run = open_recorded_run(folder.path() / "run");
  ASSERT_TRUE(run) << run.error().message;
  ASSERT_TRUE((*played)->command(R"({"command": "pause"})"));
  for (const double time : {0.31, 1.785, 0.91}) {
    const auto query = (*run)->query_at(time);
    ASSERT_TRUE(query) << query.error().message;
    const std::string seek = R"({"command": "seek", "time": )" + std::to_string(time) + "}";
    ASSERT_TRUE((*played)->command(seek));
    // The newest image of a camera at a time is known from its rate.
    EXPECT_TRUE(test::wait_for([&] {
      poll_frames(**played, seen);
      return seen[0] && seen[1] &&
             std::abs(seen[0]->frame.timestamp - std::floor(12 * time) / 12) < 1e-6 &&
             std::abs(seen[1]->frame.timestamp - std::floor(30 * time) / 30) < 1e-6;
    })) << time;
    EXPECT_EQ(seen[0]->frame.X_WC, still_pose(0));
    EXPECT_EQ(seen[1]->frame.X_WC, moving_pose(seen[1]->frame.timestamp));
  }
}

}  // namespace
}  // namespace palpate
