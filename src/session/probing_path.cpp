#include "palpate/session/probing_path.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/contact_query.h"
#include "palpate/math/sphere.h"
#include "src/session/coarse_depth.h"

namespace palpate {
namespace {

constexpr double kFraction = 0.1;       // of the tool's volume behind the surface at full depth
constexpr double kMostFraction = 0.22;  // never more, by what single frames show
constexpr std::size_t kFeelingSpheres = 1000;
constexpr double kClearance = 0.02;  // m, at least, between the tool and everything at both ends
constexpr double kPoseRate = 100;    // poses per second
constexpr double kLean = 0.45;       // rad, between the tool's axis and the viewing ray
constexpr double kMaxTurn = 0.3;     // rad, about the viewing ray
constexpr double kLong = 1.5;        // times its extent along z: then a tool is held by that axis

/// Where the tool will touch, and where its slide ends: two neighbouring cells.
struct Target {
  int column = 0, row = 0, end_column = 0;
};

/// The pair of neighbours on the calmest surface.
Result<Target> find_target(const CoarseDepth& scene) {
  Target best;
  double lowest = INFINITY;
  for (int row = 0; row < scene.rows(); ++row) {
    for (int column = 0; column < scene.columns(); ++column) {
      const int end_column = std::min(column + 1, scene.columns() - 1);
      const double cost = scene.unevenness(column, row) + scene.unevenness(end_column, row);
      if (cost < lowest) lowest = cost, best = {column, row, end_column};
    }
  }
  if (std::isfinite(lowest)) return best;
  return Error{
      Errc::bad_input,
      "the frames show no usable surface near their centre to touch: check the depth unit, "
      "or give a tool path with --path"};
}

/// Rotation that takes the tool's -z axis to the unit vector d. Turns about the horizontal axis
/// that lies across both, so that the tool does not roll.
Quaternion pointing_along(const Vec3d& d) {
  const Quaternion half_turn = axis_angle({1, 0, 0}, kPi);  // -z to +z
  const Vec3d axis = cross(Vec3d{0, 0, 1}, d);
  if (norm(axis) < 1e-9) return half_turn;
  return normalized(axis_angle(axis, std::acos(std::clamp(d.z, -1.0, 1.0))) * half_turn);
}

/// The thin end of the tool: -z, unless the tool is clearly longer along x or y. Then it is the end
/// of that axis from which the centre of mass is farther.
Vec3d tip_direction(const Tool& tool) {
  Vec3d low{INFINITY, INFINITY, INFINITY}, high = -low;
  for (const Sphere& s : tool.spheres()) {
    const Vec3d c = to_double(s.centre);
    const double r = static_cast<double>(s.radius);
    low = {std::min(low.x, c.x - r), std::min(low.y, c.y - r), std::min(low.z, c.z - r)};
    high = {std::max(high.x, c.x + r), std::max(high.y, c.y + r), std::max(high.z, c.z + r)};
  }
  const Vec3d size = high - low;
  const Vec3d to_centre = tool.sphere_mass().centre_of_mass - (low + high) / 2;
  if (std::max(size.x, size.y) < kLong * size.z) return {0, 0, -1};
  if (size.x >= size.y) return {to_centre.x > 0 ? -1.0 : 1.0, 0, 0};
  return {0, to_centre.y > 0 ? -1.0 : 1.0, 0};
}

/// Points the tip along the ray and leans the other end to the upper right of the image.
Quaternion held_like_a_pen(const Tool& tool, const Vec3d& ray) {
  const Vec3d upper_right{0.7, -0.7, 0}, tip_T = tip_direction(tool), down{0, 0, -1};
  const Quaternion upright = tip_T == down ? Quaternion{} : axis_angle(cross(tip_T, down), kPi / 2);
  return normalized(axis_angle(cross(upper_right, ray), kLean) * pointing_along(ray) * upright);
}

/// The tool as a plane across the unit vector `along_T` meets it.
struct Imprint {
  double front = -INFINITY, back = INFINITY;  ///< m along `along_T`
  double press = 0;  ///< m, how far the front must go beyond the plane for kFraction of the volume
  Vec3d centre_T;    ///< of the part that is beyond the plane then, moved along `along_T` to 0
};

Imprint imprint(const Tool& tool, const Vec3d& along_T) {
  Imprint result;
  const auto along = [&](const Sphere& s) { return dot(to_double(s.centre), along_T); };
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
    (volume < kFraction * tool.sphere_mass().volume ? low : high) = result.press;
  }
  double volume = 0;
  for (const Sphere& s : tool.spheres()) {
    const double part = beyond(s, result.press);
    result.centre_T += part * to_double(s.centre);
    volume += part;
  }
  if (volume > 0) result.centre_T = result.centre_T / volume;
  result.centre_T -= along_T * dot(result.centre_T, along_T);
  return result;
}

/// 0 before `start`, 1 after `end`, smooth in between.
double ease(double t, double start, double end) {
  const double x = std::clamp((t - start) / (end - start), 0.0, 1.0);
  return x * x * (3 - 2 * x);
}

/// Everything about the path but how deep the tool is.
class Motion {
 public:
  Motion(const CoarseDepth& scene, const Target& target, const Tool& tool, double end)
      : end_(end),
        first_ray_(scene.ray(target.column, target.row)),
        last_ray_(scene.ray(target.end_column, target.row)),
        first_depth_(scene.profile(target.column, target.row)),
        last_depth_(scene.profile(target.end_column, target.row)),
        into_W_(normalized(first_ray_)),
        held_(held_like_a_pen(tool, into_W_)),
        tip_(imprint(tool, rotate(conjugate(held_), into_W_))) {
    const double way = norm(last_ray_ - first_ray_) * first_depth_.at(end / 2);
    slide_ = way > 0 ? std::min(1.0, 0.3 * length() / way) : 0;
  }

  double length() const { return tip_.front - tip_.back; }
  /// How far the tip may go beyond a plane.
  double press() const { return tip_.press; }
  /// Distance of the surface from the camera on the ray that the tool follows at this time.
  double surface(double time) const {
    const double shift = slide_ * slid(time);
    return norm(ray(time)) * ((1 - shift) * first_depth_.at(time) + shift * last_depth_.at(time));
  }
  /// The tip at `distance` from the camera.
  Pose pose(double time, double distance) const {
    const Quaternion rotation = normalized(axis_angle(into_W_, kMaxTurn * slid(time)) * held_);
    const Vec3d origin = direction(time) * distance - into_W_ * tip_.front;
    return {origin - rotate(rotation, tip_.centre_T), rotation};
  }
  Vec3d direction(double time) const { return normalized(ray(time)); }
  /// 0: in free space; 1: pressed in.
  double pressed(double time) const {
    return ease(time / end_, 0.05, 0.35) - ease(time / end_, 0.75, 0.95);
  }

 private:
  double slid(double time) const { return ease(time / end_, 0.4, 0.7); }
  Vec3d ray(double time) const {
    const double shift = slide_ * slid(time);
    return (1 - shift) * first_ray_ + shift * last_ray_;
  }

  double end_, slide_ = 0;
  Vec3d first_ray_, last_ray_;
  DepthProfile first_depth_, last_depth_;
  Vec3d into_W_;
  Quaternion held_;
  Imprint tip_;
};

/// How deep the tool may be, as distances of its tip from the camera.
struct Reach {
  double free = INFINITY;  ///< nothing is touched up to here
  double aim = INFINITY;   ///< kFraction of the tool is in, or its tip is kFraction deep
  double most = INFINITY;  ///< kMostFraction is in: no farther
};

/// Feels its way into single frames with the query itself, which sees what any part of the tool
/// meets.
class Feeler {
 public:
  static Result<Feeler> create(const DepthStreamInfo& info, const Tool& tool) {
    auto coarse = tool.prefix(
        static_cast<int>(std::min<std::size_t>(tool.spheres().size(), kFeelingSpheres)));
    if (!coarse) return coarse.error();
    auto surface = SurfaceEstimator::create(info.width, info.height, info.intrinsics);
    if (!surface) return surface.error();
    auto field = DepthField::create(info.width, info.height);
    if (!field) return field.error();
    Feeler feeler(tool, *std::move(coarse), *std::move(surface), *std::move(field));
    auto query = make_contact_query(Backend::cpu, *feeler.coarse_);
    if (!query) return query.error();
    feeler.query_ = *std::move(query);
    return feeler;
  }

  void take_frame(const DepthFrame& frame, ThreadPool& pool) {
    surface_.update(frame, pool);
    field_.update(surface_.cloud(), pool);
    query_->set_field(field_.view());
    nearest_ = INFINITY;
    for (const float z : surface_.depth()) {
      if (z > 0) nearest_ = std::min(nearest_, static_cast<double>(z));  // false for NaN
    }
  }

  /// Comes in along the path's ray at `time` until too much of the tool is in.
  Reach reach(const Motion& motion, double time) {
    const double surface = motion.surface(time), aim = surface + motion.press();
    const double last = aim + motion.press();
    Reach reach{surface, aim, last};
    const Vec3d direction = motion.direction(time);
    double front = -INFINITY;  // of the whole tool along z, tip at the camera
    const Pose X_WT = motion.pose(time, 0);
    for (const Sphere& s : full_->spheres()) {
      front = std::max(front, (X_WT * to_double(s.centre)).z + static_cast<double>(s.radius));
    }
    const double first = (nearest_ - front) / direction.z;
    if (!(first < last)) return reach;
    reach.free = std::min(reach.free, first);
    const double step = std::max(motion.length() / 40, (last - first) / 150);
    for (double before = first; before < last; before += step) {
      const double here = std::min(before + step, last), in = fraction(motion, time, here);
      if (in == 0 && reach.free == before) reach.free = std::min(here, surface);
      if (in >= kFraction && reach.aim == aim)
        reach.aim = std::min(aim, cross(motion, time, before, here, kFraction));
      if (in >= kMostFraction) {
        reach.most = cross(motion, time, before, here, kMostFraction);
        break;
      }
    }
    return reach;
  }

 private:
  Feeler(const Tool& tool, Tool coarse, SurfaceEstimator surface, DepthField field)
      : full_(&tool),
        coarse_(std::make_unique<Tool>(std::move(coarse))),
        surface_(std::move(surface)),
        field_(std::move(field)) {}

  double fraction(const Motion& motion, double time, double distance) {
    constexpr ContactOptions kField{.method = InsideMethod::field};
    return query_->query(motion.pose(time, distance), kField).volume /
           full_volume(*coarse_, kField);
  }
  /// Where between two distances the fraction is reached: the nearer end of a small interval.
  double cross(const Motion& motion, double time, double low, double high, double level) {
    for (int i = 0; i < 6; ++i) {
      const double middle = (low + high) / 2;
      (fraction(motion, time, middle) < level ? low : high) = middle;
    }
    return low;
  }

  const Tool* full_;
  std::unique_ptr<Tool> coarse_;
  SurfaceEstimator surface_;
  DepthField field_;
  std::unique_ptr<ContactQuery> query_;
  double nearest_ = INFINITY;
};

/// The reach over time.
struct Depths {
  double free = INFINITY;  ///< over all frames
  DepthProfile aim, most;
};

/// Feels every frame while it is current.
Result<Depths> feel(DepthSource& stream, const Tool& tool, const Motion& motion, double end) {
  auto feeler = Feeler::create(stream.info(), tool);
  if (!feeler) return feeler.error();
  ThreadPool pool;
  Depths depths;
  std::vector<double> middles, aims;
  double most_before = INFINITY;
  const auto feel_part = [&](double begin, double stop) {
    const Reach a = feeler->reach(motion, begin), b = feeler->reach(motion, stop);
    depths.free = std::min({depths.free, a.free, b.free});
    middles.push_back((begin + stop) / 2);
    aims.push_back((a.aim + b.aim) / 2);
    // Straight lines between these points respect the limits of both neighbours.
    const double most = std::min(a.most, b.most);
    depths.most.times.push_back(begin);
    depths.most.depths.push_back(std::min(most_before, most));
    most_before = most;
  };
  const auto feel_frame = [&](double begin, double stop) {
    const int parts = std::clamp(static_cast<int>(std::ceil((stop - begin) / 0.1)), 1, 100);
    const double part = (stop - begin) / parts;
    for (int i = 0; i < parts; ++i) feel_part(begin + i * part, begin + (i + 1) * part);
  };
  DepthFrame frame;
  double start = 0, time = -1;  // of the current frame; none yet
  while (true) {
    const auto got = stream.next(frame);
    if (!got) return got.error();
    if (!*got) break;
    if (time < 0) start = frame.timestamp;
    const double next = frame.timestamp - start;
    if (next >= end) break;
    if (time >= 0) feel_frame(time, next);
    feeler->take_frame(frame, pool);
    time = next;
  }
  if (time < 0) return Error{Errc::bad_input, "the depth stream gave frames only once"};
  feel_frame(time, end);
  depths.most.times.push_back(end);
  depths.most.depths.push_back(most_before);
  depths.aim = smooth_profile(std::move(middles), std::move(aims));
  return depths;
}

}  // namespace

Result<std::vector<TimedPose>> probing_path(const OpenDepthSource& open, const Tool& tool,
                                            std::optional<double> duration) {
  auto stream = open();
  if (!stream) return stream.error();
  if (!duration && !(*stream)->info().num_frames) {
    return Error{Errc::invalid_argument,
                 "the depth stream has no end: say how long the probing path is to be"};
  }
  if (duration && !(*duration > 0 && *duration * kPoseRate < 1e7)) {
    return Error{Errc::invalid_argument,
                 "a probing path must be longer than 0 s and shorter than a day"};
  }
  const auto scene =
      CoarseDepth::scan(**stream, duration.value_or(std::numeric_limits<double>::infinity()));
  if (!scene) return scene.error();
  const double end = duration.value_or(scene->duration());
  const auto target = find_target(*scene);
  if (!target) return target.error();
  const Motion motion(*scene, *target, tool, end);

  stream = open();
  if (!stream) return stream.error();
  const auto depths = feel(**stream, tool, motion, end);
  if (!depths) return depths.error();
  // Room to start from; beside the camera rather than behind it, if that is enough.
  const double room = 0.5 * motion.length() + kClearance;
  const double start = depths->free - std::clamp(0.5 * depths->free, kClearance, room);

  std::vector<TimedPose> path;
  const int num_steps = std::max(1, static_cast<int>(std::ceil(end * kPoseRate)));
  for (int i = 0; i <= num_steps; ++i) {
    const double time = end * i / num_steps;
    const double deep = std::min(depths->aim.at(time), depths->most.at(time));
    path.push_back({time, motion.pose(time, start + (deep - start) * motion.pressed(time))});
  }
  return path;
}

}  // namespace palpate
