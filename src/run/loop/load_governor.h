// Reduces the load of a live loop by its counters: other settings, with a note for each change.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "palpate/run/run_loop.h"
#include "src/run/loop/load_relief.h"

namespace palpate::inline v0 {

/// What has been counted so far; the difference of two is a window.
struct LoadCounts {
  std::uint64_t ticks = 0, frames = 0;
  std::uint64_t pictures = 0;  ///< that were requested
  std::uint64_t old_frames = 0, old_contacts = 0, ageing_frames = 0, ageing_contacts = 0;

  /// Ticks by the age of what they worked on. What only comes rarely is not late for that: a
  /// contact is as old as a tick at least. Rates: Hz.
  void count_ages(const LoopTimes& times, const SafetyOptions& limits, double frame_rate,
                  double contact_rate, double tick_rate);
};

/// One thread.
class LoadGovernor {
 public:
  LoadGovernor(const DepthStreamInfo& stream, const RunSettings& settings, std::size_t num_spheres);

  struct Decision {
    std::optional<RunSettings> settings;  ///< other ones that are to be used now
    std::string note;                     ///< what has been decided, for humans; else empty
  };
  /// `present`: the settings as they are; if they are not those that were decided last, somebody
  /// has chosen otherwise, and these are the whole ones. Decides at most once a second.
  Decision look(double now, const RunSettings& present, const LoadCounts& counts);
  /// What has been decided is done: a new window begins.
  void begin_window(double now, const LoadCounts& counts);
  /// It could not be done: nothing is decided any more.
  void give_up(const RunSettings& present);

  const ReliefSteps& steps() const { return applied_; }
  /// s with such steps so far.
  double page_seconds() const { return page_; }
  double image_seconds() const { return image_; }
  double spheres_seconds() const { return spheres_; }

 private:
  LoadRelief make_relief(const RunSettings& settings) const;
  std::size_t num_requested() const;
  RunSettings thinned(const RunSettings& settings, const ReliefSteps& steps) const;

  DepthStreamInfo stream_;
  std::size_t num_spheres_;
  RunSettings whole_;  // binning and spheres without any steps
  LoadRelief relief_;
  ReliefSteps applied_;
  LoadCounts counted_;
  double window_start_ = -1;  // s, monotonic
  double page_ = 0, image_ = 0, spheres_ = 0;
};

/// What has changed with these steps; `binning` and `num_spheres` are those without any.
std::string describe_relief(const ReliefSteps& before, const ReliefSteps& after, int binning,
                            std::size_t num_spheres);
/// For how long less was computed; empty: never.
std::string time_thinned(const LoopReport& report);

}  // namespace palpate::inline v0
