#include "src/session/run_recorder.h"

#include <chrono>
#include <cmath>
#include <utility>

#include "palpate/io/tool_file.h"
#include "src/session/ros_messages.h"

namespace palpate {
namespace {

constexpr std::uint64_t kTransformPeriod = 10'000'000;  // ns: ticks hold every pose exactly
constexpr std::uint64_t kPointsPeriod = 500'000'000;    // ns: for people; depth holds every pixel

// Frames, as ROS names them: world = camera, base of the device, handle, tool.
constexpr const char* kWorld = "world";
constexpr const char* kCamera = "camera";
constexpr const char* kBase = "base";
constexpr const char* kHand = "hand";
constexpr const char* kToolFrame = "tool";

template <class Clock>
double seconds() {
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

McapChannel ros_channel(const char* topic, std::string type) {
  const std::string schema = message_schema(type);
  type.insert(type.find('/'), "/msg");
  return {topic, type, schema};
}

Wrench turned_into(const Quaternion& q_AB, const Wrench& wrench_A) {
  const Quaternion q_BA = conjugate(q_AB);
  return {rotate(q_BA, wrench_A.force), rotate(q_BA, wrench_A.torque)};
}

}  // namespace

RunRecorder::RunRecorder(McapWriter writer, const Tool& tool, const RunSetup& setup,
                         bool is_simulated)
    : writer_(std::move(writer)),
      setup_(setup),
      centre_of_mass_T_(tool.sphere_mass().centre_of_mass) {
  settings_ = writer_.add_channel(settings_channel());
  frame_ = writer_.add_channel(frame_channel());
  contact_ = writer_.add_channel(contact_channel());
  tick_ = writer_.add_channel(tick_channel());
  note_ = writer_.add_channel(note_channel());
  depth_ = writer_.add_channel(ros_channel(kDepthTopic, "sensor_msgs/Image"));
  points_ = writer_.add_channel(ros_channel("/depth/points", "sensor_msgs/PointCloud2"));
  camera_ = writer_.add_channel(ros_channel("/camera_info", "sensor_msgs/CameraInfo"));
  transforms_ = writer_.add_channel(ros_channel("/tf", "tf2_msgs/TFMessage"));
  statics_ = writer_.add_channel(ros_channel("/tf_static", "tf2_msgs/TFMessage"));
  tool_wrench_ = writer_.add_channel(ros_channel("/tool/wrench", "geometry_msgs/WrenchStamped"));
  hand_wrench_ = writer_.add_channel(ros_channel("/hand/wrench", "geometry_msgs/WrenchStamped"));
  marker_ = writer_.add_channel(ros_channel("/tool/marker", "visualization_msgs/Marker"));
  if (is_simulated) {
    wall_offset_ = setup.time_origin;
    last_time_ = wall_time(0);
  } else {
    const double now = seconds<std::chrono::steady_clock>();
    wall_offset_ = seconds<std::chrono::system_clock>() - now;
    last_time_ = wall_time(now);
  }
}

Result<RunRecorder> RunRecorder::create(const std::filesystem::path& path, const Tool& tool,
                                        const RunSetup& setup, bool is_simulated) {
  auto writer = McapWriter::create(path);
  if (!writer) return writer.error();
  // On the disk before the run: without them nothing else can be understood.
  const auto attach = [&](const std::string& name, const Tool& shape) -> Status {
    const auto bytes = tool_to_bytes(shape);
    if (!bytes) return bytes.error();
    return writer->attach(name, "application/x-palpate-tool", *bytes);
  };
  if (const Status status = attach(kToolFile, tool); !status) return status.error();
  for (std::size_t i = 0; i < setup.settings.objects.size(); ++i) {
    const Status status = attach(object_file(i), *setup.settings.objects[i].shape);
    if (!status) return status.error();
  }
  RunRecorder recorder(*std::move(writer), tool, setup, is_simulated);
  if (const Status status = recorder.begin(tool); !status) return status.error();
  return recorder;
}

Status RunRecorder::begin(const Tool& tool) {
  write(settings_, last_time_, settings_message(setup_));
  const RosTransform fixed[] = {{kWorld, kCamera, {}},
                                {kWorld, kBase, setup_.settings.coupling.X_WB}};
  write(statics_, last_time_, transform_message(last_time_, fixed));
  write(camera_, last_time_, camera_info_message({last_time_, kCamera}, setup_.stream));
  write(marker_, last_time_, tool_marker_message({last_time_, kToolFrame}, tool.mesh()));
  return writer_.flush();
}

void RunRecorder::end_with(const Error& error) {
  trouble_ = "the recording ended before the run: " + error.message;
}

std::uint64_t RunRecorder::wall_time(double time) {
  const double wall = 1e9 * (time + wall_offset_);
  if (wall >= 0 && wall < 1e19) last_time_ = static_cast<std::uint64_t>(wall);
  return last_time_;
}

void RunRecorder::write(std::uint16_t channel, std::uint64_t time, std::string_view message) {
  if (!trouble_.empty()) return;
  if (const Status status = writer_.write(channel, time, message); !status) {
    end_with(status.error());
  }
}

void RunRecorder::add_settings(std::uint32_t revision, const RunSettings& settings) {
  setup_.revision = revision;
  setup_.settings = settings;
  write(settings_, last_time_, settings_message(setup_));
}

void RunRecorder::add_frame(const FrameRecord& record, const DepthFrame& frame) {
  if (!trouble_.empty()) return;
  const std::uint64_t time = wall_time(record.capture_time);
  write(frame_, time, frame_message(record));
  write(depth_, time, image_message({time, kCamera}, frame));
  write(camera_, time, camera_info_message({time, kCamera}, setup_.stream));
  if (time < next_points_) return;
  next_points_ = time + kPointsPeriod;
  write(points_, time, points_message({time, kCamera}, frame, setup_.stream.intrinsics));
}

void RunRecorder::add_contact(const ContactRecord& contact) {
  if (trouble_.empty()) write(contact_, wall_time(contact.contact.time), contact_message(contact));
}

void RunRecorder::add_tick(const TickRecord& tick) {
  if (!trouble_.empty()) return;
  const std::uint64_t time = wall_time(tick.device.time);
  write(tick_, time, tick_message(tick));
  // At the origins of their frames, in their axes.
  const Pose& X_WT = tick.step.X_WT;
  Wrench on_tool_W = tick.step.contact_W;
  on_tool_W.torque += cross(rotate(X_WT.rotation, centre_of_mass_T_), on_tool_W.force);
  write(tool_wrench_, time,
        wrench_message({time, kToolFrame}, turned_into(X_WT.rotation, on_tool_W)));
  write(hand_wrench_, time,
        wrench_message({time, kHand}, turned_into(tick.device.X_BH.rotation, tick.F_H_B)));
  if (time >= next_transforms_) add_transforms(tick, time);
}

void RunRecorder::add_transforms(const TickRecord& tick, std::uint64_t time) {
  next_transforms_ = time + kTransformPeriod;
  const RosTransform moving[] = {{kWorld, kToolFrame, tick.step.X_WT},
                                 {kBase, kHand, tick.device.X_BH},
                                 {kWorld, "tool_in_hand", tick.step.X_WT_hand}};
  write(transforms_, time, transform_message(time, moving));
}

void RunRecorder::add_note(std::string_view text) { write(note_, last_time_, note_message(text)); }

void RunRecorder::add_note(std::string_view text, double time) {
  write(note_, wall_time(time), note_message(text));
}

void RunRecorder::finish() {
  const Status status = writer_.finish();
  if (!status && trouble_.empty()) end_with(status.error());
}

}  // namespace palpate
