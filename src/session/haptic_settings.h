// The settings of a haptic run, each once: its place in a file, its range, and what it means.
#pragma once

#include <array>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "palpate/run/haptic_loop.h"
#include "palpate/session/names.h"

namespace palpate {

/// Where a setting stands, and a line for people.
struct SettingName {
  const char* section;
  const char* key;
  const char* words;
};

/// What a number may be, both ends included.
struct SettingRange {
  double low = 0, high = 0;
};

/// Calls visit(SettingName, value, how) for every setting, in the order of the file. `how` is a
/// SettingRange for numbers, a table of names for what is chosen by name, and nothing for the rest.
template <class Settings, class Visit>
void visit_settings(Settings& s, Visit&& visit) {
  using Range = SettingRange;
  constexpr double kPositive = 1e-6, kLong = 3600;

  const auto contact = [&](const char* key, const char* words, auto& value, const auto&... how) {
    visit(SettingName{"contact", key, words}, value, how...);
  };
  contact("method", "how a sphere is measured", s.contact.method, kMethodNames);
  contact("priority", "what makes a boundary sphere good", s.contact.priority, kPriorityNames);
  contact("inside", "volume of a sphere that the graph reaches", s.contact.inside, kInsideNames);
  contact("volumes", "what a sphere counts", s.contact.volumes, kVolumesNames);
  contact("edges", "where the surface ends in front of something farther away", s.contact.edges,
          kEdgesNames);
  contact("continuity", "smoothing of the point-hit methods", s.contact.continuity,
          kContinuityNames);

  const auto surface = [&](const char* key, const char* words, auto& value, const auto&... how) {
    visit(SettingName{"surface", key, words}, value, how...);
  };
  auto& filter = s.surface.filter;
  surface("min_depth", "m; nearer pixels are no measurement", s.surface.min_depth,
          Range{1e-3, 1e3});
  surface("max_depth", "m; farther pixels are no measurement", s.surface.max_depth,
          Range{1e-3, 1e3});
  surface("filter", "bilateral filter of the depth", filter.enabled);
  surface("filter_radius", "pixels", filter.radius, Range{1, 7});
  surface("filter_sigma_space", "pixels", filter.sigma_space, Range{0.1, 1000});
  surface("filter_sigma_depth", "m at a depth of 1 m", filter.sigma_depth, Range{1e-9, 1});
  auto& normals = s.surface.normals;
  surface("plane_fit", "which coordinates of a pixel are noisy", normals.fit, kPlaneFitNames);
  surface("normal_radius", "pixels around a point for its normal", normals.radius, Range{1, 7});
  surface("normal_max_depth_change", "share of the depth; beyond it is another surface",
          normals.max_depth_change, Range{kPositive, 10});
  surface("anchoring", "planes through the point itself", normals.anchoring);
  surface("weighting", "near neighbours count more", normals.weighting);
  surface("weight_sigma", "m at a depth of 1 m", normals.weight_sigma, Range{kPositive, 10});
  surface("normalization", "all neighbours count the same", normals.normalization);
  surface("min_neighbours", "fewer valid pixels give no normal", normals.min_neighbours,
          Range{3, 225});
  surface("depth_change", "find where the surface ends, for `edges`",
          s.surface.depth_change.enabled);
  surface("depth_change_min_step", "m", s.surface.depth_change.min_step, Range{0, 10});

  const auto field = [&](const char* key, const char* words, auto& value, const auto&... how) {
    visit(SettingName{"field", key, words}, value, how...);
  };
  field("unknown", "what lies where nothing was measured", s.field.unknown, kUnknownNames);
  field("fill_levels", "close holes up to about 2^this pixels wide", s.field.fill_levels,
        Range{0, 5});
  field("thickness", "m; how far behind a surface a tool is pushed out of its front",
        s.field.thickness, Range{1e-3, kSolidBehind});

  const auto time = [&](const char* key, const char* words, auto& value, const auto&... how) {
    visit(SettingName{"time", key, words}, value, how...);
  };
  time("mode", "what is felt until the next depth frame comes", s.time.mode, kTimeModeNames);
  time("max_jump", "predict: share of the depth; a larger change is another surface",
       s.time.max_jump, Range{0, 10});
  time("first_period", "s between the first frames; 0: as the stream says", s.time.first_period,
       Range{0, kLong});
  time("average", "of each pixel's depth over time", s.time.average.kind, kDepthAverageNames);
  time("average_frames", "moving: measurements in the mean", s.time.average.frames, Range{1, 64});
  time("average_weight", "exponential: of the newest measurement", s.time.average.weight,
       Range{1e-9, 1});
  time("average_max_jump", "share of the mean; farther off it is another surface",
       s.time.average.max_jump, Range{kPositive, 10});
  time("average_keep_frames", "a pixel without measurement keeps its mean so long",
       s.time.average.keep_frames, Range{0, 100});

  const auto loop = [&](const char* key, const char* words, auto& value, const auto&... how) {
    visit(SettingName{"loop", key, words}, value, how...);
  };
  loop("backend", "where surfaces and queries are computed", s.backend, kUsedBackendNames);
  loop("sensing_gpu", "cuda: which GPU makes the surfaces", s.sensing_gpu, Range{0, 63});
  loop("contact_gpu", "cuda: which GPU computes queries", s.contact_gpu, Range{0, 63});
  loop("threads", "for surfaces; 0: one per core", s.num_threads, Range{0, 256});
  loop("contact_rate", "queries per second, at most", s.contact_rate, Range{1, 100000});
  loop("real_time", "real-time scheduling and locked memory where they are allowed",
       s.wants_real_time);

  const auto coupling = [&](const char* key, const char* words, auto& value, const auto&... how) {
    visit(SettingName{"coupling", key, words}, value, how...);
  };
  auto& c = s.coupling;
  coupling("kind", "what joins hand and tool", c.kind, kCouplingNames);
  coupling("hold", "how contact between queries is known", c.hold, kContactHoldNames);
  coupling("stiffness", "N/m; 0: as much as device and passivity allow", c.stiffness,
           Range{0, 1e6});
  coupling("angular_stiffness", "N m/rad; 0: as much as device and passivity allow",
           c.angular_stiffness, Range{0, 1e4});
  coupling("damping_ratio", "1: critical", c.damping_ratio, Range{0, 100});
  coupling("tool_mass", "kg, of the simulated tool", c.tool_mass, Range{kPositive, 1e3});
  coupling("force_at_eighth", "N at an eighth of the tool's volume; 0: the device's largest",
           c.force_at_eighth, Range{0, 1e6});
  coupling("motion_scale", "metres of tool per metre of hand", c.motion_scale,
           Range{kPositive, 1e6});
  coupling("base_in_scene", "X_WB: x y z in m, quaternion x y z w; identity: put before the scene",
           c.X_WB);
  coupling("tool_in_hand", "X_HT: x y z in m, quaternion x y z w", c.X_HT);

  const auto safety = [&](const char* key, const char* words, auto& value, const auto&... how) {
    visit(SettingName{"safety", key, words}, value, how...);
  };
  auto& f = s.safety;
  safety("force_share", "of the device's limits; no more goes out", f.force_share, Range{0, 1});
  safety("max_slew", "N/s", f.max_slew, Range{kPositive, 1e7});
  safety("max_torque_slew", "N m/s", f.max_torque_slew, Range{kPositive, 1e7});
  safety("ramp_seconds", "s from no force to all of it", f.ramp_seconds, Range{0, kLong});
  safety("engage_force", "N; engages once the wanted force is below", f.engage_force,
         Range{0, 1e4});
  safety("engage_ticks", "ticks in a row below it", f.engage_ticks, Range{1, 1000000});
  safety("engage_timeout", "s; then a hand inside something is let in by the ramp",
         f.engage_timeout, Range{0, kLong});
  safety("fade_seconds", "s from any force to none after a fault", f.fade_seconds, Range{0, 1});
  safety("max_contact_age", "s", f.max_contact_age, Range{kPositive, kLong});
  safety("max_sensor_age", "s", f.max_sensor_age, Range{kPositive, kLong});
  safety("max_device_silence", "s without a usable state", f.max_device_silence,
         Range{kPositive, kLong});
  safety("max_tick", "s between ticks", f.max_tick, Range{kPositive, kLong});
  safety("dead_man", "force only while button 0 is held", f.dead_man);
  safety("passivity_control", "damps when the hand is given energy", f.passivity_control);
  safety("energy_tank", "J that may be given; it damps from half of it on", f.energy_tank,
         Range{kPositive, 1e3});
}

nlohmann::ordered_json to_json(const HapticSettings& settings);
/// Throws nlohmann::json::exception for missing or ill-typed members. Error: a name that is not
/// known.
Result<HapticSettings> haptic_settings_from_json(const nlohmann::ordered_json& json);

}  // namespace palpate
