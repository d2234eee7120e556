#include "src/session/internal/probing_path.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <utility>

#include "palpate/math/geometry.h"
#include "src/session/probing/coarse_depth.h"
#include "tests/session/function_stream.h"
#include "tests/session/packed_tool.h"
#include "tests/session/path_run.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

using test::copies_of;
using test::every;
using test::FunctionStream;
using Scene = test::DepthFunction;

double still_wall(double, int, int) { return 0.7; }

/// A wall that comes and goes by 3 cm in two seconds, as fast as the tool can follow while it
/// slides and turns; every fifth frame shows nothing.
double swinging_depth(double time) { return 0.75 - 0.015 * std::sin(kPi * time); }
double swinging_wall(double time, int, int) {
  return std::lround(time / 0.04) % 5 == 3 ? 0 : swinging_depth(time);
}

/// Share of the tool's volume behind a wall across the viewing direction: the sum of caps.
double share_behind(const Tool& tool, const Pose& X_WT, double wall) {
  double behind = 0;
  for (std::size_t i = 0; i < tool.spheres().size(); ++i) {
    const Sphere& s = tool.spheres()[i];
    const double radius = s.radius, z = (X_WT * to_double(s.center)).z;
    behind += static_cast<double>(tool.represented_volumes()[i]) * cap_volume(radius, wall - z) /
              sphere_volume(radius);
  }
  return behind / tool.mesh_mass().volume;
}

TEST(ProbingPath, StartsFreeReachesATenthAndLeaves) {
  const Tool tool = test::random_tool(150, 0.04, 3);
  FunctionStream stream(still_wall, every(0.04, 100)), again(still_wall, every(0.04, 100));
  const auto path = probing_path(copies_of(stream), tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_EQ(path->choice.note, "");
  EXPECT_EQ(path->poses.front().time, 0);
  EXPECT_NEAR(path->poses.back().time, 4.0, 1e-12);
  const auto log = test::run_path(
      tool, again, [&](double time) { return pose_at(path->poses, time); }, test::path_settings());
  ASSERT_TRUE(log) << log.error().message;
  const auto fraction = [&](std::size_t tick) {
    return log->ticks[tick].penetration.volume / full_volume(tool, ContactOptions{});
  };
  EXPECT_EQ(fraction(0), 0);
  EXPECT_EQ(fraction(log->ticks.size() - 1), 0);
  for (std::size_t tick = 1500; tick < 2900; tick += 50) EXPECT_NEAR(fraction(tick), 0.1, 0.02);
}

TEST(ProbingPath, FollowsAMovingScene) {
  const Tool tool = test::random_tool(150, 0.04, 3);
  FunctionStream stream(swinging_wall, every(0.04, 100));
  const auto path = probing_path(copies_of(stream), tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_EQ(path->choice.note, "");
  // The wall of the frame that is current then, missing or not.
  for (const auto& [time, X_WT] : path->poses) {
    const double wall = swinging_depth(std::floor(time / 0.04 + 1e-9) * 0.04);
    const double behind = share_behind(tool, X_WT, wall);
    if (time > 0.36 * 4 && time < 0.74 * 4) {
      EXPECT_NEAR(behind, 0.1, 0.08) << time;
    }
    if (time < 0.05 * 4 || time > 0.96 * 4) {
      EXPECT_EQ(behind, 0) << time;
    }
  }
}

TEST(ProbingPath, LiftsWhereTheSceneJumps) {
  // A wall, and while the tool is pressed in, for a second another one before or behind it.
  for (const double other : {0.6, 0.9, 2.9}) {
    SCOPED_TRACE(other);
    const auto wall_at = [other](double time) { return time > 6 && time < 7 ? other : 0.7; };
    const Tool tool = test::random_tool(150, 0.02, 3);
    FunctionStream stream([&](double time, int, int) { return wall_at(time); }, every(0.04, 300));
    const auto path = probing_path(copies_of(stream), tool, std::nullopt);
    ASSERT_TRUE(path) << path.error().message;
    EXPECT_NE(path->choice.note.find("lifted"), std::string::npos) << path->choice.note;
    for (const auto& [time, X_WT] : path->poses) {
      // Pressed in before and after, never deeper than it should be, and free at the jumps.
      const double here = share_behind(tool, X_WT, wall_at(time));
      EXPECT_LT(here, 0.13) << time;
      if (std::abs(time - 4.6) < 0.1 || std::abs(time - 8.7) < 0.1) {
        EXPECT_GT(here, 0.07) << time;
      }
      for (const double jump : {6.0, 7.0}) {
        if (std::abs(time - jump) > 0.08) continue;
        EXPECT_EQ(share_behind(tool, X_WT, std::min(other, 0.7)), 0) << time;
      }
    }
  }
}

TEST(ProbingPath, PressesThroughNothingOnItsWayToWhatIsFarBehind) {
  // A hole opens for four seconds, hardly wider than the tool.
  const Scene hole = [](double time, int u, int v) {
    return std::abs(u - 120) < 16 && std::abs(v - 90) < 16 && time > 5 && time < 9 ? 2.9 : 0.7;
  };
  const Tool tool = test::random_tool(150, 0.04, 3);
  FunctionStream stream(hole, every(0.04, 300)), again(hole, every(0.04, 300));
  const auto path = probing_path(copies_of(stream), tool, std::nullopt, {.pixel = {{119.5, 89.5}}});
  ASSERT_TRUE(path) << path.error().message;
  const auto log = test::run_path(
      tool, again, [&](double time) { return pose_at(path->poses, time); }, test::path_settings());
  ASSERT_TRUE(log) << log.error().message;
  EXPECT_GT(log->ticks[4500].penetration.volume, 0.05 * tool.mesh_mass().volume);
  for (std::size_t tick = 5400; tick < 8800; tick += 20) {
    EXPECT_LT(log->ticks[tick].penetration.volume, 0.005 * tool.mesh_mass().volume) << tick;
  }
}

TEST(ProbingPath, HoldsALongToolByItsAxisAndStaysClearOfSurroundings) {
  // A rod of 24 cm along x, thin at its low end, in a pit with walls that come nearer for a while.
  SpherePacking packing;
  for (int i = 0; i < 24; ++i) {
    packing.spheres.push_back({{0.01f * static_cast<float>(i), 0, 0}, i < 6 ? 0.005f : 0.012f});
  }
  std::reverse(packing.spheres.begin(), packing.spheres.end());  // largest first
  const auto tool = Tool::build(make_box({0.24, 0.02, 0.02}), packing);
  ASSERT_TRUE(tool) << tool.error().message;
  const Scene pit = [](double time, int u, int v) {
    const bool in_pit = std::abs(u - 120) < 45 && std::abs(v - 90) < 45;
    return in_pit ? 0.7 : time > 5 ? 0.35 : 0.55;
  };
  FunctionStream stream(pit, every(0.04, 150)), again(pit, every(0.04, 150));
  const auto path = probing_path(copies_of(stream), *tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  for (const TimedPose& pose : path->poses) {
    EXPECT_GT(rotate(pose.X_WT.rotation, {-1, 0, 0}).z, 0.8);
  }
  const auto log = test::run_path(
      *tool, again, [&](double time) { return pose_at(path->poses, time); }, test::path_settings());
  ASSERT_TRUE(log) << log.error().message;
  EXPECT_EQ(log->ticks.front().penetration.volume, 0);
  EXPECT_EQ(log->ticks.back().penetration.volume, 0);
  const double peak = log->ticks[log->deepest_tick].penetration.volume / tool->sphere_mass().volume;
  EXPECT_GT(peak, 0.02);
  EXPECT_LT(peak, 0.3);
}

TEST(ProbingPath, ChoosesACalmPlace) {
  // A post sticks out of the middle of the wall, and a curtain flutters on the right.
  const Scene scene = [](double time, int u, int v) {
    if (std::abs(u - 125) < 12 && std::abs(v - 90) < 12) return 0.5;
    return u > 150 ? 0.7 + 0.1 * std::sin(40 * time + u) : 0.7;
  };
  const Tool tool = test::random_tool(50, 0.02, 3);
  FunctionStream stream(scene, every(0.04, 25));
  const auto path = probing_path(copies_of(stream), tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  const Vec3d p_W = pose_at(path->poses, 1.3) * Vec3d{};
  EXPECT_GT(p_W.z, 0.62);
  const double u = 119.5 + 220 * p_W.x / p_W.z, v = 89.5 + 220 * p_W.y / p_W.z;
  EXPECT_LT(u, 150);
  EXPECT_FALSE(std::abs(u - 125) < 12 && std::abs(v - 90) < 12) << u << " " << v;
}

TEST(ProbingPath, TakesTimeFromTheStampsOrTheCaller) {
  const Tool tool = test::random_tool(20, 0.04, 3);
  FunctionStream uneven(still_wall, {0, 0.1, 0.5, 3.0}), cut(still_wall, {0, 0.1, 0.5, 3.0});
  const auto path = probing_path(copies_of(uneven), tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_NEAR(path->poses.back().time, 3.0 + 1 / 25.0, 1e-12);
  const auto longer = probing_path(copies_of(cut), tool, 1.5);
  ASSERT_TRUE(longer) << longer.error().message;
  EXPECT_NEAR(longer->poses.back().time, 1.5, 1e-12);
}

TEST(ProbingPath, OffCenterToolsStillMeetTheRay) {
  SpherePacking packing;
  packing.spheres = {{{0.3f, 0.2f, 0.1f}, 0.02f}};
  const auto tool = Tool::build(make_box({0.1, 0.1, 0.1}), packing);
  ASSERT_TRUE(tool) << tool.error().message;
  FunctionStream stream(still_wall, every(0.04, 25));
  const auto path = probing_path(copies_of(stream), *tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  const Vec3d C_W = pose_at(path->poses, 1.3) * tool->sphere_mass().center_of_mass;
  EXPECT_LT(std::hypot(C_W.x, C_W.y), 0.05);
  EXPECT_NEAR(C_W.z, 0.7, 0.03);
}

TEST(ProbingPath, PointsTheTipOfAPenIntoTheScene) {
  const Tool tool = test::packed_tool(make_stylus(0.008, 0.12, 0.03, 24));
  FunctionStream stream(still_wall, every(0.04, 25));
  const auto path = probing_path(copies_of(stream), tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  for (const TimedPose& pose : path->poses) {
    const Vec3d back_W = rotate(pose.X_WT.rotation, {0, 0, 1});
    EXPECT_LT(back_W.z, -0.8);
    EXPECT_GT(back_W.x, 0.1);
    EXPECT_LT(back_W.y, -0.1);
  }
}

/// A wall 1 m away and, held out before it, a palm as large as a hand, left of the middle.
double palm_before_a_wall(double, int u, int v) {
  return std::abs(u - 85) < 25 && std::abs(v - 90) < 25 ? 0.5 : 1;
}

TEST(ProbingPath, MeetsAHandThatIsHeldOut) {
  const Tool tool = test::random_tool(50, 0.02, 3);
  FunctionStream stream(palm_before_a_wall, every(0.04, 25));
  const auto path = probing_path(copies_of(stream), tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_NEAR(path->choice.u, 85, 20);
  EXPECT_NEAR(path->choice.v, 90, 20);
  EXPECT_NEAR(path->choice.p_W.z, 0.5, 0.002);
  EXPECT_EQ(path->choice.note, "");
  EXPECT_NEAR((pose_at(path->poses, 1.2) * tool.sphere_mass().center_of_mass).z, 0.49, 0.04);
}

TEST(ProbingPath, KeepsToTheMiddleWhenNothingStandsOut) {
  const Tool tool = test::random_tool(50, 0.02, 3);
  FunctionStream stream(still_wall, every(0.04, 25));
  const auto path = probing_path(copies_of(stream), tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_NEAR(path->choice.u, 119.5, 6);
  EXPECT_NEAR(path->choice.v, 89.5, 6);
}

TEST(ProbingPath, AimsWherePeopleSay) {
  const Tool tool = test::random_tool(50, 0.02, 3);
  FunctionStream stream(palm_before_a_wall, every(0.04, 25));
  const Vec3d p_W{0.4, -0.2, 1};  // pixel 207.5, 45.5
  for (const ProbeAim& aim : {ProbeAim{.pixel = {{207.5, 45.5}}}, ProbeAim{.point_W = p_W}}) {
    const auto path = probing_path(copies_of(stream), tool, std::nullopt, aim);
    ASSERT_TRUE(path) << path.error().message;
    EXPECT_NEAR(path->choice.u, 207.5, 1);
    EXPECT_NEAR(path->choice.v, 45.5, 1);
    EXPECT_LT(norm(path->choice.p_W - p_W), 0.01);
    EXPECT_EQ(path->choice.why_place, "as you said");
    // Pressed in before it slides: near the place, by less than the tool's own size.
    EXPECT_LT(norm(pose_at(path->poses, 1.2) * tool.sphere_mass().center_of_mass - p_W), 0.035);
  }
  FunctionStream holed(
      [](double time, int u, int v) {
        return std::hypot(u - 60, v - 60) < 15 ? 0 : still_wall(time, u, v);
      },
      every(0.04, 25));
  const auto error = [&](const ProbeAim& aim) {
    const auto path = probing_path(copies_of(holed), tool, std::nullopt, aim);
    return path ? "" : path.error().message;
  };
  EXPECT_NE(error({.pixel = {{240, 10}}}).find("columns u are 0 to 239"), std::string::npos);
  EXPECT_NE(error({.pixel = {{-1, 10}}}).find("outside the image"), std::string::npos);
  EXPECT_NE(error({.pixel = {{10, NAN}}}).find("outside the image"), std::string::npos);
  EXPECT_NE(error({.pixel = {{60, 60}}}).find("no depth at the pixel 60, 60"), std::string::npos);
  EXPECT_NE(error({.point_W = Vec3d{0, 0, -1}}).find("in front of"), std::string::npos);
  EXPECT_NE(error({.point_W = Vec3d{2, 0, 0.7}}).find("outside the image"), std::string::npos);
  EXPECT_NE(error({.point_W = Vec3d{0, 0, 0.4}}).find("z = 0.7 m"), std::string::npos);
  EXPECT_NE(error({.tip_T = Vec3d{0.3, 0, 0}}).find("away from the tool"), std::string::npos);
  EXPECT_EQ(error({.pixel = {{0, 0}}}), "");
  EXPECT_EQ(error({.pixel = {{239, 179}}}), "");
}

TEST(ProbingPath, NothingToTouchIsAnError) {
  const Tool tool = test::random_tool(20, 0.04, 3);
  const auto error = [&](Scene scene, std::vector<double> times, std::optional<double> duration) {
    FunctionStream stream(std::move(scene), std::move(times));
    const auto path = probing_path(copies_of(stream), tool, duration);
    EXPECT_FALSE(path);
    return path ? "" : path.error().message;
  };
  const auto nothing = [](double, int, int) { return 0.0; };
  EXPECT_NE(error(nothing, every(0.04, 3), 3.0).find("--path"), std::string::npos);
  error(still_wall, {}, 3.0);
  for (const double duration : {0.0, -1.0, double(NAN), double(INFINITY)}) {
    error(still_wall, every(0.04, 3), duration);
  }
  FunctionStream broken(still_wall, every(0.04, 4));
  broken.fail_at = 2;
  const auto path = probing_path(copies_of(broken), tool, std::nullopt);
  ASSERT_FALSE(path);
  EXPECT_EQ(path.error().message, "frame 2 is broken");
}

TEST(CoarseDepth, FillsGapsAndDropsOutliers) {
  // 1 m and 1 mm more per frame, with a gap at 3, nothing at the start, and a ghost at 8.
  const Scene scene = [](double time, int, int) {
    const long k = std::lround(time / 0.04);
    return k == 0 || k == 3 ? 0 : k == 8 ? 3 : 1 + 0.001 * static_cast<double>(k);
  };
  FunctionStream stream(scene, every(0.04, 15));
  const auto coarse = CoarseDepth::scan(stream);
  ASSERT_TRUE(coarse) << coarse.error().message;
  EXPECT_NEAR(coarse->duration(), 0.6, 1e-12);
  const DepthProfile profile = coarse->profile(coarse->columns() / 2, coarse->rows() / 2);
  ASSERT_EQ(profile.times.size(), 15u);
  EXPECT_NEAR(profile.times[4], 4.5 * 0.04, 1e-12);
  for (std::size_t k = 0; k < 15; ++k) {
    EXPECT_NEAR(profile.depths[k], 1 + 0.001 * static_cast<double>(k), 0.0021) << k;
  }
  EXPECT_EQ(profile.at(-1), profile.depths.front());
  EXPECT_EQ(profile.at(9), profile.depths.back());
  EXPECT_NEAR(profile.at(0.2), (profile.depths[4] + profile.depths[5]) / 2, 1e-12);
}

TEST(CoarseDepth, CopesWithTinyImages) {
  class TinyStream : public DepthSource {
   public:
    explicit TinyStream(int width, int height) {
      info_.width = width;
      info_.height = height;
      info_.intrinsics = {10, 10, 0, 0};
    }
    const DepthStreamInfo& info() const override { return info_; }
    Result<bool> next(DepthFrame& frame) override {
      frame = {info_.width, info_.height, 0.001, {}, 0};
      frame.pixels.assign(static_cast<std::size_t>(info_.width * info_.height), 500);
      return !std::exchange(done_, true);
    }

   private:
    DepthStreamInfo info_;
    bool done_ = false;
  };
  const Tool tool = test::random_tool(20, 0.04, 3);
  for (const auto& [width, height] :
       {std::pair{1, 1}, {2, 1}, {3, 7}, {30, 1}, {8, 8}, {9, 30}, {64, 48}}) {
    TinyStream stream(width, height);
    // No surface has fewer than 8 pixels a side.
    const auto path = probing_path(copies_of(stream), tool, 1.0);
    EXPECT_EQ(path.has_value(), std::min(width, height) >= 8) << width << " x " << height;
  }
}

}  // namespace
}  // namespace palpate
