// A table, an arm that swings in front of it, and what cameras see of both by exact rays.
#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "palpate/mesh/mesh.h"
#include "scenes/scene.h"

namespace palpate::test {

inline constexpr double kTableDepth = 1.4;  // m

/// Three links: an upper arm, a forearm and a hand. Each lies along its z, from 0 on.
inline std::vector<RobotLink> arm_links() {
  const auto along_z = [](TriangleMesh mesh, double middle) {
    for (Vec3d& p : mesh.vertices) p.z += middle;
    return mesh;
  };
  return {{"upper_arm", along_z(make_cylinder(0.05, 0.3, 24), 0.15)},
          {"forearm", along_z(make_cylinder(0.04, 0.3, 24), 0.15)},
          {"hand", along_z(make_box({0.1, 0.03, 0.1}), 0.05)}};
}

/// The arm stands beside the table and swings over it, 10 rad/s at the elbow at most.
class SwingingArm : public LinkPoses {
 public:
  double unknown_from = 1e9, unknown_to = -1e9;  ///< s: meanwhile nobody knows

  static double shoulder(double t) { return 0.3 * std::sin(5 * t); }
  static double elbow(double t) { return 0.8 + 1.0 * std::sin(10 * t); }
  static Pose base() { return {{-0.35, 0.1, 0.8}, {0, std::sqrt(0.5), 0, std::sqrt(0.5)}}; }
  static std::vector<Pose> poses(double t) {
    const Pose upper = base() * Pose{{}, axis_angle({1, 0, 0}, shoulder(t))};
    const Pose fore = upper * Pose{{0, 0, 0.3}, axis_angle({1, 0, 0}, elbow(t))};
    const Pose hand = fore * Pose{{0, 0, 0.3}, axis_angle({0, 0, 1}, 0.5)};
    return {upper, fore, hand};
  }
  static Vec3d middle_of_link(int link, double t) {
    return poses(t)[static_cast<std::size_t>(link)] * Vec3d{0, 0, 0.15};
  }

  Status at(double time, std::span<Pose> X_WL) const override {
    if (time >= unknown_from && time <= unknown_to) {
      return Error{Errc::unavailable, "the arm is asleep"};
    }
    const auto all = poses(time);
    std::copy(all.begin(), all.end(), X_WL.begin());
    return Done{};
  }
};

/// The same arm as a URDF.
inline constexpr const char* kArmUrdf = R"(<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper_arm"><collision><origin xyz="0 0 0.15"/>
    <geometry><cylinder radius="0.05" length="0.3"/></geometry></collision></link>
  <link name="forearm"><collision><origin xyz="0 0 0.15"/>
    <geometry><cylinder radius="0.04" length="0.3"/></geometry></collision></link>
  <link name="hand"><collision><origin xyz="0 0 0.05"/>
    <geometry><box size="0.1 0.03 0.1"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper_arm"/>
    <axis xyz="1 0 0"/><limit lower="-0.01" upper="0.01" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><origin xyz="0 0 0.3"/><parent link="upper_arm"/>
    <child link="forearm"/><axis xyz="2 0 0"/></joint>
  <joint name="wrist" type="fixed"><origin xyz="0 0 0.3" rpy="0 0 0.5"/><parent link="forearm"/>
    <child link="hand"/></joint>
</robot>
)";

/// Frames that were seen before.
class FrameList : public DepthSource {
 public:
  explicit FrameList(std::vector<DepthFrame> frames) : frames_(std::move(frames)) {
    info_.width = frames_.front().width;
    info_.height = frames_.front().height;
    info_.intrinsics = {525, 525, 319.5, 239.5};
    info_.name = "frames";
  }
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    if (next_ == frames_.size()) return false;
    frame = frames_[next_++];
    return true;
  }

 private:
  std::vector<DepthFrame> frames_;
  DepthStreamInfo info_;
  std::size_t next_ = 0;
};

/// A frame each 50 ms, in counts of 0.1 mm, with the arm or of the table alone.
inline std::vector<DepthFrame> frames_of_arm(const std::function<Pose(double)>& X_WC,
                                             bool has_arm) {
  std::vector<DepthFrame> frames;
  for (int k = 0; k < 7; ++k) {
    const double t = 0.05 * k;
    scenes::Scene scene;
    scene.intrinsics = {525, 525, 319.5, 239.5};
    scene.X_WC = [pose = X_WC(t)](double) { return pose; };
    scene.environment = scenes::Environment::wall(kTableDepth);
    const auto poses = SwingingArm::poses(t);
    const auto links = arm_links();
    for (std::size_t i = 0; has_arm && i < links.size(); ++i) {
      scene.bodies.push_back({links[i].name, links[i].mesh, nullptr, poses[i]});
    }
    DepthFrame& frame = frames.emplace_back();
    frame.width = scene.width;
    frame.height = scene.height;
    frame.unit = 0.0001;
    frame.timestamp = t;
    frame.X_WC = X_WC(t);
    for (const float depth : scenes::render_depth(scene, t)) {
      frame.pixels.push_back(depth > 0 ? static_cast<std::uint16_t>(std::lround(depth / 0.0001f))
                                       : 0);
    }
  }
  return frames;
}

}  // namespace palpate::test
