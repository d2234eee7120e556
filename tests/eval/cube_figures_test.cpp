// The recorded cube by a tracked camera: poses as a run has them, and what the figure says of them.
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "eval/figures/cube_figures.h"
#include "eval/studies/real_cube.h"
#include "palpate/cameras/cameras.h"
#include "tests/test_util/data.h"

namespace palpate::eval {
namespace {

Settings quick_with(const std::filesystem::path& data) {
  Settings settings;
  settings.quick = true;
  settings.data = data;
  return settings;
}

TEST(CubeFigures, TrackedSaysWhatIsSkipped) {
  Context context(quick_with(""));
  const FigureResult result = tracked_cube_figure(context).value();
  EXPECT_EQ(result.claims.size(), 5u);
  for (const Claim& claim : result.claims) {
    EXPECT_EQ(claim.verdict, Verdict::not_measured);
    EXPECT_NE(claim.measured.find("SKIPPED cube-tracked"), std::string::npos) << claim.measured;
  }
}

TEST(CubeFigures, PosesAreThoseOfACameraWithAFileOfPoses) {
  PALPATE_DATA_OR_SKIP(recording, "sequences/visp_rbt");
  const auto data = recording.parent_path().parent_path();
  Context context(quick_with(data));
  const auto cube = real_cube(context, 1);
  ASSERT_TRUE(cube) << cube.error().message;
  ASSERT_TRUE(cube->has_value());
  const auto camera = open_camera("folder:" + (data / "sequences/visp_rbt/depth").string() +
                                  "?intrinsics=607.1785,607.2343,321.3913,241.9182&rate=30&poses=" +
                                  (data / "trajectories/visp_rbt_camera_in_grid_tum.txt").string());
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ((*cube)->frames.size(), 99u);
  for (const CubeFrame& f : (*cube)->frames) {
    DepthFrame frame;
    ASSERT_TRUE((*camera)->next(frame).value());
    const Vec3d p{1, 2, 3};
    EXPECT_LT(norm(f.frame.X_WC * p - frame.X_WC * p), 1e-12);
    EXPECT_EQ(f.frame.pixels, frame.pixels);
    // The cube is where the tracking has it, moved back: every frame says the same place.
    const Pose X_WB = f.frame.X_WC * f.X_CB * f.tracked_shift;
    EXPECT_LT(norm(X_WB.translation - (*cube)->X_WB.translation), 1e-12);
    EXPECT_LT(norm(X_WB * p - (*cube)->X_WB * p), 1e-12);
  }
}

TEST(CubeFigures, TrackedByFixedTools) {
  PALPATE_DATA_OR_SKIP(recording, "sequences/visp_rbt");
  const auto data = recording.parent_path().parent_path();
  Context context(quick_with(data));
  const auto made = [&] { return tracked_cube_figure(context).value(); };
  const FigureResult result = made(), again = made();
  std::map<std::string, double> all, repeated;
  for (const Number& n : result.numbers) all[n.key] = n.value;
  for (const Number& n : again.numbers) repeated[n.key] = n.value;
  EXPECT_EQ(all, repeated);
  // The tracking error shows in the error against the cube's true pose, and not in the others.
  for (const char* key :
       {"shown.volume.", "registered.volume.", "refined.volume.", "refined_memory.volume."}) {
    EXPECT_LT(all.at(std::string(key) + "median"), 1) << key;
    EXPECT_LT(all.at(std::string(key) + "p95"), all.at("tracked.volume.p95") / 5) << key;
  }
  EXPECT_LT(all.at("shown.direction.median"), 6);
  EXPECT_GT(all.at("explained"), 90);
  EXPECT_LT(all.at("explained"), 100);
  EXPECT_LT(all.at("registered.force_jump"), all.at("tracked.force_jump") / 5);
  EXPECT_NEAR(all.at("tracked.force_jump"), all.at("exact.force_jump"),
              0.25 * all.at("exact.force_jump"));
  EXPECT_EQ(all.at("shown.torque_jump"), all.at("tracked.torque_jump"));
  EXPECT_GT(all.at("pose.moved.median"), 1);
  EXPECT_LT(all.at("pose.moved.most"), 100);
  // Depth alone says where the camera was, much better than the tags do.
  EXPECT_LT(all.at("refined.moved.median"), all.at("pose.moved.median") / 5);
  EXPECT_LT(all.at("refined.moved.most"), all.at("pose.moved.most") / 3);
  EXPECT_LT(all.at("refined.force_jump"), all.at("tracked.force_jump") / 5);
  // A memory does not correct poses, and takes nothing away where the camera looks.
  EXPECT_GT(all.at("tracked_memory.volume.p95"), all.at("tracked.volume.p95") / 2);
}

}  // namespace
}  // namespace palpate::eval
