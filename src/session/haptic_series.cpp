#include "src/session/haptic_series.h"

#include <algorithm>

namespace palpate {
namespace {

double force(const HapticRecord& tick) { return norm(tick.F_H_B.force); }

}  // namespace

void HapticSeries::add(const HapticRecord& tick) {
  if (num_in_group_ == 0) {
    if (ticks_.size() == kMost) {
      for (std::size_t i = 0; i < kMost / 2; ++i) {
        const HapticRecord &a = ticks_[2 * i], &b = ticks_[2 * i + 1];
        ticks_[i] = force(b) > force(a) ? b : a;
      }
      ticks_.resize(kMost / 2);
      group_size_ *= 2;
    }
    ticks_.push_back(tick);
  } else if (force(tick) > force(ticks_.back())) {
    ticks_.back() = tick;
  }
  num_in_group_ = (num_in_group_ + 1) % group_size_;
}

void HapticPeaks::add(const HapticRecord& tick) {
  force = std::max(force, norm(tick.F_H_B.force));
  torque = std::max(torque, norm(tick.F_H_B.torque));
  wanted_force = std::max(wanted_force, norm(tick.step.F_H_B.force));
  stretch = std::max(stretch, tick.step.stretch);
  volume = std::max(volume, tick.penetration.volume);
  energy = std::max(energy, tick.safety.energy);
  spring_energy = std::max(spring_energy, tick.step.energy);
  num_engaged += tick.safety.is_engaged ? 1 : 0;
  num_limited = tick.safety.num_limited;
}

}  // namespace palpate
