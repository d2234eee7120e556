// Setup of every batch benchmark: a gripper's finger (a box of 20 x 16 x 80 mm) at random
// poses before and in the bumpy wall.
#pragma once

#include <map>
#include <memory>
#include <vector>

#include "bench/contact_setup.h"
#include "palpate/contact/contact.h"

namespace palpate::bench {

inline const Tool& finger_tool(int num_spheres) {
  static std::map<int, std::unique_ptr<Tool>> tools;
  auto& tool = tools[num_spheres];
  if (tool == nullptr) {
    tool = std::make_unique<Tool>(
        Tool::pack(make_box({0.02, 0.016, 0.08}), {.max_spheres = num_spheres}).value());
  }
  return *tool;
}

/// Region of the poses of a batch.
enum class Where {
  view,     ///< anywhere in view, from 0.3 m before the wall to 0.03 m behind it
  surface,  ///< with the center within 2 cm of the surface: nearly all touch it
};

/// Returns random poses. `half_angle`: tangent of the half angle of view that they fill.
inline std::vector<Pose> finger_poses(int num, Where where, double half_angle = 0.4) {
  test::Random random(1);
  std::vector<Pose> poses;
  poses.reserve(static_cast<std::size_t>(num));
  for (int i = 0; i < num; ++i) {
    const double z = kWallDepth + (where == Where::view ? random.uniform(-0.3, 0.03)
                                                        : random.uniform(-0.02, 0.02));
    const double x = random.uniform(-half_angle, half_angle) * z;
    const double y = random.uniform(-half_angle, half_angle) * z;
    poses.push_back({{x, y, z}, random.rotation(kPi)});
  }
  return poses;
}

}  // namespace palpate::bench
