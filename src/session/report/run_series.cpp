#include "src/session/report/run_series.h"

#include <algorithm>

#include "palpate/session/run.h"

namespace palpate { inline namespace v0 {
namespace {

/// Returns the larger of the forces on hand and tool, N.
double force(const TickRecord& tick) {
  return std::max(norm(tick.F_H_B.force), norm(tick.step.contact_W.force));
}

/// Keeps the largest value and the time when it was first reached.
void raise(double value, double time, double& most, double& time_of_max) {
  if (!(value > most)) return;
  most = value;
  time_of_max = time;
}

}  // namespace

void RunSeries::add(const TickRecord& tick) {
  if (num_in_group_ == 0) {
    if (ticks_.size() == kMaxTicks) {
      for (std::size_t i = 0; i < kMaxTicks / 2; ++i) {
        const TickRecord &a = ticks_[2 * i], &b = ticks_[2 * i + 1];
        ticks_[i] = force(b) > force(a) ? b : a;
      }
      ticks_.resize(kMaxTicks / 2);
      group_size_ *= 2;
    }
    ticks_.push_back(tick);
  } else if (force(tick) > force(ticks_.back())) {
    ticks_.back() = tick;
  }
  num_in_group_ = (num_in_group_ + 1) % group_size_;
}

void RunPeaks::add(const TickRecord& tick) {
  force = std::max(force, norm(tick.F_H_B.force));
  torque = std::max(torque, norm(tick.F_H_B.torque));
  desired_force = std::max(desired_force, norm(tick.step.desired_F_H_B.force));
  raise(norm(tick.step.contact_W.force), tick.time, contact_force, contact_force_time);
  contact_torque = std::max(contact_torque, norm(tick.step.contact_W.torque));
  stretch = std::max(stretch, tick.step.stretch);
  raise(tick.penetration.volume, tick.time, volume, volume_time);
  raise(tick.penetration.unseen_volume, tick.time, unseen_volume, unseen_volume_time);
  raise(tick.objects.volume, tick.time, objects_volume, objects_volume_time);
  energy = std::max(energy, tick.safety.energy);
  spring_energy = std::max(spring_energy, tick.step.energy);
  num_engaged += tick.safety.is_engaged() ? 1 : 0;
  num_limited = tick.safety.num_limited;
  num_in_contact += tick.penetration.volume > 0 ? 1 : 0;
  num_in_objects += tick.num_object_pairs > 0 ? 1 : 0;
}

bool is_contact_lost(const TickRecord& tick) {
  return tick.safety.fault == Fault::backend && !tick.safety.is_engaged() &&
         tick.penetration.status.has(StepStatus::backend_failed);
}

Fault reported_fault(const TickRecord& tick) {
  return tick.safety.fault == Fault::stopped ? Fault::none : tick.safety.fault;
}

}}  // namespace palpate::v0
