// Largest stiffness of a stable wall, and the effect of contact with a camera's surface on a
// simulated hand. On a simulated clock: the same numbers on every machine.
//   z_width [CSV]
// 1. The stiffest stable wall over its damping (Z-width, Colgate & Brown 1994), for every model.
// 2. A hand that presses and slides on a wall, a ridge, a corner and a moving wall, by each
// coupling.
// 3. The force when a depth frame of the moving wall arrives (thesis Fig. 3.15).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "bench/haptic_setup.h"
#include "bench/harness.h"
#include "palpate/devices/devices.h"
#include "scenes/environment.h"
#include "src/run/internal/pipeline.h"

namespace palpate::bench {
namespace {

constexpr double kTick = 1e-3;  // s

// ---------------------------------------------------------------------------------- 1. Z-width

/// True if device and wall come to rest: a wall on both sides of the handle, F = -K x - B v, that
/// begins 10 um off its rest. On both sides the result is that of linear theory.
bool is_stable(const DeviceModel& model, const HandModel& hand, double stiffness, double damping) {
  constexpr double kOff = 1e-5;
  constexpr int kTicks = 1500;
  SimulatedDeviceOptions options;
  options.model = model;
  options.model.limits.max_force = 1e4;  // motors at their limit would hide the growth
  options.hand = hand;
  options.in_real_time = false;
  auto device = SimulatedDevice::create(options).value();
  double early = 0, late = 0;
  int number = 0;
  const Status started = device->start([&](const DeviceState& state) -> Wrench {
    const double x = state.X_BH.translation.z - kOff, v = state.V_BH.linear.z;
    const double speed = norm(device->true_state().V_BH.linear);
    if (number >= kTicks / 4 && number < kTicks / 2) early = std::max(early, speed);
    if (number >= 3 * kTicks / 4) late = std::max(late, speed);
    ++number;
    return {{0, 0, std::clamp(-stiffness * x - damping * v, -1e3, 1e3)}, {}};
  });
  if (!started) return false;
  device->run(kTicks);
  return late < 0.9 * early || late < 1e-9;
}

double largest_stiffness(const DeviceModel& model, const HandModel& hand, double damping) {
  double low = 1, high = 1e6;
  if (!is_stable(model, hand, low, damping)) return 0;
  while (high / low > 1.01) {
    const double middle = std::sqrt(low * high);
    (is_stable(model, hand, middle, damping) ? low : high) = middle;
  }
  return low;
}

/// Adds the largest stable stiffness of a wall by its damping, beside the passivity bound without
/// damping of the wall, 2 b / T.
void z_widths(ResultRows& rows) {
  constexpr double kDampings[] = {0, 0.5, 1, 2, 5, 10, 20, 50};
  constexpr HandModel kReleased{0, 0, 0, 2e-4, 0.01, 0};
  for (const DeviceModel& model : device_models()) {
    const double passive = 2 * model.limits.damping / kTick;
    for (const bool is_held : {false, true}) {
      for (const double damping : kDampings) {
        const double stiffness =
            largest_stiffness(model, is_held ? HandModel{} : kReleased, damping);
        rows.add("z-width/" + std::string(model.key) + (is_held ? "/held" : "/released") +
                     facts("/damping_Ns_m:%g", damping),
                 facts("max_stiffness_N_m=%.0f passive_N_m=%.0f", stiffness, passive));
      }
    }
  }
}

// ------------------------------------------------------------------------------ closed loops

/// A place to touch: frames from time 0 on, and the tool's pose just before contact.
struct Place {
  std::string name;
  DepthStreamInfo stream;
  std::vector<DepthFrame> frames;
  Pose X_WB;
  bool moves = false;
};

Place place_of(std::string name, scenes::Scene scene, const Vec3d& p_WB) {
  scene.width = 320;
  scene.height = 240;
  scene.intrinsics = {287.9, 287.9, 159.5, 119.5};
  scenes::SimulatedCameraOptions camera;
  camera.noise.enabled = false;
  camera.unit = 1e-4;
  Place place;
  place.name = std::move(name);
  place.moves = std::any_of(scene.bodies.begin(), scene.bodies.end(),
                            [](const scenes::Body& body) { return body.motion != nullptr; });
  if (!place.moves) camera.duration = 0.01;  // one frame
  place.frames = frames_of(scene, camera, place.stream).value();
  place.X_WB.translation = p_WB;
  return place;
}

Place place_of(const char* name, const scenes::Environment& environment, const Vec3d& p_WB) {
  scenes::Scene scene;
  scene.name = name;
  scene.environment = environment;
  return place_of(name, std::move(scene), p_WB);
}

constexpr double kBox = 0.1;  // m

std::vector<Place> places() {
  const double gap = 0.005;
  std::vector<Place> all;
  all.push_back(place_of("wall", scenes::Environment::wall(1), {0, 0, 1 - kBox / 2 - gap}));
  all.push_back(
      place_of("ridge", scenes::Environment::wedge(1, kPi / 2), {0, 0, 1 - kBox / 2 - gap}));
  all.push_back(
      place_of("corner", scenes::Environment::wedge(1, 1.5 * kPi), {0, 0, 1 - kBox - gap}));
  // The wall comes 6 cm nearer and goes back.
  all.push_back(place_of("moving wall", scenes::make_scene("moving-wall").value(),
                         {0, 0, 0.95 - kBox / 2 - gap}));
  return all;
}

/// Returns the hand's pose: 15 mm forward in 1 s, then 3 cm aside in 1 s; then it holds still.
Pose pressing_hand(double t) {
  const auto eased = [](double x) { return x <= 0 ? 0 : x >= 1 ? 1 : x * x * (3 - 2 * x); };
  return {{0.03 * eased(t - 1), 0, 0.015 * eased(t)}, {}};
}

/// A run on a simulated clock: frames arrive when they are captured, and a contact is available one
/// tick after its pose.
class Touch {
 public:
  Touch(const Tool& tool, const Place& place, const DeviceInfo& device, const RunSettings& settings)
      : place_(place), pipeline_(Pipeline::create(tool, place.stream, device, settings).value()) {}

  /// Takes new frames. True if one has arrived.
  bool look(double time) {
    bool is_arrival = false;
    for (; next_ < place_.frames.size() && place_.frames[next_].timestamp <= time; ++next_) {
      pipeline_.push(place_.frames[next_], place_.frames[next_].timestamp);
      is_arrival = next_ > 0;
    }
    return is_arrival;
  }
  Pipeline& pipeline() { return pipeline_; }

 private:
  const Place& place_;
  Pipeline pipeline_;
  std::size_t next_ = 0;
};

RunSettings settings_of(CouplingKind kind, TimeMode mode) {
  RunSettings settings;
  settings.num_threads = 1;
  settings.time.mode = mode;
  settings.coupling.kind = kind;
  settings.safety.max_sensor_age = 3600;  // some places have a single frame
  return settings;
}

/// Force on the hand at each tick, and summary values of the run.
struct Run {
  std::vector<double> times;
  std::vector<Vec3d> force;
  std::vector<bool> is_arrival;
  double largest_force = 0, observed_energy = -1e9, given_energy = -1e9, rattle = 0, stretch = 0;
  double stiffness = 0;  ///< of the coupling
  Fault fault = Fault::none;
};

Run feel(const Tool& tool, const Place& place, const DeviceModel& model, CouplingKind kind,
         TimeMode mode, double seconds) {
  SimulatedDeviceOptions options;
  options.model = model;
  options.target = pressing_hand;
  options.in_real_time = false;
  auto device = SimulatedDevice::create(options).value();
  RunSettings settings = settings_of(kind, mode);
  settings.coupling.X_WB = place.X_WB;
  Touch touch(tool, place, device->info(), settings);

  Run run;
  run.stiffness = touch.pipeline().coupling().stiffness;
  bool has_arrived = false;
  const Status started = device->start([&](const DeviceState& state) {
    // A frame that arrives now takes effect at the next tick.
    run.is_arrival.push_back(std::exchange(has_arrived, touch.look(state.time)));
    const TickRecord& tick = touch.pipeline().tick(state);
    run.times.push_back(state.time);
    run.force.push_back(tick.F_H_B.force);
    run.largest_force = std::max(run.largest_force, norm(tick.F_H_B.force));
    run.observed_energy = std::max(run.observed_energy, tick.safety.energy);
    run.given_energy = std::max(run.given_energy, device->energy_given());
    run.stretch = std::max(run.stretch, tick.step.stretch);
    run.fault = tick.safety.fault;
    return tick.F_H_B;
  });
  if (!started) return run;
  device->run(static_cast<int>(seconds / kTick) - 500);
  double sum = 0;
  for (int i = 0; i < 500; ++i) {
    device->run(1);
    const Vec3d v = device->true_state().V_BH.linear;
    sum += dot(v, v);
  }
  run.rattle = std::sqrt(sum / 500);
  return run;
}

struct NamedCoupling {
  const char* name;
  CouplingKind kind;
};
constexpr NamedCoupling kCouplings[] = {{"direct (penalty)", CouplingKind::direct},
                                        {"virtual coupling", CouplingKind::virtual_coupling},
                                        {"proxy", CouplingKind::proxy}};
constexpr const char* kModels[] = {"touch", "omega.6", "lambda.7"};

/// Adds a hand that presses 10 mm in, slides 3 cm and holds still, with contacts one tick late: the
/// energy that it was given net at most, by the safety filter's observer and truly; the RMS speed
/// of the handle at the end; the largest distance between hand and tool.
void closed_loops(const Tool& tool, const std::vector<Place>& all, ResultRows& rows) {
  for (const char* model : kModels) {
    for (const Place& place : all) {
      for (const auto& [name, kind] : kCouplings) {
        const Run run =
            feel(tool, place, *find_device_model(model), kind, TimeMode::interpolate, 4);
        rows.add(std::string("closed-loop/") + model + "/" + place.name + "/" + name,
                 facts("stiffness_N_m=%.0f largest_force_N=%.3f observed_mJ=%.3f true_mJ=%.3f "
                       "rattle_mm_s=%.4f apart_mm=%.3f fault=%d",
                       run.stiffness, run.largest_force, run.observed_energy * 1e3,
                       run.given_energy * 1e3, run.rattle * 1e3, run.stretch * 1e3,
                       static_cast<int>(run.fault)));
      }
    }
  }
}

// ------------------------------------------------------------------- 3. when a frame arrives

double median(std::vector<double> values, double share = 0.5) {
  if (values.empty()) return NAN;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

/// Changes of the force from tick to tick in contact: at the arrival of a frame, and elsewhere.
struct Steps {
  double arrival, arrival_max, between;
};
Steps steps_of(const Run& run) {
  std::vector<double> arrival, between;
  for (std::size_t k = 500; k < run.force.size(); ++k) {
    if (norm(run.force[k]) < 0.1 * run.largest_force) continue;
    (run.is_arrival[k] ? arrival : between).push_back(norm(run.force[k] - run.force[k - 1]));
  }
  return {median(arrival), median(arrival, 1), median(between)};
}

/// Holds the tool fixed: the contact force itself.
Run held_fast(const Tool& tool, const Place& place, const Pose& X_WT, const DeviceModel& model,
              TimeMode mode) {
  DeviceInfo device;
  device.limits = model.limits;
  Touch touch(tool, place, device, settings_of(CouplingKind::none, mode));
  Run run;
  for (double time = 0; time <= place.frames.back().timestamp; time += kTick) {
    run.times.push_back(time);
    run.is_arrival.push_back(touch.look(time));
    run.force.push_back(touch.pipeline().measure(X_WT, time).contact.F_C_W.force);
    run.largest_force = std::max(run.largest_force, norm(run.force.back()));
  }
  return run;
}

/// Returns the lag of the force, s, by the best fit of the time-shifted linear interpolation
/// between the frames' own forces.
double lag_of(const Run& run, const Run& latest) {
  std::vector<std::pair<double, double>> truth;
  for (std::size_t k = 0; k < latest.force.size(); ++k) {
    if (k == 0 || latest.is_arrival[k]) truth.emplace_back(latest.times[k], latest.force[k].z);
  }
  const auto truth_at = [&truth](double time) {
    auto next = std::upper_bound(truth.begin(), truth.end(), std::pair{time, 1e9});
    if (next == truth.begin()) return next->second;
    if (next == truth.end()) return truth.back().second;
    const auto last = std::prev(next);
    return std::lerp(last->second, next->second,
                     (time - last->first) / (next->first - last->first));
  };
  double best = 0, least = 1e300;
  for (double lag = -0.02; lag <= 0.08; lag += 0.0005) {
    double sum = 0;
    for (std::size_t k = 300; k < run.force.size(); ++k) {
      const double off = run.force[k].z - truth_at(run.times[k] - lag);
      sum += off * off;
    }
    if (sum < least) std::tie(least, best) = std::pair{sum, lag};
  }
  return best;
}

/// Adds the changes of the force before a moving wall: within the tick of a frame's arrival, and
/// within other ticks.
void arrivals(const Tool& tool, const Place& place, ResultRows& rows) {
  const DeviceModel model = *find_device_model("touch");
  Pose X_WT = place.X_WB;
  X_WT.translation.z += 0.01;
  const std::pair<const char*, TimeMode> modes[] = {{"latest", TimeMode::latest},
                                                    {"interpolate", TimeMode::interpolate},
                                                    {"predict", TimeMode::predict}};
  const Run latest = held_fast(tool, place, X_WT, model, TimeMode::latest);
  const std::pair<const char*, std::optional<CouplingKind>> ways[] = {
      {"contact, tool held fast", std::nullopt},
      {"hand, direct", CouplingKind::direct},
      {"hand, virtual coupling", CouplingKind::virtual_coupling}};
  for (const auto& [what, kind] : ways) {
    for (const auto& [name, mode] : modes) {
      const Run run = kind ? feel(tool, place, model, *kind, mode, 4)
                           : held_fast(tool, place, X_WT, model, mode);
      const Steps steps = steps_of(run);
      rows.add(std::string("arrival/") + what + "/" + name,
               facts("arrival_N=%.6f arrival_max_N=%.6f between_N=%.6f lag_ms=%.1f", steps.arrival,
                     steps.arrival_max, steps.between, kind ? NAN : lag_of(run, latest) * 1e3));
    }
  }
}

void run_all(ResultRows& rows) {
  z_widths(rows);
  scenes::Scene scene;
  scene.tool_shape = "box";
  scene.tool_size = kBox;
  const Tool tool = tool_for(scene, 1000).value();
  const std::vector<Place> all = places();
  closed_loops(tool, all, rows);
  arrivals(tool, all.back(), rows);
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::ResultRows rows(argc, argv);
  if (!rows.open(argc > 1 ? argv[1] : "z-width.csv")) return 1;
  palpate::bench::run_all(rows);
  return rows.close() ? 0 : 1;
}
