// Parts of a recording: files that follow each other, and the pauses between them.
//
// Each part has tool and settings and can be viewed alone, so the recording can end an old part, go
// on after the disk was full, and remove old parts. Parts that have ended go to the disk while the
// next one is being written.
#include <algorithm>
#include <cstdio>
#include <limits>
#include <tuple>
#include <utility>

#include "palpate/io/files.h"
#include "src/io/internal/ros_messages.h"
#include "src/session/internal/run_folder.h"
#include "src/session/recording/run_recorder.h"

namespace palpate { inline namespace v0 {
namespace fs = std::filesystem;
namespace {

constexpr int kMaxToldTroubles = 20;  // the recording has notes of all

std::string at(double seconds) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2f s", seconds);
  return text;
}

}  // namespace

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
  const auto& regions = setup_.settings.regions;
  for (std::size_t k = 0; k < regions.size(); ++k) {
    if (!regions[k] || regions[k]->labels.empty()) continue;
    const std::string bytes(regions[k]->labels.begin(), regions[k]->labels.end());
    const Status status = writer->attach(labels_file(k), "application/octet-stream", bytes);
    if (!status) return status.error();
  }
  const auto& objects = setup_.settings.objects;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const Status status = attach(object_file(i), *objects[i].shape);
    if (!status) return status.error();
  }
  McapWriter& w = *writer;
  channels_.part = w.add_channel(part_channel());
  channels_.settings = w.add_channel(settings_channel());
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
    if (!setup_.streams[k].has_flow) continue;
    channels_.cameras.back().flow = w.add_channel(ros_channel(flow_topic(k), "sensor_msgs/Image"));
  }
  channels_.transforms = w.add_channel(ros_channel("/tf", "tf2_msgs/TFMessage"));
  channels_.statics = w.add_channel(ros_channel("/tf_static", "tf2_msgs/TFMessage"));
  channels_.tool_wrench = w.add_channel(ros_channel("/tool/wrench", "geometry_msgs/WrenchStamped"));
  channels_.hand_wrench = w.add_channel(ros_channel("/hand/wrench", "geometry_msgs/WrenchStamped"));
  channels_.marker = w.add_channel(ros_channel("/tool/marker", "visualization_msgs/Marker"));
  return writer;
}

/// Writes the beginning of a part; one that is not the first has the number of its first tick.
Status RunRecorder::begin(std::optional<std::uint64_t> first_tick) {
  if (first_tick) write(channels_.part, last_time_, part_message({num_parts_, *first_tick}));
  write(channels_.settings, last_time_, settings_message(setup_));
  const RosTransform fixed[] = {{kWorldFrame, kBaseFrame, setup_.settings.coupling.X_WB}};
  write(channels_.statics, last_time_, transform_message(last_time_, fixed));
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    cameras_[k].X_WC.reset();
    write(channels_.cameras[k].info, last_time_,
          camera_info_message({last_time_, camera_frame(k)}, setup_.streams[k]));
  }
  write(channels_.marker, last_time_, tool_marker_message({last_time_, kToolFrame}, tool_->mesh()));
  if (!writer_) return Error{Errc::io_failure, reason_};
  return writer_->flush();
}

Status RunRecorder::begin_part(std::uint64_t first_tick) {
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
  if (const Status begun = begin(first_tick); !begun) {
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

/// Ends and begins parts before the tick of this number, where it is time.
void RunRecorder::change_parts(std::uint64_t next_tick) {
  constexpr double kMaxReserve = 1 << 30, kShare = 0.02, kLongestPatience = 60,
                   kTolerance = 0.1;  // calls are not quite a second apart
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
    if (begin_part(next_tick)) {
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
  const Status begun = begin_part(next_tick);
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
