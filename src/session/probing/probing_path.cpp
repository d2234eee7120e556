#include "src/session/internal/probing_path.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "src/session/probing/coarse_depth.h"
#include "src/session/probing/lead_end.h"
#include "src/session/probing/probing_depths.h"
#include "src/session/probing/probing_motion.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kClearance = 0.02;    // m, least distance of the tool from everything at both ends
constexpr double kPoseRate = 100;      // poses per second
constexpr double kSpeedMargin = 0.98;  // of kProbeSpeed: straight lines between poses bend a little
constexpr double kUnevenCost = 20;     // cost of a place per unevenness
constexpr double kAsideCost = 2;       // likewise per half width from the image center
constexpr double kLost = 0.03;         // m from the desired distance: the tool lifts
constexpr double kJumpMargin = 0.1;    // s, before and after a jump
constexpr double kFarPlace = 2.5;      // m: a hand or a table is rarely that far away
constexpr double kOffPoint = 0.1;      // m along z, between the user's point and the surface

Error bad_aim(const char* format, auto... values) {
  char text[400];
  std::snprintf(text, sizeof text, format, values...);
  return {Errc::invalid_argument, text};
}

/// Returns the pixel that the user targets; nullopt: none.
Result<std::optional<std::array<double, 2>>> aimed_pixel(const ProbeAim& aim,
                                                         const DepthStreamInfo& info) {
  if (!aim.pixel && !aim.point_W) return std::optional<std::array<double, 2>>();
  std::array<double, 2> pixel{};
  char what[120];
  if (aim.pixel) {
    pixel = *aim.pixel;
    std::snprintf(what, sizeof what, "the pixel %g, %g to probe", pixel[0], pixel[1]);
  } else {
    const Vec3d& p = *aim.point_W;
    std::snprintf(what, sizeof what, "the point %g, %g, %g to probe", p.x, p.y, p.z);
    if (!(p.z > 0)) {
      return bad_aim(
          "%s is not in front of the camera, which looks along +z: give x, y, z in "
          "meters in its axes (x right, y down, z forward)",
          what);
    }
    const Intrinsics& k = info.intrinsics;
    pixel = {k.cx + k.fx * p.x / p.z, k.cy + k.fy * p.y / p.z};
  }
  const bool inside = pixel[0] >= -0.5 && pixel[1] >= -0.5 && pixel[0] < info.width - 0.5 &&
                      pixel[1] < info.height - 0.5;
  if (!inside) {
    return bad_aim(
        "%s is outside the image, whose columns u are 0 to %d and rows v 0 to %d: "
        "choose a place that the camera sees",
        what, info.width - 1, info.height - 1);
  }
  return std::optional(pixel);
}

/// Sets the neighbor to which the tool slides: the one that is seen best.
void choose_slide(const CoarseDepth& scene, int step, ProbeTarget& target) {
  target.end_column = target.column;
  target.end_row = target.row;
  double best = INFINITY;
  for (const auto& [right, down] : {std::pair{1, 0}, {-1, 0}, {0, -1}, {0, 1}}) {
    const int column = target.column + step * right, row = target.row + step * down;
    if (column < 0 || row < 0 || column >= scene.columns() || row >= scene.rows()) continue;
    const double unevenness = scene.unevenness(column, row);
    if (unevenness >= best) continue;
    best = unevenness;
    target.end_column = column;
    target.end_row = row;
  }
}

/// Returns the place that is seen well and near: to the camera, and to the image center.
Result<ProbeTarget> find_target(const CoarseDepth& scene) {
  ProbeTarget best;
  double lowest = INFINITY;
  for (int row = 0; row < scene.rows(); ++row) {
    for (int column = 0; column < scene.columns(); ++column) {
      const double unevenness = scene.unevenness(column, row);
      if (!std::isfinite(unevenness)) continue;
      const double cost = scene.mean_depth(column, row) *
                          (1 + kAsideCost * scene.off_center(column, row)) *
                          (1 + kUnevenCost * unevenness);
      if (cost < lowest) lowest = cost, best = {column, row, column, row};
    }
  }
  if (std::isfinite(lowest)) {
    choose_slide(scene, 1, best);
    return best;
  }
  return Error{
      Errc::bad_input,
      "the frames show no usable surface near their center to touch: check the depth unit, aim "
      "with --probe, or give a tool path with --path"};
}

/// Returns the user's target, in the middle of the cells around it.
Result<ProbeTarget> aimed_target(const CoarseDepth& scene, const ProbeAim& aim) {
  ProbeTarget target{scene.columns() / 2, scene.rows() / 2, 0, 0};
  const auto [u, v] = scene.pixel(target.column, target.row);
  if (!std::isfinite(scene.unevenness(target.column, target.row))) {
    return bad_aim(
        "there is no depth at the pixel %g, %g to probe in %.0f %% of the time: choose "
        "a place that the camera measures",
        u, v, 100 * scene.missing(target.column, target.row));
  }
  if (aim.point_W) {
    const DepthProfile profile = scene.profile(target.column, target.row);
    double nearest = INFINITY;
    for (const double depth : profile.depths) {
      if (std::abs(depth - aim.point_W->z) < std::abs(nearest - aim.point_W->z)) nearest = depth;
    }
    if (std::abs(nearest - aim.point_W->z) > kOffPoint) {
      return bad_aim(
          "the point %g, %g, %g to probe is not on a surface: on this viewing ray the camera sees "
          "z = %.3g m; give a point there, or the pixel %.0f,%.0f",
          aim.point_W->x, aim.point_W->y, aim.point_W->z, nearest, u, v);
    }
  }
  choose_slide(scene, 2, target);
  return target;
}

/// Distances of the tip over time, and the outcome of the plan.
struct Plan {
  std::vector<double> times, distances;
  double lifted = 0;     ///< s, time lifted as the surface was too fast
  bool arrives = false;  ///< reaches the desired distance at some time
};

/// Returns the desired distances, but lifted where the tool cannot follow: around jumps of the
/// surface, so that it does not stand in what comes, and as long as the surface behind a jump is
/// out of reach, so that it presses through nothing on its way there.
std::vector<double> lifted_at_jumps(const std::vector<double>& desired,
                                    const std::vector<double>& free,
                                    const std::vector<double>& steps, double period) {
  std::vector<double> lifted = desired;
  const auto margin = static_cast<std::size_t>(std::ceil(kJumpMargin / period));
  const std::size_t last = desired.size() - 1;
  double reached = desired[0];  // reached at the largest speed, if nothing comes nearer again
  for (std::size_t i = 0; i <= last; ++i) {
    if (i > 0) reached = std::min(desired[i], reached + steps[i]);
    if (desired[i] - reached > kLost) lifted[i] = std::min(lifted[i], free[i] - kClearance);
    const std::size_t before = i > margin / 2 ? i - margin / 2 : 0;
    const std::size_t after = std::min(last, i + margin / 2);
    const double possible = kProbeSpeed * period * static_cast<double>(after - before);
    if (std::abs(desired[after] - desired[before]) < kLost + possible) continue;
    const std::size_t begin = i > margin ? i - margin : 0, end = std::min(last, i + margin);
    const double nearest = *std::min_element(free.begin() + static_cast<std::ptrdiff_t>(begin),
                                             free.begin() + static_cast<std::ptrdiff_t>(end) + 1);
    for (std::size_t k = begin; k <= end; ++k)
      lifted[k] = std::min(lifted[k], nearest - kClearance);
  }
  return lifted;
}

Plan plan(const ProbingMotion& motion, const ProbeDepths& depths, double end) {
  Plan plan;
  const auto num_steps = static_cast<std::size_t>(std::max(1.0, std::ceil(end * kPoseRate)));
  const double period = end / static_cast<double>(num_steps);
  std::vector<double> desired, free;
  double farthest = 0, free_before = INFINITY, free_after = INFINITY;
  for (std::size_t i = 0; i <= num_steps; ++i) {
    const double time = end * static_cast<double>(i) / static_cast<double>(num_steps);
    plan.times.push_back(time);
    desired.push_back(std::min(depths.aim.at(time), depths.most.at(time)));
    free.push_back(depths.free.at(time));
    farthest = std::max(farthest, desired.back());
    double& free_there = time < end / 2 ? free_before : free_after;
    if (motion.pressed(time) < 0.5) free_there = std::min(free_there, free.back());
  }
  std::vector<double> steps{0};
  for (std::size_t i = 1; i <= num_steps; ++i) {
    const double sideways = motion.sideways_speed(plan.times[i - 1], plan.times[i], farthest);
    steps.push_back(std::max(0.0, kSpeedMargin * kProbeSpeed - sideways) * period);
  }
  const std::vector<double> target = lifted_at_jumps(desired, free, steps, period);
  // Room to start from; beside the camera rather than behind it, if that is enough, and not more
  // than the time allows.
  const double way = 0.2 * end * kSpeedMargin * kProbeSpeed - motion.press();
  const double room =
      std::clamp(way, kClearance, std::max(kClearance, 0.5 * motion.length() + kClearance));
  std::vector<double> distances;
  for (std::size_t i = 0; i <= num_steps; ++i) {
    const double free_there = plan.times[i] < end / 2 ? free_before : free_after;
    const double outside = free_there - std::clamp(0.5 * free_there, kClearance, room);
    distances.push_back(outside + (target[i] - outside) * motion.pressed(plan.times[i]));
  }
  plan.distances = within_speed(std::move(distances), steps);
  const std::vector<double> possible = within_speed(target, steps);
  for (std::size_t i = 0; i <= num_steps; ++i) {
    if (motion.pressed(plan.times[i]) < 0.9) continue;
    if (desired[i] - plan.distances[i] < 0.005) plan.arrives = true;
    if (desired[i] - possible[i] > kLost) plan.lifted += period;
  }
  return plan;
}

/// Returns what the user should know; `far_place`: m, of a place that Palpate chose, or 0.
std::string note_on(const Plan& plan, double end, double far_place) {
  char text[400] = "";
  if (!plan.arrives) {
    std::snprintf(text, sizeof text,
                  "within %.3g s and at most %g m/s the tool does not press in as it should: give "
                  "more time with --duration, or aim at a calmer place",
                  end, kProbeSpeed);
  } else if (plan.lifted > 0) {
    std::snprintf(text, sizeof text,
                  "the surface there moves faster than %g m/s now and then: meanwhile, for %.3g s "
                  "in all, the tool is lifted and waits",
                  kProbeSpeed, plan.lifted);
  }
  std::string note = text;
  if (far_place > kFarPlace) {
    std::snprintf(
        text, sizeof text,
        "the nearest good place is %.2g m away; if it should be nearer, the depth unit may "
        "be another: --depth-unit, of a --camera ?unit= (SR300, SR305: 0.000125 or 0.0001)",
        far_place);
    note += (note.empty() ? "" : "; ") + std::string(text);
  }
  return note;
}

}  // namespace

Result<ProbingPath> probing_path(const OpenDepthSource& open, const Tool& tool,
                                 std::optional<double> duration, const ProbeAim& aim) {
  const auto lead = aim.tip_T ? end_at(tool, *aim.tip_T) : Result<LeadEnd>(thinnest_end(tool));
  if (!lead) return lead.error();
  auto stream = open();
  if (!stream) return stream.error();
  if (!duration && !(*stream)->info().num_frames) {
    return Error{Errc::invalid_argument,
                 "the depth stream has no end: give the duration of the probing path"};
  }
  const auto is_possible = [](double seconds) { return seconds > 0 && seconds * kPoseRate < 1e7; };
  if (duration && !is_possible(*duration)) {
    return Error{Errc::invalid_argument,
                 "a probing path must be longer than 0 s and shorter than a day"};
  }
  const auto pixel = aimed_pixel(aim, (*stream)->info());
  if (!pixel) return pixel.error();
  const auto scene =
      CoarseDepth::scan(**stream, duration.value_or(std::numeric_limits<double>::infinity()),
                        *pixel, duration.value_or(kShortestProbe));
  if (!scene) return scene.error();
  const double end = duration.value_or(scene->duration());
  if (!is_possible(end)) {
    return Error{
        Errc::bad_input,
        "the timestamps of the depth stream are more than a day apart: give the duration of "
        "the probing path"};
  }
  const auto target = *pixel ? aimed_target(*scene, aim) : find_target(*scene);
  if (!target) return target.error();
  const ProbingMotion motion(*scene, *target, tool, *lead, aim.tip_T.has_value(), end);

  stream = open();
  if (!stream) return stream.error();
  const auto depths = probe_stream(**stream, tool, motion, end);
  if (!depths) return depths.error();
  const Plan moves = plan(motion, *depths, end);

  ProbingPath path;
  for (std::size_t i = 0; i < moves.times.size(); ++i)
    path.poses.push_back({moves.times[i], motion.pose(moves.times[i], moves.distances[i])});
  const auto [u, v] = scene->pixel(target->column, target->row);
  const double arrival = motion.arrival();
  path.choice = {u,
                 v,
                 motion.direction(arrival) * motion.surface(arrival),
                 arrival,
                 lead->tip_T,
                 *pixel ? "as you said"
                        : "of the places that are seen well over time, the nearest to the camera "
                          "and to the middle of the image",
                 lead->why,
                 note_on(moves, end, *pixel ? 0 : motion.surface(arrival))};
  return path;
}

}}  // namespace palpate::v0
