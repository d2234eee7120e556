// Robustness, which the thesis does not study: errors over noise, missing pixels, distance, coarser
// cameras and coarser packings. A cube goes into a wall, onto a ball and onto a ridge; all errors
// are against the exact wrench.
#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include "eval/context.h"
#include "eval/studies/accuracy.h"
#include "eval/studies/frozen_frame.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "scenes/truth.h"
#include "src/math/internal/random.h"

namespace palpate::eval {
namespace {

constexpr double kCube = 0.1;  // m
constexpr int kSpheres = 2000;
constexpr double kDepth = 1.0;  // m

/// Camera and tool of one measurement.
struct Look {
  double sigma = 0.0015;  ///< m at 1 m, grows with the square of the distance
  double missing = 0;     ///< share of pixels without depth
  double distance = 1;    ///< m
  double resolution = 1;  ///< of 640x480
  int spheres = kSpheres;
};

/// Errors of all methods over the scenes.
struct Errors {
  std::vector<double> volume, direction, jump;  ///< rms %, rms degrees, times the exact one
};

scenes::Environment solid_at(int which, double z) {
  if (which == 0) return scenes::Environment::wall(z);
  if (which == 1) return scenes::Environment::ball_outside(z, 0.35);
  return scenes::Environment::wedge(z, 135 * kPi / 180);
}

Result<Errors> errors_of(Context& context, const Look& look) {
  const auto tool = context.tool("box", kCube, look.spheres);
  if (!tool) return tool.error();
  const auto methods = all_methods_alike();
  const auto n = methods.size();
  Errors errors{std::vector<double>(n), std::vector<double>(n), std::vector<double>(n)};
  const int num_scenes = context.choose(3, 1);
  for (int which = 0; which < num_scenes; ++which) {
    ContactCase c;
    c.environment = solid_at(which, look.distance);
    c.tool_shape = "box";
    c.tool_size = kCube;
    const Quaternion turned = axis_angle({1, 2, 0.5}, 0.35);
    c.start = {{0.011, -0.007, look.distance - 0.09}, turned};
    c.end = {{0.011, -0.007, look.distance + 0.09}, turned};

    DepthStreamInfo stream;
    stream.width = static_cast<int>(640 * look.resolution);
    stream.height = static_cast<int>(480 * look.resolution);
    stream.intrinsics = {575.8157 * look.resolution, 575.8157 * look.resolution,
                         (stream.width - 1) / 2.0, (stream.height - 1) / 2.0};
    stream.unit = 5e-5;
    DepthFrame frame{stream.width, stream.height, stream.unit, {}, 0};
    Random random(static_cast<std::uint64_t>(which) + 11);
    for (int v = 0; v < stream.height; ++v) {
      for (int u = 0; u < stream.width; ++u) {
        const Vec3d ray{(u - stream.intrinsics.cx) / stream.intrinsics.fx,
                        (v - stream.intrinsics.cy) / stream.intrinsics.fy, 1};
        double z = scenes::first_hit(c.environment, ray);
        const double noise = look.sigma * z * z * random.normal();
        const bool is_missing = random.uniform() < look.missing || !std::isfinite(z);
        z = std::clamp((z + noise) / stream.unit, 0.0, 65534.0);
        frame.pixels.push_back(is_missing ? 0 : static_cast<std::uint16_t>(std::lround(z)));
      }
    }
    const auto seen = FrozenFrame::create(stream, frame);
    if (!seen) return seen.error();
    auto query = query_on(*seen, **tool);
    const auto coarse = exact_steps(c, **tool, 0, 1, context.choose(41, 11));
    const auto fine = exact_steps(c, **tool, 0.35, 0.5, context.choose(270, 40));
    for (std::size_t m = 0; m < n; ++m) {
      const Measure measured{full_volume(**tool, methods[m].options), [&](const Pose& X_WT) {
                               return query->query(X_WT, methods[m].options);
                             }};
      errors.volume[m] += 100 * volume_error(**tool, coarse, measured).rms / num_scenes;
      errors.direction[m] +=
          180 / kPi * wrench_error(**tool, coarse, measured).direction_rms / num_scenes;
      const WrenchError smooth = wrench_error(**tool, fine, measured);
      errors.jump[m] += smooth.jump / smooth.exact_jump / num_scenes;
    }
  }
  return errors;
}

/// Measures all errors over one property of the look.
Result<FigureResult> study(Context& context, const std::string& x_label,
                           const std::vector<double>& x,
                           const std::function<void(Look&, double)>& set, bool log_x = false) {
  const auto methods = all_methods_alike();
  FigureResult result;
  Plot plots[3] = {
      {"Volume", x_label, "error of the volume, % rms", {}, log_x, true, ""},
      {"Direction", x_label, "error of the force's direction, ° rms", {}, log_x, true, ""},
      {"Smoothness", x_label, "largest step of the force, exact = 1", {}, log_x, true, ""}};
  std::vector<Errors> all;
  for (const double value : x) {
    Look look;
    set(look, value);
    const auto errors = errors_of(context, look);
    if (!errors) return errors.error();
    all.push_back(*errors);
    context.progress(static_cast<double>(all.size()) / static_cast<double>(x.size()));
  }
  const auto of = [&](int which, std::size_t i) -> const std::vector<double>& {
    return which == 0 ? all[i].volume : which == 1 ? all[i].direction : all[i].jump;
  };
  const char* names[] = {"volume_rms", "direction_rms", "jump_ratio"};
  const char* units[] = {"%", "deg", "1"};
  for (int which = 0; which < 3; ++which) {
    for (std::size_t m = 0; m < methods.size(); ++m) {
      Curve curve{methods[m].name, methods[m].name, x, {}};
      for (std::size_t i = 0; i < x.size(); ++i) {
        curve.y.push_back(of(which, i)[m]);
        result.numbers.push_back(
            {words("%s.%s.%g", methods[m].name, names[which], x[i]), curve.y.back(), units[which]});
      }
      plots[which].curves.push_back(std::move(curve));
    }
    const auto &first = of(which, 0), &last = of(which, x.size() - 1);
    plots[which].caption =
        words("From %g to %g: weighted %.3g to %.3g, graph %.3g to %.3g, field %.3g to %.3g.",
              x.front(), x.back(), first[0], last[0], first[2], last[2], first[4], last[4]);
    result.plots.push_back(plots[which]);
  }
  // Compares the field with the best of the others at each x; the worst of these counts.
  struct Kind {
    const char* words;
    const char* unit;
    std::vector<Verdict> verdicts;
    double min_lead = INFINITY, at = 0, field = 0, other = 0;
  };
  Kind kinds[3] = {{"volume", " % rms", {}},
                   {"direction", "°", {}},
                   {"smoothness", " times the exact largest step", {}}};
  for (int which = 0; which < 3; ++which) {
    Kind& kind = kinds[which];
    for (std::size_t i = 0; i < x.size(); ++i) {
      const std::vector<double>& errors = of(which, i);
      const double other = *std::min_element(errors.begin(), errors.begin() + 4);
      kind.verdicts.push_back(is_better(errors[4], other));
      if (other / errors[4] >= kind.min_lead) continue;
      kind.min_lead = other / errors[4];
      kind.at = x[i], kind.field = errors[4], kind.other = other;
    }
    result.claims.push_back(
        {words("In %s the field is nearer to the exact wrench than any method of the thesis.",
               kind.words),
         words("Where it is closest, at %s = %g: %.3g%s against %.3g.", x_label.c_str(), kind.at,
               kind.field, kind.unit, kind.other),
         is_better_in_all(kind.verdicts), Source::ours});
  }
  return result;
}

Result<FigureResult> noise(Context& context) {
  const auto x = context.choose<std::vector<double>>({0, 0.5, 1, 1.5, 2, 3, 5, 8}, {0, 3});
  return study(context, "noise at 1 m, mm", x,
               [](Look& look, double mm) { look.sigma = 1e-3 * mm; });
}
Result<FigureResult> missing(Context& context) {
  const auto x = context.choose<std::vector<double>>({0, 10, 20, 40, 60, 80}, {0, 50});
  return study(context, "missing pixels, %", x,
               [](Look& look, double share) { look.missing = share / 100; });
}
Result<FigureResult> distance(Context& context) {
  const auto x = context.choose<std::vector<double>>({0.5, 0.75, 1, 1.5, 2, 3}, {0.5, 2});
  return study(context, "distance, m", x, [](Look& look, double m) { look.distance = m; });
}
Result<FigureResult> resolution(Context& context) {
  const auto x = context.choose<std::vector<double>>({160, 320, 640, 1280, 1920}, {160, 640});
  return study(
      context, "columns of the camera", x,
      [](Look& look, double columns) { look.resolution = columns / 640; }, true);
}
Result<FigureResult> packing(Context& context) {
  const auto x =
      context.choose<std::vector<double>>({100, 300, 1000, 3000, 10000, 17000}, {100, 1000});
  return study(
      context, "spheres", x,
      [](Look& look, double spheres) { look.spheres = static_cast<int>(spheres); }, true);
}

}  // namespace

std::vector<FigureSpec> robustness_figures() {
  return {
      {"noise", "Errors over the noise of the camera", "Robustness", noise},
      {"missing", "Errors over missing pixels", "Robustness", missing},
      {"distance", "Errors over the distance", "Robustness", distance},
      {"resolution", "Errors over the camera's resolution", "Robustness", resolution},
      {"packing", "Errors over the number of spheres", "Robustness", packing},
  };
}

}  // namespace palpate::eval
