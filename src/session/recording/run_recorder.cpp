#include "src/session/recording/run_recorder.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <tuple>
#include <utility>

#include "palpate/io/files.h"
#include "src/io/internal/ros_messages.h"
#include "src/math/internal/wrench_transform.h"
#include "src/session/internal/lead_frames.h"
#include "src/session/internal/run_folder.h"

namespace palpate { inline namespace v0 {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t kTransformPeriod = 10'000'000;  // ns: ticks hold every pose exactly
constexpr int kMaxToldTroubles = 20;                    // the recording has notes of all
constexpr std::uint64_t kPointsPeriod = 500'000'000;    // ns: for humans; depth holds every pixel

// Frames, as ROS names them: world, cameras in it, base of the device, handle, tool.
constexpr const char* kWorld = "world";
constexpr const char* kBase = "base";
constexpr const char* kHand = "hand";
constexpr const char* kToolFrame = "tool";

template <class Clock>
double seconds() {
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

std::string at(double seconds) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2f s", seconds);
  return text;
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

/// Makes a file with tool and objects on the disk: nothing else is of use without them.
Result<McapWriter> RunRecorder::make_file(const fs::path& path) {
  auto writer = McapWriter::create(path);
  if (!writer) return writer.error();
  const auto attach = [&](const std::string& name, const Tool& shape) -> Status {
    const auto bytes = tool_to_bytes(shape);
    if (!bytes) return bytes.error();
    return writer->attach(name, "application/x-palpate-tool", *bytes);
  };
  if (const Status status = attach(kToolFile, *tool_); !status) return status.error();
  const auto& regions = setups_.back().settings.regions;
  for (std::size_t k = 0; k < regions.size(); ++k) {
    if (!regions[k] || regions[k]->labels.empty()) continue;
    const std::string bytes(regions[k]->labels.begin(), regions[k]->labels.end());
    const Status status = writer->attach(labels_file(k), "application/octet-stream", bytes);
    if (!status) return status.error();
  }
  const auto& objects = setups_.back().settings.objects;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const Status status = attach(object_file(i), *objects[i].shape);
    if (!status) return status.error();
  }
  McapWriter& w = *writer;
  channels_.part = w.add_channel(part_channel());
  channels_.settings = w.add_channel(settings_channel());
  channels_.estimate = w.add_channel(estimate_channel());
  channels_.frame = w.add_channel(frame_channel());
  channels_.contact = w.add_channel(contact_channel());
  channels_.tick = w.add_channel(tick_channel());
  channels_.note = w.add_channel(note_channel());
  channels_.cameras.clear();
  for (std::uint32_t k = 0; k < cameras_.size(); ++k) {
    const std::string depth = depth_topic(k), info = k == 0 ? "" : "/" + camera_frame(k);
    channels_.cameras.push_back(
        {w.add_channel(ros_channel(depth, "sensor_msgs/Image")),
         w.add_channel(ros_channel(depth + "/points", "sensor_msgs/PointCloud2")),
         w.add_channel(ros_channel(info + "/camera_info", "sensor_msgs/CameraInfo"))});
    if (!setups_.back().streams[k].has_flow) continue;
    channels_.cameras.back().flow = w.add_channel(ros_channel(flow_topic(k), "sensor_msgs/Image"));
  }
  channels_.transforms = w.add_channel(ros_channel("/tf", "tf2_msgs/TFMessage"));
  channels_.statics = w.add_channel(ros_channel("/tf_static", "tf2_msgs/TFMessage"));
  channels_.tool_wrench = w.add_channel(ros_channel("/tool/wrench", "geometry_msgs/WrenchStamped"));
  channels_.hand_wrench = w.add_channel(ros_channel("/hand/wrench", "geometry_msgs/WrenchStamped"));
  channels_.marker = w.add_channel(ros_channel("/tool/marker", "visualization_msgs/Marker"));
  return writer;
}

/// True if contacts can be repeated from here on.
bool RunRecorder::can_begin_here() const {
  const bool has_leads = std::all_of(setups_.begin(), setups_.end(), [](const RunSetup& setup) {
    return has_whole_lead(setup.settings.time) && !has_moving_objects(setup.settings);
  });
  return has_leads && std::all_of(cameras_.begin(), cameras_.end(), [](const Camera& camera) {
           if (camera.frames.empty()) return true;
           const FrameRecord& next = camera.frames.front().record;
           return camera.lead.is_known_before(static_cast<std::int64_t>(next.camera_frame),
                                              next.revision);
         });
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

/// Writes the beginning of a part; one that is not the first has its `snapshot`.
Status RunRecorder::begin(const HandSnapshot* snapshot) {
  PartStart start;
  if (snapshot != nullptr) {
    forget_settings(snapshot->revision);
    start.number = num_parts_;
    start.revision = setups_.front().revision;
    start.has_surfaces = can_begin_here();
    for (const Camera& camera : cameras_) {
      start.periods.push_back(camera.frames.empty() ? 0 : camera.frames.front().record.period);
    }
    start.hand = *snapshot;
    write(channels_.part, last_time_, part_message(start));
  }
  for (const RunSetup& setup : setups_) {
    write(channels_.settings, last_time_, settings_message(setup));
  }
  const RunSetup& setup = setups_.back();
  const RosTransform fixed[] = {{kWorld, kBase, setup.settings.coupling.X_WB}};
  write(channels_.statics, last_time_, transform_message(last_time_, fixed));
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    cameras_[k].X_WC.reset();
    write(channels_.cameras[k].info, last_time_,
          camera_info_message({last_time_, camera_frame(k)}, setup.streams[k]));
  }
  write(channels_.marker, last_time_, tool_marker_message({last_time_, kToolFrame}, tool_->mesh()));
  if (snapshot != nullptr) {
    for (std::uint32_t k = 0; k < cameras_.size(); ++k) {
      const LeadEstimate& lead = cameras_[k].lead;
      if (!start.has_surfaces || !lead.has_estimate(setups_.front().revision)) continue;
      write(channels_.estimate, last_time_, estimate_message({k, lead.revision(), lead.state()}));
    }
    for (const Camera& camera : cameras_) {
      for (const auto& [record, frame] : camera.frames) write_frame(record, frame);
    }
    for (const ContactRecord& contact : contacts_) {
      write(channels_.contact, wall_time(contact.contact.time), contact_message(contact));
    }
  }
  if (!writer_) return Error{Errc::io_failure, reason_};
  return writer_->flush();
}

/// Begins another part, whose first tick is the one that the snapshot names.
Status RunRecorder::begin_after(const HandSnapshot& snapshot) {
  const fs::path name = part_file(num_parts_ + 1), path = folder() / name;
  const Channels before = channels_;
  auto file = make_file(path);
  std::error_code ignored;
  if (!file) {
    channels_ = before;
    fs::remove(path, ignored);
    return file.error();
  }
  std::optional<McapWriter> last = std::exchange(writer_, *std::move(file));
  const auto before_it = std::tuple(gap_, next_try_, reason_, notes_);
  ++num_parts_;
  parts_.push_back({name, {{0, time_}}});
  if (const Status begun = begin(&snapshot); !begun) {
    writer_ = std::move(last);
    channels_ = before;
    std::tie(gap_, next_try_, reason_, notes_) = before_it;
    --num_parts_;
    parts_.pop_back();
    fs::remove(path, ignored);
    return begun;
  }
  if (last) end_part(parts_[parts_.size() - 2], *std::move(last));
  part_start_ = time_;
  return Done{};
}

void RunRecorder::add_hand_snapshot(const HandSnapshot& snapshot) {
  constexpr double kMaxReserve = 1 << 30, kShare = 0.02, kLongestPatience = 60,
                   kTolerance = 0.1;  // snapshots are not quite a second apart
  take_ended(false);
  remove_old();
  std::error_code error;
  const fs::space_info space = fs::space(folder(), error);
  const double reserve = options_.reserve_bytes.value_or(
      std::min(kMaxReserve, kShare * static_cast<double>(space.capacity)));
  const bool has_space = error || static_cast<double>(space.available) >= reserve;
  if (writer_ && !has_space) {
    const auto left = static_cast<std::uint64_t>(space.available >> 20);
    end_part(parts_.back(), *std::exchange(writer_, std::nullopt));
    pause({Errc::io_failure, "only " + std::to_string(left) + " MiB are free on the disk of " +
                                 folder().string() + "; free some space"});
    return;
  }
  if (!writer_) {
    if (time_ < next_try_ || !has_space) return;
    const std::string gap = gap_ + " to " + at(time_) + ": " + reason_;
    if (begin_after(snapshot)) {
      patience_ = 1;
      add_trouble(gap);
      notes_.push_back("the recording goes on");
      add_note(gap);
    } else {
      patience_ = std::min(2 * patience_, kLongestPatience);
      next_try_ = time_ + patience_;
    }
    return;
  }
  // Ten or more parts in the time that is kept, but none of less than some seconds.
  const double longest = options_.is_bounded() ? std::max(options_.keep_seconds / 10, 2.0)
                                               : std::numeric_limits<double>::infinity();
  const bool is_long = static_cast<double>(writer_->bytes_written()) >= options_.split_bytes ||
                       time_ - part_start_ >= longest - kTolerance;
  if (!is_long) return;
  // Only one part at a time is being flushed: simulated runs wait, others get longer parts.
  if (is_simulated_) take_ended(true);
  if (waits_for_disk()) return;
  // The part's data in memory is written before another part begins.
  if (const Status written = writer_->flush(); !written) return pause(written.error());
  const Status begun = begin_after(snapshot);
  if (!begun && !std::exchange(has_told_no_part_, true)) {
    notes_.push_back("the recording goes on in " + parts_.back().file.string() +
                     ", because no other part can be begun: " + begun.error().message);
  }
}

/// Returns the time up to which all ticks are in the part, s.
double RunRecorder::Part::kept_until(const McapWriter& writer) const {
  const auto is_lost = [kept = writer.bytes_kept()](const Mark& mark) { return mark.bytes > kept; };
  return std::prev(std::find_if(marks.begin() + 1, marks.end(), is_lost))->time;
}

/// Describes from when on records may be missing.
std::string RunRecorder::Part::gap(const McapWriter& writer) const {
  const bool is_in_doubt = writer.bytes_kept() < writer.bytes_written();
  return (is_in_doubt ? "it is not certain that anything was recorded from "
                      : "nothing was recorded from ") +
         at(kept_until(writer));
}

/// Marks the last tick as in the file if something was written since the last mark.
void RunRecorder::add_mark(Part& part, const McapWriter& writer) const {
  const std::uint64_t bytes = writer.bytes_written();
  if (bytes <= part.marks.back().bytes) return;
  part.marks.push_back({bytes, time_});
  const std::uint64_t on_disk = writer.bytes_on_disk();
  while (part.marks.size() > 1 && part.marks[1].bytes <= on_disk) part.marks.pop_front();
}

/// Ends a whole part, which goes to the disk while others are written.
void RunRecorder::end_part(Part& part, McapWriter writer) {
  (void)writer.end();  // `take_ended` reports its outcome
  add_mark(part, writer);
  part.end = time_;
  part.ending = std::move(writer);
}

/// Takes the outcome of ended parts that are on the disk, or with `waits` of all.
void RunRecorder::take_ended(bool waits) {
  for (Part& part : parts_) {
    if (!part.ending || (part.ending->waits_for_disk() && !waits)) continue;
    if (const Status ended = part.ending->finish(); ended) {
      part.bytes = part.ending->bytes_written();
    } else {
      const bool is_lost = part.kept_until(*part.ending) < part.end;
      add_trouble((is_lost ? part.gap(*part.ending) + " to " + at(part.end)
                           : part.file.string() + " is cut off") +
                  ": " + ended.error().message);
    }
    part.ending.reset();
  }
}

bool RunRecorder::waits_for_disk() const {
  return std::any_of(parts_.begin(), parts_.end(),
                     [](const Part& part) { return part.ending && part.ending->waits_for_disk(); });
}

void RunRecorder::add_trouble(const std::string& text) {
  if (++num_troubles_ <= kMaxToldTroubles) trouble_ += (trouble_.empty() ? "" : "; ") + text;
}

void RunRecorder::remove_old() {
  while (parts_.size() > 1 && parts_.front().end < time_ - options_.keep_seconds) {
    std::error_code ignored;
    fs::remove(folder() / parts_.front().file, ignored);
    parts_.pop_front();
  }
}

void RunRecorder::pause(const Error& error) {
  reason_ = error.message;
  gap_ = "nothing was recorded from " + at(time_);
  if (writer_) {
    gap_ = parts_.back().gap(*writer_);
    parts_.back().end = time_;
    writer_.reset();
  }
  next_try_ = time_ + patience_;
  notes_.push_back("the recording pauses: " + reason_);
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
  const RosTransform pose[] = {{kWorld, frame.c_str(), X_WC}};
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
        wrench_message({time, kHand}, expressed_in(tick.device.X_BH.rotation, tick.F_H_B)));
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
  const RosTransform moving[] = {{kWorld, kToolFrame, tick.step.X_WT},
                                 {kBase, kHand, tick.device.X_BH},
                                 {kWorld, "tool_in_hand", tick.step.X_WT_hand}};
  write(channels_.transforms, time, transform_message(time, moving));
}

void RunRecorder::add_note(std::string_view text) {
  write(channels_.note, last_time_, note_message(text));
}

void RunRecorder::add_note(std::string_view text, double time) {
  write(channels_.note, wall_time(time), note_message(text));
}

void RunRecorder::end() {
  if (std::exchange(has_ended_, true)) return;
  if (writer_) {
    end_part(parts_.back(), *std::exchange(writer_, std::nullopt));
  } else {
    add_trouble(gap_ + " on: " + reason_);
  }
}

void RunRecorder::finish() {
  end();
  take_ended(true);
  // Writing to a file that has no name any more, or that another program has cut, never fails.
  for (const Part& part : parts_) {
    std::error_code error;
    if (part.bytes > 0 && (fs::file_size(folder() / part.file, error) != part.bytes || error)) {
      add_trouble(part.file.string() + " was removed or changed by another program");
    }
  }
  if (num_troubles_ > kMaxToldTroubles) {
    trouble_ += "; and " + std::to_string(num_troubles_ - kMaxToldTroubles) + " more";
  }
}

}}  // namespace palpate::v0
