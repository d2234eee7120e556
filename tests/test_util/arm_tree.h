// An arm like a Panda: seven turning joints with its lengths and limits, a hand, and a finger that
// slides with one that follows it. Its ten links are boxes that are covered with spheres.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "palpate/mesh/mesh.h"
#include "palpate/tool/tool.h"
#include "src/contact/internal/joint_tree.h"
#include "src/packing/internal/sphere_cover.h"
#include "tests/test_util/random.h"

namespace palpate::test {

struct ArmTree {
  std::vector<Tool> tools;
  std::shared_ptr<const JointTree> tree;

  std::size_t num_positions() const { return tree->ranges.size(); }
  std::size_t num_spheres() const {
    std::size_t num = 0;
    for (const Tool& tool : tools) num += tool.spheres().size();
    return num;
  }
  std::vector<const Tool*> pointers() const {
    std::vector<const Tool*> all;
    for (const Tool& tool : tools) all.push_back(&tool);
    return all;
  }
  /// Returns positions within the ranges of the joints.
  std::vector<double> random_positions(std::size_t num, Random& random) const {
    std::vector<double> positions;
    for (std::size_t i = 0; i < num; ++i) {
      for (const JointRange& range : tree->ranges) {
        positions.push_back(random.uniform(range.lower, range.upper));
      }
    }
    return positions;
  }
  /// Returns the poses of the tools, by products of poses and rotations about axes.
  std::vector<Pose> placed(const Pose& X_WB, const double* positions) const {
    std::vector<Pose> X_WF{X_WB};
    for (const TreeJoint& joint : tree->joints) {
      double q = joint.offset;
      if (joint.moved >= 0) {
        const JointRange& range = tree->ranges[static_cast<std::size_t>(joint.moved)];
        q += joint.factor * std::clamp(positions[joint.moved], range.lower, range.upper);
      }
      Pose X_JC;
      if (joint.kind == JointKind::turning) X_JC.rotation = axis_angle(joint.axis, q);
      if (joint.kind == JointKind::sliding) X_JC.translation = joint.axis * q;
      X_WF.push_back(X_WF[static_cast<std::size_t>(joint.parent)] * joint.X_PJ * X_JC);
    }
    std::vector<Pose> X_WT;
    for (const std::int32_t frame : tree->frame_of_tool) {
      X_WT.push_back(X_WF[static_cast<std::size_t>(frame)]);
    }
    return X_WT;
  }
};

/// `standoff`: m, of surfaces from the nearest sphere of their link.
inline ArmTree arm_tree(double standoff = 0.0188) {
  ArmTree arm;
  JointTree tree;
  const auto add_joint = [&](const TreeJoint& joint) {
    tree.joints.push_back(joint);
    return static_cast<std::int32_t>(tree.joints.size());  // its frame
  };
  const auto add_box = [&](std::int32_t frame, const Vec3d& center, const Vec3d& size) {
    tree.frame_of_tool.push_back(add_joint({.parent = frame, .X_PJ = {center, {}}}));
    SpherePacking spheres = cover_solid(make_box(size), standoff, 1000).value();
    arm.tools.push_back(Tool::build(make_box(size), std::move(spheres)).value());
  };
  // Lengths along x and z (m) and turns about x, then about z: Denavit and Hartenberg, modified.
  struct Link {
    double a, d, turn, lower, upper;
    Vec3d center, size;
  };
  const Link links[] = {
      {0, 0.333, 0, -2.8973, 2.8973, {0, 0, -0.1}, {0.11, 0.11, 0.28}},
      {0, 0, -kPi / 2, -1.7628, 1.7628, {0, -0.1, 0}, {0.11, 0.28, 0.11}},
      {0, 0.316, kPi / 2, -2.8973, 2.8973, {0.03, 0, -0.05}, {0.13, 0.11, 0.2}},
      {0.0825, 0, kPi / 2, -3.0718, -0.0698, {-0.06, 0.08, 0}, {0.13, 0.2, 0.11}},
      {-0.0825, 0.384, -kPi / 2, -2.8973, 2.8973, {0, 0.03, -0.15}, {0.1, 0.1, 0.28}},
      {0, 0, kPi / 2, -0.0175, 3.7525, {0.04, 0, 0}, {0.17, 0.1, 0.1}},
      {0.088, 0, kPi / 2, -2.8973, 2.8973, {0, 0, 0.06}, {0.09, 0.09, 0.09}}};
  const Vec3d x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};
  std::int32_t frame = 0;
  for (const Link& link : links) {
    const Quaternion turn = axis_angle(x, link.turn);
    frame = add_joint({.kind = JointKind::turning,
                       .parent = frame,
                       .moved = static_cast<std::int32_t>(tree.ranges.size()),
                       .X_PJ = {Vec3d{link.a, 0, 0} + rotate(turn, z * link.d), turn},
                       .axis = z});
    tree.ranges.push_back({link.lower, link.upper});
    add_box(frame, link.center, link.size);
  }
  const std::int32_t hand =
      add_joint({.parent = frame, .X_PJ = {{0, 0, 0.107}, axis_angle(z, -kPi / 4)}});
  add_box(hand, {0, 0, 0.03}, {0.04, 0.2, 0.07});
  const auto finger = static_cast<std::int32_t>(tree.ranges.size());
  tree.ranges.push_back({0, 0.04});
  for (const double side : {1.0, -1.0}) {
    const std::int32_t slide = add_joint({.kind = JointKind::sliding,
                                          .parent = hand,
                                          .moved = finger,
                                          .factor = side,
                                          .X_PJ = {{0, 0.01 * side, 0.0584}, {}},
                                          .axis = y});
    add_box(slide, {0, 0, 0.025}, {0.02, 0.018, 0.05});
  }
  arm.tree = std::make_shared<const JointTree>(std::move(tree));
  return arm;
}

}  // namespace palpate::test
