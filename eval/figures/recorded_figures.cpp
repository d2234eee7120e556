// 3.4-3.6, 3.11, 5.7-5.16: smoothness of the force on recorded scenes (thesis sections 3.2.2,
// 3.3.2, 3.4 and 5.1.1). There is no exact force here, so smoothness is what counts.
#include <algorithm>
#include <cmath>
#include <utility>

#include "eval/studies/accuracy.h"
#include "eval/studies/recorded_run.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "src/math/internal/random.h"

namespace palpate::eval {
namespace {

constexpr double kClean = 1;          // largest step of a calm plot, % of its height
constexpr double kSpikes = 2;         // times the step of a clean plot
constexpr double kVisible = 2;        // % of the brightness: visible in smooth shading
constexpr double kSmallNoise = 0.05;  // N of kFullForce: half a percent
constexpr double kMinuscule = 2;      // % of the whole force
constexpr double kSwing = 0.1;        // in and out, of the tool's radius
constexpr double kWorse = 1.25;       // times as wrong

/// Forces along a path, in shares of the whole tool's force.
struct ForceSeries {
  std::vector<double> at;  ///< % of the path
  std::vector<Vec3d> force;

  /// Largest change from one pose to the next, and the rms change, %.
  double largest_step() const { return 100 * step(true); }
  double rms_step() const { return 100 * step(false); }

 private:
  double step(bool is_largest) const {
    double largest = 0, sum = 0;
    for (std::size_t i = 0; i + 1 < force.size(); ++i) {
      const double d = norm(force[i + 1] - force[i]);
      largest = std::max(largest, d);
      sum += d * d;
    }
    return is_largest ? largest : std::sqrt(sum / static_cast<double>(force.size() - 1));
  }
};

Result<ForceSeries> forces_by(const RecordedRun& run, const Tool& tool,
                              const ContactOptions& options) {
  const auto measured = run.by(options);
  if (!measured) return measured.error();
  ForceSeries series;
  for (std::size_t i = 0; i < measured->size(); ++i) {
    series.at.push_back(100 * static_cast<double>(i) / static_cast<double>(measured->size()));
    series.force.push_back((*measured)[i].penetration.measure_W.force / full_volume(tool, options));
  }
  return series;
}

/// Plots one axis of the force in newtons.
Curve curve_of(const ForceSeries& series, const char* name, const char* style, int axis) {
  Curve curve{name, style, series.at, {}};
  for (const Vec3d& f : series.force) {
    curve.y.push_back(kFullForce * (axis == 0 ? f.x : axis == 1 ? f.y : f.z));
  }
  return curve;
}

constexpr const char* kAxes[] = {"x", "y", "z"};

std::string newtons(int axis) {
  return words("%s force, N (wholly inside: %.0f N)", kAxes[axis], kFullForce);
}

/// One hand path on the recorded scene for all methods, in `finer` times as many steps.
struct Comparison {
  std::string name;  ///< of the scene
  double mean_depth = 0;
  std::vector<ForceSeries> series;  ///< as `methods`
};

Result<Comparison> compare(Context& context, int num_spheres, double depth,
                           const std::vector<Method>& methods, std::size_t finer = 1,
                           GapRule rule = GapRule::absolute) {
  const auto scene = hand_interaction(context);
  if (!scene) return scene.error();
  const auto tool = context.tool(scene->shape, scene->size, num_spheres, rule);
  if (!tool) return tool.error();
  const auto path =
      hand_path(scene->frame, **tool, depth, finer * context.choose<std::size_t>(2000, 200), kSwing,
                scene->motion, scene->farthest);
  if (!path) return path.error();
  const auto run = RecordedRun::record(**tool, scene->picture, path->X_WT);
  if (!run) return run.error();
  Comparison comparison{scene->name, path->mean_depth, {}};
  for (const Method& method : methods) {
    auto series = forces_by(*run, **tool, method.options);
    if (!series) return series.error();
    comparison.series.push_back(*std::move(series));
  }
  return comparison;
}

void add_forces(FigureResult& result, const Comparison& c, const std::vector<Method>& methods,
                const std::string& title) {
  for (int axis = 0; axis < 3; ++axis) {
    Plot plot{title, "share of the path, %", newtons(axis), {}, false, false, ""};
    for (std::size_t m = 0; m < methods.size(); ++m) {
      plot.curves.push_back(curve_of(c.series[m], methods[m].name, methods[m].name, axis));
    }
    result.plots.push_back(std::move(plot));
  }
  Table table{"Steps of the force from pose to pose, % of the whole tool's",
              {"method", "largest", "rms", "largest / rms"},
              {}};
  std::size_t smoothest = 0;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const ForceSeries& series = c.series[m];
    const double largest = series.largest_step(), mean = series.rms_step();
    table.rows.push_back({methods[m].name, words("%.3f", largest), words("%.4f", mean),
                          words("%.1f", largest / mean)});
    result.numbers.push_back({std::string(methods[m].name) + ".largest_step", largest, "%"});
    result.numbers.push_back({std::string(methods[m].name) + ".rms_step", mean, "%"});
    if (largest < c.series[smoothest].largest_step()) smoothest = m;
  }
  const std::string caption =
      words("Largest step %.2f %% (%s), of the others up to %.2f %%.",
            c.series[smoothest].largest_step(), methods[smoothest].name,
            std::max_element(c.series.begin(), c.series.end(),
                             [](const ForceSeries& a, const ForceSeries& b) {
                               return a.largest_step() < b.largest_step();
                             })
                ->largest_step());
  for (Plot& plot : result.plots) plot.caption = caption;
  result.tables.push_back(std::move(table));
  result.notes.push_back(c.name +
                         ": a recorded hand is a trajectory of 30 s that a motion capture system "
                         "saw of something held in a hand (TUM fr1/xyz), as it turned, its shifts "
                         "scaled to 15 mm rms across the place that is touched; the frame stands "
                         "still. All methods count the volumes that spheres represent. A hand that "
                         "moves is in the figure protocol.");
}

std::vector<Method> with_priority(Priority priority) {
  std::vector<Method> methods = all_methods_alike();
  methods.resize(2);
  for (Method& method : methods) method.options.priority = priority;
  return methods;
}

Result<FigureResult> figure_3_4(Context& context) {
  const auto methods = with_priority(Priority::distance);
  const auto c = compare(context, 5000, 0.1, methods);
  if (!c) return c.error();
  const auto counted = compare(context, 5000, 0.1, with_priority(Priority::count));
  if (!counted) return counted.error();
  FigureResult result;
  add_forces(result, *c, methods, c->name + ", 10 % deep, priority: inverse distance");
  const double distance = c->series[1].largest_step(), count = counted->series[1].largest_step();
  result.claims.push_back(
      {"With inverse distance as priority simplified is smoother than weighted, with fewer spikes.",
       words("Largest step of simplified %.2f %%, of weighted %.2f %%; rms step %.3f and %.3f %% "
             "(simplified with the count: %.2f %%).",
             distance, c->series[0].largest_step(), c->series[1].rms_step(),
             c->series[0].rms_step(), count),
       is_less(distance, c->series[0].largest_step())});
  return result;
}

Result<FigureResult> figure_3_5(Context& context) {
  const auto methods = with_priority(Priority::count);
  const auto c = compare(context, 5000, 0.1, methods);
  if (!c) return c.error();
  FigureResult result;
  add_forces(result, *c, methods, c->name + ", 10 % deep, priority: number of points");
  const double weighted = c->series[0].largest_step(), simplified = c->series[1].largest_step();
  result.claims.push_back(
      {"With the collision count weighted is clean and simplified has severe spikes.",
       words("Largest step: weighted %.2f %%, simplified %.2f %% (%.1f times).", weighted,
             simplified, simplified / weighted),
       are_true({weighted<kClean, simplified> kSpikes * weighted})});
  return result;
}

/// True if a point is inside a closed mesh, by crossings of a ray that is tilted to meet no edge.
bool contains(const TriangleMesh& mesh, const Vec3d& p) {
  const Vec3d d = normalized(Vec3d{0.3127, 0.5711, 0.7589});
  int num = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3d a = mesh.vertices[t[0]], e1 = mesh.vertices[t[1]] - a, e2 = mesh.vertices[t[2]] - a;
    const Vec3d q = cross(d, e2);
    const double det = dot(e1, q);
    if (det == 0) continue;
    const Vec3d s = p - a;
    const double u = dot(s, q) / det;
    if (u < 0 || u > 1) continue;
    const Vec3d r = cross(s, e1);
    const double v = dot(d, r) / det;
    if (v < 0 || u + v > 1) continue;
    num += dot(e2, r) / det > 0;
  }
  return num % 2 == 1;
}

/// The spiral in the mannequin's chest: a winding that leaves the chest at the back is not
/// connected to the inside.
Result<FigureResult> figure_3_6(Context& context) {
  const auto scene = scenes::make_scene("mannequin");
  if (!scene) return scene.error();
  const auto frame = seen_scene(context, *scene, false);
  if (!frame) return frame.error();
  const auto tool = context.thesis_tool(scene->tool_shape, scene->tool_size, 3000);
  if (!tool) return tool.error();
  auto query = query_on(*frame, **tool);

  FigureResult result;
  Table table{"Spheres counted as inside although they lie wholly outside all bodies",
              {"method", "most at one pose", "of so many inside", "wrong volume, % of the tool"},
              {}};
  const auto spheres = (*tool)->spheres();
  const std::size_t step = context.choose<std::size_t>(20, 80);
  struct Wrong {
    int most = 0, inside = 0;
    double volume = 0;
  };
  const auto methods = all_methods();
  std::vector<Wrong> wrong(methods.size());
  for (std::size_t i = 0; i < scene->path_poses.size(); i += step) {
    const Pose& X_WT = scene->path_poses[i];
    // Spheres that are truly outside, once per pose.
    std::vector<bool> is_outside(spheres.size(), false);
    if (query->query(X_WT, ContactOptions{}).volume == 0) continue;
    for (std::size_t s = 0; s < spheres.size(); ++s) {
      const Vec3d c_W = X_WT * to_double(spheres[s].center);
      is_outside[s] =
          std::none_of(scene->bodies.begin(), scene->bodies.end(), [&](const auto& body) {
            return contains(body.mesh, inverse(body.motion ? body.motion(0) : body.X_WB) * c_W);
          });
    }
    for (std::size_t m = 0; m < methods.size(); ++m) {
      query->query(X_WT, methods[m].options);
      const auto states = query->states();
      int num = 0, inside = 0;
      double volume = 0;
      for (std::size_t s = 0; s < spheres.size(); ++s) {
        if (states[s] != SphereState::inside) continue;
        ++inside;
        if (!is_outside[s]) continue;
        ++num;
        volume += sphere_volume(static_cast<double>(spheres[s].radius));
      }
      if (num > wrong[m].most) {
        wrong[m] = {num, inside, 100 * volume / (*tool)->sphere_mass().volume};
      }
    }
  }
  for (std::size_t m = 0; m < methods.size(); ++m) {
    table.rows.push_back({methods[m].name, words("%d", wrong[m].most), words("%d", wrong[m].inside),
                          words("%.2f", wrong[m].volume)});
    result.numbers.push_back({std::string(methods[m].name) + ".wrong_spheres",
                              static_cast<double>(wrong[m].most), "spheres"});
  }
  result.claims.push_back(
      {"Brute force marks an unconnected part of a spiral inside; the graph does not.",
       words("On our mannequin, most wrong spheres at a pose: weighted %d, simplified %d, graph "
             "%d, field %d.",
             wrong[0].most, wrong[1].most, wrong[2].most, wrong[4].most),
       are_true({wrong[0].most > 0, wrong[1].most > 0, wrong[2].most == 0})});
  result.claims.push_back(
      {"The field marks fewer of them than the best of the thesis' methods.",
       words("%d against %d.", wrong[4].most,
             std::min({wrong[0].most, wrong[1].most, wrong[2].most})),
       is_better(wrong[4].most, std::min({wrong[0].most, wrong[1].most, wrong[2].most})),
       Source::ours});
  result.notes.push_back(
      "A sphere is wrong if its center lies in no body although the method counts it "
      "as inside; what the camera cannot see behind a body counts as outside here.");
  result.tables.push_back(std::move(table));
  return result;
}

/// A noisy depth image of a ball in front of a wall, where the thesis observed wrong lighting.
struct NoisyBall {
  static constexpr int kWidth = 320, kHeight = 240;
  static constexpr double kRadius = 0.2, kDistance = 1.2;  // m
  Intrinsics k{287.9, 287.9, 159.5, 119.5};
  std::vector<float> depth;
  std::vector<Vec3d> normal;  ///< zero: not on the ball, or at its rim

  NoisyBall() {
    Random random(3);
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const Vec3d ray{(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1};
        // |t ray - c| = r
        const double a = dot(ray, ray), b = ray.z * kDistance;
        const double root = b * b - a * (kDistance * kDistance - kRadius * kRadius);
        const double z = root > 0 ? (b - std::sqrt(root)) / a : kDistance;
        const Vec3d n = (ray * z - Vec3d{0, 0, kDistance}) / kRadius;
        const bool is_seen_well = root > 0 && -dot(n, ray) > 0.5 * norm(ray);
        normal.push_back(is_seen_well ? n : Vec3d{});
        depth.push_back(static_cast<float>(z + 0.0015 * random.normal()));
      }
    }
  }
};

Result<FigureResult> figure_3_11(Context& context) {
  const NoisyBall ball;
  FigureResult result;
  Table table{"On a ball of 0.4 m with 1.5 mm noise",
              {"plane", "normals, rms °", "95th percentile, °", "lighting, rms %"},
              {}};
  struct Fit {
    const char *key, *name;
    PlaneFit fit;
    bool is_anchored, is_weighted = false, is_normalized = false, is_filtered = false;
  };
  constexpr Fit kFits[] = {
      {"principal", "eq. 3.7: through the mean", PlaneFit::principal, false},
      {"principal_anchored", "eq. 3.9: through the point (anchoring)", PlaneFit::principal, true},
      {"along_ray", "ours: through the mean, noise along the ray", PlaneFit::along_ray, false},
      {"along_ray_anchored", "ours, anchored", PlaneFit::along_ray, true},
      {"weighted", "eq. 3.10: near neighbors count more", PlaneFit::principal, false, true},
      {"normalized", "eq. 3.11: all neighbors count the same", PlaneFit::principal, false, false,
       true},
      {"filtered", "eq. 3.7 after the bilateral filter (eq. 3.12)", PlaneFit::principal, false,
       false, false, true},
      {"along_ray_filtered", "ours after the filter: the default", PlaneFit::along_ray, false,
       false, false, true}};
  enum : std::size_t { kPlain, kAnchored, kRay, kRayAnchored, kWeighted, kNormalized, kFiltered };
  double shading[std::size(kFits)] = {}, angle[std::size(kFits)] = {};
  for (std::size_t f = 0; f < std::size(kFits); ++f) {
    SurfaceOptions options;
    options.filter.enabled = kFits[f].is_filtered;
    options.normals.weighting = kFits[f].is_weighted;
    options.normals.normalization = kFits[f].is_normalized;
    options.normals.fit = kFits[f].fit;
    options.normals.anchoring = kFits[f].is_anchored;
    auto surface = SurfaceEstimator::create(NoisyBall::kWidth, NoisyBall::kHeight, ball.k, options);
    if (!surface) return surface.error();
    ThreadPool pool(1);
    surface->update(std::span<const float>(ball.depth), pool);
    const PointCloudView cloud = surface->cloud();
    std::vector<double> angles;
    double squares = 0, light = 0;
    const Vec3d lamp = normalized(Vec3d{0.4, -0.5, -1});  // from above, beside the camera
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      if (norm(ball.normal[i]) == 0 || !std::isfinite(cloud.nz[i])) continue;
      const Vec3d n = to_double(Vec3f{cloud.nx[i], cloud.ny[i], cloud.nz[i]});
      const double a = std::acos(std::clamp(dot(n, ball.normal[i]), -1.0, 1.0)) * 180 / kPi;
      angles.push_back(a);
      squares += a * a;
      const double d = std::max(0.0, dot(n, lamp)) - std::max(0.0, dot(ball.normal[i], lamp));
      light += d * d;
    }
    std::sort(angles.begin(), angles.end());
    const auto num = static_cast<double>(angles.size());
    angle[f] = std::sqrt(squares / num), shading[f] = 100 * std::sqrt(light / num);
    table.rows.push_back({kFits[f].name, words("%.2f", angle[f]),
                          words("%.2f", angles[angles.size() * 95 / 100]),
                          words("%.2f", shading[f])});
    result.numbers.push_back({words("%s.angle_rms", kFits[f].key), angle[f], "deg"});
    result.numbers.push_back({words("%s.lighting_rms", kFits[f].key), shading[f], "%"});
  }
  result.claims.push_back(
      {"Anchoring gives visible errors in the lighting.",
       words(
           "By eq. 3.7 the brightness is off by %.1f %% rms with anchoring and by %.1f %% without "
           "(visible from %.0f %% on); normals by %.1f° and %.1f°.",
           shading[kAnchored], shading[kPlain], kVisible, angle[kAnchored], angle[kPlain]),
       are_true({shading[kAnchored] > kVisible, shading[kAnchored] > kWorse * shading[kPlain]})});
  result.claims.push_back(
      {"Weighting neighbors by their distance is better than a threshold alone (3.4.1.2).",
       words(
           "Normals off by %.2f° rms with weights of eq. 3.10, by %.2f° with the threshold alone.",
           angle[kWeighted], angle[kPlain]),
       is_less(angle[kWeighted], angle[kPlain])});
  result.claims.push_back({"Normalization makes no noticeable difference (3.4.1.3).",
                           words("Normals off by %.2f° rms with it, by %.2f° without.",
                                 angle[kNormalized], angle[kPlain]),
                           is_times(angle[kNormalized], angle[kPlain], 1)});
  result.claims.push_back(
      {"The bilateral filter makes normals less noisy (3.4.2).",
       words("By eq. 3.7 they are off by %.2f° rms with the filter, by %.2f° without.",
             angle[kFiltered], angle[kPlain]),
       is_less(angle[kFiltered], angle[kPlain])});
  result.claims.push_back({"Our fit gives normals as right as eq. 3.7 does, or better.",
                           words("%.2f° rms against %.2f°.", angle[kRay], angle[kPlain]),
                           is_better(angle[kRay], angle[kPlain]), Source::ours});
  result.tables.push_back(std::move(table));
  context.progress(1);
  return result;
}

/// Findings of 5.7-5.15. Figures of one run have one claim.
enum class Finding {
  continuous,  ///< weighted and graph are continuous, weighted is smoother
  rougher,     ///< the graph is rougher than with 7 % and 5,000 spheres
  ranked,      ///< weighted is the smoothest, simplified nearly, the graph the roughest
  as_good,     ///< weighted is as good as with `other` spheres
};
struct Shown {
  const char* id;
  double depth;
  int spheres;
  Finding finding;
  int other;  ///< spheres
  const char* claim;
};
constexpr Shown kShown[] = {
    {"5.7-5.8", 0.07, 5000, Finding::continuous, 0,
     "7 %: brute force and the graph are continuous with small x noise, brute force slightly "
     "smoother."},
    {"5.9", 0.10, 3000, Finding::rougher, 5000, "10 %, graph: more discontinuity."},
    {"5.10-5.12", 0.31, 1000, Finding::ranked, 0,
     "31 %, 1,000 spheres: the graph is bad, simplified good and weighted best."},
    {"5.13", 0.40, 8000, Finding::as_good, 1000, "40 %, 8,000 spheres: as good as with fewer."},
    {"5.14", 0.46, 12000, Finding::as_good, 1000, "46 %, 12,000 spheres: as good as with fewer."},
    {"5.15", 0.70, 1500, Finding::as_good, 8000,
     "70 %, 1,500 spheres, weighted: as good as with more."},
};

/// Returns the sideways noise (x) of a force along a path: rms of its second differences, N.
double x_noise(const ForceSeries& series) {
  double sum = 0;
  for (std::size_t i = 1; i + 1 < series.force.size(); ++i) {
    const double bend = series.force[i + 1].x - 2 * series.force[i].x + series.force[i - 1].x;
    sum += bend * bend / 6;  // six times the variance for white noise
  }
  return kFullForce * std::sqrt(sum / static_cast<double>(series.force.size() - 2));
}

/// Returns the largest step of one method on a run with other settings, %.
Result<double> largest_step(Context& context, const Method& method, int num_spheres, double depth,
                            std::size_t finer = 1, GapRule rule = GapRule::absolute) {
  const auto c = compare(context, num_spheres, depth, {method}, finer, rule);
  if (!c) return c.error();
  return c->series[0].largest_step();
}

/// Judges the claims about the thesis' methods, which are the first three of `methods`.
Result<Claim> judge(Context& context, const Shown& figure, const Comparison& c,
                    const std::vector<Method>& methods, const std::string& steps) {
  const Method &weighted = methods[0], &graph = methods[2];
  const auto step = [&](std::size_t m) { return c.series[m].largest_step(); };
  switch (figure.finding) {
    case Finding::continuous: {
      const auto half = largest_step(context, weighted, figure.spheres, figure.depth, 2);
      const auto half_of_graph = largest_step(context, graph, figure.spheres, figure.depth, 2);
      if (!half) return half.error();
      if (!half_of_graph) return half_of_graph.error();
      const double noise = x_noise(c.series[0]), noise_of_graph = x_noise(c.series[2]);
      return Claim{
          figure.claim,
          words("Largest step of weighted %.2f %% of the whole force, %.2f %% in half as long "
                "steps, of the graph %.2f and %.2f %%; x noise %.3f and %.3f N rms of %.0f.",
                step(0), *half, step(2), *half_of_graph, noise, noise_of_graph, kFullForce),
          are_true({is_continuous(step(0), *half) == Verdict::agrees,
                    is_continuous(step(2), *half_of_graph) == Verdict::agrees, step(0) < step(2),
                    noise < kSmallNoise, noise_of_graph < kSmallNoise})};
    }
    case Finding::rougher: {
      const auto before = largest_step(context, graph, figure.other, 0.07);
      if (!before) return before.error();
      return Claim{figure.claim,
                   words("Largest step %.2f %%; 7 %% deep with %d spheres %.2f %%.", step(2),
                         figure.other, *before),
                   is_less(*before, step(2))};
    }
    case Finding::ranked:
      return Claim{figure.claim, "Largest steps: " + steps + ".",
                   are_ranked(step(0), step(1), step(2))};
    case Finding::as_good: break;
  }
  const auto other = largest_step(context, weighted, figure.other, figure.depth);
  if (!other) return other.error();
  return Claim{
      figure.claim,
      words("Largest step %.2f %%, with %d spheres %.2f %%.", step(0), figure.other, *other),
      is_as_good(step(0), *other)};
}

Result<FigureResult> shown(Context& context, const Shown& figure) {
  const auto methods = all_methods_alike();
  const auto c = compare(context, figure.spheres, figure.depth, methods);
  if (!c) return c.error();
  FigureResult result;
  add_forces(
      result, *c, methods,
      words("%s, %.0f %% deep, %d spheres", c->name.c_str(), 100 * figure.depth, figure.spheres));
  const auto of_pack =
      largest_step(context, methods[2], figure.spheres, figure.depth, 1, GapRule::relative);
  if (!of_pack) return of_pack.error();
  result.numbers.push_back({"graph.gap_rule_relative.largest_step", *of_pack, "%"});
  const auto step = [&](std::size_t m) { return c->series[m].largest_step(); };
  const std::string steps = words(
      "weighted %.2f %%, simplified %.2f, graph %.2f (with the gap rule of our packings %.2f)",
      step(0), step(1), step(2), *of_pack);
  auto claim = judge(context, figure, *c, methods, steps);
  if (!claim) return claim.error();
  result.claims.push_back(*std::move(claim));
  result.claims.push_back(
      {"The field is smoother than the smoothest of the thesis' methods.",
       words("Largest step of the field %.2f %% of the whole force; ", step(4)) + steps + ".",
       is_better(step(4), std::min({step(0), step(1), step(2)})), Source::ours});
  return result;
}

Result<FigureResult> figure_5_16(Context& context) {
  const auto scene = hand_interaction(context);
  if (!scene) return scene.error();
  const int many = context.choose(17000, 5000);
  const auto fine = context.thesis_tool(scene->shape, scene->size, many);
  const auto coarse = context.thesis_tool(scene->shape, scene->size, 1000);
  if (!fine) return fine.error();
  if (!coarse) return coarse.error();
  const auto path = hand_path(scene->frame, **fine, 0.28, context.choose<std::size_t>(500, 100),
                              kSwing, scene->motion, scene->farthest);
  if (!path) return path.error();
  const auto fine_run = RecordedRun::record(**fine, scene->picture, path->X_WT);
  const auto coarse_run = RecordedRun::record(**coarse, scene->picture, path->X_WT);
  if (!fine_run) return fine_run.error();
  if (!coarse_run) return coarse_run.error();
  auto fine_query = query_on(scene->frame, **fine);
  auto coarse_query = query_on(scene->frame, **coarse);
  FigureResult result;
  Table table{words("1,000 against %d spheres, 28 %% deep", many),
              {"method", "difference of the force, % rms", "times as long"},
              {}};
  double weighted_difference = 0, weighted_cost = 0;
  for (const Method& method : all_methods_alike()) {
    const auto coarse_forces = forces_by(*coarse_run, **coarse, method.options);
    const auto fine_forces = forces_by(*fine_run, **fine, method.options);
    if (!coarse_forces) return coarse_forces.error();
    if (!fine_forces) return fine_forces.error();
    const ForceSeries &a = *coarse_forces, &b = *fine_forces;
    double sum = 0;
    for (std::size_t i = 0; i < a.force.size(); ++i) {
      const double d = norm(a.force[i] - b.force[i]);
      sum += d * d;
    }
    const double difference = 100 * std::sqrt(sum / static_cast<double>(a.force.size()));
    const double cost = time_queries(*fine_query, method.options, path->X_WT).median /
                        time_queries(*coarse_query, method.options, path->X_WT).median;
    table.rows.push_back({method.name, words("%.2f", difference), words("%.1f", cost)});
    result.numbers.push_back({std::string(method.name) + ".difference", difference, "%"});
    result.numbers.push_back({std::string(method.name) + ".cost", cost, "1"});
    if (method.options.method == MethodKind::weighted) {
      weighted_difference = difference, weighted_cost = cost;
      for (int axis = 0; axis < 3; ++axis) {
        result.plots.push_back({scene->name + ", weighted, 28 % deep",
                                "share of the path, %",
                                newtons(axis),
                                {curve_of(a, "1,000 spheres", "other1", axis),
                                 curve_of(b, words("%d spheres", many).c_str(), "other2", axis)},
                                false,
                                false,
                                words("The force differs by %.2f %% rms.", difference)});
      }
    }
  }
  result.claims.push_back(
      {"1,000 against 17,000 spheres: minuscule difference for about two orders of cost "
       "(weighted).",
       words("%.2f %% rms of the whole force for %.0f times the time.", weighted_difference,
             weighted_cost),
       are_true({weighted_difference<kMinuscule, weighted_cost> 30})});
  result.tables.push_back(std::move(table));
  return result;
}

template <std::size_t kIndex>
Result<FigureResult> make_shown(Context& context) {
  return shown(context, kShown[kIndex]);
}
template <std::size_t... kIndices>
void add_shown(std::vector<FigureSpec>& figures, std::index_sequence<kIndices...>) {
  (figures.push_back({kShown[kIndices].id, "Force along a path", "Quality", make_shown<kIndices>}),
   ...);
}

}  // namespace

std::vector<FigureSpec> recorded_figures() {
  std::vector<FigureSpec> figures{
      {"3.4", "Priority: inverse distance", "Quality", figure_3_4},
      {"3.5", "Priority: number of points", "Quality", figure_3_5},
      {"3.6", "A spiral in a mannequin: unconnected parts", "Quality", figure_3_6},
      {"3.11", "Anchored planes", "Quality", figure_3_11},
  };
  add_shown(figures, std::make_index_sequence<std::size(kShown)>{});
  figures.push_back({"5.16", "1,000 against 17,000 spheres", "Quality", figure_5_16});
  return figures;
}

}  // namespace palpate::eval
