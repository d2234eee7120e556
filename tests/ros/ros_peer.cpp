// Our side of a conversation with other implementations, one line of standard input at a time:
//   hash TYPE            answers the type's hash
//   again TYPE DIGITS    a message in hexadecimal digits: answers it, after it was a structure of C
//   sample NAME          answers a message that src/io makes
#include <cstdint>
#include <iostream>
#include <sstream>
#include <string>

#include "src/io/internal/ros_messages.h"
#include "src/ros/native_layout.h"

namespace palpate {
namespace {

std::string digits_of(std::string_view bytes) {
  std::string digits;
  for (const char byte : bytes) {
    digits += "0123456789abcdef"[static_cast<unsigned char>(byte) >> 4];
    digits += "0123456789abcdef"[byte & 15];
  }
  return digits;
}

std::string bytes_of(const std::string& digits) {
  std::string bytes;
  for (std::size_t i = 0; i + 1 < digits.size(); i += 2) {
    bytes += static_cast<char>(std::stoi(digits.substr(i, 2), nullptr, 16));
  }
  return bytes;
}

std::string sample(const std::string& name) {
  const RosHeader header{1'700'000'000'123'456'789, "camera_depth_optical_frame"};
  const Pose X{{1, -2, 3}, {0.5, -0.5, 0.5, 0.5}};
  DepthFrame frame;
  frame.width = 8;
  frame.height = 8;
  for (std::uint16_t i = 0; i < 64; ++i) frame.pixels.push_back(i);
  DepthStreamInfo stream;
  stream.width = stream.height = 8;
  stream.intrinsics = {100, 101, 3.5, 3.25};
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}};
  if (name == "Image") return image_message(header, frame);
  if (name == "CameraInfo") return camera_info_message(header, stream);
  if (name == "PointCloud2") return points_message(header, frame, stream.intrinsics);
  if (name == "TFMessage") {
    const RosTransform transforms[] = {{"world", "camera", X}, {"camera", "tool", {}}};
    return transform_message(header.time, transforms);
  }
  if (name == "WrenchStamped") return wrench_message(header, {{1, 2, 3}, {4, 5, 6}});
  if (name == "PoseStamped") return pose_message(header, X);
  if (name == "TwistStamped") return twist_message(header, {{1, 2, 3}, {4, 5, 6}});
  if (name == "Marker") return tool_marker_message(header, mesh);
  if (name == "MarkerArray") {
    const Sphere spheres[] = {{{1, 2, 3}, 0.5f}, {{4, 5, 6}, 0.25f}, {{7, 8, 9}, 0.25f}};
    const RosSphere states[] = {RosSphere::inside, RosSphere::unseen, RosSphere::unseen};
    return sphere_markers_message(header, spheres, states);
  }
  if (name == "DiagnosticArray") {
    const RosDiagnostic statuses[] = {
        {RosDiagnostic::Level::stale, "palpate: touch", "no image", "H", {{"age", "0.2"}}}, {}};
    return diagnostics_message(header, statuses);
  }
  if (name == "Contact") {
    RosContact contact;
    contact.state = RosContact::State::stale;
    contact.reason = "why";
    contact.volume = 1;
    contact.unseen = 0.125;
    contact.wrench.torque.z = 6;
    contact.stiffness[35] = 36;
    contact.depth_age = 0.25;
    contact.status = 7;
    return ros_contact_message(header, contact);
  }
  if (name == "Float64") return number_message(0.375);
  if (name == "Guard") {
    const std::string joints[] = {"shoulder", "elbow"};
    RosGuard guard;
    guard.reason = "why";
    guard.assumes = "free";
    guard.clearance = 0.5;
    guard.link = "hand";
    guard.scale = 0.25;
    guard.is_held = true;
    guard.joints = joints;
    guard.links = {"hand"};
    guard.clearances = {0.5};
    guard.rows = {1, -2};
    guard.bounds = {3};
    return ros_guard_message(header, guard);
  }
  if (name == "ParticipantEntitiesInfo") {
    RosEntities entities;
    entities.participant.fill(1);
    entities.node_namespace = "/";
    entities.node_name = "palpate";
    entities.readers.resize(2);
    entities.readers[1].fill(200);
    entities.writers.resize(1);
    return entities_message(entities);
  }
  return {};
}

}  // namespace
}  // namespace palpate

int main() {
  std::string line;
  while (std::getline(std::cin, line)) {
    std::istringstream words(line);
    std::string word, what, digits;
    words >> word >> what >> digits;
    if (word == "hash") std::cout << palpate::ros_type_hash(what) << std::endl;
    if (word == "sample") std::cout << palpate::digits_of(palpate::sample(what)) << std::endl;
    if (word != "again") continue;
    const palpate::NativeLayout layout(what);
    const std::string message = palpate::bytes_of(digits);
    const auto native = layout.to_native(message);
    std::cout << (native ? palpate::digits_of(layout.from_native(native->get())) : "damaged")
              << std::endl;
  }
  return 0;
}
