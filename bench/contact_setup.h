// Setup of every contact benchmark: a 640x480 frame of a bumpy wall at 1 m, a cube of 0.2 m
// packed with N spheres, 200 random poses at a given depth.
#pragma once

#include <cstdlib>
#include <map>
#include <memory>
#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "palpate/tool/tool.h"
#include "tests/test_util/random.h"

namespace palpate::bench {

inline constexpr double kToolSize = 0.2;
inline constexpr double kWallDepth = 1.0;

/// One packing serves all sizes: every prefix is the packing for that number.
inline const Tool& cube_tool(int num_spheres) {
  static std::map<int, std::unique_ptr<Tool>> tools;
  auto& tool = tools[num_spheres];
  if (tool == nullptr) {
    static SpherePacking largest;
    if (static_cast<int>(largest.spheres.size()) < num_spheres) {
      PackOptions options;
      options.max_spheres = std::max(num_spheres, 17000);
      largest = pack_spheres(make_box({kToolSize, kToolSize, kToolSize}), options).value();
    }
    SpherePacking packing = largest;
    packing.spheres.resize(static_cast<std::size_t>(num_spheres));
    tool = std::make_unique<Tool>(
        Tool::build(make_box({kToolSize, kToolSize, kToolSize}), std::move(packing)).value());
  }
  return *tool;
}

inline const PointCloud& bumpy_wall() {
  static const PointCloud cloud = [] {
    const Intrinsics k{525, 525, 319.5, 239.5};
    PointCloud wall(640, 480, k);
    for (int v = 0; v < 480; ++v) {
      for (int u = 0; u < 640; ++u) {
        const double a = u * 0.05, b = v * 0.06;
        const double z = kWallDepth + 0.01 * std::sin(a) * std::cos(b);
        const Vec3d n{0.01 * 0.05 * 525 * std::cos(a) * std::cos(b),
                      -0.01 * 0.06 * 525 * std::sin(a) * std::sin(b), -1};
        wall.set(static_cast<std::size_t>(v * 640 + u),
                 to_float({(u - k.cx) * z / k.fx, (v - k.cy) * z / k.fy, z}), to_float(n));
      }
    }
    return wall;
  }();
  return cloud;
}

/// Returns random poses. `depth` 0..1: penetration of the cube's leading face into the wall, in
/// cube sizes. +-15 degrees per axis, +-0.25 / 0.15 m to the side.
inline std::vector<Pose> random_poses(double depth, int num = 200) {
  test::Random random(1);
  std::vector<Pose> poses;
  for (int i = 0; i < num; ++i) {
    const double limit = 15 * kPi / 180;
    const Quaternion q = axis_angle({1, 0, 0}, random.uniform(-limit, limit)) *
                         axis_angle({0, 1, 0}, random.uniform(-limit, limit)) *
                         axis_angle({0, 0, 1}, random.uniform(-limit, limit));
    const double x = random.uniform(-0.25, 0.25), y = random.uniform(-0.15, 0.15);
    poses.push_back({{x, y, kWallDepth + (depth - 0.5) * kToolSize}, q});
  }
  return poses;
}

/// Returns random poses. `depth` 0..1: penetration of one cube into a face of the other, in cube
/// sizes. +-15 degrees per axis, up to a tenth of the cube to the side.
inline std::vector<Pose> overlapping_poses(double depth, int num = 200) {
  test::Random random(1);
  std::vector<Pose> poses;
  for (int i = 0; i < num; ++i) {
    const double limit = 15 * kPi / 180, side = 0.1 * kToolSize;
    const Quaternion q = axis_angle({1, 0, 0}, random.uniform(-limit, limit)) *
                         axis_angle({0, 1, 0}, random.uniform(-limit, limit)) *
                         axis_angle({0, 0, 1}, random.uniform(-limit, limit));
    const double x = random.uniform(-side, side), y = random.uniform(-side, side);
    poses.push_back({{x, y, (1 - depth) * kToolSize}, q});
  }
  return poses;
}

}  // namespace palpate::bench
