#include "src/run/setting_changes.h"

#include <string>

namespace palpate {
namespace {

// Each of these names all members of its structure, or it does not compile.

bool is_same(const DepthFilterOptions& a, const DepthFilterOptions& b) {
  const auto& [enabled, radius, sigma_space, sigma_depth] = a;
  return enabled == b.enabled && radius == b.radius && sigma_space == b.sigma_space &&
         sigma_depth == b.sigma_depth;
}

bool is_same(const NormalOptions& a, const NormalOptions& b) {
  const auto& [fit, radius, max_change, anchoring, weighting, sigma, normalization, min] = a;
  return fit == b.fit && radius == b.radius && max_change == b.max_depth_change &&
         anchoring == b.anchoring && weighting == b.weighting && sigma == b.weight_sigma &&
         normalization == b.normalization && min == b.min_neighbours;
}

bool is_same(const DepthChangeOptions& a, const DepthChangeOptions& b) {
  const auto& [enabled, min_step] = a;
  return enabled == b.enabled && min_step == b.min_step;
}

bool is_same(const SurfaceOptions& a, const SurfaceOptions& b) {
  const auto& [filter, normals, depth_change, min_depth, max_depth] = a;
  return is_same(filter, b.filter) && is_same(normals, b.normals) &&
         is_same(depth_change, b.depth_change) && min_depth == b.min_depth &&
         max_depth == b.max_depth;
}

bool is_same(const DepthFieldOptions& a, const DepthFieldOptions& b) {
  const auto& [unknown, fill_levels, thickness] = a;
  return unknown == b.unknown && fill_levels == b.fill_levels && thickness == b.thickness;
}

bool is_same(const DepthAverageOptions& a, const DepthAverageOptions& b) {
  const auto& [kind, frames, weight, max_jump, keep_frames] = a;
  return kind == b.kind && frames == b.frames && weight == b.weight && max_jump == b.max_jump &&
         keep_frames == b.keep_frames;
}

bool is_same(const TimeOptions& a, const TimeOptions& b) {
  const auto& [mode, average, max_jump, first_period] = a;
  return mode == b.mode && is_same(average, b.average) && max_jump == b.max_jump &&
         first_period == b.first_period;
}

bool is_same(const CouplingOptions& a, const CouplingOptions& b) {
  const auto& [kind, hold, stiffness, angular_stiffness, damping_ratio, mass, force, scale, X_WB,
               X_HT] = a;
  return kind == b.kind && hold == b.hold && stiffness == b.stiffness &&
         angular_stiffness == b.angular_stiffness && damping_ratio == b.damping_ratio &&
         mass == b.tool_mass && force == b.force_at_eighth && scale == b.motion_scale &&
         X_WB == b.X_WB && X_HT == b.X_HT;
}

/// The first of them that differs.
const char* safety_change(const SafetyOptions& a, const SafetyOptions& b) {
  const auto& [force_share, max_slew, max_torque_slew, ramp, engage_force, engage_ticks,
               engage_timeout, fade, contact_age, sensor_age, silence, tick, dead_man, passivity,
               tank] = a;
  if (force_share != b.force_share) return "safety.force_share";
  if (max_slew != b.max_slew) return "safety.max_slew";
  if (max_torque_slew != b.max_torque_slew) return "safety.max_torque_slew";
  if (ramp != b.ramp_seconds) return "safety.ramp_seconds";
  if (engage_force != b.engage_force) return "safety.engage_force";
  if (engage_ticks != b.engage_ticks) return "safety.engage_ticks";
  if (engage_timeout != b.engage_timeout) return "safety.engage_timeout";
  if (fade != b.fade_seconds) return "safety.fade_seconds";
  if (contact_age != b.max_contact_age) return "safety.max_contact_age";
  if (sensor_age != b.max_sensor_age) return "safety.max_sensor_age";
  if (silence != b.max_device_silence) return "safety.max_device_silence";
  if (tick != b.max_tick) return "safety.max_tick";
  if (dead_man != b.dead_man) return "safety.dead_man";
  if (passivity != b.passivity_control) return "safety.passivity_control";
  if (tank != b.energy_tank) return "safety.energy_tank";
  return nullptr;
}

const char* lasting_change(const HapticSettings& a, const HapticSettings& b) {
  if (const char* name = safety_change(a.safety, b.safety)) return name;
  if (a.num_threads != b.num_threads) return "loop.threads";
  if (a.sensing_gpu != b.sensing_gpu) return "loop.sensing_gpu";
  if (a.contact_gpu != b.contact_gpu) return "loop.contact_gpu";
  if (a.wants_real_time != b.wants_real_time) return "loop.real_time";
  if (a.coupling.X_WB != b.coupling.X_WB) return "coupling.base_in_scene";
  if (a.coupling.X_HT != b.coupling.X_HT) return "coupling.tool_in_hand";
  return nullptr;
}

bool has_field(const HapticSettings& settings) {
  return settings.contact.method == InsideMethod::field;
}

}  // namespace

Status check_change(const HapticSettings& before, const HapticSettings& after) {
  const char* name = lasting_change(before, after);
  if (name == nullptr) return Done{};
  return Error{Errc::invalid_argument,
               std::string(name) + " cannot change while the loop runs; end it and start again"};
}

bool keeps_surfaces(const HapticSettings& before, const HapticSettings& after) {
  return before.backend == after.backend && has_field(before) == has_field(after) &&
         is_same(before.surface, after.surface) && is_same(before.time, after.time) &&
         (!has_field(after) || is_same(before.field, after.field));
}

bool keeps_coupling(const HapticSettings& before, const HapticSettings& after) {
  return is_same(before.coupling, after.coupling);
}

}  // namespace palpate
