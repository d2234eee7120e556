// Messages of ROS 2 from other programs. The first byte says of which type.
#include "src/io/internal/ros_messages.h"
#include "src/ros/native_layout.h"
#include "tests/fuzz/target.h"

namespace palpate::fuzz {
namespace {

constexpr const char* kTypes[] = {"tf2_msgs/TFMessage",
                                  "geometry_msgs/PoseStamped",
                                  "sensor_msgs/CameraInfo",
                                  "sensor_msgs/JointState",
                                  "visualization_msgs/MarkerArray",
                                  "diagnostic_msgs/DiagnosticArray",
                                  "rmw_dds_common/ParticipantEntitiesInfo"};

const NativeLayout& layout_of(std::size_t index) {
  static const auto& layouts = *new std::vector<NativeLayout>(std::begin(kTypes), std::end(kTypes));
  return layouts[index % layouts.size()];
}

}  // namespace

std::vector<std::string> seeds() {
  const RosTransform transforms[] = {{"world", "camera", {}}, {"camera", "tool", {}}};
  const std::string joints[] = {"elbow", "wrist"};
  const double positions[] = {0.5, -1};
  const RosDiagnostic statuses[] = {{RosDiagnostic::Level::ok, "a", "b", "c", {{"d", "e"}}}};
  RosEntities entities;
  entities.node_name = "palpate";
  entities.writers.resize(2);
  DepthStreamInfo stream;
  stream.width = stream.height = 8;
  return {'\0' + transform_message(5, transforms),
          '\1' + pose_message({6, "camera"}, {}),
          '\2' + camera_info_message({7, "camera"}, stream),
          '\3' + joint_state_message({9, ""}, joints, positions),
          '\5' + diagnostics_message({8, ""}, statuses),
          '\6' + entities_message(entities)};
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  using namespace palpate::fuzz;
  if (size == 0) return 0;
  const std::string_view message = text_of(data + 1, size - 1);
  if (const auto transforms = read_transforms(message)) {
    for (const RosStampedTransform& each : *transforms)
      require(is_finite(each.X_PC), "a pose is finite");
  }
  if (const auto state = read_joint_state(message)) {
    require(state->names.size() == state->positions.size(), "each joint has a position");
  }
  if (const auto pose = read_pose(message)) require(is_finite(pose->pose), "a pose is finite");
  const NativeLayout& layout = layout_of(data[0]);
  const auto native = layout.to_native(message);
  if (!native) return 0;
  const std::string written = layout.from_native(native->get());
  const auto again = layout.to_native(written);
  require(again.has_value(), "what was written can be read");
  require(layout.from_native(again->get()) == written, "it comes back with the same bytes");
  return 0;
}
