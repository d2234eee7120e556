// silhouettes: lengths and directions of forces behind the near surface of a step, and behind a
// plane with noise. The field is minus the distance to free space there, so |F| <= V.
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "eval/studies/parallel.h"
#include "eval/studies/range.h"
#include "eval/studies/silhouettes.h"
#include "eval/studies/verdict_rules.h"
#include "src/field/internal/field_point.h"
#include "src/math/internal/random.h"

namespace palpate::eval {
namespace {

// The step: near surface left of the optical axis, far one right of it.
constexpr double kNear = 1, kFar = 2;  // m
constexpr Intrinsics kCamera{525, 525, 319.5, 239.5};
constexpr int kWidth = 640, kHeight = 480;
constexpr double kSigma = 0.0015;  // m at 1 m, grows with the square of the distance

constexpr std::array kBehind{0.01, 0.05, 0.1, 0.4, 0.8};

const char* camera_name(bool with_noise) { return with_noise ? "noise" : "noise-free"; }
/// Renders a surface at depth `left` left of the optical axis and one at `right` right of it, m.
Result<FrozenFrame> seen_step(double left, double right, bool with_noise) {
  DepthStreamInfo stream;
  stream.width = kWidth, stream.height = kHeight, stream.intrinsics = kCamera;
  stream.unit = 5e-5;
  DepthFrame frame{kWidth, kHeight, stream.unit, {}, 0};
  Random random(17);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      double z = u < kCamera.cx ? left : right;
      if (with_noise) z += kSigma * z * z * random.normal();
      frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(z / stream.unit)));
    }
  }
  return FrozenFrame::create(stream, frame);
}

/// |F| / V along x, past the edge, at some depth behind the near surface; NaN: no contact.
struct Sweep {
  double behind = 0;
  std::vector<double> x, ratio;

  double worst() const {
    double worst = 0;
    for (const double r : ratio) worst = std::max(worst, std::isfinite(r) ? r : 0);
    return worst;
  }
};
std::vector<Sweep> sweeps_of(ContactProbe& probe) {
  constexpr int kPoses = 121;
  std::vector<Sweep> sweeps;
  for (const double behind : kBehind) {
    Sweep sweep{behind, {}, {}};
    const double z = kNear + behind;
    for (int i = 0; i < kPoses; ++i) {
      const double x = z * kSilhouetteToolSize * (2.0 * i / (kPoses - 1) - 1);
      const auto contact = probe({{x, 0, z}, {}});
      sweep.x.push_back(x);
      sweep.ratio.push_back(contact ? contact->ratio() : NAN);
    }
    sweeps.push_back(std::move(sweep));
  }
  return sweeps;
}

/// Forces at random poses in the shadow, by distance to free space.
struct Directions {
  static constexpr std::array kUpTo{0.1, 0.2, 0.35};  // m
  static constexpr double kNearAngle = 15 * kPi / 180;
  std::array<int, kUpTo.size()> num{}, right{};
  Ratios ratios;

  double share(std::size_t i) const { return num[i] ? static_cast<double>(right[i]) / num[i] : 0; }
  int total() const { return num[0] + num[1] + num[2]; }
  double share() const {
    return total() ? static_cast<double>(right[0] + right[1] + right[2]) / total() : 0;
  }
};
Directions directions_of(Context& context, ContactProbe& probe) {
  Directions directions;
  Random random(23);
  const int num_poses = context.choose(4000, 500);
  for (int i = 0; i < num_poses; ++i) {
    const Vec3d p{random.uniform(-Directions::kUpTo.back(), 0), random.uniform(-0.1, 0.1),
                  random.uniform(kNear, kFar - 0.1)};
    const Quaternion turned = random.rotation(kPi);
    const double front = p.z - kNear, side = -p.x;
    const double least = std::min(front, side), most = std::max(front, side);
    if (most - least < std::max(0.07, 0.3 * most)) continue;
    const auto contact = probe({p, turned});
    if (!contact) continue;
    const Vec3d way = front < side ? Vec3d{0, 0, -1} : Vec3d{1, 0, 0};
    const double cosine = dot(contact->force, way) / norm(contact->force);
    const auto upper = std::ranges::lower_bound(Directions::kUpTo, least);
    const auto at = static_cast<std::size_t>(upper - Directions::kUpTo.begin());
    ++directions.num[at];
    directions.ratios.values.push_back(contact->ratio());
    directions.right[at] += cosine > std::cos(Directions::kNearAngle);
  }
  return directions;
}

/// Returns the line phi = `level` over (x, z) as short pieces with gaps between them.
Curve level_line(const std::vector<double>& x, const std::vector<double>& z,
                 const std::vector<double>& phi, double level, const std::string& style) {
  Curve curve{words("%.0f cm deep", -100 * level), style, {}, {}};
  const auto value = [&](std::size_t i, std::size_t k) { return phi[k * x.size() + i] - level; };
  for (std::size_t k = 0; k + 1 < z.size(); ++k) {
    for (std::size_t i = 0; i + 1 < x.size(); ++i) {
      // Two triangles per cell: at most one piece cuts each.
      for (const std::size_t upper : {std::size_t{0}, std::size_t{1}}) {
        const std::pair<std::size_t, std::size_t> corners[3] = {
            {i, k}, {i + 1, k + 1}, {i + 1 - upper, k + upper}};
        int num = 0;
        for (int c = 0; c < 3; ++c) {
          const auto [ai, ak] = corners[c];
          const auto [bi, bk] = corners[(c + 1) % 3];
          const double a = value(ai, ak), b = value(bi, bk);
          if ((a < 0) == (b < 0)) continue;
          const double t = a / (a - b);
          curve.x.push_back(100 * (x[ai] + t * (x[bi] - x[ai])));
          curve.y.push_back(100 * (z[ak] + t * (z[bk] - z[ak]) - kNear));
          ++num;
        }
        if (num == 0) continue;
        curve.x.push_back(NAN);
        curve.y.push_back(NAN);
      }
    }
  }
  return curve;
}

/// Adds the gradient path from a point behind the surface to free space.
void add_way_out(Curve& curve, const DepthFieldView& field, Vec3d p, double radius) {
  constexpr double kStep = 0.004;  // m
  for (int i = 0; i < 400; ++i) {
    curve.x.push_back(100 * p.x);
    curve.y.push_back(100 * (p.z - kNear));
    const FieldSample<double> at = sample_field(field, p, radius);
    if (at.phi > 0 || norm(at.gradient) == 0) break;
    p += kStep * normalized(at.gradient);
  }
  curve.x.push_back(NAN);
  curve.y.push_back(NAN);
}

/// The field of the step over (x, z), in the image row of the optical axis.
struct FieldMap {
  Plot plot;
  double longest = 0, share_long = 0;  ///< gradients behind the surface; share above kBound
};
FieldMap map_of(const DepthFieldView& field) {
  constexpr double kRadius = 0.005, kLeft = -0.4, kRight = 0.3, kFront = 0.9, kBack = 2.3;  // m
  constexpr std::size_t kColumns = 161, kRows = 141;
  const auto grid = [](double from, double to, std::size_t num) {
    std::vector<double> values;
    for (std::size_t i = 0; i < num; ++i) {
      values.push_back(from + (to - from) * static_cast<double>(i) / static_cast<double>(num - 1));
    }
    return values;
  };
  const auto x = grid(kLeft, kRight, kColumns), z = grid(kFront, kBack, kRows);
  std::vector<double> phi;
  Ratios lengths;  // of gradients behind the surface
  for (const double each_z : z) {
    for (const double each_x : x) {
      const auto at = sample_field(field, Vec3d{each_x, 0, each_z}, kRadius);
      phi.push_back(at.phi);
      if (at.phi < 0) lengths.values.push_back(norm(at.gradient));
    }
  }
  Plot plot{"The field of a clean step, 1 m | 2 m, over one row of the image",
            "x, cm",
            "behind the near surface, cm",
            {},
            false,
            false,
            words("Before it is shortened the gradient behind the surface is at most %.2f long, at "
                  "%.0f %% of the points longer than %.1f.",
                  lengths.worst(), 100 * lengths.share_above(kBound), kBound)};
  plot.curves.push_back({"surface",
                         "exact",
                         {100 * kLeft, 0, 0, 100 * kRight},
                         {0, 0, 100 * (kFar - kNear), 100 * (kFar - kNear)}});
  constexpr const char* kStyles[] = {"other1", "other2", "other3"};
  constexpr double kLevels[] = {-0.05, -0.1, -0.2};
  for (std::size_t i = 0; i < std::size(kLevels); ++i) {
    plot.curves.push_back(level_line(x, z, phi, kLevels[i], kStyles[i]));
  }
  Curve ways{"ways out", "field", {}, {}};
  for (double start_x = -0.35; start_x < 0.25; start_x += 0.1) {
    for (double start_z = kNear + 0.1; start_z < kBack; start_z += 0.2) {
      if (start_x > 0 && start_z < kFar) continue;
      add_way_out(ways, field, {start_x, 0, start_z}, kRadius);
    }
  }
  plot.curves.push_back(std::move(ways));
  return {std::move(plot), lengths.worst(), lengths.share_above(kBound)};
}

Plot plot_of(const std::vector<Sweep>& sweeps) {
  Plot plot{"A cube passes the edge of a clean step, behind its near surface",
            "x, cm",
            "|F| / V",
            {},
            false,
            false,
            ""};
  constexpr const char* kStyles[] = {"other1", "other2", "other3", "other4", "field"};
  double worst = 0;
  for (std::size_t i = 0; i < sweeps.size(); ++i) {
    Curve curve{words("%.0f cm behind", 100 * sweeps[i].behind), kStyles[i], {}, sweeps[i].ratio};
    for (const double x : sweeps[i].x) curve.x.push_back(100 * x);
    plot.curves.push_back(std::move(curve));
    worst = std::max(worst, sweeps[i].worst());
  }
  plot.caption = words(
      "Next to the edge the force is at most %.2f times the volume, however far behind.", worst);
  return plot;
}

/// Results on the clean step and on the noisy one.
struct Steps {
  std::vector<Sweep> sweeps[2];
  Directions directions[2];
  double longest_gradient = 0, share_long = 0;  ///< of FieldMap

  double worst(bool with_noise) const {
    double worst = 0;
    for (const Sweep& sweep : sweeps[with_noise]) worst = std::max(worst, sweep.worst());
    return worst;
  }
};

Verdict verdict_of_length(double clean, double noisy) {
  return holds_with({holds_up_to(clean, kCalm, kBound + kRounding),
                     holds_up_to(noisy, kLong, kBound + kRounding)});
}
Verdict verdict_of_gradient(double longest, double share_long) {
  constexpr double kFew = 0.01;
  return holds_with({holds_up_to(longest, kBound + kRounding), holds_up_to(share_long, kFew)});
}
Verdict verdict_of_direction(double min_share) {
  constexpr double kFew = 0.05, kHalf = 0.5;
  return holds_up_to(1 - min_share, kFew, kHalf);
}

void add_steps(FigureResult& result, const Steps& steps) {
  Table lengths{"Largest |F| / V behind the near surface of a step", {"camera"}, {}};
  Table ways{"Forces within 15° of the nearest way to free space, %", {"camera"}, {}};
  for (const double behind : kBehind) lengths.columns.push_back(words("%.0f cm", 100 * behind));
  for (const double up_to : Directions::kUpTo) {
    ways.columns.push_back(words("up to %.0f cm away", 100 * up_to));
  }
  ways.columns.insert(ways.columns.end(),
                      {"all", "poses", "|F| above 1.1 V, %", "largest |F| / V"});
  for (const bool with_noise : {false, true}) {
    const char* camera = camera_name(with_noise);
    std::vector<std::string> row{camera};
    for (const Sweep& sweep : steps.sweeps[with_noise]) {
      row.push_back(words("%.3f", sweep.worst()));
      result.numbers.push_back(
          {words("step.%s.%.0fcm.worst", camera, 100 * sweep.behind), sweep.worst(), "1"});
    }
    lengths.rows.push_back(std::move(row));
    const Directions& directions = steps.directions[with_noise];
    row = {camera};
    for (std::size_t i = 0; i < Directions::kUpTo.size(); ++i) {
      row.push_back(words("%.1f", 100 * directions.share(i)));
      result.numbers.push_back(
          {words("step.%s.right_way.%.0fcm", camera, 100 * Directions::kUpTo[i]),
           100 * directions.share(i), "%"});
    }
    row.push_back(words("%.1f", 100 * directions.share()));
    row.push_back(words("%d", directions.total()));
    row.push_back(words("%.1f", 100 * directions.ratios.share_above(kLong)));
    row.push_back(words("%.3f", directions.ratios.worst()));
    result.numbers.push_back({words("step.%s.shadow.above_1.1", camera),
                              100 * directions.ratios.share_above(kLong), "%"});
    result.numbers.push_back(
        {words("step.%s.shadow.worst", camera), directions.ratios.worst(), "1"});
    result.numbers.push_back({words("step.%s.right_way", camera), 100 * directions.share(), "%"});
    ways.rows.push_back(std::move(row));
  }
  const double clean = steps.worst(false), noisy = steps.worst(true);
  result.claims.push_back(
      {"Behind the near surface of a step, next to its edge, the force of the "
       "field is at most 1.05 times the volume (1.1 times with noise), however far behind.",
       words("At most %.3f V without noise, %.3f V with it.", clean, noisy),
       verdict_of_length(clean, noisy)});
  const Ratios &in_shadow = steps.directions[0].ratios, &in_noise = steps.directions[1].ratios;
  result.claims.push_back(
      {"Nor is it longer than that anywhere in the shadow of the step.",
       words("Up to 35 cm from free space at most %.3f V without noise, %.3f V with it; %.1f %% of "
             "the poses above 1.1 V.",
             in_shadow.worst(), in_noise.worst(), 100 * in_shadow.share_above(kLong)),
       verdict_of_length(in_shadow.worst(), in_noise.worst())});
  result.claims.push_back(
      {"Behind a clean step the gradient of the field is 1 long, and nothing "
       "has "
       "to be shortened.",
       words("It is at most %.2f long, and longer than %.2f at %.1f %% of the points of the map.",
             steps.longest_gradient, kBound, 100 * steps.share_long),
       verdict_of_gradient(steps.longest_gradient, steps.share_long)});
  result.numbers.push_back({"step.map.longest_gradient", steps.longest_gradient, "1"});
  result.numbers.push_back({"step.map.above_bound", 100 * steps.share_long, "%"});
  const double right[2] = {steps.directions[0].share(), steps.directions[1].share()};
  result.claims.push_back(
      {"In the shadow of a step the force points along the nearest way to free "
       "space, out of the front or sideways.",
       words("%.1f %% of %d poses within 15° without noise, %.1f %% with it.", 100 * right[0],
             steps.directions[0].total(), 100 * right[1]),
       verdict_of_direction(std::min(right[0], right[1]))});
  result.tables.push_back(std::move(lengths));
  result.tables.push_back(std::move(ways));
}

/// Adds the angle between the normal and the forces deep behind a plane with noise.
Status add_plane(FigureResult& result, const Tool& tool, int num_poses) {
  constexpr std::array kDeep{0.005, 0.02, 0.05, 0.1, 0.2, 0.5};  // m, of the middle of the tool
  const auto frame = seen_step(kNear, kNear, true);
  if (!frame) return frame.error();
  auto probe = probe_on(*frame, tool);
  if (!probe) return probe.error();
  Table table{"Direction of the force behind a plane with noise, degrees rms", {"behind"}, {}};
  table.columns.push_back("off the normal");
  Random random(23);
  double worst = 0;
  for (const double behind : kDeep) {
    double squares = 0;
    for (int i = 0; i < num_poses; ++i) {
      const double a = random.normal(), b = random.normal(), c = random.normal(),
                   d = random.normal();
      const double x = random.uniform(-0.2, 0.2), y = random.uniform(-0.15, 0.15);
      const auto contact = (*probe)({{x, y, kNear + behind}, normalized(Quaternion{a, b, c, d})});
      if (!contact) continue;
      const double sine = norm(cross(contact->force, {0, 0, -1})) / norm(contact->force);
      squares += std::pow(std::asin(std::min(1.0, sine)) * 180 / kPi, 2);
    }
    const double rms = std::sqrt(squares / num_poses);
    worst = std::max(worst, rms);
    table.rows.push_back({words("%.1f cm", 100 * behind), words("%.2f", rms)});
    result.numbers.push_back({words("plane.%.1fcm", 100 * behind), rms, "deg"});
  }
  result.tables.push_back(std::move(table));
  constexpr double kTarget = 1.5;  // degrees
  result.claims.push_back(
      {"Deep behind a plane with noise the force still points along its normal.",
       words("Up to 50 cm behind it at most %.2f° rms off, with %.1f mm of noise.", worst,
             1e3 * kSigma),
       holds_up_to(worst, kTarget, 3 * kTarget), Source::docs});
  return Done{};
}

Result<FigureResult> figure_silhouettes(Context& context) {
  const auto tool = context.tool(kSilhouetteTool, kSilhouetteToolSize, kSilhouetteSpheres);
  if (!tool) return tool.error();
  FigureResult result;
  Steps steps;
  for (const bool with_noise : {false, true}) {
    const auto frame = seen_step(kNear, kFar, with_noise);
    if (!frame) return frame.error();
    auto probe = probe_on(*frame, **tool);
    if (!probe) return probe.error();
    steps.sweeps[with_noise] = sweeps_of(*probe);
    context.progress(with_noise ? 0.35 : 0.1);
    steps.directions[with_noise] = directions_of(context, *probe);
    context.progress(with_noise ? 0.5 : 0.25);
    if (with_noise) continue;
    FieldMap map = map_of(frame->field());
    steps.longest_gradient = map.longest, steps.share_long = map.share_long;
    result.plots.push_back(std::move(map.plot));
  }
  result.plots.push_back(plot_of(steps.sweeps[0]));
  add_steps(result, steps);
  result.notes.push_back(words(
      "Step: a surface at %.0f m left of the optical axis, one at %.0f m right of it; a cube of "
      "%.0f cm; noise %.1f mm at 1 m. The two ways: out of the front, or through the plane x = 0, "
      "in which the eye and the edge lie; poses are left out where they differ by less than 7 cm "
      "or by less than 30 %% of the longer one.",
      kNear, kFar, 100 * kSilhouetteToolSize, 1e3 * kSigma));
  if (Status status = add_plane(result, **tool, context.choose(200, 30)); !status) {
    return status.error();
  }
  if (Status status = add_recorded_contacts(result, context); !status) return status.error();
  return result;
}

}  // namespace

std::vector<FigureSpec> silhouette_figures() {
  return {{"silhouettes", "Forces behind silhouettes", "Time and edges", figure_silhouettes}};
}

}  // namespace palpate::eval
