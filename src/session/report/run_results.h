// Writes the results of a run beside its recording: wrench.csv, summary.json, report.html.
#pragma once

#include <deque>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "src/session/report/run_report.h"

namespace palpate { inline namespace v0 {

class RunResults {
 public:
  /// Begins wrench.csv, under another name until it is finished; or, where not `all_ticks` are
  /// kept, writes it at the end, of the ticks that the recording has then.
  RunResults(const std::filesystem::path& folder, const Tool& tool, const RunSetup& setup,
             bool all_ticks = true);

  void add_settings(const RunSettings& settings);
  void add_frame(const FrameRecord& record, const DepthFrame& frame);
  void add_contact(const ContactRecord& contact);
  /// Takes a tick, whose contact has been added.
  void add_tick(const TickRecord& tick);

  /// Writes all files after the last tick and moves the added data into `log`. The folder may have
  /// another name by now. A full disk destroys nothing that is there: missing data is reported in
  /// `log.not_kept`. Returns the content of summary.json.
  std::string write(const std::filesystem::path& folder, const Tool& tool, const LoopTimes& times,
                    RunLog& log);

 private:
  void move_to(RunLog& log);
  void begin_csv(const std::filesystem::path& folder);
  void add_row(const TickRecord& tick);
  void keep_pose(const FrameRecord& record);
  Pose first_camera_at(const TickRecord& tick);
  void write_kept_rows(const std::filesystem::path& folder, RunLog& log);
  void finish_csv(const std::filesystem::path& folder, RunLog& log);
  void add_fault(const TickRecord& tick);
  void keep_deepest(const TickRecord& tick);
  std::string scarce_surface_warning(const RunSetup& setup) const;
  static std::string force_off_warning(const RunLog& log, const LoopTimes& times);

  struct NumberedFrame {
    std::uint64_t number = 0;
    DepthFrame frame;
  };
  struct PoseAtTime {
    std::uint64_t number = 0;
    Pose X_WC;
  };
  struct Camera {
    std::deque<NumberedFrame> recent;
    NumberedFrame deepest;
  };

  const Tool& tool_;
  double full_volume_, time_origin_;
  const OutputOptions output_;
  const bool has_output_columns_;  // other than the world's axes and the center of mass
  const Pose X_WB_;
  std::deque<PoseAtTime> first_poses_;  // of the first camera
  std::vector<Camera> cameras_;
  struct BodiesAtContact {
    std::uint64_t number = 0;
    BodyPoses bodies;
  };
  const bool has_moving_objects_;
  std::deque<BodiesAtContact> bodies_;  // at the contact of the last tick, and at later ones
  bool reports_unseen_;
  const bool reports_std_;
  const bool all_ticks_;
  std::ofstream csv_;
  std::string line_;
  ChangeList changes_;
  struct Revision {
    std::uint32_t number = 0;
    RunSettings settings;
  };
  std::deque<Revision> revisions_;  // that of the last tick, and later ones
  RunSeries series_;
  RunPeaks peaks_;
  std::vector<FaultPeriod> faults_;
  std::uint32_t num_faults_ = 0;
  std::vector<double> captures_;  // s, on the clock of the device states
  double start_ = 0;              // s, on that clock: of the run
  TickRecord deepest_;
  RunSettings deepest_settings_;
  BodyPoses deepest_bodies_;
  bool has_ticked_ = false;
  std::uint64_t first_scarce_ = 0, num_scarce_ = 0, num_frames_ = 0;
  int scarce_points_ = 0, pixels_of_scarce_ = 0;
};

}}  // namespace palpate::v0
