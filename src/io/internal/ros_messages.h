// Messages of ROS 2 as bytes (CDR, little-endian), for recordings and other programs. ros_types.h
// has their definitions.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/math/geometry.h"
#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

/// When, in ns since 1970 (or since the run began), and in which frame.
struct RosHeader {
  std::uint64_t time = 0;
  std::string_view frame;
};

/// 16UC1: counts as they were measured. read_depth_image of ros_image.h reads it.
std::string image_message(const RosHeader& header, const DepthFrame& frame);
/// sensor_msgs/Image, 32FC2: its optical flow, pixels per second.
std::string flow_message(const RosHeader& header, const DepthFrame& frame);
std::string camera_info_message(const RosHeader& header, const DepthStreamInfo& stream);
/// sensor_msgs/PointCloud2 with float32 x, y, z, m, in the frame A of the header: the measured
/// pixels of every n-th row and column, so that there are at most kMaxRecordedPoints.
inline constexpr int kMaxRecordedPoints = 20000;
std::string points_message(const RosHeader& header, const DepthFrame& frame,
                           const Intrinsics& intrinsics, const Pose& X_AC = {});

struct RosTransform {
  std::string_view parent, child;
  Pose X_PC;
};
std::string transform_message(std::uint64_t time, std::span<const RosTransform> transforms);
/// Force and torque at the origin of the header's frame, in its axes.
std::string wrench_message(const RosHeader& header, const Wrench& wrench);
/// visualization_msgs/Marker: the tool's mesh, at rest in its frame; of large ones every n-th
/// triangle.
std::string tool_marker_message(const RosHeader& header, const TriangleMesh& mesh);

/// A body as it is drawn.
struct RosBody {
  std::string_view frame, name;
  const TriangleMesh& mesh;
  Pose X_FB;  ///< at rest there in its frame, wherever that goes
};
/// visualization_msgs/MarkerArray: the tool in its frame, like that one, and bodies.
std::string mesh_markers_message(std::string_view tool_frame, const TriangleMesh& tool,
                                 std::span<const RosBody> bodies);

/// State of a sphere of the tool, by which it is colored.
enum class RosSphere : std::uint8_t { free, touching, inside, unseen };
constexpr auto names_of(RosSphere) { return std::array{"free", "touching", "inside", "unseen"}; }
/// visualization_msgs/MarkerArray: for each state and each of eight ranges of radii one SPHERE_LIST
/// (all its spheres are as large as their mean), in the color of the state; empty lists are
/// deleted. In the frame of the header, by poses that the tool had at that time. `states`: of each
/// sphere.
std::string sphere_markers_message(const RosHeader& header, std::span<const Sphere> spheres,
                                   std::span<const RosSphere> states);
std::string pose_message(const RosHeader& header, const Pose& X);
/// geometry_msgs/TwistStamped.
std::string twist_message(const RosHeader& header, const Twist& V);
std::string joint_state_message(const RosHeader& header, std::span<const std::string> names,
                                std::span<const double> positions);

struct RosDiagnostic {
  enum class Level : std::uint8_t { ok, warning, error, stale };

  Level level = Level::ok;
  std::string name, message, hardware;
  std::vector<std::pair<std::string, std::string>> values;
};
/// diagnostic_msgs/DiagnosticArray.
std::string diagnostics_message(const RosHeader& header, std::span<const RosDiagnostic> statuses);

/// palpate_msgs/Contact: how the tool touches, for robots. Wrench and stiffness are at the origin
/// of the header's frame, in its axes; the stiffness, row by row, says what the wrench loses with a
/// small shift and turn of the tool.
struct RosContact {
  enum class State : std::uint8_t { valid, stale, failed };

  State state = State::valid;
  std::string reason;        ///< why it is not valid: then all numbers are 0
  double volume = 0;         ///< m3
  double fraction = 0;       ///< of the tool's volume
  double unseen = 0;         ///< share of it where no camera sees
  double potential = 0;      ///< m4
  double max_stiffness = 0;  ///< N/m
  Wrench wrench;             ///< N, N m
  std::array<double, 36> stiffness{};
  double depth_age = 0;      ///< s, of the depth image at the header's time
  double contact_age = 0;    ///< s, of the query likewise
  std::uint32_t status = 0;  ///< bits of StepStatus
  /// Standard deviations in m3, N and N m by the noise of the depth, the torque's about the center
  /// of mass; not numbers if nobody asked.
  double volume_std = std::numeric_limits<double>::quiet_NaN();
  Vec3d force_std{volume_std, volume_std, volume_std}, torque_std = force_std;
};
std::string ros_contact_message(const RosHeader& header, const RosContact& contact);

/// palpate_msgs/Guard: how far a robot is from what cameras see, and what keeps it away. Joint
/// velocities v keep to row . v <= bound, for each row.
struct RosGuard {
  RosContact::State state = RosContact::State::valid;
  std::string reason;    ///< why it is not valid: then all but depth_age is 0, without rows
  std::string assumes;   ///< what counts where no camera has seen anything
  double clearance = 0;  ///< m: least of all links
  std::string link;      ///< that has it; empty: it is farther than cameras are asked
  double unseen = 0;     ///< share of the robot's volume in space that no camera has seen
  double scale = 0;      ///< 0 to 1, for velocities
  double depth_age = 0;  ///< s, of the oldest depth image at the header's time
  bool is_held = false;  ///< a joint was beyond its limits, and counts as held there
  std::span<const std::string> joints = {};    ///< n, of the columns
  std::vector<std::string> links = {};         ///< of the rows
  std::vector<double> clearances = {};         ///< m, of these
  std::vector<double> rows = {}, bounds = {};  ///< row-major, x n, m/rad or m/m; m/s
};
std::string ros_guard_message(const RosHeader& header, const RosGuard& guard);
/// std_msgs/Float64
std::string number_message(double number);

/// Identifies an entity of DDS, as ROS 2 announces it from Iron on.
using RosGid = std::array<std::uint8_t, 16>;
/// rmw_dds_common/ParticipantEntitiesInfo of a participant with one node.
struct RosEntities {
  RosGid participant{};
  std::string node_namespace, node_name;
  std::vector<RosGid> readers, writers;
};
std::string entities_message(const RosEntities& entities);

// Readers. Errors: a damaged message, numbers that are no pose.

struct RosStampedTransform {
  double time = 0;  ///< s since 1970
  std::string parent, child;
  Pose X_PC;
};
/// Those whose numbers are no pose are left out, and their children named.
Result<std::vector<RosStampedTransform>> read_transforms(std::string_view message,
                                                         std::set<std::string>* no_poses = nullptr);
struct RosStampedPose {
  double time = 0;  ///< s since 1970
  std::string frame;
  Pose pose;
};
Result<RosStampedPose> read_pose(std::string_view message);
struct RosJointState {
  double time = 0;  ///< s since 1970
  std::vector<std::string> names;
  std::vector<double> positions;  ///< of each, rad or m; NaN: its hardware reports nothing
};
/// sensor_msgs/JointState; those without positions have no names here.
Result<RosJointState> read_joint_state(std::string_view message);

}}  // namespace palpate::v0
