// The hand's side of a run, from a device's state to a wrench: the coupling computes the force, and
// the safety filter limits it.
//
// A tick reads the last contact that is known, however old it is, and never waits for a newer one.
// The force thus keeps the rate of the device, and the contact's age tells the filter when the
// force has to fade.
#include <algorithm>
#include <cmath>
#include <utility>

#include "src/run/internal/pipeline.h"

namespace palpate { inline namespace v0 {
namespace {

/// Returns the filter's input of a tick, apart from the force on the hand.
SafetyInput safety_input(const TickRecord& record) {
  SafetyInput input;
  input.time = record.device.time;
  input.state = record.device;
  input.contact_age = record.contact_age;
  input.sensor_age = record.sensor_age;
  input.backend_failed = record.has_backend_failed;
  input.sensor_failed = record.has_sensor_failed;
  input.is_suspended = record.is_suspended;
  return input;
}

}  // namespace

HandPart::HandPart(std::unique_ptr<Coupling> coupling, SafetyFilter safety, double tick_seconds)
    : coupling_(std::move(coupling)), safety_(std::move(safety)), tick_seconds_(tick_seconds) {}

void HandPart::tick(const DeviceState& state, const ContactRecord& known, const TickFlags& flags,
                    TickRecord& record) noexcept {
  if (num_ticks_ == 0 || !std::isfinite(first_tick_)) first_tick_ = state.time;
  const bool has_contact = known.number > 0;
  record.revision = revision_;
  record.number = num_ticks_++;
  record.time = state.time - start_time_;
  record.device = state;
  record.dt = step_seconds(state);
  record.step = record.dt > 0 ? coupling_->step(state, known.contact, record.dt) : CouplingStep{};
  record.penetration = known.penetration;
  record.objects = known.objects;
  record.noise = known.noise;
  record.num_object_pairs = known.num_object_pairs;
  record.contact_age = state.time - (has_contact ? known.contact.time : first_tick_);
  record.sensor_age = state.time - (has_contact ? known.capture_time : first_tick_);
  record.contact_number = known.number;
  record.frame_number = known.frame_number;
  record.is_stopping = is_stopping_ = is_stopping_ || flags.is_stopping;
  record.is_force_requested = flags.is_force_requested;
  record.is_suspended = flags.is_suspended;
  record.has_sensor_failed = flags.has_sensor_failed;
  record.has_backend_failed = flags.has_backend_failed;
  if (is_stopping_) safety_.stop();
  if (!coupling_->drives_device()) return end_without_force(record);
  const Wrench& contact_W = record.step.contact_W;
  const bool is_free = known.contact.is_valid && known.penetration.volume == 0 &&
                       contact_W.force == Vec3d{} && contact_W.torque == Vec3d{};
  const std::uint32_t num_faults = safety_.status().num_faults;
  SafetyInput input = safety_input(record);
  input.is_requested = record.is_force_requested;
  input.is_free = is_free;
  input.is_measured = known.contact.is_valid;
  input.is_clutched = record.step.is_clutched;
  input.stored = record.step.stored;
  record.F_H_B = safety_.filter(record.step.desired_F_H_B, input);
  record.safety = safety_.status();
  status_without_force_.num_faults += record.safety.num_faults - num_faults;
  record.safety.num_faults = status_without_force_.num_faults;
}

/// Ends a tick without a force on a hand: reports the contact whenever it is measured. The force of
/// the coupling before fades through the filter, and so does that of the next one.
void HandPart::end_without_force(TickRecord& record) noexcept {
  const Fault fault = record.is_stopping          ? Fault::stopped
                      : record.has_sensor_failed  ? Fault::sensor
                      : record.has_backend_failed ? Fault::backend
                                                  : Fault::none;
  if (fault != Fault::none && status_without_force_.fault == Fault::none) {
    status_without_force_.fault_time = record.device.time;
    ++status_without_force_.num_faults;
  }
  status_without_force_.fault = fault;
  status_without_force_.state = fault == Fault::none ? ForceState::engaged
                                : is_lasting(fault)  ? ForceState::ended
                                                     : ForceState::off;
  status_without_force_.gain = status_without_force_.is_engaged() ? 1 : 0;
  if (record.has_backend_failed) {
    record.step.contact_W = {};
    record.penetration = record.objects = {};
    record.penetration.status = StepStatus::backend_failed;
  }
  record.F_H_B = {};
  if (safety_.has_ticked()) {
    SafetyInput input = safety_input(record);
    input.is_driven = false;
    record.F_H_B = safety_.filter({}, input);
  }
  record.safety = status_without_force_;
}

void HandPart::change(std::uint32_t revision, std::unique_ptr<Coupling>& coupling) noexcept {
  revision_ = revision;
  if (coupling == nullptr) return;
  if (has_tool_) coupling->take_over(coupling_->state());
  std::swap(coupling_, coupling);
}

/// Returns the time step, s; 0 until the first usable state, from which on the hand moves the tool.
/// A tick without a time counts as a nominal one; the next one covers both.
double HandPart::step_seconds(const DeviceState& state) noexcept {
  const bool has_time = std::isfinite(state.time);
  if (has_tool_ && !has_time) return tick_seconds_;
  if (!has_tool_) {
    if (!state.is_valid || !has_time) return 0;
    coupling_->reset(state);
    has_tool_ = true;
    last_state_time_ = state.time - tick_seconds_;
  }
  // A late tick is a longer step, within bounds.
  const double dt =
      std::clamp(state.time - last_state_time_, tick_seconds_ / 10, 10 * tick_seconds_);
  last_state_time_ = state.time;
  return dt;
}

}}  // namespace palpate::v0
