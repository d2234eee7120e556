// What arrives in the hand when a depth frame arrives: steps of the force, lag and noise of every
// method, for each way of going from frame to frame. An evaluation, not a test.
//   frame_step [DATA]     DATA: folder of real data, with sequences/visp_rbt
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "palpate/cloud/cloud_blend.h"
#include "palpate/contact/blended_query.h"
#include "palpate/io/depth_files.h"
#include "palpate/math/sphere.h"
#include "palpate/mesh/shapes.h"
#include "palpate/packing/packer.h"
#include "palpate/session/names.h"
#include "palpate/session/probing_path.h"
#include "scenes/scene.h"
#include "tests/test_util/random.h"

namespace palpate::bench {
namespace {

constexpr double kTickRate = 1000;
constexpr std::size_t kSettled = 300;  // ticks until averages have settled

constexpr InsideMethod kMethods[] = {InsideMethod::weighted, InsideMethod::simplified,
                                     InsideMethod::graph, InsideMethod::field};
constexpr std::size_t kNumMethods = std::size(kMethods);

/// A way of going from frame to frame.
struct Way {
  const char* name;
  TimeOptions options;
  /// Eq. 3.18 to the letter: the points are moved and one surface is measured at each tick.
  bool moves_points = false;
};
TimeOptions way(TimeMode mode, DepthAverage average = DepthAverage::none) {
  TimeOptions options;
  options.mode = mode;
  options.average.kind = average;
  return options;
}
const Way kWays[] = {
    {"latest", way(TimeMode::latest)},
    {"latest, mean of 8", way(TimeMode::latest, DepthAverage::moving)},
    {"latest, exponential", way(TimeMode::latest, DepthAverage::exponential)},
    {"interpolate", way(TimeMode::interpolate)},
    {"predict", way(TimeMode::predict)},
    {"predict, exponential", way(TimeMode::predict, DepthAverage::exponential)},
    {"interpolate points", way(TimeMode::interpolate), true},
};

/// Frames with a tool and its way.
struct Run {
  std::string name;
  DepthStreamInfo info;
  std::vector<DepthFrame> frames;  // time stamps from 0
  const Tool* tool = nullptr;
  bool compares_points = false;  // with moving the points, which takes long
  std::function<Pose(double time)> X_WT;
  /// Force along -z at a time, m3, if the scene is felt as it was `lag` s ago; may be empty.
  std::function<double(double time, double lag)> truth;
};

/// Force at each tick, and at which ticks a frame had just arrived.
struct Series {
  std::vector<Vec3d> force;
  std::vector<bool> is_arrival;
};

double median(std::vector<double> values, double share = 0.5) {
  if (values.empty()) return NAN;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

std::vector<Series> feel(const Run& run, const Way& way) {
  ThreadPool pool(0);
  SurfaceTimeline timeline =
      std::move(SurfaceTimeline::create(run.info, {}, DepthFieldOptions{}, way.options)).value();
  BlendedQuery query(std::move(make_contact_query(Backend::cpu, *run.tool)).value());
  PointCloud moved(run.info.width, run.info.height, run.info.intrinsics);
  DepthField moved_field = std::move(DepthField::create(run.info.width, run.info.height)).value();
  std::vector<Series> all(kNumMethods);
  std::size_t next = 0;
  const double end = run.frames.back().timestamp;
  for (int k = 0; k / kTickRate <= end; ++k) {
    const double time = k / kTickRate;
    bool is_arrival = false;
    for (; next < run.frames.size() && run.frames[next].timestamp <= time; ++next) {
      timeline.push(run.frames[next], run.frames[next].timestamp, pool);
      is_arrival = next > 0;
    }
    SurfaceMoment moment = timeline.at(time);
    if (way.moves_points && moment.progress < 1) {
      blend_clouds(moment.from.cloud, moment.to.cloud, moment.progress, 0.03, pool, moved);
      moved_field.update(moved.view(), pool);
      moment.to = {moved.view(), moved_field.view()};
      moment.progress = 1;
    }
    query.set_moment(moment);
    for (std::size_t m = 0; m < kNumMethods; ++m) {
      ContactOptions options;
      options.method = kMethods[m];
      options.volumes = SphereVolumes::own;
      all[m].force.push_back(query.query(run.X_WT(time), options).measure_W.force);
      all[m].is_arrival.push_back(is_arrival);
    }
  }
  return all;
}

/// Steps between ticks in contact, on arrival of a frame and all.
struct Steps {
  double arrival, arrival_95, all;
};
Steps steps_of(const Series& series) {
  double largest = 0;
  for (const Vec3d& force : series.force) largest = std::max(largest, norm(force));
  std::vector<double> arrival, all;
  for (std::size_t k = kSettled; k < series.force.size(); ++k) {
    if (norm(series.force[k]) < 0.1 * largest || norm(series.force[k - 1]) < 0.1 * largest)
      continue;
    const double step = norm(series.force[k] - series.force[k - 1]);
    all.push_back(step);
    if (series.is_arrival[k]) arrival.push_back(step);
  }
  return {median(arrival), median(arrival, 0.95), median(all)};
}

/// How far off the newest frame's force the felt one is when that frame arrives, as a share of what
/// the frame changes: 1 if nothing is predicted, 0 if all is.
double surprise_of(const Series& series, const Series& latest) {
  double off = 0, change = 0;
  for (std::size_t k = kSettled; k < series.force.size(); ++k) {
    if (!series.is_arrival[k]) continue;
    off += norm(series.force[k] - latest.force[k]);
    change += norm(latest.force[k] - latest.force[k - 1]);
  }
  return off / change;
}

/// By how much (s) the series comes behind the truth: where the two correlate best; and the rms
/// distance from the truth as it is now, as a share of the largest force.
struct Lag {
  double lag = NAN, error = NAN;
};
Lag lag_of(const Series& series, const Run& run) {
  if (!run.truth) return {};
  Lag result;
  double best = -1, sum_error = 0, largest = 0;
  const std::size_t begin = kSettled, n = series.force.size();
  for (double lag = -0.05; lag < 0.25; lag += 0.001) {
    double x = 0, y = 0, xx = 0, yy = 0, xy = 0, num = 0;
    for (std::size_t k = begin; k < n; ++k) {
      const double a = -series.force[k].z;
      const double b = run.truth(static_cast<double>(k) / kTickRate, lag);
      x += a, y += b, xx += a * a, yy += b * b, xy += a * b, num += 1;
    }
    const double correlation =
        (num * xy - x * y) / std::sqrt((num * xx - x * x) * (num * yy - y * y));
    if (correlation > best) {
      best = correlation;
      result.lag = lag;
    }
  }
  for (std::size_t k = begin; k < n; ++k) {
    const double truth = run.truth(static_cast<double>(k) / kTickRate, 0);
    largest = std::max(largest, truth);
    sum_error += std::pow(-series.force[k].z - truth, 2);
  }
  result.error = std::sqrt(sum_error / static_cast<double>(n - begin)) / largest;
  return result;
}

/// Standard deviation of the force over its mean.
double noise_of(const Series& series) {
  double x = 0, xx = 0, n = 0;
  for (std::size_t k = kSettled; k < series.force.size(); ++k) {
    const double f = norm(series.force[k]);
    x += f, xx += f * f, n += 1;
  }
  return std::sqrt(std::max(0.0, xx / n - x / n * x / n)) / (x / n);
}

enum class Noise { none, gaussian, kinect };
constexpr const char* kNoiseNames[] = {"no noise", "1.5 mm noise", "Kinect noise"};

void take_frames(scenes::Scene scene, Noise noise, double duration, Run& run) {
  scenes::SimulatedCameraOptions camera;
  camera.noise.enabled = noise == Noise::kinect;
  camera.unit = noise == Noise::kinect ? 0.001 : 0.0001;
  camera.duration = duration;
  auto source = std::move(scenes::open_simulated_camera(std::move(scene), camera)).value();
  run.info = source->info();
  DepthFrame frame;
  while (source->next(frame).value()) run.frames.push_back(frame);
  if (noise != Noise::gaussian) return;
  test::Random random(1);
  for (DepthFrame& each : run.frames) {
    for (std::uint16_t& count : each.pixels) {
      if (count > 0) count = static_cast<std::uint16_t>(count + std::lround(15 * random.normal()));
    }
  }
}

Tool packed(std::string_view shape, double size) {
  PackOptions options;
  options.max_spheres = 1000;
  const TriangleMesh mesh = make_shape(shape, size).value();
  return std::move(Tool::build(mesh, pack_spheres(mesh, options).value(), GapRule::relative,
                               std::string(shape)))
      .value();
}

/// Of all spheres behind z = depth.
double wall_force(const Tool& tool, const Pose& X_WT, double depth) {
  double sum = 0;
  for (const Sphere& s : tool.spheres()) {
    sum += cap_volume(static_cast<double>(s.radius), depth - (X_WT * to_double(s.centre)).z);
  }
  return sum;
}

/// Thesis Fig. 3.15a: wall and tool move towards each other, the wall by 75 mm/s at most.
double wall_depth(double t) { return 1 - 0.03 * (1 - std::cos(2.5 * t)); }
Pose wall_pose(double t) { return {{0, 0, wall_depth(t)}, {}}; }

Run wall_run(const Tool& tool, Noise noise, bool moves) {
  Run run;
  run.name = std::string(moves ? "moving wall" : "wall at rest") + ", " +
             kNoiseNames[static_cast<int>(noise)];
  scenes::Scene scene = scenes::make_scene("moving-wall").value();
  scene.bodies[0].motion = moves ? wall_pose : nullptr;
  scene.bodies[0].X_WB = wall_pose(1);
  run.tool = &tool;
  run.compares_points = moves && noise == Noise::gaussian;
  run.X_WT = [moves](double t) {
    return Pose{{0.001, 0.002, moves ? 0.96 + 0.01 * std::sin(4 * t) : 0.93},
                axis_angle({1, 2, 0}, 0.1)};
  };
  run.truth = [&tool, X_WT = run.X_WT](double t, double lag) {
    return wall_force(tool, X_WT(t), wall_depth(t - lag));
  };
  if (!moves) run.truth = nullptr;
  take_frames(std::move(scene), noise, 1.5, run);
  return run;
}

Run scene_run(const char* name, const Tool& tool, Noise noise) {
  Run run;
  run.name = std::string(name) + ", " + kNoiseNames[static_cast<int>(noise)];
  scenes::Scene scene = scenes::make_scene(name).value();
  std::vector<TimedPose> path;
  for (std::size_t i = 0; i < scene.path_times.size(); ++i) {
    path.push_back({scene.path_times[i], scene.path_poses[i]});
  }
  run.tool = &tool;
  run.X_WT = [path](double t) { return pose_at(path, t); };
  take_frames(std::move(scene), noise, 2, run);
  return run;
}

Run real_run(const std::filesystem::path& data, const Tool& tool) {
  Run run;
  run.name = "visp_rbt, hand-held RealSense";
  DepthFolderOptions options;
  options.intrinsics = {607.178, 607.234, 321.391, 241.918};
  const OpenDepthSource open = [&] {
    return open_depth_folder(data / "sequences" / "visp_rbt", options);
  };
  auto source = std::move(open()).value();
  run.info = source->info();
  DepthFrame frame;
  while (source->next(frame).value()) run.frames.push_back(frame);
  run.tool = &tool;
  const auto path = probing_path(open, tool, std::nullopt).value();
  run.X_WT = [path](double t) { return pose_at(path, t); };
  return run;
}

void print(const Run& run) {
  std::printf("\n%s (%zu frames)\n%-22s %-10s %12s %12s %7s %7s %9s %7s %8s\n", run.name.c_str(),
              run.frames.size(), "", "", "median step", "arrival", "ratio", "95 %", "surprise",
              "lag ms", run.truth ? "error %" : "std %");
  std::vector<Series> latest;
  for (const Way& way : kWays) {
    if (way.moves_points && !run.compares_points) continue;
    const std::vector<Series> all = feel(run, way);
    if (latest.empty()) latest = all;
    for (std::size_t m = 0; m < kNumMethods; ++m) {
      const Steps steps = steps_of(all[m]);
      const Lag lag = lag_of(all[m], run);
      std::printf("%-22s %-10s %12.4g %12.4g %7.2f %7.2f %9.2f %7.1f %8.2f\n", m ? "" : way.name,
                  name_of(kMethodNames, kMethods[m]).c_str(), steps.all * 1e9, steps.arrival * 1e9,
                  steps.arrival / steps.all, steps.arrival_95 / steps.all,
                  surprise_of(all[m], latest[m]), lag.lag * 1e3,
                  100 * (run.truth ? lag.error : noise_of(all[m])));
    }
    std::fflush(stdout);
  }
}

void run_all(const std::filesystem::path& data) {
  const Tool box = packed("box", 0.1);
  std::printf("Steps of the force from tick to tick at 1 kHz, mm3; frames at 30 Hz.\n");
  for (const Noise noise : {Noise::none, Noise::gaussian, Noise::kinect}) {
    print(wall_run(box, noise, true));
  }
  for (const Noise noise : {Noise::gaussian, Noise::kinect}) print(wall_run(box, noise, false));
  print(scene_run("moving-box", packed("octahedron", 0.08), Noise::kinect));
  if (!data.empty()) print(real_run(data, box));
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) { palpate::bench::run_all(argc > 1 ? argv[1] : ""); }
