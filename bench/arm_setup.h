// Setup of the benchmarks of the self filter: an arm of seven tubes that curls up and stretches in
// front of a wall.
#pragma once

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "palpate/cameras/cameras.h"

namespace palpate::bench {

inline constexpr int kArmWidth = 640, kArmHeight = 480, kNumLinks = 7;
inline constexpr Intrinsics kArmCamera{525, 525, 319.5, 239.5};
inline constexpr double kTubeLength = 0.25;  // m

/// Makes an open tube along z with `around` corners around.
inline TriangleMesh tube(int around) {
  constexpr double kRadius = 0.05;  // m
  const int along = around * 9 / 10;
  TriangleMesh mesh;
  const auto id = [&](int i, int j) { return static_cast<std::uint32_t>(j * around + i % around); };
  for (int j = 0; j <= along; ++j) {
    for (int i = 0; i < around; ++i) {
      const double angle = 2 * std::numbers::pi * i / around;
      mesh.vertices.push_back(
          {kRadius * std::cos(angle), kRadius * std::sin(angle), kTubeLength * j / along});
    }
  }
  for (int j = 0; j < along; ++j) {
    for (int i = 0; i < around; ++i) {
      mesh.triangles.push_back({id(i, j), id(i + 1, j), id(i, j + 1)});
      mesh.triangles.push_back({id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)});
    }
  }
  return mesh;
}

inline std::vector<RobotLink> arm_of_tubes(int around) {
  return std::vector<RobotLink>(kNumLinks, {"tube", tube(around)});
}

/// Returns the link poses of the arm at a step.
inline std::vector<Pose> arm_poses(int step) {
  const double curled = 0.4 + 0.2 * std::sin(0.1 * step);
  std::vector<Pose> X_CL;
  Pose X{{-0.5, 0.3, 1.1}, {}};
  for (int i = 0; i < kNumLinks; ++i) {
    X = X * Pose{{}, axis_angle({0.3, 1, 0.2}, curled + 0.1 * i)};
    X_CL.push_back(X);
    X = X * Pose{{0, 0, kTubeLength}, {}};
  }
  return X_CL;
}

/// Renders the wall alone.
inline DepthFrame wall_behind_arm() {
  return {kArmWidth, kArmHeight, 0.001,
          std::vector<std::uint16_t>(static_cast<std::size_t>(kArmWidth * kArmHeight), 1500)};
}

}  // namespace palpate::bench
