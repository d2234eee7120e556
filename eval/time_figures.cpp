// 3.12-3.16: edges of what a camera sees (thesis section 3.5), and what happens between two depth
// frames (section 3.6).
#include <algorithm>
#include <cmath>
#include <optional>

#include "eval/accuracy.h"
#include "eval/speed.h"
#include "palpate/contact/blended_query.h"
#include "scenes/truth.h"

namespace palpate::eval {
namespace {

constexpr double kTick = 1e-3;        // s
constexpr double kPillarEdge = 0.11;  // m: x of the pillar's edges; its front is at z = 1 m
constexpr double kBox = 0.08;         // m

Result<SeenFrame> seen_pillar(Context& context, bool with_noise) {
  const auto scene = scenes::make_scene("pillar");
  if (!scene) return scene.error();
  scenes::SimulatedCameraOptions camera;
  camera.noise.enabled = with_noise;
  camera.unit = with_noise ? 1e-3 : 1e-4;
  camera.duration = 0.01;
  DepthStreamInfo stream;
  const auto frames = context.simulated(*scene, camera, stream);
  if (!frames) return frames.error();
  return SeenFrame::create(stream, frames->front());
}

/// Depth-change vectors at both sides of the pillar: do they point away from it?
Result<FigureResult> figure_3_12(Context& context) {
  FigureResult result;
  Table table{
      "Depth-change vectors along the pillar", {"camera", "side", "vectors", "outward, %"}, {}};
  double least = 1;
  for (const bool with_noise : {false, true}) {
    const auto frame = seen_pillar(context, with_noise);
    if (!frame) return frame.error();
    const PointCloudView cloud = frame->cloud();
    int num[2] = {}, outward[2] = {};
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vec3d edge = to_double(Vec3f{cloud.edge_x[i], cloud.edge_y[i], cloud.edge_z[i]});
      const double x = static_cast<double>(cloud.x[i]), z = static_cast<double>(cloud.z[i]);
      const bool is_pillar = std::abs(z - 1) < 0.03 && std::abs(std::abs(x) - kPillarEdge) < 0.01;
      if (!is_pillar || norm(edge) < 0.005) continue;
      const int side = x > 0;
      ++num[side];
      outward[side] += edge.x * x > 0;
    }
    for (int side = 0; side < 2; ++side) {
      const double share = num[side] ? static_cast<double>(outward[side]) / num[side] : 0;
      table.rows.push_back({with_noise ? "Kinect noise" : "no noise", side ? "right" : "left",
                            words("%d", num[side]), words("%.1f", 100 * share)});
      result.numbers.push_back(
          {words("%s.%s.outward", with_noise ? "noisy" : "clean", side ? "right" : "left"),
           100 * share, "%"});
      // A shadow takes the place of the room beside the left edge: no vectors there.
      if (num[side] > 0) least = std::min(least, share);
    }
  }
  result.claims.push_back({"Depth-change vectors point outward at both sides of a pillar.",
                           words("At least %.1f %% of them at each side.", 100 * least),
                           least > 0.95 ? Verdict::agrees : Verdict::differs});
  result.notes.push_back(
      "Left of the pillar the Kinect's projector throws a shadow: where nothing is "
      "measured beside an edge there is no vector; the methods find that edge by "
      "the missing pixels.");
  result.tables.push_back(std::move(table));
  return result;
}

/// The pillar as the camera sees it: the solid behind its front and behind the plane of sight along
/// its right edge.
scenes::Environment pillar_solid() {
  scenes::Environment environment;
  environment.kind = scenes::Environment::Kind::ridge;
  environment.a = {{0, 0, -1}, -1};
  environment.b = {normalized(Vec3d{1, 0, -kPillarEdge}), 0};
  return environment;
}

Result<FigureResult> figure_3_14(Context& context) {
  const auto tool = context.tool("box", kBox, 1500);
  if (!tool) return tool.error();
  const auto frame = seen_pillar(context, false);
  if (!frame) return frame.error();
  auto query = query_on(*frame, **tool);
  if (!query) return query.error();
  const scenes::Environment solid = pillar_solid();
  FigureResult result;
  Plot plot{"A box leaves a pillar to the side",
            "x of the box, mm",
            "volume, % of the box",
            {},
            false,
            false,
            ""};
  Table table{"Error of the volume, % of the box", {"method", "edges", "rms", "worst"}, {}};
  Curve exact{"exact", "exact", {}, {}};
  const auto way = [&](double x) {
    return Pose{{x, -0.1, 1.005}, axis_angle({0.3, 1, 0.2}, 20 * kPi / 180)};
  };
  const double step = context.choose(0.00025, 0.002);
  for (double x = 0.05; x < 0.16; x += step) {
    exact.x.push_back(1e3 * x);
    exact.y.push_back(100 * scenes::exact_volume((*tool)->mesh(), way(x), solid) /
                      (*tool)->mesh_mass().volume);
  }
  struct Try {
    const char* name;
    InsideMethod method;
    Edges edges;
    const char *words, *style;
  };
  const Try tries[] = {{"graph", InsideMethod::graph, Edges::none, "none", "graph"},
                       {"graph", InsideMethod::graph, Edges::strict, "strict", "other1"},
                       {"graph", InsideMethod::graph, Edges::cut, "cut", "other2"},
                       {"simplified", InsideMethod::simplified, Edges::none, "none", "simplified"},
                       {"simplified", InsideMethod::simplified, Edges::cut, "cut", "other3"},
                       {"field", InsideMethod::field, Edges::none, "of its own", "field"}};
  double worst_none = 0, worst_strict = 0, worst_cut = 0, worst_field = 0;
  for (const Try& t : tries) {
    ContactOptions options;
    options.method = t.method;
    options.edges = t.edges;
    options.volumes = SphereVolumes::represented;
    Curve curve{words("%s, edges: %s", t.name, t.words), t.style, exact.x, {}};
    double sum = 0, worst = 0;
    for (std::size_t i = 0; i < exact.x.size(); ++i) {
      const double v = 100 * (*query)->query(way(1e-3 * exact.x[i]), options).volume /
                       full_volume(**tool, options);
      curve.y.push_back(v);
      sum += (v - exact.y[i]) * (v - exact.y[i]);
      worst = std::max(worst, std::abs(v - exact.y[i]));
    }
    const double rms = std::sqrt(sum / static_cast<double>(exact.x.size()));
    table.rows.push_back({t.name, t.words, words("%.2f", rms), words("%.2f", worst)});
    result.numbers.push_back({words("%s.%s.worst", t.name, t.words), worst, "%"});
    if (t.method == InsideMethod::graph && t.edges == Edges::none) worst_none = worst;
    if (t.method == InsideMethod::graph && t.edges == Edges::strict) worst_strict = worst;
    if (t.method == InsideMethod::graph && t.edges == Edges::cut) worst_cut = worst;
    if (t.method == InsideMethod::field) worst_field = worst;
    plot.curves.push_back(std::move(curve));
  }
  plot.curves.insert(plot.curves.begin(), std::move(exact));
  plot.caption = words(
      "Without edge planes the graph is wrong by up to %.0f %% of the box, cut by them "
      "by %.1f %%; the field by %.1f %%.",
      worst_none, worst_cut, worst_field);
  result.claims.push_back({"An edge plane stops the flood that tunnels past the edge.",
                           words("Worst error of the graph: %.0f %% of the box without, %.1f %% "
                                 "with edge planes (strict), "
                                 "%.1f %% if they cut spheres.",
                                 worst_none, worst_strict, worst_cut),
                           worst_cut < worst_strict && worst_strict < worst_none ? Verdict::better
                           : worst_strict < worst_none                           ? Verdict::agrees
                                                       : Verdict::differs});
  result.plots.push_back(std::move(plot));
  result.tables.push_back(std::move(table));
  return result;
}

/// The force on a tool that is held still, tick by tick.
struct Series {
  std::vector<double> force;     ///< against z, % of the whole tool's
  std::vector<bool> is_arrival;  ///< a frame has just arrived
};

Result<Series> hold_still(const DepthStreamInfo& stream, const std::vector<DepthFrame>& frames,
                          const Tool& tool, const Pose& X_WT, TimeMode mode,
                          const ContactOptions& options) {
  TimeOptions time;
  time.mode = mode;
  auto timeline = SurfaceTimeline::create(stream, {}, DepthFieldOptions{}, time);
  if (!timeline) return timeline.error();
  auto inner = make_contact_query(Backend::cpu, tool);
  if (!inner) return inner.error();
  BlendedQuery query(*std::move(inner));
  ThreadPool pool(0);
  Series series;
  const double begin = frames.front().timestamp, end = frames.back().timestamp;
  const double whole = full_volume(tool, options);
  std::size_t next = 0;
  for (int k = 0; begin + k * kTick < end; ++k) {
    const double now = begin + k * kTick;
    bool is_arrival = false;
    for (; next < frames.size() && frames[next].timestamp <= now; ++next) {
      timeline->push(frames[next], frames[next].timestamp, pool);
      is_arrival = next > 0;
    }
    query.set_moment(timeline->at(now));
    series.force.push_back(-100 * query.query(X_WT, options).measure_W.force.z / whole);
    series.is_arrival.push_back(is_arrival);
  }
  return series;
}

struct Steps {
  double arrival = 0, other = 0;  ///< largest change at a tick, %
};
Steps steps_of(const Series& series) {
  Steps steps;
  constexpr std::size_t kSettled = 100;  // ticks: three frames
  for (std::size_t k = kSettled; k < series.force.size(); ++k) {
    const double step = std::abs(series.force[k] - series.force[k - 1]);
    double& largest = series.is_arrival[k] ? steps.arrival : steps.other;
    largest = std::max(largest, step);
  }
  return steps;
}

/// By how many ticks b comes behind a: where the two agree best.
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

Result<FigureResult> moving(const char* title, const DepthStreamInfo& stream,
                            const std::vector<DepthFrame>& frames, const Tool& tool,
                            const Pose& X_WT) {
  FigureResult result;
  Plot plot{title, "time, s", "force, % of the whole tool's", {}, false, false, ""};
  Table table{"Largest change of the force at a tick, % of the whole tool's",
              {"method", "between frames", "when a frame arrives", "at other ticks"},
              {}};
  double latest_step = 0, interpolated_step = 0;
  std::vector<double> latest, interpolated;
  struct Mode {
    TimeMode mode;
    const char *name, *style;
  };
  const Mode modes[] = {{TimeMode::latest, "latest frame", "other1"},
                        {TimeMode::interpolate, "interpolated", "field"},
                        {TimeMode::predict, "predicted", "other2"}};
  for (const Method& method : all_methods()) {
    const bool is_drawn = method.options.method == InsideMethod::field;
    for (const Mode& mode : modes) {
      if (!is_drawn && mode.mode == TimeMode::predict) continue;
      const auto series = hold_still(stream, frames, tool, X_WT, mode.mode, method.options);
      if (!series) return series.error();
      const Steps steps = steps_of(*series);
      table.rows.push_back(
          {method.name, mode.name, words("%.3f", steps.arrival), words("%.3f", steps.other)});
      result.numbers.push_back(
          {words("%s.%s.arrival", method.name, mode.name), steps.arrival, "%"});
      if (!is_drawn) continue;
      Curve curve{mode.name, mode.style, {}, series->force};
      for (std::size_t k = 0; k < series->force.size(); ++k) {
        curve.x.push_back(static_cast<double>(k) * kTick);
      }
      plot.curves.push_back(std::move(curve));
      if (mode.mode == TimeMode::latest) latest = series->force, latest_step = steps.arrival;
      if (mode.mode == TimeMode::interpolate) {
        interpolated = series->force, interpolated_step = steps.arrival;
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
       words("Field: steps at frames %.0f times smaller (%.2f to %.3f %%), %d ms "
             "behind the latest frame.",
             factor, latest_step, interpolated_step, lag),
       factor > 5 && lag <= 34 ? Verdict::agrees : Verdict::differs});
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
  const auto tool = context.tool(scene->tool_shape, scene->tool_size, 1000);
  if (!tool) return tool.error();
  // In the middle of where the wall comes and goes.
  return moving("A wall moves towards a tool and back", stream, *frames, **tool,
                {{0, 0, 0.97}, axis_angle({1, 2, 3}, 0.5)});
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
  const auto tool = context.tool("sphere", 0.08, 1000);
  if (!tool) return tool.error();
  const auto first = SeenFrame::create(stream, (**frames)[0]);
  if (!first) return first.error();
  const auto path = hand_path(*first, **tool, 0.3, 1);
  if (!path) return path.error();
  return moving("A camera is moved by hand, the tool held still", stream, **frames, **tool,
                path->X_WT.front());
}

/// A frame of the wall with and without a tenth of its pixels: nothing may come between the wall
/// and the depth 0 of a missing pixel.
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
    auto timeline = SurfaceTimeline::create(stream, {}, DepthFieldOptions{}, time);
    if (!timeline) return timeline.error();
    ThreadPool pool(0);
    double nearest = INFINITY;
    int num = 0;
    for (const DepthFrame& frame : frames) {
      timeline->push(frame, frame.timestamp, pool);
      for (int k = 0; k < 4; ++k) {
        const SurfaceMoment moment = timeline->at(frame.timestamp + k * 0.008);
        for (const Surfaces& surfaces : {moment.from, moment.to}) {
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
                           is_clean ? Verdict::agrees : Verdict::contradicts});
  result.tables.push_back(std::move(table));
  return result;
}

}  // namespace

std::vector<FigureSpec> time_figures() {
  return {
      {"3.12/3.13", "Depth-change vectors at a pillar", "Time and edges", figure_3_12},
      {"3.14", "Tunnelling past an edge", "Time and edges", figure_3_14},
      {"3.15a", "A moving wall between frames", "Time and edges", figure_3_15a},
      {"3.15b", "A moving camera between frames", "Time and edges", figure_3_15b},
      {"3.16", "Missing pixels between frames", "Time and edges", figure_3_16},
  };
}

}  // namespace palpate::eval
