// One's own haptic loop: the newest measure as a local contact, and at each tick the coupling and
// the safety filter.
#include <cmath>

#include "palpate/haptics/coupling.h"
#include "palpate/haptics/safety.h"
#include "src/c/handles.h"

using namespace palpate;

struct palpate_hand {
  MassProperties mass;
  double tool_volume;
  DeviceLimits limits;
  double tick_seconds;
  CouplingOptions options;
  std::unique_ptr<Coupling> coupling;
  SafetyFilter safety;
  VolumeStiffness scale;
  LocalContact contact;
  double captured = 0, first_tick = 0, last_time = 0;
  bool has_tool = false, has_ticked = false;
};

namespace {

Stiffness stiffness_of(const palpate_measure& m) {
  Stiffness all;
  for (int i = 0; i < 36; ++i) all.m[i / 6][i % 6] = m.stiffness[i];
  return all;
}

/// Returns the time step of a tick, s; 0 until the first usable state, from which on the hand moves
/// the tool.
double step_seconds(palpate_hand& hand, const DeviceState& state) {
  if (!hand.has_tool) {
    if (!state.is_valid || !std::isfinite(state.time)) return 0;
    hand.coupling->reset(state);
    hand.has_tool = true;
    hand.last_time = state.time - hand.tick_seconds;
  }
  if (!std::isfinite(state.time)) return hand.tick_seconds;
  const double dt =
      std::clamp(state.time - hand.last_time, hand.tick_seconds / 10, 10 * hand.tick_seconds);
  hand.last_time = state.time;
  return dt;
}

/// Reads and checks options on top of `coupling` and `safety`.
Status read_hand(const char* text, const palpate_hand* hand, const DeviceLimits& limits,
                 double tick_seconds, const MassProperties& mass, CouplingOptions& coupling,
                 SafetyOptions& safety) {
  static_cast<void>(hand);
  if (const Status status = read_options(text, coupling, safety); !status) return status;
  auto checked = check_coupling(coupling, limits, tick_seconds, mass);
  if (!checked) return checked.error();
  coupling = checked->options;
  return Done{};
}

}  // namespace

extern "C" {

palpate_hand* palpate_hand_create(const palpate_tool* tool, const palpate_device* device,
                                  const char* options, palpate_error* error) {
  return guarded_call(error, static_cast<palpate_hand*>(nullptr), [&]() -> palpate_hand* {
    if (tool == nullptr || !is_given(device)) {
      return fail(error, "a hand has no tool, or no device with its size set: give both"), nullptr;
    }
    const palpate_device d = taken(device);
    if (!(d.rate >= 1 && d.rate <= 1e6))
      return fail(error, "the rate of a device is not from 1 to 1000000 ticks per second"), nullptr;
    const DeviceLimits limits{
        d.max_force,   d.max_torque,       d.max_stiffness, d.max_angular_stiffness,
        d.max_damping, d.workspace_radius, d.damping,       d.angular_damping};
    const MassProperties& mass = tool->tool.sphere_mass();
    CouplingOptions coupling;
    SafetyOptions safe;
    if (const Status status = read_hand(options, nullptr, limits, 1 / d.rate, mass, coupling, safe);
        !status)
      return fail(error, status.error()), nullptr;
    auto safety = SafetyFilter::create(limits, safe);
    if (!safety) return fail(error, safety.error()), nullptr;
    const double volume = tool->tool.mesh_mass().volume;
    auto hand = new palpate_hand{mass,
                                 volume,
                                 limits,
                                 1 / d.rate,
                                 coupling,
                                 make_coupling(coupling, limits, mass),
                                 *std::move(safety),
                                 {},
                                 {}};
    hand->scale = thesis_volume_stiffness(coupling.force_at_eighth, volume);
    return hand;
  });
}

void palpate_hand_free(palpate_hand* hand) { delete hand; }

void palpate_hand_contact(palpate_hand* hand, const palpate_measure* measure,
                          const palpate_pose* X_WT, double time, double captured) {
  if (hand == nullptr || !is_given(measure) || X_WT == nullptr) return;
  const palpate_measure m = taken(measure);
  Penetration p;
  p.volume = m.volume;
  p.potential = m.potential;
  p.measure_W = {vector_of(m.force), vector_of(m.torque)};
  p.status.bits = m.status;
  const bool has_stiffness = (m.wants & PALPATE_WANTS_STIFFNESS) != 0;
  const Pose X = pose_of(*X_WT);
  const Stiffness stiffness = has_stiffness ? stiffness_of(m) : Stiffness{};
  VolumeMoments moments;
  for (int i = 0; i < 9; ++i) moments.first[i / 3][i % 3] = m.moments[i];
  moments.polar = m.polar_moment;
  ContactPatch patch;
  if (m.volume > 0) {
    patch = has_stiffness ? contact_patch(p.measure_W, p.volume, stiffness, moments)
                          : guessed_patch(p.measure_W, p.volume, hand->mass, X.rotation);
  }
  hand->contact = local_contact(p, stiffness, X, hand->mass.center_of_mass, hand->scale, time,
                                time - captured, patch);
  hand->captured = captured;
}

void palpate_hand_tick(palpate_hand* hand, const palpate_handle* handle, palpate_tick* tick) {
  if (hand == nullptr || !is_given(handle) || !is_given(tick)) return;
  const palpate_handle h = taken(handle);
  const DeviceState state{h.time,
                          pose_of(h.X_BH),
                          {vector_of(h.linear), vector_of(h.angular)},
                          h.buttons,
                          h.is_valid != 0};
  if (!hand->has_ticked) hand->first_tick = h.time;
  hand->has_ticked = true;
  const double dt = step_seconds(*hand, state);
  const CouplingStep step =
      dt > 0 ? hand->coupling->step(state, hand->contact, dt) : CouplingStep{};
  const bool is_measured = hand->contact.is_valid;
  SafetyInput input;
  input.time = h.time;
  input.state = state;
  input.contact_age = h.time - (is_measured ? hand->contact.time : hand->first_tick);
  input.sensor_age = h.time - (is_measured ? hand->captured : hand->first_tick);
  input.is_requested = h.wants_force != 0;
  input.is_free = is_measured && hand->contact.volume == 0 && step.contact_W.force == Vec3d{} &&
                  step.contact_W.torque == Vec3d{};
  input.is_measured = is_measured;
  input.is_driven = h.is_released == 0;
  input.is_clutched = step.is_clutched;
  input.stored = step.stored;
  if (h.is_stopping != 0) hand->safety.stop();
  const Wrench F_H_B = hand->safety.filter(step.desired_F_H_B, input);
  const SafetyStatus& status = hand->safety.status();
  palpate_tick out{};
  put(F_H_B.force, out.F_H_B.force);
  put(F_H_B.torque, out.F_H_B.torque);
  put(step.contact_W.force, out.contact_W.force);
  put(step.contact_W.torque, out.contact_W.torque);
  out.X_WT = c_pose(step.X_WT);
  out.X_WT_hand = c_pose(step.X_WT_hand);
  out.stretch = step.stretch;
  out.energy = status.energy;
  out.gain = status.gain;
  out.state = static_cast<int32_t>(status.state);
  out.fault = static_cast<int32_t>(status.fault);
  out.num_faults = static_cast<int32_t>(status.num_faults);
  give(out, tick);
}

int palpate_hand_change(palpate_hand* hand, const char* options, palpate_error* error) {
  return guarded_call(error, PALPATE_FAILED, [&] {
    if (hand == nullptr) return fail(error, "there is no hand to change: create one");
    CouplingOptions coupling;
    SafetyOptions safety;
    const Status status =
        read_hand(options, hand, hand->limits, hand->tick_seconds, hand->mass, coupling, safety);
    if (!status) return fail(error, status.error());
    auto made = make_coupling(coupling, hand->limits, hand->mass);
    if (hand->has_tool) made->take_over(hand->coupling->state());
    hand->coupling = std::move(made);
    hand->options = coupling;
    hand->scale = thesis_volume_stiffness(coupling.force_at_eighth, hand->tool_volume);
    return PALPATE_OK;
  });
}

void palpate_hand_handle_at(const palpate_hand* hand, const palpate_pose* X_WT,
                            palpate_pose* X_BH) {
  if (hand == nullptr || X_WT == nullptr || X_BH == nullptr) return;
  *X_BH = c_pose(handle_at(hand->options, pose_of(*X_WT)));
}

const char* palpate_fault_text(int32_t fault) {
  const int32_t num = static_cast<int32_t>(names_of(Fault{}).size());
  return fault >= 0 && fault < num ? describe(static_cast<Fault>(fault)).data() : "";
}

}  // extern "C"
