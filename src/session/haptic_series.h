// The course of a haptic run, as far as pages show it.
#pragma once

#include <vector>

#include "palpate/run/haptic_loop.h"

namespace palpate {

/// Ticks of a run of any length in bounded memory: of each group of neighbours the one with the
/// largest force stays; groups double when there are too many.
class HapticSeries {
 public:
  void add(const HapticRecord& tick);
  const std::vector<HapticRecord>& ticks() const { return ticks_; }

 private:
  static constexpr std::size_t kMost = 1 << 14;
  std::vector<HapticRecord> ticks_;
  std::size_t group_size_ = 1, num_in_group_ = 0;  // the last of ticks_ stands for the open group
};

/// Largest values of a run, of all ticks.
struct HapticPeaks {
  double force = 0, torque = 0;                    ///< N and N m, felt
  double wanted_force = 0;                         ///< N, before the safety filter
  double stretch = 0;                              ///< m
  double volume = 0;                               ///< m3
  double energy = 0;                               ///< J, given to the hand
  double spring_energy = 0;                        ///< J
  std::uint64_t num_engaged = 0, num_limited = 0;  ///< ticks

  void add(const HapticRecord& tick);
};

}  // namespace palpate
