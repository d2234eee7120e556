#include "src/io/internal/ros_messages.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "src/io/internal/cdr.h"
#include "src/io/internal/ros_image.h"

namespace palpate { inline namespace v0 {
namespace {

void put(CdrWriter& to, std::uint64_t time) {
  constexpr std::uint64_t kSecond = 1'000'000'000;
  to.number(static_cast<std::int32_t>(time / kSecond));
  to.number(static_cast<std::uint32_t>(time % kSecond));
}
void put(CdrWriter& to, const RosHeader& header) {
  put(to, header.time);
  to.text(header.frame);
}
void put(CdrWriter& to, const Vec3d& v) {
  for (int axis = 0; axis < 3; ++axis) to.number(v[axis]);
}
void put(CdrWriter& to, const Pose& X) {
  put(to, X.translation);
  for (const double value : {X.rotation.x, X.rotation.y, X.rotation.z, X.rotation.w}) {
    to.number(value);
  }
}

/// False: these are no numbers of a pose.
bool take_pose(CdrReader& from, Pose& X) {
  for (int axis = 0; axis < 3; ++axis) X.translation[axis] = from.number<double>();
  Quaternion& q = X.rotation;
  for (double* part : {&q.x, &q.y, &q.z, &q.w}) *part = from.number<double>();
  const double size = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
  if (!from.is_good() || !is_finite(X) || !(std::abs(size - 1) < 0.1)) return false;
  q = normalized(q);
  return true;
}

Error no_pose(const char* what) {
  return {Errc::bad_input, std::string(what) + " is damaged or has an invalid pose"};
}

constexpr const char* kNoJointState =
    "a JointState is damaged or has not one position for each name";

struct RosMarker {
  std::string_view name;
  std::int32_t number = 0, type = 0;
  double scale = 1;
  std::array<float, 4> color{};
  bool is_locked = false;  // to its frame, wherever that goes
  Pose X = {};
};
constexpr std::int32_t kSphereList = 7, kTriangleList = 11;

/// Writes a marker; without points, viewers delete it.
void put(CdrWriter& to, const RosHeader& header, const RosMarker& marker,
         std::span<const Vec3d> points) {
  const std::int32_t add = 0, remove = 2;
  put(to, header);
  to.text(marker.name);
  for (const std::int32_t number : {marker.number, marker.type, points.empty() ? remove : add}) {
    to.number(number);
  }
  put(to, marker.X);
  put(to, Vec3d{1, 1, 1} * marker.scale);
  for (const float color : marker.color) to.number(color);
  put(to, std::uint64_t{0});  // for ever
  to.number(marker.is_locked);
  to.number(static_cast<std::uint32_t>(points.size()));
  for (const Vec3d& point : points) put(to, point);
  to.number(std::uint32_t{0});  // colors
  to.text("");
  put(to, RosHeader{});  // texture
  to.text("");
  to.number(std::uint32_t{0});
  to.number(std::uint32_t{0});  // coordinates on it
  to.text("");
  to.text("");
  to.text("");  // mesh file
  to.number(std::uint32_t{0});
  to.number(false);
}

constexpr RosMarker kToolMarker{"tool", 0, kTriangleList, 1, {0.35f, 0.6f, 0.85f, 1}, true};

/// Writes a mesh as a marker, of large ones every n-th triangle.
void put(CdrWriter& to, const RosHeader& header, const RosMarker& marker,
         const TriangleMesh& mesh) {
  constexpr std::size_t kMaxTriangles = 20000;
  const std::size_t step = (mesh.triangles.size() + kMaxTriangles - 1) / kMaxTriangles;
  std::vector<Vec3d> corners;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += step) {
    for (const auto corner : mesh.triangles[i]) {
      corners.push_back(mesh.vertices[static_cast<std::size_t>(corner)]);
    }
  }
  put(to, header, marker, std::span<const Vec3d>(corners));
}

/// sensor_msgs/Image, whose pixels have so many numbers each.
template <class T>
std::string image(const RosHeader& header, const DepthFrame& frame, const char* encoding,
                  const std::vector<T>& numbers, std::size_t num_channels) {
  CdrWriter to;
  put(to, header);
  to.number(static_cast<std::uint32_t>(frame.height));
  to.number(static_cast<std::uint32_t>(frame.width));
  to.text(encoding);
  to.number(std::uint8_t{0});
  to.number(static_cast<std::uint32_t>(num_channels * sizeof(T)) *
            static_cast<std::uint32_t>(frame.width));
  to.bytes(numbers.data(), sizeof(T) * numbers.size());
  return to.take();
}

}  // namespace

std::string image_message(const RosHeader& header, const DepthFrame& frame) {
  return image(header, frame, "16UC1", frame.pixels, 1);
}

std::string flow_message(const RosHeader& header, const DepthFrame& frame) {
  return image(header, frame, "32FC2", frame.flow, 2);
}

std::string camera_info_message(const RosHeader& header, const DepthStreamInfo& stream) {
  const auto& [fx, fy, cx, cy] = stream.intrinsics;
  CdrWriter to;
  put(to, header);
  to.number(static_cast<std::uint32_t>(stream.height));
  to.number(static_cast<std::uint32_t>(stream.width));
  to.text("plumb_bob");
  to.number(std::uint32_t{5});
  for (int i = 0; i < 5; ++i) to.number(0.0);
  for (const double k : {fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0}) to.number(k);
  for (const double r : {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}) to.number(r);
  for (const double p : {fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0}) to.number(p);
  for (int i = 0; i < 6; ++i) to.number(std::uint32_t{0});
  to.number(false);
  return to.take();
}

std::string points_message(const RosHeader& header, const DepthFrame& frame,
                           const Intrinsics& intrinsics, const Pose& X_AC) {
  constexpr std::uint8_t kFloat32 = 7;
  const auto [fx, fy, cx, cy] = intrinsics;
  int step = 1;
  while (((frame.width + step - 1) / step) * ((frame.height + step - 1) / step) >
         kMaxRecordedPoints) {
    ++step;
  }
  std::vector<Vec3f> points;
  for (int v = 0; v < frame.height; v += step) {
    for (int u = 0; u < frame.width; u += step) {
      const int count = frame.pixels[static_cast<std::size_t>(v * frame.width + u)];
      if (count == 0 || count == 65535) continue;
      const double z = count * frame.unit;
      const Vec3d p_C{(u - cx) / fx * z, (v - cy) / fy * z, z};
      points.push_back(to_float(X_AC == Pose{} ? p_C : X_AC * p_C));
    }
  }
  const auto num_points = static_cast<std::uint32_t>(points.size());
  CdrWriter to;
  put(to, header);
  to.number(std::uint32_t{1});
  to.number(num_points);
  to.number(std::uint32_t{3});
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    to.text(std::string_view("xyz").substr(axis, 1));
    to.number(static_cast<std::uint32_t>(axis * sizeof(float)));
    to.number(kFloat32);
    to.number(std::uint32_t{1});
  }
  to.number(false);
  to.number(static_cast<std::uint32_t>(sizeof(Vec3f)));
  to.number(static_cast<std::uint32_t>(num_points * sizeof(Vec3f)));
  to.bytes(points.data(), num_points * sizeof(Vec3f));
  to.number(true);
  return to.take();
}

std::string transform_message(std::uint64_t time, std::span<const RosTransform> transforms) {
  CdrWriter to;
  to.number(static_cast<std::uint32_t>(transforms.size()));
  for (const auto& [parent, child, X_PC] : transforms) {
    put(to, RosHeader{time, parent});
    to.text(child);
    put(to, X_PC);
  }
  return to.take();
}

std::string wrench_message(const RosHeader& header, const Wrench& wrench) {
  CdrWriter to;
  put(to, header);
  put(to, wrench.force);
  put(to, wrench.torque);
  return to.take();
}

std::string tool_marker_message(const RosHeader& header, const TriangleMesh& mesh) {
  CdrWriter to;
  put(to, header, kToolMarker, mesh);
  return to.take();
}

std::string mesh_markers_message(std::string_view tool_frame, const TriangleMesh& tool,
                                 std::span<const RosBody> bodies) {
  constexpr std::array<float, 4> kWood{0.8f, 0.65f, 0.45f, 1};
  CdrWriter to;
  to.number(static_cast<std::uint32_t>(1 + bodies.size()));
  put(to, {0, tool_frame}, kToolMarker, tool);
  std::int32_t number = 0;  // one may be called as the tool is
  for (const auto& [frame, name, mesh, X_FB] : bodies) {
    put(to, {0, frame}, {name, ++number, kTriangleList, 1, kWood, true, X_FB}, mesh);
  }
  return to.take();
}

std::string sphere_markers_message(const RosHeader& header, std::span<const Sphere> spheres,
                                   std::span<const RosSphere> states) {
  constexpr std::size_t kNumSizes = 8, kNumStates = checked_names<RosSphere>().size();
  constexpr std::array<std::array<float, 4>, kNumStates> kColors{{{0.6f, 0.6f, 0.6f, 0.3f},
                                                                  {1, 0.7f, 0.1f, 1},
                                                                  {0.9f, 0.1f, 0.1f, 1},
                                                                  {0.3f, 0.3f, 0.9f, 0.6f}}};
  float least = std::numeric_limits<float>::max(), most = 0;
  for (const Sphere& sphere : spheres) {
    least = std::min(least, sphere.radius);
    most = std::max(most, sphere.radius);
  }
  const double range = std::max(std::log(double(most) / double(least)), 1e-9);
  struct Group {
    std::vector<Vec3d> centers;
    double radii = 0;
  };
  std::array<std::array<Group, kNumSizes>, kNumStates> groups;
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    const double size = std::log(double(spheres[i].radius) / double(least)) / range;
    const auto number = std::min(static_cast<std::size_t>(size * kNumSizes), kNumSizes - 1);
    Group& group = groups[static_cast<std::size_t>(states[i])][number];
    group.centers.push_back(to_double(spheres[i].center));
    group.radii += double(spheres[i].radius);
  }
  CdrWriter to;
  to.number(static_cast<std::uint32_t>(kNumStates * kNumSizes));
  for (std::size_t state = 0; state < kNumStates; ++state) {
    for (std::size_t size = 0; size < kNumSizes; ++size) {
      const auto& [centers, radii] = groups[state][size];
      const double diameter = centers.empty() ? 1 : 2 * radii / double(centers.size());
      put(to, header,
          {checked_names<RosSphere>()[state], static_cast<std::int32_t>(size), kSphereList,
           diameter, kColors[state], false},
          centers);
    }
  }
  return to.take();
}

std::string pose_message(const RosHeader& header, const Pose& X) {
  CdrWriter to;
  put(to, header);
  put(to, X);
  return to.take();
}

std::string twist_message(const RosHeader& header, const Twist& V) {
  CdrWriter to;
  put(to, header);
  put(to, V.linear);
  put(to, V.angular);
  return to.take();
}

std::string joint_state_message(const RosHeader& header, std::span<const std::string> names,
                                std::span<const double> positions) {
  CdrWriter to;
  put(to, header);
  to.number(static_cast<std::uint32_t>(names.size()));
  for (const std::string& name : names) to.text(name);
  to.number(static_cast<std::uint32_t>(positions.size()));
  for (const double position : positions) to.number(position);
  for (int i = 0; i < 2; ++i) to.number(std::uint32_t(0));  // velocities and efforts
  return to.take();
}

std::string diagnostics_message(const RosHeader& header, std::span<const RosDiagnostic> statuses) {
  CdrWriter to;
  put(to, header);
  to.number(static_cast<std::uint32_t>(statuses.size()));
  for (const RosDiagnostic& status : statuses) {
    to.number(status.level);
    for (const std::string& text : {status.name, status.message, status.hardware}) to.text(text);
    to.number(static_cast<std::uint32_t>(status.values.size()));
    for (const auto& [key, value] : status.values) {
      to.text(key);
      to.text(value);
    }
  }
  return to.take();
}

std::string ros_contact_message(const RosHeader& header, const RosContact& contact) {
  CdrWriter to;
  put(to, header);
  to.number(contact.state);
  to.text(contact.reason);
  for (const double number : {contact.volume, contact.fraction, contact.unseen, contact.potential,
                              contact.max_stiffness}) {
    to.number(number);
  }
  put(to, contact.wrench.force);
  put(to, contact.wrench.torque);
  for (const double number : contact.stiffness) to.number(number);
  to.number(contact.depth_age);
  to.number(contact.contact_age);
  to.number(contact.status);
  to.number(contact.volume_std);
  put(to, contact.force_std);
  put(to, contact.torque_std);
  return to.take();
}

std::string entities_message(const RosEntities& entities) {
  CdrWriter to;
  const auto put_gid = [&](const RosGid& gid) {
    for (const std::uint8_t byte : gid) to.number(byte);
  };
  put_gid(entities.participant);
  to.number(std::uint32_t{1});
  to.text(entities.node_namespace);
  to.text(entities.node_name);
  for (const auto* gids : {&entities.readers, &entities.writers}) {
    to.number(static_cast<std::uint32_t>(gids->size()));
    for (const RosGid& gid : *gids) put_gid(gid);
  }
  return to.take();
}

Result<std::vector<RosStampedTransform>> read_transforms(std::string_view message,
                                                         std::set<std::string>* no_poses) {
  CdrReader from(message);
  const std::size_t num = from.number<std::uint32_t>();
  std::vector<RosStampedTransform> transforms;
  for (std::size_t i = 0; i < num && from.is_good(); ++i) {
    const auto [time, frame] = read_ros_header(from);
    RosStampedTransform& transform = transforms.emplace_back();
    transform.time = time;
    transform.parent = frame;
    transform.child = from.text();
    if (take_pose(from, transform.X_PC)) continue;
    if (no_poses != nullptr && from.is_good()) no_poses->insert(transform.child);
    transforms.pop_back();  // as tf2 does
  }
  if (!from.is_good()) return no_pose("a TFMessage");
  return transforms;
}

Result<RosStampedPose> read_pose(std::string_view message) {
  CdrReader from(message);
  const auto [time, frame] = read_ros_header(from);
  RosStampedPose pose{time, std::string(frame), {}};
  if (!take_pose(from, pose.pose)) return no_pose("a PoseStamped");
  return pose;
}

Result<RosJointState> read_joint_state(std::string_view message) {
  CdrReader from(message);
  RosJointState state;
  state.time = read_ros_header(from).time;
  const std::size_t num_names = from.number<std::uint32_t>();
  for (std::size_t i = 0; i < num_names && from.is_good(); ++i) {
    state.names.emplace_back(from.text());
  }
  const std::size_t num = from.number<std::uint32_t>();
  for (std::size_t i = 0; i < num && from.is_good(); ++i) {
    state.positions.push_back(from.number<double>());
  }
  if (!from.is_good() || (num != 0 && num != num_names)) {
    return Error{Errc::bad_input, kNoJointState};
  }
  state.names.resize(num);
  return state;
}

}}  // namespace palpate::v0
