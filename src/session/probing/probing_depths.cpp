#include "src/session/probing/probing_depths.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/contact.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kFraction = ProbingMotion::kFraction;  // of the tool, behind the surface
constexpr double kMaxFraction = 0.22;                   // the largest one, in single frames
constexpr std::size_t kStudySpheres = 1000;

/// Limits of the tool's depth at one time, as distances of its tip from the camera.
struct Reach {
  double free = INFINITY;  ///< nothing is touched up to here
  double aim = INFINITY;   ///< kFraction of the tool is in, or its tip is kFraction deep
  double most = INFINITY;  ///< kMaxFraction is in: no farther
};

/// Probes single frames with the query itself, which sees what any part of the tool meets.
class DepthProbe {
 public:
  static Result<DepthProbe> create(const DepthStreamInfo& info, const Tool& tool) {
    auto coarse =
        tool.prefix(static_cast<int>(std::min<std::size_t>(tool.spheres().size(), kStudySpheres)));
    if (!coarse) return coarse.error();
    auto surface = SurfaceEstimator::create(info.width, info.height, info.intrinsics);
    if (!surface) return surface.error();
    auto field = DepthField::create(info.width, info.height);
    if (!field) return field.error();
    DepthProbe probe(tool, *std::move(coarse), *std::move(surface), *std::move(field));
    auto query = make_contact_query(Place::cpu(), *probe.coarse_);
    if (!query) return query.error();
    probe.query_ = *std::move(query);
    return probe;
  }

  void take_frame(const DepthFrame& frame, ThreadPool& pool) {
    surface_.update(frame, pool);
    field_.update(surface_.cloud(), pool);
    nearest_ = INFINITY;
    for (const float z : surface_.depth()) {
      if (z > 0) nearest_ = std::min(nearest_, static_cast<double>(z));  // false for NaN
    }
  }

  /// Moves the tool in along the path's ray at `time` until too much of it is in.
  Reach reach(const ProbingMotion& motion, double time) {
    const double surface = motion.surface(time), aim = surface + motion.press();
    const double last = aim + motion.press();
    Reach reach{surface, aim, last};
    const Vec3d direction = motion.direction(time);
    double front = -INFINITY;  // of the whole tool along z, tip at the camera
    const Pose X_WT = motion.pose(time, 0);
    for (const Sphere& s : full_->spheres()) {
      front = std::max(front, (X_WT * to_double(s.center)).z + static_cast<double>(s.radius));
    }
    const double first = (nearest_ - front) / direction.z;
    if (!(first < last)) return reach;
    reach.free = std::min(reach.free, first);
    const double step = std::max(motion.length() / 40, (last - first) / 150);
    double before = first;
    while (before < last) {
      const double here = std::min(before + step, last), in = fraction(motion, time, here);
      if (in == 0 && reach.free == before) reach.free = std::min(here, surface);
      if (in >= kFraction && reach.aim == aim)
        reach.aim = std::min(aim, cross(motion, time, before, here, kFraction));
      if (in >= kMaxFraction) {
        reach.most = cross(motion, time, before, here, kMaxFraction);
        break;
      }
      before = here;
    }
    return reach;
  }

 private:
  DepthProbe(const Tool& tool, Tool coarse, SurfaceEstimator surface, DepthField field)
      : full_(&tool),
        coarse_(std::make_unique<Tool>(std::move(coarse))),
        surface_(std::move(surface)),
        field_(std::move(field)) {}

  double fraction(const ProbingMotion& motion, double time, double distance) {
    const SurfaceView surface{{}, field_.view()};
    return query_->measure(surface, motion.pose(time, distance)).penetration.volume /
           full_volume(*coarse_, FieldMethod{}.volumes);
  }
  /// Returns where between two distances the fraction is reached: the near end of a small interval.
  double cross(const ProbingMotion& motion, double time, double low, double high, double level) {
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

}  // namespace

Result<ProbeDepths> probe_stream(DepthSource& stream, const Tool& tool, const ProbingMotion& motion,
                                 double end) {
  auto probe = DepthProbe::create(stream.info(), tool);
  if (!probe) return probe.error();
  ThreadPool pool;
  ProbeDepths depths;
  std::vector<double> middles, aims;
  double free_before = INFINITY, max_before = INFINITY;
  const auto feel_part = [&](double begin, double stop) {
    const Reach a = probe->reach(motion, begin), b = probe->reach(motion, stop);
    middles.push_back((begin + stop) / 2);
    aims.push_back((a.aim + b.aim) / 2);
    // Straight lines between these points respect the limits of both neighbors.
    const double free = std::min(a.free, b.free), most = std::min(a.most, b.most);
    depths.free.times.push_back(begin);
    depths.free.depths.push_back(std::min(free_before, free));
    depths.most.times.push_back(begin);
    depths.most.depths.push_back(std::min(max_before, most));
    free_before = free;
    max_before = most;
  };
  const auto probe_frame = [&](double begin, double stop) {
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
    if (time >= 0) probe_frame(time, next);
    probe->take_frame(frame, pool);
    time = next;
  }
  if (time < 0) return Error{Errc::bad_input, "the depth stream gave frames only once"};
  probe_frame(time, end);
  depths.free.times.push_back(end);
  depths.free.depths.push_back(free_before);
  depths.most.times.push_back(end);
  depths.most.depths.push_back(max_before);
  depths.aim = smooth_profile(std::move(middles), std::move(aims));
  return depths;
}

}}  // namespace palpate::v0
