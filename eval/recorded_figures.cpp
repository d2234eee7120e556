// 3.4-3.6, 3.11, 5.7-5.16: how the force feels on something that a depth camera recorded (thesis
// sections 3.2.2, 3.3.2, 3.4 and 5.1.1). There is no exact force here, so smoothness is what
// counts.
#include <algorithm>
#include <cmath>
#include <utility>

#include "eval/accuracy.h"
#include "eval/random.h"
#include "eval/speed.h"

namespace palpate::eval {
namespace {

/// Forces along a path, in shares of the whole tool's.
struct Felt {
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

Felt feel(MethodQueries& query, const Tool& tool, const ContactOptions& options,
          const std::vector<Pose>& path) {
  Felt felt;
  const double whole = full_volume(tool, options);
  for (std::size_t i = 0; i < path.size(); ++i) {
    felt.at.push_back(100 * static_cast<double>(i) / static_cast<double>(path.size()));
    felt.force.push_back(query.query(path[i], options).measure_W.force / whole);
  }
  return felt;
}

Curve curve_of(const Felt& felt, const char* name, const char* style) {
  Curve curve{name, style, felt.at, {}};
  for (const Vec3d& f : felt.force) curve.y.push_back(100 * norm(f));
  return curve;
}

/// All methods along one path of the recorded scene.
struct Comparison {
  std::string name;  ///< of the scene
  double mean_depth = 0;
  std::vector<Felt> felt;  ///< as `methods`
};

Result<Comparison> compare(Context& context, int num_spheres, double depth,
                           const std::vector<Method>& methods) {
  const auto scene = recorded_interaction(context);
  if (!scene) return scene.error();
  const auto tool = context.tool(scene->shape, scene->size, num_spheres);
  if (!tool) return tool.error();
  const auto path = hand_path(scene->frame, **tool, depth, context.choose<std::size_t>(2000, 200));
  if (!path) return path.error();
  auto query = query_on(scene->frame, **tool);
  Comparison comparison{scene->name, path->mean_depth, {}};
  for (const Method& method : methods) {
    comparison.felt.push_back(feel(*query, **tool, method.options, path->X_WT));
  }
  return comparison;
}

void add_felt(FigureResult& result, const Comparison& c, const std::vector<Method>& methods,
              const std::string& title) {
  Plot plot{title, "share of the path, %", "force, % of the whole tool's", {}, false, false, ""};
  Table table{"Steps of the force from pose to pose, % of the whole tool's",
              {"method", "largest", "rms", "largest / rms"},
              {}};
  std::size_t smoothest = 0;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const Felt& felt = c.felt[m];
    plot.curves.push_back(curve_of(felt, methods[m].name, methods[m].name));
    const double largest = felt.largest_step(), mean = felt.rms_step();
    table.rows.push_back({methods[m].name, words("%.3f", largest), words("%.4f", mean),
                          words("%.1f", largest / mean)});
    result.numbers.push_back({std::string(methods[m].name) + ".largest_step", largest, "%"});
    result.numbers.push_back({std::string(methods[m].name) + ".rms_step", mean, "%"});
    if (largest < c.felt[smoothest].largest_step()) smoothest = m;
  }
  plot.caption =
      words("Largest step %.2f %% (%s), of the others up to %.2f %%.",
            c.felt[smoothest].largest_step(), methods[smoothest].name,
            std::max_element(c.felt.begin(), c.felt.end(), [](const Felt& a, const Felt& b) {
              return a.largest_step() < b.largest_step();
            })->largest_step());
  result.plots.push_back(std::move(plot));
  result.tables.push_back(std::move(table));
}

std::vector<Method> with_priority(Priority priority) {
  std::vector<Method> methods = thesis_methods();
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
  add_felt(result, *c, methods, c->name + ", 10 % deep, priority: inverse distance");
  const double distance = c->felt[1].largest_step(), count = counted->felt[1].largest_step();
  result.claims.push_back(
      {"With inverse distance as priority simplified is smoother, with fewer spikes.",
       words(
           "Largest step of simplified %.2f %% with the distance, %.2f %% with the count; weighted "
           "%.2f %%.",
           distance, count, c->felt[0].largest_step()),
       distance < count ? Verdict::agrees : Verdict::differs});
  return result;
}

Result<FigureResult> figure_3_5(Context& context) {
  const auto methods = with_priority(Priority::count);
  const auto c = compare(context, 5000, 0.1, methods);
  if (!c) return c.error();
  FigureResult result;
  add_felt(result, *c, methods, c->name + ", 10 % deep, priority: number of points");
  const double weighted = c->felt[0].largest_step(), simplified = c->felt[1].largest_step();
  result.claims.push_back(
      {"With the collision count weighted is clean and simplified has severe spikes.",
       words("Largest step: weighted %.2f %%, simplified %.2f %% (%.1f times).", weighted,
             simplified, simplified / weighted),
       simplified > 1.5 * weighted ? Verdict::agrees : Verdict::differs});
  return result;
}

/// Is a point inside a closed mesh? Crossings of a ray that meets no edge, being askew.
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

/// The spiral in the mannequin's chest: a winding that reaches out again behind is not connected to
/// what is inside.
Result<FigureResult> figure_3_6(Context& context) {
  const auto scene = scenes::make_scene("mannequin");
  if (!scene) return scene.error();
  DepthStreamInfo stream;
  scenes::SimulatedCameraOptions camera;
  camera.noise.enabled = false;
  camera.unit = 1e-4;
  camera.duration = 0.01;
  const auto frames = context.simulated(*scene, camera, stream);
  if (!frames) return frames.error();
  const auto frame = SeenFrame::create(stream, frames->front());
  if (!frame) return frame.error();
  const auto tool = context.tool(scene->tool_shape, scene->tool_size, 3000);
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
    // What is truly outside: once per pose.
    std::vector<bool> is_outside(spheres.size(), false);
    if (query->query(X_WT, ContactOptions{}).volume == 0) continue;
    for (std::size_t s = 0; s < spheres.size(); ++s) {
      const Vec3d c_W = X_WT * to_double(spheres[s].centre);
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
       wrong[2].most < std::min(wrong[0].most, wrong[1].most) ? Verdict::agrees
                                                              : Verdict::contradicts});
  result.notes.push_back(
      "A sphere is wrong if its centre lies in no body although the method counts it "
      "as inside; what the camera cannot see behind a body counts as outside here.");
  result.tables.push_back(std::move(table));
  return result;
}

Result<FigureResult> figure_3_11(Context& context) {
  // A noisy wall, whose normal is known.
  FigureResult result;
  Table table{"Error of the normals on a wall with 1.5 mm noise",
              {"plane", "rms, °", "95th percentile, °"},
              {}};
  double errors[2] = {};
  const int width = 320, height = 240;
  const Intrinsics k{287.9, 287.9, 159.5, 119.5};
  Random random(3);
  std::vector<float> depth(static_cast<std::size_t>(width * height));
  for (float& z : depth) z = static_cast<float>(1 + 0.0015 * random.normal());
  for (const bool is_anchored : {false, true}) {
    SurfaceOptions options;
    options.filter.enabled = false;
    options.normals.anchoring = is_anchored;
    auto surface = SurfaceEstimator::create(width, height, k, options);
    if (!surface) return surface.error();
    ThreadPool pool(1);
    surface->update(std::span<const float>(depth), pool);
    const PointCloudView cloud = surface->cloud();
    std::vector<double> angles;
    double sum = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      if (!std::isfinite(cloud.nz[i])) continue;
      const double a = std::acos(std::clamp(-static_cast<double>(cloud.nz[i]), -1.0, 1.0));
      angles.push_back(a * 180 / kPi);
      sum += angles.back() * angles.back();
    }
    std::sort(angles.begin(), angles.end());
    errors[is_anchored] = std::sqrt(sum / static_cast<double>(angles.size()));
    const double p95 = angles[angles.size() * 95 / 100];
    table.rows.push_back({is_anchored ? "through the point (anchoring)" : "fitted (default)",
                          words("%.2f", errors[is_anchored]), words("%.2f", p95)});
    result.numbers.push_back(
        {is_anchored ? "anchored_rms" : "fitted_rms", errors[is_anchored], "deg"});
  }
  result.claims.push_back({"Anchoring gives visible errors in the lighting.",
                           words("Normals are %.1f times as wrong: %.1f° instead of %.1f° rms.",
                                 errors[1] / errors[0], errors[1], errors[0]),
                           errors[1] > 1.2 * errors[0] ? Verdict::agrees : Verdict::differs});
  result.tables.push_back(std::move(table));
  context.progress(1);
  return result;
}

/// 5.7-5.15: what was shown, and of which method it was said.
struct Shown {
  const char* id;
  double depth;
  int spheres;
  std::size_t method;  ///< of all_methods()
  const char* claim;
  bool is_good;  ///< the claim is that it is smooth
};
constexpr Shown kShown[] = {
    {"5.7", 0.07, 5000, 0, "7 %, brute force: continuous, small x noise, slightly smoother.", true},
    {"5.8", 0.07, 5000, 2, "7 %, graph: continuous, small x noise.", true},
    {"5.9", 0.10, 3000, 2, "10 %, graph: more discontinuity.", false},
    {"5.10", 0.31, 1000, 2, "31 %, 1,000 spheres: graph is bad.", false},
    {"5.11", 0.31, 1000, 1, "31 %, 1,000 spheres: simplified is good.", true},
    {"5.12", 0.31, 1000, 0, "31 %, 1,000 spheres: weighted is best.", true},
    {"5.13", 0.40, 8000, 0, "40 %, 8,000 spheres: as good as with fewer.", true},
    {"5.14", 0.46, 12000, 0, "46 %, 12,000 spheres: as good as with fewer.", true},
    {"5.15", 0.70, 1500, 0, "70 %, 1,500 spheres, weighted: as good as with more.", true},
};

Result<FigureResult> shown(Context& context, const Shown& figure) {
  const auto methods = all_methods();
  const auto c = compare(context, figure.spheres, figure.depth, methods);
  if (!c) return c.error();
  FigureResult result;
  add_felt(
      result, *c, methods,
      words("%s, %.0f %% deep, %d spheres", c->name.c_str(), 100 * figure.depth, figure.spheres));
  const double own = c->felt[figure.method].largest_step(), field = c->felt[4].largest_step();
  double best = INFINITY, worst = 0;
  for (std::size_t m = 0; m < 3; ++m) {
    best = std::min(best, c->felt[m].largest_step());
    worst = std::max(worst, c->felt[m].largest_step());
  }
  // Nearer to the smoothest of the thesis' methods than to the roughest.
  const bool is_good = own <= std::sqrt(best * worst);
  result.claims.push_back(
      {figure.claim,
       words("Largest step of %s %.2f %% of the whole force (its rms step %.3f %%); of the thesis' "
             "methods %.2f to %.2f %%, of the field %.2f %%.",
             methods[figure.method].name, own, c->felt[figure.method].rms_step(), best, worst,
             field),
       is_good == figure.is_good ? (field < own ? Verdict::better : Verdict::agrees)
                                 : Verdict::differs});
  return result;
}

Result<FigureResult> figure_5_16(Context& context) {
  const auto scene = recorded_interaction(context);
  if (!scene) return scene.error();
  const int many = context.choose(17000, 5000);
  const auto fine = context.tool(scene->shape, scene->size, many);
  const auto coarse = context.tool(scene->shape, scene->size, 1000);
  if (!fine) return fine.error();
  if (!coarse) return coarse.error();
  const auto path = hand_path(scene->frame, **fine, 0.28, context.choose<std::size_t>(500, 100));
  if (!path) return path.error();
  auto fine_query = query_on(scene->frame, **fine);
  auto coarse_query = query_on(scene->frame, **coarse);
  FigureResult result;
  Table table{words("1,000 against %d spheres, 28 %% deep", many),
              {"method", "difference of the force, % rms", "times as long"},
              {}};
  double weighted_difference = 0, weighted_cost = 0;
  for (const Method& method : all_methods()) {
    const Felt a = feel(*coarse_query, **coarse, method.options, path->X_WT);
    const Felt b = feel(*fine_query, **fine, method.options, path->X_WT);
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
    if (method.options.method == InsideMethod::weighted) {
      weighted_difference = difference, weighted_cost = cost;
      result.plots.push_back({scene->name + ", weighted, 28 % deep",
                              "share of the path, %",
                              "force, % of the whole tool's",
                              {curve_of(a, "1,000 spheres", "other1"),
                               curve_of(b, words("%d spheres", many).c_str(), "other2")},
                              false,
                              false,
                              words("The force differs by %.2f %% rms.", difference)});
    }
  }
  result.claims.push_back(
      {"1,000 against 17,000 spheres: minuscule difference for about two orders of cost "
       "(weighted).",
       words("%.2f %% rms of the whole force for %.0f times the time.", weighted_difference,
             weighted_cost),
       weighted_difference < 2 && weighted_cost > 30 ? Verdict::agrees : Verdict::differs});
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
