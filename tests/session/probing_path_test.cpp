#include "palpate/session/probing_path.h"

#include <gtest/gtest.h>

#include <cmath>

#include "palpate/contact/contact_query.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

TEST(ProbingPath, StartsFreeAndReachesATenthOfTheTool) {
  const Tool tool = test::random_tool(150, 0.04, 3);
  const PointCloud cloud = test::noisy_wall(320, 240, 300, 0.7, 0, 5);
  const auto path = probing_path(cloud.view(), tool, 3.0);
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_EQ(path->front().time, 0);
  EXPECT_NEAR(path->back().time, 3.0, 1e-12);
  const auto query = make_contact_query(Backend::cpu, tool);
  ASSERT_TRUE(query) << query.error().message;
  (*query)->set_cloud(cloud.view());
  const auto fraction = [&](double time) {
    return (*query)->query(pose_at(*path, time), {}).volume / tool.sphere_mass().volume;
  };
  EXPECT_EQ(fraction(0), 0);
  EXPECT_EQ(fraction(3), 0);
  // The wall is bumpy, so the tenth is not exact.
  EXPECT_NEAR(fraction(1.25), 0.1, 0.06);
  for (std::size_t i = 1; i < path->size(); ++i) {
    EXPECT_LT(norm((*path)[i].X_WT.translation - (*path)[i - 1].X_WT.translation), 0.005);
  }
}

TEST(ProbingPath, OffCentreToolsStillMeetTheRay) {
  SpherePacking packing;
  packing.spheres = {{{0.3f, 0.2f, 0.1f}, 0.02f}};
  const auto tool =
      Tool::build(make_box({0.1, 0.1, 0.1}), packing, GapRule::absolute, "one sphere");
  ASSERT_TRUE(tool) << tool.error().message;
  const PointCloud cloud = test::noisy_wall(320, 240, 300, 0.7, 0, 5);
  const auto path = probing_path(cloud.view(), *tool, 1.0);
  ASSERT_TRUE(path) << path.error().message;
  // While it presses, the tool's centre lies on the viewing ray of the image centre.
  const Vec3d C_W = pose_at(*path, 0.42) * tool->sphere_mass().centre_of_mass;
  EXPECT_LT(std::hypot(C_W.x, C_W.y), 0.02);
  EXPECT_NEAR(C_W.z, 0.7, 0.05);
}

TEST(ProbingPath, NothingToTouchIsAnError) {
  const Tool tool = test::random_tool(20, 0.04, 3);
  const PointCloud empty(320, 240);
  EXPECT_FALSE(probing_path(empty.view(), tool, 3.0));
  const PointCloud wall = test::noisy_wall(320, 240, 300, 0.7, 0, 5);
  for (const double duration : {0.0, -1.0, double(NAN), double(INFINITY)}) {
    EXPECT_FALSE(probing_path(wall.view(), tool, duration));
  }
}

}  // namespace
}  // namespace palpate
