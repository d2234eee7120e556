// 3.15, 3.16: force between two depth frames (thesis section 3.6).
#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

#include "eval/studies/between_frames.h"
#include "eval/studies/interaction.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr double kRemoved = 0.2;  // of the step
constexpr int kFrameMs = 34;

struct Steps {
  double arrival = 0, other = 0;  ///< largest change at a tick, %
};
Steps steps_of(const std::vector<double>& force, const std::vector<bool>& is_arrival) {
  Steps steps;
  constexpr std::size_t kSettled = 100;  // ticks: three frames
  for (std::size_t k = kSettled; k < force.size(); ++k) {
    double& largest = is_arrival[k] ? steps.arrival : steps.other;
    largest = std::max(largest, std::abs(force[k] - force[k - 1]));
  }
  return steps;
}

/// Returns the force along -z, % of the whole tool's force.
std::vector<double> lifting(const ForceSeries& series) {
  std::vector<double> force;
  for (const Vec3d& f : series.force) force.push_back(-100 * f.z);
  return force;
}

/// Returns the lag of b behind a in ticks, by the least squared difference.
int lag_between(const std::vector<double>& a, const std::vector<double>& b) {
  int best = 0;
  double least = INFINITY;
  for (int lag = 0; lag < 80; ++lag) {
    double sum = 0;
    for (std::size_t k = 200; k < a.size(); ++k) {
      const double d = b[k] - a[k - static_cast<std::size_t>(lag)];
      sum += d * d;
    }
    if (sum < least) least = sum, best = lag;
  }
  return best;
}

Result<FigureResult> moving(Context& context, const char* title, const Touch& touch) {
  FigureResult result;
  Plot plot{title, "time, s", "force, % of the whole tool's", {}, false, false, ""};
  Table table{"Largest change of the force at a tick, % of the whole tool's",
              {"method", "between frames", "when a frame arrives", "at other ticks"},
              {}};
  double latest_step = 0, interpolated_step = 0;
  std::vector<double> latest, interpolated;
  std::vector<double> latest_steps, interpolated_steps;  // of each method, %
  struct Mode {
    TimeMode mode;
    const char *name, *style;
  };
  const Mode modes[] = {{TimeMode::latest, "latest frame", "other1"},
                        {TimeMode::interpolate, "interpolated", "field"},
                        {TimeMode::predict, "predicted", "other2"}};
  const std::vector<Method> methods = all_methods_alike();
  std::vector<Trial> trials;
  for (const Mode& mode : modes) {
    TimeOptions time;
    time.mode = mode.mode;
    trials.push_back({&touch, time});
  }
  const auto all = measure_trials(context, trials, methods);
  if (!all) return all.error();
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const Method& method = methods[m];
    for (std::size_t i = 0; i < trials.size(); ++i) {
      const Mode& mode = modes[i];
      const ForceSeries& series = (*all)[i][m];
      const std::vector<double> force = lifting(series);
      const Steps steps = steps_of(force, series.is_arrival);
      table.rows.push_back(
          {method.name, mode.name, words("%.3f", steps.arrival), words("%.3f", steps.other)});
      result.numbers.push_back(
          {words("%s.%s.arrival", method.name, mode.name), steps.arrival, "%"});
      if (mode.mode == TimeMode::latest) latest_steps.push_back(steps.arrival);
      if (mode.mode == TimeMode::interpolate) interpolated_steps.push_back(steps.arrival);
      if (method.options.method != MethodKind::field) continue;
      Curve curve{mode.name, mode.style, {}, force};
      for (std::size_t k = 0; k < force.size(); ++k) {
        curve.x.push_back(static_cast<double>(k) * kTick);
      }
      plot.curves.push_back(std::move(curve));
      if (mode.mode == TimeMode::latest) latest = force, latest_step = steps.arrival;
      if (mode.mode == TimeMode::interpolate) {
        interpolated = force, interpolated_step = steps.arrival;
      }
    }
  }
  const double factor = latest_step / interpolated_step;
  const int lag = lag_between(latest, interpolated);
  plot.caption =
      words("Steps when a frame arrives are %.0f times smaller; the force comes %d ms later.",
            factor, lag);
  result.claims.push_back(
      {"Steps at each 33rd haptic frame are removed, for a lag of at most a frame.",
       words(
           "Largest step when a frame arrives, latest and interpolated: weighted %.2f and %.2f %%, "
           "simplified %.2f and %.2f, graph %.2f and %.2f; %d ms behind the latest frame.",
           latest_steps[0], interpolated_steps[0], latest_steps[1], interpolated_steps[1],
           latest_steps[2], interpolated_steps[2], lag),
       are_true({interpolated_steps[0] <= kRemoved * latest_steps[0],
                 interpolated_steps[1] <= kRemoved * latest_steps[1],
                 interpolated_steps[2] <= kRemoved * latest_steps[2], lag <= kFrameMs})});
  // Relative to each method's own step: a method that underestimates the force has smaller steps in
  // any case.
  double others = INFINITY;
  for (std::size_t m = 0; m < 3; ++m) {
    others = std::min(others, interpolated_steps[m] / latest_steps[m]);
  }
  result.claims.push_back(
      {"Less is left of the step with the field.",
       words("%.2f %% of it, with the best of the others %.2f %%.", 100 / factor, 100 * others),
       is_better(1 / factor, others), Source::ours});
  result.numbers.push_back({"field.factor", factor, "1"});
  result.numbers.push_back({"field.lag", static_cast<double>(lag), "ms"});
  result.plots.push_back(std::move(plot));
  result.tables.push_back(std::move(table));
  return result;
}

Result<FigureResult> figure_3_15a(Context& context) {
  const auto scene = scenes::make_scene("moving-wall");
  if (!scene) return scene.error();
  scenes::SimulatedCameraOptions camera;
  camera.noise.enabled = false;
  camera.unit = 1e-4;
  camera.duration = context.choose(2.5, 0.6);
  DepthStreamInfo stream;
  const auto frames = context.simulated(*scene, camera, stream);
  if (!frames) return frames.error();
  const auto tool = context.thesis_tool(scene->tool_shape, scene->tool_size, 1000);
  if (!tool) return tool.error();
  // In the middle of the wall's motion.
  const Pose X_WT{{0, 0, 0.97}, axis_angle({1, 2, 3}, 0.5)};
  return moving(context, "A wall moves towards a tool and back",
                {stream, *frames, *tool, [X_WT](double) { return X_WT; }});
}

Result<FigureResult> figure_3_15b(Context& context) {
  DepthStreamInfo stream;
  auto frames = context.recorded("sequences/visp_rbt/depth", stream);
  if (!frames) return frames.error();
  if (!*frames) {
    FigureResult result;
    result.claims.push_back({"The same with a camera that is moved by hand.",
                             "Needs the recorded sequence visp_rbt.", Verdict::not_measured});
    return result;
  }
  (*frames)->resize(std::min<std::size_t>((*frames)->size(), context.choose<std::size_t>(60, 15)));
  const auto tool = context.thesis_tool("sphere", 0.08, 1000);
  if (!tool) return tool.error();
  const auto first = FrozenFrame::create(stream, (**frames)[0]);
  if (!first) return first.error();
  const auto path = hand_path(*first, **tool, 0.3, 1);
  if (!path) return path.error();
  return moving(context, "A camera is moved by hand, the tool held still",
                {stream, **frames, *tool, [X_WT = path->X_WT.front()](double) { return X_WT; }});
}

/// Adds the step of the volume when a tenth of the pixels drops out.
Status add_drop_out(FigureResult& result, Context& context, const DepthStreamInfo& stream,
                    const std::vector<DepthFrame>& frames) {
  const auto tool = context.thesis_tool("box", 0.1, 1000);
  if (!tool) return tool.error();
  const Pose X_WT{{0, 0, 0.97}, axis_angle({1, 2, 3}, 0.5)};
  const auto methods = all_methods_alike();
  std::vector<double> volumes[2];
  for (int k = 0; k < 2; ++k) {
    const auto seen = FrozenFrame::create(stream, frames[static_cast<std::size_t>(k)]);
    if (!seen) return seen.error();
    auto query = query_on(*seen, **tool);
    for (const Method& method : methods) {
      volumes[k].push_back(100 * query->query(X_WT, method.options).volume /
                           full_volume(**tool, method.options));
    }
  }
  Table table{"Step of the volume when a tenth of the pixels drops out, % of the tool",
              {"method", "step"},
              {}};
  std::vector<double> steps;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    steps.push_back(std::abs(volumes[1][m] - volumes[0][m]));
    table.rows.push_back({methods[m].name, words("%.2g", steps.back())});
    result.numbers.push_back({words("%s.drop_out", methods[m].name), steps.back(), "%"});
  }
  const double others = *std::min_element(steps.begin(), steps.begin() + 4);
  result.claims.push_back(
      {"Pixels that drop out make a smaller step in the volume of the field.",
       words("%.2g %% of the tool, of the best of the others %.2g %%.", steps[4], others),
       is_better(steps[4], others), Source::ours});
  result.tables.push_back(std::move(table));
  return Done{};
}

/// Compares a frame of the wall with and without a tenth of its pixels: nothing may be interpolated
/// between the wall and the depth 0 of a missing pixel.
Result<FigureResult> figure_3_16(Context& context) {
  const auto scene = scenes::make_scene("wall");
  if (!scene) return scene.error();
  scenes::SimulatedCameraOptions camera;
  camera.noise.enabled = false;
  camera.unit = 1e-4;
  camera.duration = 0.01;
  DepthStreamInfo stream;
  const auto seen = context.simulated(*scene, camera, stream);
  if (!seen) return seen.error();
  std::vector<DepthFrame> frames(4, seen->front());
  for (std::size_t k = 0; k < frames.size(); ++k) {
    frames[k].timestamp = static_cast<double>(k) / stream.rate;
    if (k % 2 == 0) continue;
    for (std::size_t i = k; i < frames[k].pixels.size(); i += 10) frames[k].pixels[i] = 0;
  }
  FigureResult result;
  Table table{"Nearest point of all that is looked at between two frames, m",
              {"between frames", "nearest", "points nearer than the wall"},
              {}};
  bool is_clean = true;
  struct Mode {
    TimeMode mode;
    const char* name;
  };
  for (const Mode& mode :
       {Mode{TimeMode::latest, "latest frame"}, Mode{TimeMode::interpolate, "interpolated"},
        Mode{TimeMode::predict, "predicted"}}) {
    TimeOptions time;
    time.mode = mode.mode;
    auto timeline = SurfaceTimeline::create(stream, {.time = time});
    if (!timeline) return timeline.error();
    ThreadPool pool(0);
    double nearest = INFINITY;
    int num = 0;
    for (const DepthFrame& frame : frames) {
      timeline->push(frame, frame.timestamp, pool);
      for (int k = 0; k < 4; ++k) {
        const SurfaceBlend moment = timeline->at(frame.timestamp + k * 0.008);
        for (const SurfaceView& surfaces : {moment.from, moment.to}) {
          for (std::size_t i = 0; i < surfaces.cloud.size(); ++i) {
            const auto z = static_cast<double>(surfaces.cloud.z[i]);
            if (!std::isfinite(z)) continue;
            nearest = std::min(nearest, z);
            num += z < 0.99;
          }
        }
      }
    }
    is_clean = is_clean && num == 0;
    table.rows.push_back({mode.name, words("%.4f", nearest), words("%d", num)});
    result.numbers.push_back({words("%s.nearer", mode.name), static_cast<double>(num), "points"});
  }
  result.claims.push_back({"A pixel without depth must not be interpolated with.",
                           is_clean
                               ? "No point comes between a missing pixel and the wall, in any mode."
                               : "Points appear in front of the wall, see the table.",
                           are_true({is_clean})});
  if (const Status status = add_drop_out(result, context, stream, frames); !status) {
    return status.error();
  }
  result.tables.push_back(std::move(table));
  return result;
}

}  // namespace

std::vector<FigureSpec> time_figures() {
  return {
      {"3.15a", "A moving wall between frames", "Time and edges", figure_3_15a},
      {"3.15b", "A moving camera between frames", "Time and edges", figure_3_15b},
      {"3.16", "Missing pixels between frames", "Time and edges", figure_3_16},
  };
}

}  // namespace palpate::eval
