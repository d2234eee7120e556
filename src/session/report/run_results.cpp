#include "src/session/report/run_results.h"

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "src/core/internal/message_text.h"
#include "src/io/internal/atomic_file.h"
#include "src/run/internal/reported_output.h"
#include "src/session/internal/more_than_whole.h"
#include "src/session/internal/run_reader.h"
#include "src/session/report/text.h"

namespace palpate { inline namespace v0 {
namespace fs = std::filesystem;
namespace {

constexpr const char* kCsv = "wrench.csv";
constexpr const char* kUnfinishedCsv = "wrench.csv.part";
constexpr std::size_t kMaxFaultPeriods = 1000;
constexpr std::size_t kMaxCaptures = 100'000;  // drawn in plots: an hour of frames
constexpr std::size_t kNumRecent = 3;          // frames; contacts are at most one behind

/// `measure` is the contact's volume times direction, before the volume stiffness makes newtons.
constexpr const char* kHeader =
    "time_s,timestamp_s,tool_x_m,tool_y_m,tool_z_m,tool_qx,tool_qy,tool_qz,tool_qw,volume_m3,"
    "fraction,measure_x_m3,measure_y_m3,measure_z_m3,measure_mx_m4,measure_my_m4,measure_mz_m4,"
    "force_x_N,force_y_N,force_z_N,torque_x_Nm,torque_y_Nm,torque_z_Nm,"
    "hand_force_x_N,hand_force_y_N,hand_force_z_N,hand_torque_x_Nm,hand_torque_y_Nm,"
    "hand_torque_z_Nm,stretch_m,boundary_spheres,inside_spheres,points,object_pairs,"
    "objects_volume_m3,objects_measure_x_m3,objects_measure_y_m3,objects_measure_z_m3,objects_"
    "measure_mx_m4,"
    "objects_measure_my_m4,objects_measure_mz_m4,contact,frame,"
    "status,contact_age_s,sensor_age_s,gain,fault";

/// Standard deviations, if the settings ask for them.
constexpr const char* kStdHeader =
    ",volume_std_m3,measure_std_x_m3,measure_std_y_m3,measure_std_z_m3,measure_std_mx_m4,"
    "measure_std_my_m4,measure_std_mz_m4";

/// The columns of OutputOptions, if it has any.
constexpr const char* kOutputHeader =
    ",reported_x_m,reported_y_m,reported_z_m,reported_qx,reported_qy,reported_qz,reported_qw,"
    "reported_force_x_N,reported_force_y_N,reported_force_z_N,reported_torque_x_Nm,reported_torque_"
    "y_Nm,"
    "reported_torque_z_Nm,reported_measure_x_m3,reported_measure_y_m3,reported_measure_z_m3,"
    "reported_measure_mx_m4,reported_measure_my_m4,reported_measure_mz_m4";

}  // namespace

RunResults::RunResults(const fs::path& folder, const Tool& tool, const RunSetup& setup,
                       bool all_ticks)
    : tool_(tool),
      full_volume_(full_volume(tool, setup.settings.contact)),
      time_origin_(setup.time_origin),
      output_(setup.settings.output),
      has_output_columns_(!(output_ == OutputOptions{})),
      X_WB_(setup.settings.coupling.X_WB),
      cameras_(setup.streams.size()),
      has_moving_objects_(has_moving_objects(setup.settings)),
      reports_unseen_(reports_unseen(setup)),
      reports_std_(setup.settings.wants_std),
      all_ticks_(all_ticks),
      changes_(setup.settings),
      revisions_{{setup.revision, setup.settings}},
      deepest_settings_(setup.settings) {
  if (all_ticks_) begin_csv(folder);
}

void RunResults::begin_csv(const fs::path& folder) {
  csv_.open(folder / kUnfinishedCsv, std::ios::binary);
  csv_ << kHeader << (reports_unseen_ ? ",unseen" : "") << (reports_std_ ? kStdHeader : "")
       << (has_output_columns_ ? kOutputHeader : "") << "\n";
}

void RunResults::add_settings(const RunSettings& settings) {
  changes_.add(settings);
  revisions_.push_back({revisions_.back().number + 1, settings});
  full_volume_ = full_volume(tool_, settings.contact);
}

void RunResults::add_frame(const FrameRecord& record, const DepthFrame& frame) {
  if (captures_.size() < kMaxCaptures) captures_.push_back(record.capture_time);
  ++num_frames_;
  // If only a window was made, num_valid still counts the measurements of the whole image.
  const bool has_all = record.requested.has_all(frame.width, frame.height);
  const int num_points = has_all ? record.surface.num_points : record.surface.num_valid;
  if (num_points < 0.001 * frame.width * frame.height) {
    if (num_scarce_++ == 0) {
      first_scarce_ = record.number;
      pixels_of_scarce_ = frame.width * frame.height;
      scarce_points_ = num_points;
    }
  }
  if (record.camera == 0 && all_ticks_ && has_output_columns_) keep_pose(record);
  std::deque<NumberedFrame>& recent = cameras_[record.camera].recent;
  if (recent.size() == kNumRecent) {
    // Reuses the memory of the oldest.
    recent.push_back(std::move(recent.front()));
    recent.pop_front();
  } else {
    recent.emplace_back();
  }
  recent.back().number = record.number;
  recent.back().frame = frame;
}

void RunResults::keep_pose(const FrameRecord& record) {
  first_poses_.push_back({record.number, record.X_WC});
}

void RunResults::add_contact(const ContactRecord& contact) {
  if (has_moving_objects_) bodies_.push_back({contact.number, contact.bodies});
}

void RunResults::add_tick(const TickRecord& tick) {
  if (all_ticks_) add_row(tick);
  series_.add(tick);
  while (revisions_.size() > 1 && revisions_[1].number <= tick.revision) revisions_.pop_front();
  while (bodies_.size() > 1 && bodies_[1].number <= tick.contact_number) bodies_.pop_front();
  if (!has_ticked_ || tick.penetration.volume > peaks_.volume) keep_deepest(tick);
  peaks_.add(tick);
  add_fault(tick);
  has_ticked_ = true;
  start_ = tick.device.time - tick.time;
}

void RunResults::add_row(const TickRecord& tick) {
  const auto& [p, q] = tick.step.X_WT;
  // Nothing was measured: not zero.
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  Penetration all = tick.penetration;
  Wrench on_tool = tick.step.contact_W;
  if (is_contact_lost(tick)) {
    all.volume = kNone;
    const Vec3d none{kNone, kNone, kNone};
    all.measure_W = {none, none};
    on_tool = {none, none};
  }
  const auto& [mf, mt] = all.measure_W;
  const auto& [force, torque] = on_tool;
  const auto& [hand_force, hand_torque] = tick.F_H_B;
  const auto& [of, ot] = tick.objects.measure_W;
  line_.clear();
  append_row(line_, ',', tick.time, time_origin_ + tick.time, p.x, p.y, p.z, q.x, q.y, q.z, q.w,
             all.volume, all.volume / full_volume_, mf.x, mf.y, mf.z, mt.x, mt.y, mt.z, force.x,
             force.y, force.z, torque.x, torque.y, torque.z, hand_force.x, hand_force.y,
             hand_force.z, hand_torque.x, hand_torque.y, hand_torque.z, tick.step.stretch,
             all.num_boundary_spheres, all.num_inside_spheres, all.num_points,
             tick.num_object_pairs, tick.objects.volume, of.x, of.y, of.z, ot.x, ot.y, ot.z,
             tick.contact_number, tick.frame_number, all.status.bits, tick.contact_age,
             tick.sensor_age, tick.safety.gain, static_cast<int>(reported_fault(tick)));
  if (reports_unseen_) {
    line_.back() = ',';
    append_number(line_, all.unseen_volume / full_volume_);
    line_ += '\n';
  }
  if (reports_std_) {
    constexpr Vec3d none{kNone, kNone, kNone};
    const bool is_known = tick.noise && !is_contact_lost(tick);
    const Vec3d f = is_known ? tick.noise->force_std() : none;
    const Vec3d t = is_known ? tick.noise->torque_std() : none;
    line_.back() = ',';
    append_row(line_, ',', is_known ? tick.noise->volume_std() : kNone, f.x, f.y, f.z, t.x, t.y,
               t.z);
  }
  if (has_output_columns_) {
    const ReportedOutput reported(
        output_, {tick.step.X_WT, tick.step.X_WT * tool_.sphere_mass().center_of_mass,
                  first_camera_at(tick), X_WB_});
    const auto [at, turned] = reported.pose();
    const Wrench wrench = reported.wrench(on_tool);
    const VolumeWrench measure = reported.wrench(all.measure_W);
    line_.back() = ',';
    append_row(line_, ',', at.x, at.y, at.z, turned.x, turned.y, turned.z, turned.w, wrench.force.x,
               wrench.force.y, wrench.force.z, wrench.torque.x, wrench.torque.y, wrench.torque.z,
               measure.force.x, measure.force.y, measure.force.z, measure.torque.x,
               measure.torque.y, measure.torque.z);
  }
  csv_ << line_;
}

/// Returns the first camera's pose at its newest image that the tick rests on.
Pose RunResults::first_camera_at(const TickRecord& tick) {
  // Ticks come in order: no later one needs poses that this one has passed.
  const auto is_passed = [&](std::size_t i) {
    return i < first_poses_.size() && first_poses_[i].number <= tick.frame_number;
  };
  while (is_passed(1)) first_poses_.pop_front();
  return is_passed(0) ? first_poses_.front().X_WC : Pose{};
}

/// Writes the rows of the recorded ticks, with the tool's full volume by the last settings.
void RunResults::write_kept_rows(const fs::path& folder, RunLog& log) {
  begin_csv(folder);
  first_poses_.clear();
  auto reader = RunReader::open(folder);
  TickRecord tick;
  Result<bool> got = true;
  while (reader && got && *got && csv_) {
    got = reader->next_tick(tick, [this](const FrameRecord& frame) {
      if (frame.camera == 0) keep_pose(frame);
    });
    if (got && *got) add_row(tick);
  }
  if (!reader || !got) {
    log.add_not_kept("wrench.csv is not whole: " + (reader ? got.error() : reader.error()).message);
  }
}

void RunResults::add_fault(const TickRecord& tick) {
  const SafetyStatus& safety = tick.safety;
  const bool is_open = !faults_.empty() && !faults_.back().seconds;
  if (is_open && safety.is_engaged()) faults_.back().seconds = tick.time - faults_.back().time;
  const bool is_new = safety.num_faults > num_faults_ && safety.fault != Fault::stopped;
  num_faults_ = safety.num_faults;
  if (!is_new || faults_.size() == kMaxFaultPeriods) return;
  // A fault that came while the force was still away extends the time without force.
  if (is_open) {
    faults_.back().fault = safety.fault;
  } else {
    faults_.push_back({tick.time, safety.fault});
  }
}

void RunResults::keep_deepest(const TickRecord& tick) {
  deepest_ = tick;
  deepest_settings_ = revisions_.front().settings;
  if (!bodies_.empty()) deepest_bodies_ = bodies_.front().bodies;
  for (auto& [recent, deepest] : cameras_) {
    // The newest frame up to the one that the tick names, which is of any camera.
    const NumberedFrame* used = nullptr;
    for (const NumberedFrame& seen : recent) {
      if (seen.number <= tick.frame_number) used = &seen;
    }
    const bool is_known = !deepest.frame.pixels.empty();
    if (used != nullptr && !(is_known && deepest.number == used->number)) deepest = *used;
  }
}

std::string RunResults::scarce_surface_warning(const RunSetup& setup) const {
  if (num_scarce_ == 0) return {};
  std::string range;
  append_number(range, setup.settings.surface.min_depth);
  range += " to ";
  append_number(range, setup.settings.surface.max_depth);
  return std::to_string(scarce_points_) + " of " + std::to_string(pixels_of_scarce_) +
         " pixels are usable (" + range + " m, with a surface around them) in frame " +
         std::to_string(first_scarce_) + ", and hardly any in " + std::to_string(num_scarce_) +
         " of " + std::to_string(num_frames_) + " frames; check --depth-unit";
}

/// Returns for how long the hand had no force and why, if that was a tenth of the run; else
/// nothing.
std::string RunResults::force_off_warning(const RunLog& log, const LoopTimes& times) {
  double off = 0, period = 0;
  for (const auto& [time, fault, seconds] : log.faults) {
    off += seconds.value_or(log.loop.seconds - time);
  }
  if (!log.has_hand() || log.faults.empty() || off < 0.1 * log.loop.seconds) return {};
  for (const DepthStreamInfo& stream : log.setup.streams) {
    period = std::max(period, 1 / stream.rate);
  }
  const FaultPeriod& first = log.faults.front();
  const double surface = 1e-6 * times.surface_compute.summary().p50;
  std::string why(describe(first.fault));
  const bool is_live = !log.loop.scheduling.empty();
  if (is_live && first.fault == Fault::stale_sensor && surface > 0.9 * period) {
    why = "this computer was too busy for a depth frame in time: a surface took " +
          number_text(1e3 * surface, 3) + " ms, and there are " + number_text(1e3 * period, 3) +
          " ms for it; a smaller image, a GPU or fewer other programs help";
  } else if (const std::size_t at = why.find(": the force is off"); at != std::string::npos) {
    why.erase(at, std::string_view(": the force is off").size());
  }
  char text[100];
  std::snprintf(text, sizeof text,
                "the force on the hand was off for %.2f of %.2f s, first at %.2f s: ", off,
                log.loop.seconds, first.time);
  return text + why;
}

void RunResults::move_to(RunLog& log) {
  log.series = std::move(series_);
  log.peaks = peaks_;
  log.faults = std::move(faults_);
  log.changes = std::move(changes_);
  log.deepest = deepest_;
  log.deepest_settings = std::move(deepest_settings_);
  log.deepest_bodies = deepest_bodies_;
  // If the newest frame was not published, the others are unknown too.
  const bool is_known = std::any_of(cameras_.begin(), cameras_.end(), [&](const Camera& camera) {
    return camera.deepest.number == deepest_.frame_number;
  });
  for (Camera& camera : cameras_) {
    log.deepest_frames.push_back(is_known ? std::move(camera.deepest.frame) : DepthFrame{});
  }
  for (const double time : captures_) {
    if (time >= start_) log.frame_times.push_back(time - start_);
  }
  if (std::string warning = scarce_surface_warning(log.setup); !warning.empty()) {
    log.warnings.push_back(std::move(warning));
  }
}

void RunResults::finish_csv(const fs::path& folder, RunLog& log) {
  if (!all_ticks_) write_kept_rows(folder, log);
  csv_.close();
  const fs::path unfinished = folder / kUnfinishedCsv;
  if (!csv_) {
    log.add_not_kept(unfinished.string() + " is cut off: check the free space");
    return;
  }
  std::error_code error;
  fs::rename(unfinished, folder / kCsv, error);
  if (error) {
    log.add_not_kept("cannot rename " + unfinished.string() + ": " + error.message());
  }
}

std::string RunResults::write(const fs::path& folder, const Tool& tool, const LoopTimes& times,
                              RunLog& log) {
  move_to(log);
  std::string note = more_than_whole(tool, log.setup.settings.contact, log.peaks.volume);
  if (!note.empty()) log.warnings.push_back(std::move(note));
  std::string off = force_off_warning(log, times);
  if (!off.empty()) log.warnings.push_back(std::move(off));
  finish_csv(folder, log);
  auto summary = run_summary(tool, log, times);
  const auto page = run_page(summary, tool, log, times);
  if (!page) {
    log.warnings.push_back(page.error().message);
    summary["warnings"] = log.warnings;
  }
  const auto keep = [&](const char* file, const std::string& text) {
    const Status status = write_file_atomically(folder / file, text);
    if (!status) log.add_not_kept(status.error().message);
  };
  std::string text = file_text(summary);
  keep("summary.json", text);
  if (page) keep("report.html", *page);
  return text;
}

}}  // namespace palpate::v0
