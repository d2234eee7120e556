// planes, holes: recorded frames at their largest flat region, where the truth is a plane, and the
// same frames with a hole cut into it, where the truth is the original frame.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

#include "eval/studies/flat_region.h"
#include "eval/studies/parallel.h"
#include "eval/studies/range.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "src/math/internal/random.h"

namespace palpate::eval {
namespace {

constexpr std::size_t kNumOthers = 4;  // all_methods() before the field

struct FlatFrame : FirstFrame {
  FlatRegion region;
};

/// Returns recorded frames with a flat region; of sequences the first one.
Result<std::vector<FlatFrame>> flat_frames(Context& context) {
  std::vector<FlatFrame> frames;
  auto recorded = context.first_frames(true);
  if (!recorded) return recorded.error();
  for (FirstFrame& of_recording : *recorded) {
    auto region = largest_flat_region(of_recording.stream, of_recording.frame);
    if (region) frames.push_back({std::move(of_recording), *std::move(region)});
    context.progress(0.1);
  }
  return frames;
}

FigureResult without_data(std::initializer_list<const char*> claims, Source source) {
  FigureResult result;
  for (const char* claim : claims) {
    result.claims.push_back({claim,
                             "The recorded frames are not here: give their folder with "
                             "--data.",
                             Verdict::not_measured, source});
  }
  return result;
}

/// Errors of measured points: distance from the plane, mm rms, and deviation from the mean of both
/// neighbors in the row, scaled to that of white noise.
struct PointErrors {
  double rms = 0, flicker = 0, distance = 0;  ///< mm, mm, m
};
PointErrors point_errors(const FlatFrame& f) {
  const Intrinsics& k = f.stream.intrinsics;
  const auto width = static_cast<std::size_t>(f.frame.width);
  PointErrors errors;
  double bends = 0;
  for (const std::size_t pixel : f.region.pixels) {
    const double z = f.frame.pixels[pixel] * f.frame.unit;
    const Vec3d p{(static_cast<double>(pixel % width) - k.cx) / k.fx * z,
                  (static_cast<double>(pixel / width) - k.cy) / k.fy * z, z};
    const double off = dot(f.region.plane_C.normal, p) - f.region.plane_C.offset;
    errors.rms += off * off;
    errors.distance += z;
    if (pixel == 0 || pixel + 1 == f.frame.pixels.size()) continue;
    const double bend =
        f.frame.pixels[pixel - 1] - 2.0 * f.frame.pixels[pixel] + f.frame.pixels[pixel + 1];
    if (std::abs(bend * f.frame.unit) < 0.03 * z) bends += bend * bend / 6;
  }
  const auto num = static_cast<double>(f.region.pixels.size());
  errors.rms = 1e3 * std::sqrt(errors.rms / num);
  errors.flicker = 1e3 * f.frame.unit * std::sqrt(bends / num);
  errors.distance /= num;
  return errors;
}

/// Errors of one method in one frame.
struct MethodErrors {
  double off = 0, shake = 0, direction = 0;  ///< sums of squares: mm, mm, degrees
  double num = 0, num_pairs = 0, num_lost = 0;
  double rms() const { return std::sqrt(off / std::max(1.0, num)); }
  double direction_rms() const { return std::sqrt(direction / std::max(1.0, num - num_lost)); }
  double shake_rms() const { return std::sqrt(shake / std::max(1.0, num_pairs)); }
};

const Quaternion kTurned = axis_angle({1, 2, 0.5}, 0.35);  // of all tools
constexpr double kReach = 0.025;  // m from the plane: contact farther away counts as lost

/// Height at which a method first measures contact with a tilted cube that moves along the normal
/// until half of it is behind the surface; nullopt: never.
struct Height {
  double above = 0;  ///< the plane, m
  Vec3d force;
};
std::optional<Height> contact_height(MethodQueries& query, const Tool& tool,
                                     const Plane<double>& plane, const Vec3d& place,
                                     const ContactOptions& options) {
  constexpr double kStep = 0.001;
  constexpr int kHalvings = 8;
  const double half = full_volume(tool, options) / 2;
  Penetration at;
  const auto is_in_contact = [&](double above) {
    at = query.query({place + above * plane.normal, kTurned}, options);
    return at.volume >= half;
  };
  double above = kReach;
  while (!is_in_contact(above)) {
    above -= kStep;
    if (above < -kReach) return std::nullopt;
  }
  double low = above, high = above + kStep;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = (low + high) / 2;
    (is_in_contact(middle) ? low : high) = middle;
  }
  is_in_contact(low);
  return Height{(low + high) / 2, at.measure_W.force};
}

constexpr const char* kNearer =
    "On flat regions of recorded frames the contact surface of the field is nearer to their plane "
    "than that of any method of the thesis.";
constexpr const char* kCalmer =
    "It shakes less when the probe is moved by a millimeter than that of any method of the thesis.";
constexpr const char* kStraighter =
    "Its force is nearer to the normal of the plane than that of any method of the thesis.";
constexpr const char* kThanPoints = "It is nearer to the plane than the measured points are.";

Result<FigureResult> planes(Context& context) {
  constexpr double kProbe = 0.02, kBeside = 0.001;  // m
  const auto frames = flat_frames(context);
  if (!frames) return frames.error();
  if (frames->empty()) {
    FigureResult result = without_data({kNearer, kCalmer, kStraighter}, Source::ours);
    result.claims.push_back(without_data({kThanPoints}, Source::docs).claims.front());
    return result;
  }
  const auto tool = context.tool("box", kProbe, 500);
  if (!tool) return tool.error();
  const auto methods = all_methods_alike();
  const std::size_t most = context.choose<std::size_t>(150, 20);
  std::vector<std::vector<MethodErrors>> errors(frames->size(),
                                                std::vector<MethodErrors>(methods.size()));
  run_tasks(
      context, static_cast<int>(frames->size()), static_cast<double>(frames->size()),
      [&](int task, Work& work) {
        const auto i = static_cast<std::size_t>(task);
        const FlatFrame& f = (*frames)[i];
        const auto seen = FrozenFrame::create(f.stream, f.frame);
        auto query = query_on(seen.value(), **tool);
        const auto places = f.region.places(f.stream, std::min(3, f.region.max_within()));
        const Vec3d beside = kBeside * normalized(cross(f.region.plane_C.normal, {0, 1, 0.2}));
        for (std::size_t m = 0; m < methods.size(); ++m) {
          MethodErrors& sum = errors[i][m];
          for (std::size_t p = 0; p < std::min(most, places.size()); ++p) {
            const Vec3d& place = places[p * places.size() / std::min(most, places.size())];
            const auto at = [&](const Vec3d& where) {
              return contact_height(*query, **tool, f.region.plane_C, where, methods[m].options);
            };
            const auto here = at(place), there = at(place + beside);
            ++sum.num;
            if (!here) {
              sum.off += 1e6 * kReach * kReach, ++sum.num_lost;
              continue;
            }
            sum.off += 1e6 * here->above * here->above;
            const double angle = std::atan2(norm(cross(here->force, f.region.plane_C.normal)),
                                            dot(here->force, f.region.plane_C.normal));
            sum.direction += angle * angle * (180 / kPi) * (180 / kPi);
            if (!there) continue;
            const double step = 1e3 * (there->above - here->above);
            sum.shake += step * step, ++sum.num_pairs;
          }
        }
        work.step();
      });

  FigureResult result;
  Table sensor{
      "The sensor: measured points of the largest flat region",
      {"frame", "pixels", "distance, m", "from the plane, mm rms", "between neighbors, mm rms"},
      {}};
  Table by_frame{
      "Distance of the contact from the plane / change when moved by 1 mm, mm rms", {"frame"}, {}};
  for (const Method& method : methods) by_frame.columns.emplace_back(method.name);
  // Each frame counts once, at 0.4 m as at 3 m: lengths are relative to the rms of its own points.
  std::vector<std::vector<double>> off(methods.size()), shake(methods.size()),
      direction(methods.size()), lost(methods.size());
  for (std::size_t i = 0; i < frames->size(); ++i) {
    const FlatFrame& f = (*frames)[i];
    const PointErrors points = point_errors(f);
    sensor.rows.push_back({f.name, words("%zu", f.region.pixels.size()),
                           words("%.2f", points.distance), words("%.2f", points.rms),
                           words("%.2f", points.flicker)});
    result.numbers.push_back({f.name + ".points.rms", points.rms, "mm"});
    std::vector<std::string> cells{f.name};
    for (std::size_t m = 0; m < methods.size(); ++m) {
      const MethodErrors& one = errors[i][m];
      cells.push_back(words("%.2f / %.2f", one.rms(), one.shake_rms()));
      off[m].push_back(one.rms() / points.rms), shake[m].push_back(one.shake_rms() / points.rms);
      direction[m].push_back(one.direction_rms());
      lost[m].push_back(100 * one.num_lost / one.num);
      result.numbers.push_back({f.name + "." + methods[m].name + ".off", one.rms(), "mm"});
      result.numbers.push_back({f.name + "." + methods[m].name + ".shake", one.shake_rms(), "mm"});
      result.numbers.push_back(
          {f.name + "." + methods[m].name + ".direction", one.direction_rms(), "deg"});
    }
    by_frame.rows.push_back(std::move(cells));
  }
  Table overall{"Error on flat regions: median of the frames / worst frame",
                {"method", "from the plane, points = 1", "moved by 1 mm, rms of the points = 1",
                 "direction, ° rms", "contact lost, % of the places"},
                {}};
  std::vector<double> ratio(methods.size()), calm(methods.size()), askew(methods.size());
  const auto in_table = [](const char* format, const std::vector<double>& of_frames) {
    char text[2][32];
    std::snprintf(text[0], sizeof text[0], format, percentile(of_frames, 0.5));
    std::snprintf(text[1], sizeof text[1], format, largest_of(of_frames));
    return std::string(text[0]) + " / " + text[1];
  };
  for (std::size_t m = 0; m < methods.size(); ++m) {
    ratio[m] = percentile(off[m], 0.5), calm[m] = percentile(shake[m], 0.5);
    askew[m] = percentile(direction[m], 0.5);
    overall.rows.push_back({methods[m].name, in_table("%.2f", off[m]), in_table("%.3f", shake[m]),
                            in_table("%.2f", direction[m]), in_table("%.1f", lost[m])});
    result.numbers.push_back({std::string(methods[m].name) + ".off_ratio", ratio[m], "1"});
    result.numbers.push_back({std::string(methods[m].name) + ".shake_ratio", calm[m], "1"});
    result.numbers.push_back({std::string(methods[m].name) + ".direction", askew[m], "deg"});
  }
  Plot plot{"Distance of the contact from the plane",
            "frame",
            "mm rms",
            {},
            false,
            true,
            "Each frame's largest flat region; the points themselves are dashed."};
  for (std::size_t m = 0; m < methods.size(); ++m) {
    Curve curve{methods[m].name, methods[m].name, {}, {}};
    for (std::size_t i = 0; i < frames->size(); ++i) {
      curve.x.push_back(static_cast<double>(i)), curve.y.push_back(errors[i][m].rms());
    }
    plot.curves.push_back(std::move(curve));
  }
  Curve points{"points", "exact", {}, {}};
  for (std::size_t i = 0; i < frames->size(); ++i) {
    points.x.push_back(static_cast<double>(i));
    points.y.push_back(point_errors((*frames)[i]).rms);
  }
  plot.curves.push_back(std::move(points));
  result.plots.push_back(std::move(plot));
  for (Table* table : {&sensor, &overall, &by_frame}) result.tables.push_back(std::move(*table));
  const auto best = [](const std::vector<double>& values) {
    return *std::min_element(values.begin(), values.begin() + kNumOthers);
  };
  result.claims.push_back(
      {kNearer,
       words("In the median frame %.2f times as far as its points (rms), of the "
             "others at best %.2f; %zu frames.",
             ratio[kNumOthers], best(ratio), frames->size()),
       is_better(ratio[kNumOthers], best(ratio)), Source::ours});
  result.claims.push_back({kCalmer,
                           words("In the median frame by %.3f of its points' rms, of the others at "
                                 "best by %.3f.",
                                 calm[kNumOthers], best(calm)),
                           is_better(calm[kNumOthers], best(calm)), Source::ours});
  result.claims.push_back({kStraighter,
                           words("In the median frame %.2f° rms against %.2f, where the probe is "
                                 "half inside.",
                                 askew[kNumOthers], best(askew)),
                           is_better(askew[kNumOthers], best(askew)), Source::ours});
  const auto nearer =
      std::count_if(off[kNumOthers].begin(), off[kNumOthers].end(), [](double r) { return r < 1; });
  result.claims.push_back({kThanPoints, words("In %td of %zu frames.", nearer, frames->size()),
                           holds_in_all(nearer, static_cast<std::ptrdiff_t>(frames->size())),
                           Source::docs});
  result.notes.push_back(
      "The plane is fitted to the frame itself: what all pixels have wrong in common is no error "
      "here, what the sensor bends is one of points and methods alike. The probe is a cube of 2 "
      "cm, "
      "askew; it comes along the normal, and the surface is felt where half of it is inside; where "
      "that never happens down to 25 mm behind the plane, the error is 25 mm.");
  return result;
}

// Holes.

enum class Patch { dark, shiny };
constexpr const char* kPatches[] = {"dark", "shiny"};
constexpr double kSizes[] = {0.02, 0.04, 0.08};  // m, diameters

/// Cuts a hole. Dark: no measurement. Shiny: none in the inner half (of the radius), and around it
/// depth that is wrong by up to 3 %, pixel by pixel.
DepthFrame with_hole(const FlatFrame& f, const Vec3d& middle, double diameter, Patch patch) {
  DepthFrame frame = f.frame;
  const Intrinsics& k = f.stream.intrinsics;
  Random random(5);
  for (int v = 0; v < frame.height; ++v) {
    for (int u = 0; u < frame.width; ++u) {
      const Vec3d ray{(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1};
      const Vec3d p = f.region.plane_C.offset / dot(f.region.plane_C.normal, ray) * ray;
      const double share = 2 * norm(p - middle) / diameter;
      if (!(share < 1) || p.z < 0) continue;
      std::uint16_t& pixel =
          frame.pixels[static_cast<std::size_t>(v) * static_cast<std::size_t>(frame.width) +
                       static_cast<std::size_t>(u)];
      if (patch == Patch::dark || share < 0.5) {
        pixel = 0;
      } else {
        pixel = static_cast<std::uint16_t>(
            std::clamp(pixel * (1 + random.uniform(-0.03, 0.03)), 0.0, 65534.0));
      }
    }
  }
  return frame;
}

constexpr const char* kDark =
    "A dark patch cut into recorded frames changes the contact of the field less than that of any "
    "method of the thesis.";
constexpr const char* kShiny =
    "A shiny patch cut into recorded frames changes the contact of the field less than that of any "
    "method of the thesis.";

Result<FigureResult> holes(Context& context) {
  constexpr double kTool = 0.04, kDeep = 0.012, kWay = 0.06, kSpace = 0.06;  // m
  const auto all_frames = flat_frames(context);
  if (!all_frames) return all_frames.error();
  if (all_frames->empty()) return without_data({kDark, kShiny}, Source::ours);
  const auto tool = context.tool("box", kTool, 1000);
  if (!tool) return tool.error();
  // Frames with room for patch and way.
  struct Job {
    const FlatFrame* f;
    Vec3d middle;
  };
  std::vector<Job> jobs;
  for (const FlatFrame& f : *all_frames) {
    const auto places = f.region.places(f.stream, f.region.max_within());
    const double pixel = places.front().z / f.stream.intrinsics.fx;
    if (f.region.max_within() * FlatRegion::kCell * pixel < kSpace) continue;
    jobs.push_back({&f, places[places.size() / 2]});
  }
  if (jobs.empty()) return without_data({kDark, kShiny}, Source::ours);
  const auto methods = all_methods_alike();
  const int num_poses = context.choose(61, 21);
  struct Change {
    double squares = 0, worst = 0, num = 0, num_lost = 0;
  };
  using BySize = std::array<std::array<Change, std::size(kSizes)>, 2>;  // [patch][size]
  std::vector<std::vector<BySize>> changes(jobs.size(), std::vector<BySize>(methods.size()));
  run_tasks(context, static_cast<int>(jobs.size()), static_cast<double>(jobs.size()),
            [&](int task, Work& work) {
              const auto j = static_cast<std::size_t>(task);
              const FlatFrame& f = *jobs[j].f;
              const Vec3d n = f.region.plane_C.normal, along = normalized(cross(n, {0, 1, 0.2}));
              double reach = 0;
              for (const Vec3d& p : (*tool)->mesh().vertices) {
                reach = std::max(reach, -dot(rotate(kTurned, p), n));
              }
              std::vector<Pose> path;
              for (int i = 0; i < num_poses; ++i) {
                const double at = kWay * (2.0 * i / (num_poses - 1) - 1);
                path.push_back({jobs[j].middle + at * along + (reach - kDeep) * n, kTurned});
              }
              const auto feel = [&](const DepthFrame& frame) {
                const auto seen = FrozenFrame::create(f.stream, frame);
                auto query = query_on(seen.value(), **tool);
                std::vector<std::vector<Vec3d>> forces(methods.size());
                for (std::size_t m = 0; m < methods.size(); ++m) {
                  const double whole = full_volume(**tool, methods[m].options);
                  for (const Pose& X_WT : path) {
                    forces[m].push_back(1 / whole *
                                        query->query(X_WT, methods[m].options).measure_W.force);
                  }
                }
                return forces;
              };
              const auto unharmed = feel(f.frame);
              for (std::size_t p = 0; p < 2; ++p) {
                for (std::size_t s = 0; s < std::size(kSizes); ++s) {
                  const auto harmed =
                      feel(with_hole(f, jobs[j].middle, kSizes[s], static_cast<Patch>(p)));
                  for (std::size_t m = 0; m < methods.size(); ++m) {
                    Change& change = changes[j][m][p][s];
                    for (std::size_t i = 0; i < path.size(); ++i) {
                      const double d = norm(harmed[m][i] - unharmed[m][i]);
                      change.squares += d * d, change.worst = std::max(change.worst, d);
                      ++change.num;
                      change.num_lost += harmed[m][i] == Vec3d{} && !(unharmed[m][i] == Vec3d{});
                    }
                  }
                }
              }
              work.step();
            });

  FigureResult result;
  for (std::size_t p = 0; p < 2; ++p) {
    Table table{words("Change of the force by a %s patch, %% of the tool: rms / worst / contact "
                      "lost, %% of the poses",
                      kPatches[p]),
                {"method"},
                {}};
    for (const double size : kSizes) table.columns.push_back(words("%.0f mm", 1e3 * size));
    Plot plot{words("A %s patch", kPatches[p]),
              "diameter, mm",
              "change of the force, % of the tool, rms",
              {},
              false,
              true,
              words("Against the same %zu frames unharmed.", jobs.size())};
    std::vector<std::vector<double>> rms(methods.size());
    for (std::size_t m = 0; m < methods.size(); ++m) {
      std::vector<std::string> cells{methods[m].name};
      Curve curve{methods[m].name, methods[m].name, {}, {}};
      for (std::size_t s = 0; s < std::size(kSizes); ++s) {
        Change sum;
        for (const auto& of_frame : changes) {
          const Change& c = of_frame[m][p][s];
          sum.squares += c.squares, sum.num += c.num, sum.num_lost += c.num_lost;
          sum.worst = std::max(sum.worst, c.worst);
        }
        rms[m].push_back(100 * std::sqrt(sum.squares / sum.num));
        cells.push_back(words("%.2f / %.1f / %.1f", rms[m].back(), 100 * sum.worst,
                              100 * sum.num_lost / sum.num));
        curve.x.push_back(1e3 * kSizes[s]), curve.y.push_back(rms[m].back());
        result.numbers.push_back(
            {words("%s.%s.%.0f.rms", kPatches[p], methods[m].name, 1e3 * kSizes[s]), rms[m].back(),
             "%"});
      }
      table.rows.push_back(std::move(cells));
      plot.curves.push_back(std::move(curve));
    }
    std::vector<Verdict> verdicts;
    std::string measured;
    for (std::size_t s = 0; s < std::size(kSizes); ++s) {
      double best = INFINITY;
      for (std::size_t m = 0; m < kNumOthers; ++m) best = std::min(best, rms[m][s]);
      verdicts.push_back(is_better(rms[kNumOthers][s], best));
      measured += words("%s%.0f mm: %.2f %% of the tool rms against %.2f", s ? "; " : "",
                        1e3 * kSizes[s], rms[kNumOthers][s], best);
    }
    result.claims.push_back(
        {p == 0 ? kDark : kShiny, measured + ".", is_better_in_all(verdicts), Source::ours});
    result.tables.push_back(std::move(table));
    result.plots.push_back(std::move(plot));
  }
  result.notes.push_back(words(
      "A box of 40 mm slides 12 cm across the patch, 12 mm deep, on the largest flat region of %zu "
      "recorded frames that have room for it. Dark: nothing is measured. Shiny: nothing in the "
      "inner "
      "half, around it each pixel wrong by up to 3 %%. The first number is rms over poses and "
      "frames.",
      jobs.size()));
  return result;
}

}  // namespace

std::vector<FigureSpec> flat_figures() {
  return {{"planes", "Flat regions of recorded frames", "Real data", planes},
          {"holes", "Dark and shiny patches cut into recorded frames", "Real data", holes}};
}

}  // namespace palpate::eval
