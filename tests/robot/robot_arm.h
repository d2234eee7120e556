// An arm of two links in a plane, with a finger that slides and one that follows it, before a wall.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "palpate/field/sensor.h"
#include "palpate/robot/robot.h"

namespace palpate::test {

inline constexpr double kWallDepth = 1.0;  // m

/// Turns about x at the base and 0.3 m farther along z; two fingers slide apart along y.
inline const std::string kRobotUrdf = R"(<robot name="arm">
  <link name="base"/>
  <link name="upper"><collision><origin xyz="0 0 0.15"/><geometry><box size="0.06 0.08 0.3"/></geometry></collision></link>
  <link name="fore"><collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.03" length="0.2"/></geometry></collision></link>
  <link name="left"><collision><geometry><box size="0.02 0.02 0.05"/></geometry></collision>
    <collision><origin xyz="0 0 0.02"/><geometry><sphere radius="0.012"/></geometry></collision></link>
  <link name="right"><collision><geometry><box size="0.02 0.02 0.05"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2"/></joint>
  <joint name="elbow" type="continuous"><origin xyz="0 0 0.3"/><parent link="upper"/><child link="fore"/><axis xyz="1 0 0"/></joint>
  <joint name="finger" type="prismatic"><origin xyz="0 0.01 0.22"/><parent link="fore"/><child link="left"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04"/></joint>
  <joint name="other" type="prismatic"><origin xyz="0 -0.01 0.22"/><parent link="fore"/><child link="right"/><axis xyz="0 1 0"/>
    <limit lower="-0.03" upper="0"/><mimic joint="finger" multiplier="-1"/></joint>
</robot>)";

inline Robot arm() { return Robot::from_urdf(kRobotUrdf, "arm.urdf").value(); }

/// A camera 1 m before a wall, which sees a post of 0.1 m, 0.2 m before it, if wanted.
struct SeenWall {
  std::vector<float> depth;
  Sensor sensor = Sensor::create({320, 240, {280, 280, 159.5, 119.5}}).value();
  Scene scene;

  explicit SeenWall(bool has_post = false) : depth(320 * 240, static_cast<float>(kWallDepth)) {
    for (std::size_t i = 0; has_post && i < depth.size(); ++i) {
      const std::size_t u = i % 320;
      if (u > 200 && u < 235) depth[i] = 0.8f;
    }
    scene.surfaces = {sensor.update(DepthImageView(320, 240, depth.data()))};
  }
};

}  // namespace palpate::test
