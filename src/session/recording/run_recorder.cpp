#include "src/session/recording/run_recorder.h"

#include <chrono>
#include <cmath>
#include <utility>

#include "src/io/internal/ros_messages.h"
#include "src/math/internal/wrench_transform.h"
#include "src/session/internal/run_folder.h"

namespace palpate { inline namespace v0 {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t kTransformPeriod = 10'000'000;  // ns: ticks hold every pose exactly
constexpr std::uint64_t kPointsPeriod = 500'000'000;    // ns: for humans; depth holds every pixel

template <class Clock>
double seconds() {
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

}  // namespace

std::string camera_frame(std::size_t camera) {
  return camera == 0 ? "camera" : "camera_" + std::to_string(camera + 1);
}

RunRecorder::RunRecorder(const fs::path& path, const Tool& tool, const RunSetup& setup,
                         bool is_simulated, const RecordingOptions& options)
    : tool_(&tool),
      options_(options),
      is_simulated_(is_simulated),
      place_(std::make_unique<Place>()),
      setup_(setup),
      center_of_mass_T_(tool.sphere_mass().center_of_mass),
      cameras_(setup.streams.size()) {
  parts_.push_back({path.filename(), {{0, 0}}});
  place_->folder = path.parent_path();
  if (is_simulated) {
    wall_offset_ = setup.time_origin;
    last_time_ = wall_time(0);
  } else {
    const double now = seconds<std::chrono::steady_clock>();
    wall_offset_ = seconds<std::chrono::system_clock>() - now;
    last_time_ = wall_time(now);
  }
}

Result<RunRecorder> RunRecorder::create(const fs::path& path, const Tool& tool,
                                        const RunSetup& setup, bool is_simulated,
                                        const RecordingOptions& options) {
  RunRecorder recorder(path, tool, setup, is_simulated, options);
  auto writer = recorder.make_file(path);
  if (!writer) return writer.error();
  recorder.writer_ = *std::move(writer);
  if (const Status status = recorder.begin({}); !status) return status.error();
  return recorder;
}

void RunRecorder::has_moved_to(const fs::path& folder) {
  const std::lock_guard lock(place_->mutex);
  place_->folder = folder;
}

fs::path RunRecorder::folder() const {
  const std::lock_guard lock(place_->mutex);
  return place_->folder;
}

std::uint64_t RunRecorder::wall_time(double time) {
  const double wall = 1e9 * (time + wall_offset_);
  if (wall >= 0 && wall < 1e19) last_time_ = static_cast<std::uint64_t>(wall);
  return last_time_;
}

void RunRecorder::write(std::uint16_t channel, std::uint64_t time, std::string_view message) {
  if (!writer_) return;
  if (const Status status = writer_->write(channel, time, message); !status) pause(status.error());
}

void RunRecorder::add_settings(std::uint32_t revision, const RunSettings& settings) {
  setup_.revision = revision;
  setup_.settings = settings;
  write(channels_.settings, last_time_, settings_message(setup_));
}

void RunRecorder::add_frame(const FrameRecord& record, const DepthFrame& frame) {
  if (!writer_) return;
  const std::uint64_t time = wall_time(record.capture_time);
  const DepthStreamInfo& stream = setup_.streams[record.camera];
  const Channels::Camera& channels = channels_.cameras[record.camera];
  Camera& camera = cameras_[record.camera];
  const std::string frame_name = camera_frame(record.camera);
  const RosHeader header{time, frame_name};
  write(channels_.frame, time, frame_message(record));
  if (stream.has_flow && !frame.flow.empty()) {
    write(channels.flow, time, flow_message(header, frame));
  }
  write(channels.depth, time, image_message(header, frame));
  write(channels.info, time, camera_info_message(header, stream));
  if (stream.is_moving || camera.X_WC != record.X_WC) {
    add_camera_pose(record.camera, record.X_WC, time);
  }
  if (time < camera.next_points) return;
  camera.next_points = time + kPointsPeriod;
  write(channels.points, time, points_message(header, frame, stream.intrinsics));
}

/// Writes the pose of a camera: once, or at each frame if it moves.
void RunRecorder::add_camera_pose(std::uint32_t camera, const Pose& X_WC, std::uint64_t time) {
  cameras_[camera].X_WC = X_WC;
  const bool is_moving = setup_.streams[camera].is_moving;
  const std::string frame = camera_frame(camera);
  const RosTransform pose[] = {{kWorldFrame, frame.c_str(), X_WC}};
  write(is_moving ? channels_.transforms : channels_.statics, time, transform_message(time, pose));
}

void RunRecorder::add_contact(const ContactRecord& contact) {
  write(channels_.contact, wall_time(contact.contact.time), contact_message(contact));
}

void RunRecorder::add_tick(const TickRecord& tick) {
  if (writer_) add_mark(parts_.back(), *writer_);
  if (std::floor(tick.time) > std::floor(time_)) change_parts(tick.number);  // each second
  time_ = tick.time;
  if (!writer_) return;
  const std::uint64_t time = wall_time(tick.device.time);
  write(channels_.tick, time, tick_message(tick));
  // Wrenches act at the origins of their frames, in their axes.
  const Pose& X_WT = tick.step.X_WT;
  Wrench on_tool_W = tick.step.contact_W;
  on_tool_W.torque += cross(rotate(X_WT.rotation, center_of_mass_T_), on_tool_W.force);
  write(channels_.tool_wrench, time,
        wrench_message({time, kToolFrame}, expressed_in(X_WT.rotation, on_tool_W)));
  write(channels_.hand_wrench, time,
        wrench_message({time, kHandFrame}, expressed_in(tick.device.X_BH.rotation, tick.F_H_B)));
  if (time >= next_transforms_) add_transforms(tick, time);
}

void RunRecorder::add_transforms(const TickRecord& tick, std::uint64_t time) {
  next_transforms_ = time + kTransformPeriod;
  const RosTransform moving[] = {{kWorldFrame, kToolFrame, tick.step.X_WT},
                                 {kBaseFrame, kHandFrame, tick.device.X_BH},
                                 {kWorldFrame, "tool_in_hand", tick.step.X_WT_hand}};
  write(channels_.transforms, time, transform_message(time, moving));
}

void RunRecorder::add_note(std::string_view text) {
  write(channels_.note, last_time_, note_message(text));
}

void RunRecorder::add_note(std::string_view text, double time) {
  write(channels_.note, wall_time(time), note_message(text));
}

}}  // namespace palpate::v0
