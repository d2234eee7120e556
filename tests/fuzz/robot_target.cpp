// Robots as URDF, packed robots, whose checksum is put right, and positions of joints as tables.
// The first byte says which.
#include <xxhash.h>

#include <cstring>

#include "palpate/robot/robot.h"
#include "src/cameras/internal/robot_model.h"
#include "src/cameras/robot/joint_history.h"
#include "tests/cameras/robot_scene.h"
#include "tests/fuzz/target.h"

namespace palpate::fuzz {
namespace {

/// A box on a slide and one that follows it, in one sphere each.
std::string packed_robot() {
  const std::string box = "<collision><geometry><box size='.1 .1 .1'/></geometry></collision>";
  return Robot::from_urdf("<robot><link name='a'>" + box + "</link><link name='b'>" + box +
                              "</link><link name='c'/><joint name='i' type='prismatic'><parent "
                              "link='a'/><child link='b'/><limit upper='1'/></joint><joint "
                              "name='j' type='revolute'><parent link='b'/><child link='c'/><mimic "
                              "joint='i'/></joint></robot>",
                          "robot.urdf", {.standoff = 0.05})
      .value()
      .to_bytes()
      .value();
}

void take_packed(std::string bytes) {
  constexpr std::size_t kChecksum = 8;
  if (bytes.size() > kChecksum) {
    const std::uint64_t checksum = XXH3_64bits(bytes.data(), bytes.size() - kChecksum);
    std::memcpy(bytes.data() + bytes.size() - kChecksum, &checksum, kChecksum);
  }
  const auto robot = Robot::from_bytes(bytes);
  if (!robot) {
    require(!robot.error().message.empty(), "errors have words");
    return;
  }
  const std::string written = robot->to_bytes().value();
  require(Robot::from_bytes(written).value().to_bytes().value() == written,
          "a robot comes back with the same bytes");
  std::vector<Pose> X_WL(robot->links().size());
  const std::vector<double> joints(robot->joints().size(), 0.5);
  require(robot->place(joints, {}, X_WL).has_value(), "a robot has a place");
}

}  // namespace

std::vector<std::string> seeds() {
  return {std::string("u") + test::kArmUrdf,
          "u<robot><link name='a'/><link name='b'/><link name='c'><visual><geometry><mesh "
          "filename='package://p/a.stl' scale='1 2 3'/></geometry></visual></link><joint name='i' "
          "type='prismatic'><parent link='a'/><child link='b'/></joint><joint name='j' "
          "type='continuous'><parent link='b'/><child link='c'/><mimic joint='i' multiplier='2' "
          "offset='1'/></joint></robot>",
          "p" + packed_robot(), "ttime,elbow,shoulder\n0,1,2\n0.02,1.1,2.1\n",
          "t\"t\";elbow\n# none\n1 2\r\n"};
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  if (size == 0) return 0;
  const std::string_view text = text_of(data + 1, size - 1);
  if (data[0] == 'p') {
    take_packed(std::string(text));
    return 0;
  }
  if (data[0] == 't') {
    JointHistory history({{"elbow", false}, {"shoulder", true}});
    if (!read_joint_table(text, "joints", history)) return 0;
    for (const double time : {-1e3, 0.0, 0.01, 1e3}) {
      const auto position = history.at(0, time, 0.1, true);
      require(position || !position.error().message.empty(), "errors have words");
    }
    return 0;
  }
  const auto robot = parse_urdf(text, "robot.urdf", {}, RobotGeometry::collision);
  if (!robot) {
    require(!robot.error().message.empty(), "errors have words");
    return 0;
  }
  require(robot->joints.size() + 1 == robot->links.size(), "a robot is a tree");
  std::vector<bool> is_placed(robot->links.size());
  is_placed[robot->root] = true;
  for (const RobotJoint& joint : robot->joints) {
    require(is_placed[joint.parent] && !is_placed[joint.child], "parents come before children");
    require(joint.source < robot->joints.size(), "a joint follows one that there is");
    is_placed[joint.child] = true;
  }
  for (const RobotLink& link : robot->links) {
    for (const auto& triangle : link.mesh.triangles) {
      for (const std::uint32_t id : triangle) {
        require(id < link.mesh.vertices.size(), "triangles have corners that there are");
      }
    }
  }
  const std::vector<double> positions(robot->joints.size(), 0.5);
  std::vector<Pose> X_BL(robot->links.size());
  robot->place(positions, X_BL);
  return 0;
}
