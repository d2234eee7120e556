// Noise of the force at rest, and its lag in motion, by average of depth over time: the force of
// the field at each frame, from the latest frame.
//   calm_force CSV FOLDER_OF_RECORDED_FRAMES [rest | recorded | sudden | lag | cost]
// 1. A simulated scene at rest with Kinect noise: rms of force and torque around their means.
// 2. The same where the recorded camera rests (visp_rbt, its first six frames).
// 3. Lag behind a wall of 5 to 200 mm/s and behind a hand: by correlation with the force of a
//    camera without noise.
// 4. A hand that appears and disappears: share of its force in the first frame.
// 5. Cost of a frame.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "bench/harness.h"
#include "palpate/contact/contact.h"
#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "scenes/scene.h"

namespace palpate::bench {
namespace {

constexpr DepthAverage kKinds[] = {DepthAverage::none, DepthAverage::moving,
                                   DepthAverage::exponential, DepthAverage::kalman};

ResultRows* rows = nullptr;
void row(const std::string& figure, const std::string& of, DepthAverage kind, double value,
         const char* unit) {
  rows->add(figure + "/" + of + "/average:" + name_of(kind), value, unit);
}

Tool tool_of(const char* shape, double size) {
  return Tool::pack(make_shape(shape, size).value(), {.max_spheres = 1000}).value();
}

/// Recorded frames of a camera.
struct Recorded {
  DepthStreamInfo stream;
  std::vector<DepthFrame> frames;
};

Recorded seen(scenes::Scene scene, double duration, bool has_noise, double rate = 30) {
  scenes::SimulatedCameraOptions options;
  options.noise.enabled = has_noise;
  options.unit = has_noise ? 0.001 : 2e-5;
  options.duration = duration;
  scene.rate = rate;
  auto source = scenes::open_simulated_camera(std::move(scene), options).value();
  Recorded all{source->info(), {}};
  DepthFrame frame;
  while (source->next(frame).value()) all.frames.push_back(frame);
  return all;
}

/// Measured forces and torques on the tool, frame by frame.
using Wrenches = std::vector<VolumeWrench>;
std::vector<Wrenches> felt(const Recorded& seen, const Tool& tool, const std::vector<Pose>& places,
                           const DepthAverageOptions& average, const SurfaceOptions& surface = {}) {
  TimeOptions time;
  time.mode = TimeMode::latest;
  time.average = average;
  ThreadPool pool(1);
  auto timeline = SurfaceTimeline::create(seen.stream, {.surface = surface, .time = time}).value();
  const auto query = make_contact_query(Place::cpu(), tool, FieldMethod{}).value();
  std::vector<Wrenches> all(places.size());
  double now = 0;
  for (const DepthFrame& frame : seen.frames) {
    now += 1 / seen.stream.rate;
    timeline.push(frame, now, pool);
    for (std::size_t i = 0; i < places.size(); ++i) {
      all[i].push_back(query->measure(timeline.at(now).to, places[i]).penetration.measure_W);
    }
  }
  return all;
}
Wrenches felt(const Recorded& seen, const Tool& tool, const Pose& X_WT,
              const DepthAverageOptions& average) {
  return felt(seen, tool, std::vector<Pose>{X_WT}, average).front();
}

DepthAverageOptions average_of(DepthAverage kind) {
  DepthAverageOptions options;
  options.kind = kind;
  return options;
}

/// Rms around the mean from an entry on; the torque relative to the force at half the tool's size.
struct Jitter {
  double force, torque;
  double size;  ///< of the force's magnitude alone, as in the evaluation's figure "frames"
};
Jitter jitter(const Wrenches& all, std::size_t from, double size) {
  Vec3d force, torque;
  const double num = static_cast<double>(all.size() - from);
  for (std::size_t k = from; k < all.size(); ++k) {
    force += (1 / num) * all[k].force;
    torque += (1 / num) * all[k].torque;
  }
  double f = 0, t = 0, lengths = 0, squares = 0;
  for (std::size_t k = from; k < all.size(); ++k) {
    lengths += norm(all[k].force), squares += dot(all[k].force, all[k].force);
    f += dot(all[k].force - force, all[k].force - force);
    t += dot(all[k].torque - torque, all[k].torque - torque);
  }
  const double whole = norm(force);
  return {std::sqrt(f / num) / whole, std::sqrt(t / num) / (whole * size / 2),
          std::sqrt(std::max(0.0, squares / num - lengths / num * (lengths / num))) / whole};
}

double rms(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

// --- Rest ------------------------------------------------------------------------------------

constexpr double kBox = 0.1;
const Pose kInWall{{0.001, 0.002, 0.93}, axis_angle({1, 2, 0}, 0.1)};

void rest_simulated() {
  scenes::Scene wall = scenes::make_scene("moving-wall").value();
  wall.bodies[0].motion = nullptr;
  wall.bodies[0].X_WB = {{0, 0, 0.946}, {}};
  scenes::Scene hand = scenes::make_scene("hand").value();
  hand.bodies[1].motion = nullptr;
  const struct {
    const char* name;
    scenes::Scene scene;
    Tool tool;
    double size;
    Pose X_WT;
  } cases[] = {{"wall", wall, tool_of("box", kBox), kBox, kInWall},
               {"hand", hand, tool_of("sphere", 0.06), 0.06,
                hand.bodies[1].X_WB * Pose{{0, -0.005, -0.03}, {}}}};
  for (const auto& [name, scene, tool, size, X_WT] : cases) {
    const Recorded frames = seen(scene, 4, true);
    for (const DepthAverage kind : kKinds) {
      const Wrenches all = felt(frames, tool, X_WT, average_of(kind));
      for (const double from : {0.5, 2.0}) {
        const Jitter j = jitter(all, static_cast<std::size_t>(from * 30), size);
        const std::string of = std::string(name) + ", from " + (from < 1 ? "0.5" : "2") + " s on";
        row("rest force", of, kind, 100 * j.force, "%");
        row("rest force, its length", of, kind, 100 * j.size, "%");
        row("rest torque", of, kind, 100 * j.torque, "%");
      }
    }
  }
}

void rest_recorded(const std::filesystem::path& data) {
  Recorded once;
  once.stream.width = 640;
  once.stream.height = 480;
  once.stream.intrinsics = {607.178, 607.234, 321.391, 241.918};
  once.stream.rate = 30;
  for (int i = 0; i < 6; ++i) {
    const std::string name = "sequences/visp_rbt/depth/00000" + std::to_string(i) + ".png";
    auto frame = load_depth_png(data / name, 0.001);
    if (!frame) {
      std::fprintf(stderr, "calm_force: left out: %s\n", frame.error().message.c_str());
      return;
    }
    once.frames.push_back(*std::move(frame));
  }
  // Back and forth, to extend the recorded rest.
  Recorded loop{once.stream, {}};
  for (int k = 0; k < 120; ++k) {
    const int at = k % 10;
    loop.frames.push_back(once.frames[static_cast<std::size_t>(at < 6 ? at : 10 - at)]);
  }
  constexpr double kBall = 0.08;
  const Tool tool = tool_of("sphere", kBall);
  const Intrinsics& k = once.stream.intrinsics;
  std::vector<Pose> places;
  for (int v = 80; v < 480; v += 80) {
    for (int u = 80; u < 640; u += 80) {
      std::vector<int> around;
      for (int i = -10; i <= 10; ++i) {
        for (int j = -10; j <= 10; ++j) {
          const auto at = static_cast<std::size_t>((v + i) * 640 + u + j);
          if (const int count = once.frames[0].pixels[at]; count > 0) around.push_back(count);
        }
      }
      if (around.size() < 400) continue;
      std::nth_element(around.begin(), around.begin() + 200, around.end());
      const double z = 0.001 * around[200];
      if (z > 1.5) continue;
      places.push_back({{(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z}, {}});
    }
  }
  const SurfaceOptions surface = surface_options_for(SensorKind::active_stereo);
  for (const DepthAverage kind : kKinds) {
    std::vector<double> forces, torques, steps;
    DepthAverageOptions average;
    if (kind == DepthAverage::kalman) {
      average = depth_average_options_for(SensorKind::active_stereo);
    }
    average.kind = kind;
    for (const Wrenches& all : felt(loop, tool, places, average, surface)) {
      const Jitter j = jitter(all, 30, kBall);
      forces.push_back(j.force);
      torques.push_back(j.torque);
    }
    for (const Wrenches& all : felt(once, tool, places, average, surface)) {
      for (std::size_t i = 3; i < 6; ++i) {
        steps.push_back(norm(all[i].force - all[i - 1].force) / norm(all[i].force));
      }
    }
    const std::string of = "visp_rbt, " + std::to_string(places.size()) + " places";
    row("recorded rest force", of, kind, 100 * rms(forces), "%");
    row("recorded rest torque", of, kind, 100 * rms(torques), "%");
    row("recorded steps", of + ", frames 3 to 5", kind, 100 * rms(steps), "%");
  }
}

// --- Lag -------------------------------------------------------------------------------------

/// Returns the lag behind the noise-free force with the best correlation, s.
double lag(const Wrenches& felt, double rate, const Wrenches& truth, double truth_rate) {
  const auto at = [&](double time) {
    const double x = std::clamp(time * truth_rate, 0.0, static_cast<double>(truth.size()) - 1.001);
    const auto i = static_cast<std::size_t>(x);
    const double share = x - static_cast<double>(i);
    return (1 - share) * norm(truth[i].force) + share * norm(truth[i + 1].force);
  };
  double best = -1, best_lag = 0;
  for (int step = -80; step < 800; ++step) {
    const double tau = 0.00025 * step;
    double n = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
    for (std::size_t k = 15; k < felt.size(); ++k) {
      const double a = norm(felt[k].force), b = at(static_cast<double>(k) / rate - tau);
      n += 1, x += a, y += b, xx += a * a, yy += b * b, xy += a * b;
    }
    const double r = (n * xy - x * y) / std::sqrt((n * xx - x * x) * (n * yy - y * y));
    if (r > best) best = r, best_lag = tau;
  }
  return best_lag;
}

/// The wall rests half a second, comes nearer, rests and goes back, twice.
double wall_speed = 0;
constexpr double kPause = 0.5;
double wall_travel() { return std::clamp(wall_speed, 0.01, 0.04); }
double wall_period() { return 2 * (kPause + wall_travel() / wall_speed); }
Pose wall_pose(double t) {
  const double half = wall_period() / 2, way = wall_travel();
  const double in_half = std::fmod(t, half), moved = wall_speed * std::max(in_half - kPause, 0.0);
  const bool comes = std::fmod(t, 2 * half) < half;
  return {{0, 0, 0.97 - (comes ? moved : way - moved)}, {}};
}

void lags() {
  constexpr double kFine = 60;
  const auto compare = [&](const std::string& of, const scenes::Scene& scene, double duration,
                           const Tool& tool, const Pose& X_WT) {
    const auto truth =
        felt(seen(scene, duration, false, kFine), tool, X_WT, average_of(DepthAverage::none));
    const Recorded frames = seen(scene, duration, true);
    for (const DepthAverage kind : kKinds) {
      row("lag", of, kind, 1e3 * lag(felt(frames, tool, X_WT, average_of(kind)), 30, truth, kFine),
          "ms");
    }
  };
  scenes::Scene wall = scenes::make_scene("moving-wall").value();
  wall.bodies[0].motion = wall_pose;
  const Tool box = tool_of("box", kBox);
  for (const double speed : {5, 10, 20, 50, 100, 200}) {
    wall_speed = 1e-3 * speed;
    compare("wall, " + std::to_string(static_cast<int>(speed)) + " mm/s", wall, 2 * wall_period(),
            box, kInWall);
  }
  const Pose in_hand{{0, -0.005, 0.535}, {}};
  compare("hand that sways", scenes::make_scene("hand").value(), 8, tool_of("sphere", 0.06),
          in_hand);
}

// --- A hand that comes and goes --------------------------------------------------------------

Pose (*hand_motion)(double) = nullptr;
constexpr double kComes = 2.0, kGoes = 4.0;
Pose sudden_hand(double t) {
  const bool is_there = t > kComes - 1e-3 && t < kGoes - 1e-3;
  return is_there ? hand_motion(0) : Pose{{0, 0, -5}, {}};
}

void sudden() {
  scenes::Scene scene = scenes::make_scene("hand").value();
  hand_motion = scene.bodies[1].motion;
  scene.bodies[1].motion = sudden_hand;
  const Pose X_WT = hand_motion(0) * Pose{{0, -0.005, -0.03}, {}};
  const Recorded frames = seen(scene, 5, true);
  const Tool tool = tool_of("sphere", 0.06);
  const Wrenches plain = felt(frames, tool, X_WT, average_of(DepthAverage::none));
  const auto comes = static_cast<std::size_t>(std::lround(kComes * 30));
  const auto goes = static_cast<std::size_t>(std::lround(kGoes * 30));
  for (const DepthAverage kind : kKinds) {
    const Wrenches all = felt(frames, tool, X_WT, average_of(kind));
    const auto share = [&](std::size_t k) {
      return 100 * norm(all[k].force) / norm(plain[comes].force);
    };
    row("hand that appears", "felt in its first frame", kind, share(comes), "%");
    row("hand that goes", "felt in the first frame without", kind, share(goes), "%");
  }
}

// --- Cost ------------------------------------------------------------------------------------

void cost() {
  const Recorded frames = seen(scenes::make_scene("hand").value(), 1, true);
  ThreadPool pool(1);
  for (const DepthAverage kind : kKinds) {
    auto averager =
        DepthAverager::create(frames.stream.width, frames.stream.height, average_of(kind)).value();
    std::vector<double> times;
    for (int k = 0; k < 300; ++k) {
      const DepthFrame& frame = frames.frames[static_cast<std::size_t>(k) % frames.frames.size()];
      const Clock::time_point begin = Clock::now();
      averager.update(frame, pool);
      times.push_back(microseconds_since(begin));
    }
    rows->times("cost/640x480, one core/average:" + name_of(kind), call_times(std::move(times)));
  }
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  using namespace palpate::bench;
  if (argc < 3) {
    std::fprintf(
        stderr,
        "usage: calm_force CSV FOLDER_OF_RECORDED_FRAMES [rest | recorded | sudden | lag | "
        "cost]\n");
    return 2;
  }
  const std::string only = argc > 3 ? argv[3] : "";
  const auto is_requested = [&only](const char* figure) { return only.empty() || only == figure; };
  ResultRows all(argc, argv);
  if (!all.open(argv[1])) return 1;
  rows = &all;
  if (is_requested("cost")) cost();
  if (is_requested("rest")) rest_simulated();
  if (is_requested("recorded")) rest_recorded(argv[2]);
  if (is_requested("sudden")) sudden();
  if (is_requested("lag")) lags();
  return all.close() ? 0 : 1;
}
