// Pose and wrench in frames of the user's and about other points: against the power of a motion,
// which is the same in all of them, and against poses written down by hand.
#include <gtest/gtest.h>

#include "palpate/session/run.h"
#include "src/run/internal/reported_output.h"
#include "src/session/report/run_results.h"
#include "tests/session/path_run.h"
#include "tests/session/wrench_csv.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/posed_wall.h"
#include "tests/test_util/random.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::beside_wall;
using test::PosedWall;
using test::TemporaryFolder;

Vec3d random_vector(test::Random& random) {
  return {random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)};
}
Pose random_pose(test::Random& random) { return {random_vector(random), random.rotation(3)}; }

template <class Any>
double power(const Any& F, const Vec3d& v, const Vec3d& w) {
  return dot(F.force, v) + dot(F.torque, w);
}

TEST(ReportedOutput, GivesThePowerOfEveryMotion) {
  test::Random random(5);
  const WrenchFrame frames[] = {WrenchFrame::world, WrenchFrame::camera, WrenchFrame::tool,
                                WrenchFrame::device, WrenchFrame::named};
  const WrenchPoint points[] = {WrenchPoint::center_of_mass, WrenchPoint::tcp, WrenchPoint::origin};
  for (const WrenchFrame frame : frames) {
    for (const WrenchPoint point : points) {
      SCOPED_TRACE(name_of(frame) + " " + name_of(point));
      OutputOptions options{frame, point, random_pose(random), random_pose(random)};
      const OutputFrames at{random_pose(random), random_vector(random), random_pose(random),
                            random_pose(random)};
      const Pose X_WE = at.X_WT * options.X_TE;
      const Pose X_WF = frame == WrenchFrame::world    ? Pose{}
                        : frame == WrenchFrame::camera ? at.X_WCamera
                        : frame == WrenchFrame::tool   ? X_WE
                        : frame == WrenchFrame::device ? at.X_WB
                                                       : options.X_WN;
      const Vec3d about_W = point == WrenchPoint::center_of_mass ? at.p_WC
                            : point == WrenchPoint::tcp          ? X_WE.translation
                                                                 : X_WF.translation;
      const ReportedOutput reported(options, at);
      const Wrench F_C_W{random_vector(random), random_vector(random)};
      const Wrench F_F = reported.wrench(F_C_W);
      // Six motions, which together leave no number of the wrench unseen.
      for (int i = 0; i < 6; ++i) {
        const Vec3d v0 = random_vector(random), w = random_vector(random);
        const auto velocity_of = [&](const Vec3d& p_W) { return v0 + cross(w, p_W); };
        const Mat3d R = rotation_matrix(conjugate(X_WF.rotation));
        EXPECT_NEAR(power(F_C_W, velocity_of(at.p_WC), w),
                    power(F_F, R * velocity_of(about_W), R * w), 1e-12);
      }
      EXPECT_NEAR(
          norm(X_WF * (reported.pose() * Vec3d{0.1, 0.2, 0.3}) - X_WE * Vec3d{0.1, 0.2, 0.3}), 0,
          1e-12);
    }
  }
  // As before where nobody says otherwise: not a bit is changed.
  const OutputFrames at{{}, {1, 2, 3}, {}, {}};
  const Wrench F{{1, 2, 3}, {4, 5, 6}}, same = ReportedOutput({}, at).wrench(F);
  EXPECT_EQ(F.force, same.force);
  EXPECT_EQ(F.torque, same.torque);
}

constexpr double kRate = 200, kFrames = 20;  // 1/s

Pose orbit(double time) { return beside_wall(0.3 * std::sin(2 * time)); }
Pose pressing(double time) {
  return {{0.01 * time, 0.005, 0.47 + 0.03 * std::sin(3 * time)},
          axis_angle({1, 2, 3}, 0.3 * time)};
}

std::map<std::string, std::vector<double>> recorded(const OutputOptions& output, double keep) {
  static const Tool tool = test::random_tool(200, 0.03, 7);
  const TemporaryFolder folder;
  PosedWall wall{orbit, kFrames, 0.5, int(kFrames * 2.5)};
  auto device = test::path_device(pressing, kRate);
  RunSettings settings = test::path_settings(kRate);
  settings.output = output;
  RunOptions options;
  options.recording.keep_seconds = keep;
  const auto run =
      record_run(tool, DepthSources({&wall}), **device, settings, folder.path() / "run", options);
  EXPECT_TRUE(run) << run.error().message;
  EXPECT_EQ(run->not_kept, "");
  return test::columns_of(folder.path() / "run" / "wrench.csv");
}

TEST(ReportedOutput, OfACameraThatMovesIsInRowsOfItsOwn) {
  OutputOptions output;
  EXPECT_FALSE(recorded(output, 1e9).contains("reported_x_m"));
  output.wrench_frame = WrenchFrame::camera;
  output.wrench_point = WrenchPoint::tcp;
  output.X_TE = {{0, 0, 0.1}, axis_angle({0, 1, 0}, 0.5)};
  for (const double keep : {1e9, 1.0}) {  // s; less than all is written when the run has ended
    SCOPED_TRACE(keep);
    auto csv = recorded(output, keep);
    std::size_t num_touched = 0;
    for (std::size_t i = 0; i < csv["time_s"].size(); ++i) {
      const double time = csv["time_s"][i];
      const Pose X_WC = orbit(csv["frame"][i] / kFrames);
      const Pose X_CE = inverse(X_WC) * pressing(time) * output.X_TE;
      const Vec3d reported{csv["reported_x_m"][i], csv["reported_y_m"][i], csv["reported_z_m"][i]};
      ASSERT_NEAR(norm(reported - X_CE.translation), 0, 1e-9) << "row " << i;
      const Vec3d force{csv["force_x_N"][i], csv["force_y_N"][i], csv["force_z_N"][i]};
      const Vec3d turned{csv["reported_force_x_N"][i], csv["reported_force_y_N"][i],
                         csv["reported_force_z_N"][i]};
      ASSERT_NEAR(norm(rotate(X_WC.rotation, turned) - force), 0, 1e-9 * (1 + norm(force)));
      num_touched += norm(force) > 0;
    }
    EXPECT_GT(num_touched, 50u);
  }
}

// A disk may be slow: images are kept long before the ticks that rest on them are written.
TEST(ReportedOutput, OfACameraThatMovesComesLongAfterItsImages) {
  const Tool tool = test::random_tool(200, 0.03, 7);
  const TemporaryFolder folder;
  constexpr int kLate = 100;
  RunSetup setup;
  setup.streams.resize(1);
  setup.settings.output.wrench_frame = WrenchFrame::camera;
  {
    RunResults results(folder.path(), tool, setup);
    for (int k = 0; k < kLate; ++k) {
      FrameRecord frame;
      frame.number = static_cast<std::uint64_t>(k) + 1;
      frame.X_WC = orbit(k / kFrames);
      results.add_frame(frame, DepthFrame{});
    }
    for (int k = 0; k < kLate; ++k) {
      TickRecord tick;
      tick.frame_number = static_cast<std::uint64_t>(k) + 1;
      results.add_tick(tick);
    }
  }
  auto csv = test::columns_of(folder.path() / "wrench.csv.part");
  ASSERT_EQ(csv["reported_x_m"].size(), std::size_t{kLate});
  for (int k = 0; k < kLate; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const Vec3d reported{csv["reported_x_m"][i], csv["reported_y_m"][i], csv["reported_z_m"][i]};
    EXPECT_NEAR(norm(reported - inverse(orbit(k / kFrames)).translation), 0, 1e-9) << k;
  }
}

}  // namespace
}  // namespace palpate
