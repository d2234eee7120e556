#include "palpate/session/probing_path.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <utility>

#include "palpate/math/sphere.h"
#include "palpate/session/session.h"
#include "src/session/coarse_depth.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

/// Depth as a function of time and pixel; 0: no measurement.
using Scene = std::function<double(double time, int u, int v)>;

class FunctionStream : public DepthSource {
 public:
  FunctionStream(Scene scene, std::vector<double> times) : scene_(std::move(scene)), times_(times) {
    info_.width = 240;
    info_.height = 180;
    info_.intrinsics = {220, 220, 119.5, 89.5};
    info_.unit = 0.0005;
    info_.rate = 25;
    info_.num_frames = static_cast<int>(times.size());
  }
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    if (next_ == fail_at) return Error{Errc::bad_input, "frame 2 is broken"};
    if (next_ == static_cast<int>(times_.size())) return false;
    const double time = times_[static_cast<std::size_t>(next_++)];
    frame = {info_.width, info_.height, info_.unit, {}, 1000 + time};
    for (int v = 0; v < info_.height; ++v) {
      for (int u = 0; u < info_.width; ++u) {
        frame.pixels.push_back(
            static_cast<std::uint16_t>(std::lround(scene_(time, u, v) / info_.unit)));
      }
    }
    return true;
  }

  int fail_at = -1;

 private:
  Scene scene_;
  std::vector<double> times_;
  DepthStreamInfo info_;
  int next_ = 0;
};

/// Opens copies of a stream.
template <class Stream>
OpenDepthSource copies_of(const Stream& stream) {
  return [stream]() -> Result<std::unique_ptr<DepthSource>> {
    return std::unique_ptr<DepthSource>(std::make_unique<Stream>(stream));
  };
}

std::vector<double> every(double period, int num) {
  std::vector<double> times;
  for (int k = 0; k < num; ++k) times.push_back(k * period);
  return times;
}

double still_wall(double, int, int) { return 0.7; }

/// A wall that comes and goes by 30 cm in two seconds; every fifth frame shows nothing.
double swinging_depth(double time) { return 0.75 - 0.15 * std::sin(kPi * time); }
double swinging_wall(double time, int, int) {
  return std::lround(time / 0.04) % 5 == 3 ? 0 : swinging_depth(time);
}

TEST(ProbingPath, StartsFreeReachesATenthAndLeaves) {
  const Tool tool = test::random_tool(150, 0.04, 3);
  FunctionStream stream(still_wall, every(0.04, 50)), again(still_wall, every(0.04, 50));
  const auto path = probing_path(copies_of(stream), tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_EQ(path->front().time, 0);
  EXPECT_NEAR(path->back().time, 2.0, 1e-12);
  const auto log = run_session(
      tool, again, [&](std::size_t, double time) { return pose_at(*path, time); }, RunSettings{});
  ASSERT_TRUE(log) << log.error().message;
  const auto fraction = [&](std::size_t tick) {
    return log->ticks[tick].penetration.volume / full_volume(tool, ContactOptions{});
  };
  EXPECT_EQ(fraction(0), 0);
  EXPECT_EQ(fraction(log->ticks.size() - 1), 0);
  for (std::size_t tick = 750; tick < 1450; tick += 50) EXPECT_NEAR(fraction(tick), 0.1, 0.02);
}

TEST(ProbingPath, FollowsAMovingScene) {
  const Tool tool = test::random_tool(150, 0.04, 3);
  FunctionStream stream(swinging_wall, every(0.04, 100));
  const auto path = probing_path(copies_of(stream), tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  for (std::size_t i = 1; i < path->size(); ++i) {
    const double way = norm((*path)[i].X_WT.translation - (*path)[i - 1].X_WT.translation);
    EXPECT_LT(way, 0.01);  // 1 m/s
  }
  // How much of the tool is behind the wall of the frame that is current then, missing or not.
  for (const auto& [time, X_WT] : *path) {
    const double wall = swinging_depth(std::floor(time / 0.04 + 1e-9) * 0.04);
    double behind = 0;
    for (std::size_t i = 0; i < tool.spheres().size(); ++i) {
      const Sphere& s = tool.spheres()[i];
      const double radius = s.radius, z = (X_WT * to_double(s.centre)).z;
      behind += static_cast<double>(tool.represented_volumes()[i]) * cap_volume(radius, wall - z) /
                sphere_volume(radius);
    }
    behind /= tool.mesh_mass().volume;
    if (time > 0.36 * 4 && time < 0.74 * 4) {
      EXPECT_NEAR(behind, 0.1, 0.08) << time;
    }
    if (time < 0.05 * 4 || time > 0.96 * 4) {
      EXPECT_EQ(behind, 0) << time;
    }
  }
}

TEST(ProbingPath, HoldsALongToolByItsAxisAndStaysClearOfSurroundings) {
  // A rod of 24 cm along x, thin at its low end, in a pit with walls that come nearer for a while.
  SpherePacking packing;
  for (int i = 0; i < 24; ++i) {
    packing.spheres.push_back({{0.01f * static_cast<float>(i), 0, 0}, i < 6 ? 0.005f : 0.012f});
  }
  std::reverse(packing.spheres.begin(), packing.spheres.end());  // largest first
  const auto tool = Tool::build(make_box({0.24, 0.02, 0.02}), packing, GapRule::absolute, "rod");
  ASSERT_TRUE(tool) << tool.error().message;
  const Scene pit = [](double time, int u, int v) {
    const bool in_pit = std::abs(u - 120) < 45 && std::abs(v - 90) < 45;
    return in_pit ? 0.7 : time > 1.8 ? 0.35 : 0.55;
  };
  FunctionStream stream(pit, every(0.04, 50)), again(pit, every(0.04, 50));
  const auto path = probing_path(copies_of(stream), *tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  for (const TimedPose& pose : *path) {
    EXPECT_GT(rotate(pose.X_WT.rotation, {-1, 0, 0}).z, 0.8);
  }
  const auto log = run_session(
      *tool, again, [&](std::size_t, double time) { return pose_at(*path, time); }, RunSettings{});
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
  const Vec3d p_W = pose_at(*path, 0.37) * Vec3d{};
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
  EXPECT_NEAR(path->back().time, 3.0 + 1 / 25.0, 1e-12);
  const auto longer = probing_path(copies_of(cut), tool, 1.5);
  ASSERT_TRUE(longer) << longer.error().message;
  EXPECT_NEAR(longer->back().time, 1.5, 1e-12);
}

TEST(ProbingPath, OffCentreToolsStillMeetTheRay) {
  SpherePacking packing;
  packing.spheres = {{{0.3f, 0.2f, 0.1f}, 0.02f}};
  const auto tool =
      Tool::build(make_box({0.1, 0.1, 0.1}), packing, GapRule::absolute, "one sphere");
  ASSERT_TRUE(tool) << tool.error().message;
  FunctionStream stream(still_wall, every(0.04, 25));
  const auto path = probing_path(copies_of(stream), *tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  const Vec3d C_W = pose_at(*path, 0.37) * tool->sphere_mass().centre_of_mass;
  EXPECT_LT(std::hypot(C_W.x, C_W.y), 0.05);
  EXPECT_NEAR(C_W.z, 0.7, 0.03);
}

TEST(ProbingPath, PointsTheTipOfAPenIntoTheScene) {
  const Tool tool = test::random_tool(20, 0.04, 3);
  FunctionStream stream(still_wall, every(0.04, 25));
  const auto path = probing_path(copies_of(stream), tool, std::nullopt);
  ASSERT_TRUE(path) << path.error().message;
  for (const TimedPose& pose : *path) {
    const Vec3d back_W = rotate(pose.X_WT.rotation, {0, 0, 1});
    EXPECT_LT(back_W.z, -0.8);
    EXPECT_GT(back_W.x, 0.1);
    EXPECT_LT(back_W.y, -0.1);
  }
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
