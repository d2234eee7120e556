// Reduces the load of a live loop by its counters: other settings, with a note for each change.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "palpate/run/run_loop.h"
#include "src/run/loop/load_relief.h"

namespace palpate { inline namespace v0 {

/// Counters of a run so far; the difference of two is a window.
struct LoadCounts {
  std::uint64_t ticks = 0, frames = 0;
  std::uint64_t pictures = 0;  ///< requested ones
  std::uint64_t old_frames = 0, old_contacts = 0, ageing_frames = 0, ageing_contacts = 0;

  /// Counts ticks by the age of their frames and contacts. A low rate alone makes none late: a
  /// contact is as old as a tick at least. Rates: Hz.
  void count_ages(const LoopTimes& times, const SafetyOptions& limits, double frame_rate,
                  double contact_rate, double tick_rate);
};

/// Decides on the load of a live loop. For one thread.
class LoadGovernor {
 public:
  LoadGovernor(const DepthStreamInfo& stream, const RunSettings& settings, std::size_t num_spheres);

  struct Decision {
    std::optional<RunSettings> settings;  ///< new settings to use now, if any
    std::string note;                     ///< the decision, for humans; else empty
  };
  /// `present`: the present settings; if they differ from those decided last, the user has changed
  /// them, and they are the new full settings. Decides at most once a second.
  Decision look(double now, const RunSettings& present, const LoadCounts& counts);
  /// Begins a new window, once a decision has been carried out.
  void begin_window(double now, const LoadCounts& counts);
  /// Ends all decisions, after one could not be carried out.
  void give_up(const RunSettings& present);

  const ReliefSteps& steps() const { return applied_; }
  /// Time with such steps so far, s.
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

/// Describes a change of steps, for humans; `binning` and `num_spheres` are those without any.
std::string describe_relief(const ReliefSteps& before, const ReliefSteps& after, int binning,
                            std::size_t num_spheres);
/// Describes for how long less was computed; empty: never.
std::string time_thinned(const LoopReport& report);

}}  // namespace palpate::v0
