// However a scene jumps, a tool that probes it by itself is slow.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "palpate/io/formats.h"
#include "scenes/scene.h"
#include "tests/session/function_stream.h"
#include "tests/session/packed_tool.h"
#include "tests/session/path_run.h"
#include "tests/test_util/data.h"
#include "tests/test_util/made_frame.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::copies_of;
using test::every;
using test::FunctionStream;
using test::packed_tool;

struct Fastest {
  double linear = 0;   ///< m/s, of any point of the mesh, any sphere, or the frame's origin
  double angular = 0;  ///< rad/s
};

/// From tick to tick at 1 kHz, as a run plays the path.
Fastest fastest_of(const Tool& tool, const std::vector<TimedPose>& path) {
  std::vector<Vec3d> points{{}};
  for (const Vec3d& p : tool.mesh().vertices) points.push_back(p);
  for (const Sphere& s : tool.spheres()) points.push_back(to_double(s.center));
  // Those that are farthest from each other decide: corners in 26 directions are enough and quick.
  std::vector<Vec3d> corners{{}};
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        const Vec3d d{double(x), double(y), double(z)};
        corners.push_back(*std::max_element(
            points.begin(), points.end(),
            [&](const Vec3d& a, const Vec3d& b) { return dot(a, d) < dot(b, d); }));
      }
    }
  }
  constexpr double kTick = 1e-3;
  Fastest fastest;
  Pose before = pose_at(path, path.front().time);
  for (double time = kTick; time <= path.back().time; time += kTick) {
    const Pose X_WT = pose_at(path, time);
    for (const Vec3d& p_T : corners)
      fastest.linear = std::max(fastest.linear, norm(X_WT * p_T - before * p_T) / kTick);
    const Quaternion turn = X_WT.rotation * conjugate(before.rotation);
    const double angle = 2 * std::atan2(std::hypot(turn.x, turn.y, turn.z), std::abs(turn.w));
    fastest.angular = std::max(fastest.angular, angle / kTick);
    before = X_WT;
  }
  return fastest;
}

void expect_slow(const OpenDepthSource& open, const Tool& tool, std::optional<double> duration,
                 const ProbeAim& aim = {}) {
  const auto path = probing_path(open, tool, duration, aim);
  ASSERT_TRUE(path) << path.error().message;
  const Fastest fastest = fastest_of(tool, path->poses);
  EXPECT_LE(fastest.linear, 0.15);
  EXPECT_LE(fastest.angular, 1.0);
  for (const TimedPose& pose : path->poses) EXPECT_TRUE(is_finite(pose.X_WT));
}

/// Small, long, off its frame's origin, and as large as a tool may be.
std::vector<Tool> tools() {
  std::vector<Tool> tools;
  tools.push_back(packed_tool(make_stylus(0.008, 0.14, 0.03, 24), 60));
  tools.push_back(packed_tool(make_box({0.1, 0.1, 0.1}), 60));
  tools.push_back(
      packed_tool(test::moved(make_box({0.3, 0.02, 0.02}), {{0.4, -0.6, 0.2}, {}}), 60));
  tools.push_back(packed_tool(make_stylus(0.05, 1.9, 0.4, 24), 60));
  return tools;
}

void expect_slow_for_all_tools(const OpenDepthSource& open) {
  for (const Tool& tool : tools()) {
    SCOPED_TRACE(norm(tool.mesh().vertices[0]));
    expect_slow(open, tool, std::nullopt);
  }
}

TEST(ProbingSpeed, WhateverTheSurfaceDoes) {
  const struct {
    const char* name;
    test::DepthFunction scene;
  } scenes[] = {
      {"still", [](double, int, int) { return 0.7; }},
      // The edge of a table passes: 2 m behind it there is a wall.
      {"table's edge", [](double t, int u, int) { return u > 40 * t ? 0.88 : 2.87; }},
      {"comes near at once", [](double t, int, int) { return t < 2 ? 1.5 : 0.3; }},
      {"goes away at once", [](double t, int, int) { return t < 2 ? 0.3 : 1.5; }},
      {"swings by half a meter", [](double t, int, int) { return 0.8 - 0.25 * std::sin(6 * t); }},
      {"something passes",
       [](double t, int u, int) { return std::abs(u - 100 * (t - 1)) < 20 ? 0.25 : 0.9; }},
      {"flickers",
       [](double t, int u, int v) {
         return 0.5 + 0.4 * std::abs(std::sin(1e4 * t + 7 * u / 10 + v / 10));
       }},
      {"away for a second", [](double t, int, int) { return t > 1 && t < 2 ? 0.0 : 0.6; }},
  };
  for (const auto& [name, scene] : scenes) {
    SCOPED_TRACE(name);
    expect_slow_for_all_tools(copies_of(FunctionStream(scene, every(0.04, 100))));
  }
}

TEST(ProbingSpeed, HoweverShortTheTime) {
  const Tool tool = packed_tool(make_stylus(0.008, 0.14, 0.03, 24), 60);
  FunctionStream stream([](double, int, int) { return 0.7; }, every(0.04, 2));
  for (const double duration : {0.001, 0.0123, 0.1, 0.5, 1.7, 20.0})
    expect_slow(copies_of(stream), tool, duration);
  FunctionStream one([](double, int, int) { return 0.7; }, {0});
  expect_slow(copies_of(one), tool, std::nullopt);
}

TEST(ProbingSpeed, WhereverPeopleAim) {
  const Tool tool = packed_tool(make_stylus(0.008, 0.14, 0.03, 24), 60);
  FunctionStream stream([](double t, int u, int) { return u > 40 * t ? 0.88 : 2.87; },
                        every(0.04, 100));
  for (const double u : {0.0, 60.0, 119.5, 239.0}) {
    expect_slow(copies_of(stream), tool, std::nullopt, {.pixel = {{u, 90}}});
  }
  expect_slow(copies_of(stream), tool, std::nullopt, {.tip_T = tool.mesh().vertices[0]});
}

TEST(ProbingSpeed, InAllSimulatedScenes) {
  const Tool tool = packed_tool(make_stylus(0.008, 0.14, 0.03, 24), 60);
  for (const std::string& name : scenes::scene_names()) {
    SCOPED_TRACE(name);
    const OpenDepthSource open = [&]() -> Result<std::unique_ptr<DepthSource>> {
      auto scene = scenes::make_scene(name);
      if (!scene) return scene.error();
      scenes::set_image_size(*scene, 160, 120);
      scenes::SimulatedCameraOptions camera;
      camera.duration = 1.0;
      return scenes::open_simulated_camera(*std::move(scene), camera);
    };
    expect_slow(open, tool, std::nullopt);
  }
}

/// A folder of real frames; the same at a rate at which people and cameras move twenty times too
/// fast.
void expect_slow_in(const std::filesystem::path& folder, const Intrinsics& intrinsics, double unit,
                    std::vector<double> rates) {
  for (const double rate : rates) {
    SCOPED_TRACE(rate);
    const OpenDepthSource open = [&] {
      return open_depth_folder(folder, {intrinsics, unit, rate});
    };
    expect_slow(open, packed_tool(make_stylus(0.008, 0.14, 0.03, 24), 60), std::nullopt);
    expect_slow(open, packed_tool(make_box({0.1, 0.1, 0.1}), 60), std::nullopt);
  }
}

TEST(ProbingSpeed, WhereSomebodySways) {
  const test::TemporaryFolder folder;
  for (int i = 0; i < test::kNumMadeFrames; ++i)
    ASSERT_TRUE(save_depth_png(test::made_frame(i), folder / (std::to_string(i) + ".png")));
  expect_slow_in(folder.path(), test::kMadeIntrinsics, 0.001, {1.5, 30});
}

TEST(ProbingSpeed, WhereARealHandMoves) {
  PALPATE_DATA_OR_SKIP(folder, "sequences/hand_sr305_20210326-230536");
  expect_slow_in(folder, {476.007, 476.007, 313.683, 242.755}, 0.000125, {1.5, 30});
}

TEST(ProbingSpeed, WhereARealCameraMoves) {
  PALPATE_DATA_OR_SKIP(folder, "sequences/visp_rbt");
  expect_slow_in(folder, {607.178, 607.234, 321.391, 241.918}, 0.001, {30});
}

TEST(ProbingSpeed, InUnrelatedRealFrames) {
  PALPATE_DATA_OR_SKIP(folder, "frames");
  expect_slow_in(folder, {525, 525, 319.5, 239.5}, 0.001, {1, 10});
}

}  // namespace
}  // namespace palpate
