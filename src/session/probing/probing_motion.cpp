#include "src/session/probing/probing_motion.h"

#include <algorithm>
#include <cmath>

#include "palpate/math/geometry.h"
#include "src/math/internal/farthest.h"
#include "src/session/internal/probing_path.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kLean = 0.45;    // rad, between the tool's axis and the viewing ray
constexpr double kMaxTurn = 0.3;  // rad, about the viewing ray
constexpr double kTurnRate = 0.95 * kProbeTurnRate;   // rad/s
constexpr double kSideSpeed = 0.03;                   // m/s, of the slide, and of the turn
constexpr double kSlideBegin = 0.4, kSlideEnd = 0.7;  // shares of the path's time

/// 0 before `start`, 1 after `end`, smooth in between.
double ease(double t, double start, double end) {
  const double x = std::clamp((t - start) / (end - start), 0.0, 1.0);
  return x * x * (3 - 2 * x);
}
constexpr double kSteepest = 1.5;  // of `ease`, times the mean

/// The shortest rotation from one unit vector to another; a half turn about x (or y) if they are
/// opposite.
Quaternion rotation_between(const Vec3d& from, const Vec3d& to) {
  Vec3d axis = cross(from, to);
  if (norm(axis) < 1e-9) {
    if (dot(from, to) > 0) return {};
    axis = cross(from, std::abs(from.x) < 0.9 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0});
    return axis_angle(cross(axis, from), kPi);
  }
  return axis_angle(axis, std::acos(std::clamp(dot(from, to), -1.0, 1.0)));
}

/// Points the lead end along the ray and leans the other end to the upper right of the image. Turns
/// about a horizontal axis from looking along z, so that the tool does not roll.
Quaternion held_like_a_pen(const Vec3d& lead_T, const Vec3d& ray) {
  const Vec3d upper_right{0.7, -0.7, 0}, down{0, 0, -1}, forward{0, 0, 1};
  return normalized(axis_angle(cross(upper_right, ray), kLean) * rotation_between(forward, ray) *
                    axis_angle({1, 0, 0}, kPi) * rotation_between(lead_T, down));
}

Imprint imprint(const Tool& tool, const Vec3d& along_T, const Vec3d* tip_T) {
  Imprint result{-INFINITY, INFINITY, 0, {}, 0};
  const auto along = [&](const Sphere& s) { return dot(to_double(s.center), along_T); };
  for (const Sphere& s : tool.spheres()) {
    const double r = static_cast<double>(s.radius);
    result.front = std::max(result.front, along(s) + r);
    result.back = std::min(result.back, along(s) - r);
  }
  const auto beyond = [&](const Sphere& s, double depth) {
    return cap_volume(static_cast<double>(s.radius), result.front - depth - along(s));
  };
  double low = 0, high = result.front - result.back;
  for (int i = 0; i < 40; ++i) {
    result.press = (low + high) / 2;
    double volume = 0;
    for (const Sphere& s : tool.spheres()) volume += beyond(s, result.press);
    (volume < ProbingMotion::kFraction * tool.sphere_mass().volume ? low : high) = result.press;
  }
  double volume = 0;
  Vec3d center_T;
  for (const Sphere& s : tool.spheres()) {
    const double part = beyond(s, result.press);
    center_T += part * to_double(s.center);
    volume += part;
  }
  if (volume > 0) center_T = center_T / volume;
  if (tip_T != nullptr) center_T = *tip_T;
  result.center_T = center_T - along_T * dot(center_T, along_T);
  const Vec3d pivot_T = result.center_T + along_T * result.front;
  result.reach = std::max(
      {norm(pivot_T), farthest(tool.spheres(), pivot_T), farthest(tool.mesh().vertices, pivot_T)});
  return result;
}

}  // namespace

ProbingMotion::ProbingMotion(const CoarseDepth& scene, const ProbeTarget& target, const Tool& tool,
                             const LeadEnd& lead, bool tip_is_given, double end)
    : end_(end),
      first_ray_(scene.ray(target.column, target.row)),
      last_ray_(scene.ray(target.end_column, target.end_row)),
      first_depth_(scene.profile(target.column, target.row)),
      last_depth_(scene.profile(target.end_column, target.end_row)),
      into_W_(normalized(first_ray_)),
      held_(held_like_a_pen(lead.direction_T, into_W_)),
      tip_(imprint(tool, rotate(conjugate(held_), into_W_), tip_is_given ? &lead.tip_T : nullptr)) {
  const double mean_speed = kSideSpeed / kSteepest, time = (kSlideEnd - kSlideBegin) * end;
  const double way =
      norm(last_ray_ - first_ray_) * std::max(first_depth_.at(end / 2), last_depth_.at(end / 2));
  slide_ = way > 0 ? std::min(1.0, std::min(0.3 * length(), mean_speed * time) / way) : 0;
  turn_ = std::min({kMaxTurn, kTurnRate / kSteepest * time, mean_speed * time / tip_.reach});
}

double ProbingMotion::surface(double time) const {
  const double shift = slide_ * slid(time);
  return norm(ray(time)) * ((1 - shift) * first_depth_.at(time) + shift * last_depth_.at(time));
}

Pose ProbingMotion::pose(double time, double distance) const {
  const Quaternion rotation = normalized(axis_angle(into_W_, turn_ * slid(time)) * held_);
  const Vec3d origin = direction(time) * distance - into_W_ * tip_.front;
  return {origin - rotate(rotation, tip_.center_T), rotation};
}

double ProbingMotion::pressed(double time) const {
  return ease(time / end_, 0.05, 0.35) - ease(time / end_, 0.75, 0.95);
}

double ProbingMotion::arrival() const { return kSlideBegin * end_; }

double ProbingMotion::sideways_speed(double begin, double end, double farthest) const {
  const double slide = norm(direction(end) - direction(begin)) * std::abs(farthest);
  const double turn = turn_ * std::abs(slid(end) - slid(begin)) * tip_.reach;
  return (slide + turn) / (end - begin);
}

double ProbingMotion::slid(double time) const { return ease(time / end_, kSlideBegin, kSlideEnd); }

Vec3d ProbingMotion::ray(double time) const {
  const double shift = slide_ * slid(time);
  return (1 - shift) * first_ray_ + shift * last_ray_;
}

std::vector<double> within_speed(std::vector<double> desired, const std::vector<double>& steps) {
  for (std::size_t i = 1; i < desired.size(); ++i) {
    desired[i] = std::min(desired[i], desired[i - 1] + steps[i]);
  }
  for (std::size_t i = desired.size() - 1; i > 0; --i) {
    desired[i - 1] = std::min(desired[i - 1], desired[i] + steps[i]);
  }
  return desired;
}

}}  // namespace palpate::v0
