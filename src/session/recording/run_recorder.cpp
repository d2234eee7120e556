#include "src/session/recording/run_recorder.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "src/io/internal/ros_messages.h"
#include "src/math/internal/wrench_transform.h"
#include "src/session/internal/lead_frames.h"
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
      setups_{setup},
      center_of_mass_T_(tool.sphere_mass().center_of_mass) {
  parts_.push_back({path.filename(), {{0, 0}}});
  place_->folder = path.parent_path();
  for (const DepthStreamInfo& stream : setup.streams) {
    cameras_.push_back({{}, 0, {}, LeadEstimate(stream)});
    cameras_.back().lead.begin(setup.revision, setup.settings);
  }
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
  if (const Status status = recorder.begin(nullptr); !status) return status.error();
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

/// Drops settings that no record after a tick of this revision uses. Contacts and frames may come
/// after a tick with later settings.
void RunRecorder::forget_settings(std::uint32_t tick_revision) {
  std::uint32_t first =
      std::min({tick_revision, setups_.back().revision, frame_revision_, contact_revision_});
  for (const Camera& camera : cameras_) {
    if (camera.frames.empty()) continue;
    first = std::min(first, camera.frames.front().record.revision);
  }
  if (!contacts_.empty()) first = std::min(first, contacts_.front().revision);
  while (setups_.size() > 1 && setups_[1].revision <= first) setups_.pop_front();
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
  setups_.push_back(setups_.back());
  setups_.back().revision = revision;
  if (!keeps_surfaces(setups_.back().settings, settings)) {
    for (Camera& camera : cameras_) camera.lead.begin(revision, settings);
  }
  setups_.back().settings = settings;
  write(channels_.settings, last_time_, settings_message(setups_.back()));
}

void RunRecorder::add_frame(const FrameRecord& record, const DepthFrame& frame) {
  write_frame(record, frame);
  cameras_[record.camera].frames.push_back({record, frame});
  frame_revision_ = record.revision;
  forget_frames();
}

void RunRecorder::write_frame(const FrameRecord& record, const DepthFrame& frame) {
  if (!writer_) return;
  const std::uint64_t time = wall_time(record.capture_time);
  const DepthStreamInfo& stream = setups_.back().streams[record.camera];
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
  const bool is_moving = setups_.back().streams[camera].is_moving;
  const std::string frame = camera_frame(camera);
  const RosTransform pose[] = {{kWorldFrame, frame.c_str(), X_WC}};
  write(is_moving ? channels_.transforms : channels_.statics, time, transform_message(time, pose));
}

void RunRecorder::add_contact(const ContactRecord& contact) {
  write(channels_.contact, wall_time(contact.contact.time), contact_message(contact));
  contacts_.push_back(contact);
  contact_revision_ = contact.revision;
}

void RunRecorder::add_tick(const TickRecord& tick) {
  if (writer_) add_mark(parts_.back(), *writer_);
  time_ = tick.time;
  forget(tick);
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

/// Drops records that no later part needs: ticks rest on the contact of this one or on later ones,
/// contacts on the frame of the first of these or on later ones, and frames on those in their lead.
void RunRecorder::forget(const TickRecord& tick) {
  while (!contacts_.empty() && contacts_.front().number < tick.contact_number) {
    contacts_.pop_front();
  }
  forget_frames();
  forget_settings(tick.revision);
}

/// Drops old frames, also while no ticks come: a device may take long to start, or be silent.
void RunRecorder::forget_frames() {
  // Numbers of frames kept while nothing is measured, and at most.
  constexpr std::int64_t kMaxIdleFrames = 4, kMaxFrames = 100;
  // A contact of earlier settings rests on the frames in their lead.
  std::int64_t lead = 0;
  for (const RunSetup& setup : setups_) {
    lead = std::max<std::int64_t>(lead, num_recorded_lead_frames(setup.settings.time));
  }
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    std::deque<RecordedDepth>& frames = cameras_[k].frames;
    if (frames.empty()) continue;
    const auto number = [](const RecordedDepth& frame) {
      return static_cast<std::int64_t>(frame.record.camera_frame);
    };
    const std::int64_t newest = number(frames.back());
    const std::int64_t needed =
        contacts_.empty()
            ? newest - kMaxIdleFrames
            : std::max(contacts_.front().cameras.of[k].camera_frame, newest - kMaxFrames);
    // A contact may come before its frame.
    while (!frames.empty() && number(frames.front()) + lead < needed) {
      cameras_[k].lead.take(frames.front());
      frames.pop_front();
    }
  }
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
