// Spheres for the thin ends of a solid. Greedy filling reaches an end that is thinner than its
// spheres only when they have become as small. Now and then, at numbers of spheres that depend on
// no limit, the surface is looked at: places much farther from the spheres than the rest get
// spheres of their own. They are part of the one sequence of which every packing is a prefix.
#include <algorithm>
#include <cmath>
#include <limits>

#include "src/packing/packer.h"

namespace palpate { inline namespace v0 {
namespace {

// The surface is looked at from kFirstLook spheres on, whenever there are a twentieth more. Until
// the next look the bound shrinks by about 2 %, so the requested value is well within it.
constexpr std::size_t kMorePerLook = 20;  // one part of so many
constexpr double kReachMargin = 0.8;      // of standoff_bound
// The standoffs of packings have much the same distribution: 80 % of the surface are within 0.70 to
// 0.76 of what 95 % are within. Only where more than 5 % are thinner than the spheres this is less,
// and then p95 falls within few spheres to its usual place once these 5 % are reached. So that it
// does not leave the ends behind, a p95 beyond this times p80 is not believed.
constexpr double kMaxOfP80 = 1.5;

// The largest sphere that fits near a place is taken if it brings the standoff there down to this
// fraction: greedy filling would come to it too.
constexpr double kNaturalStep = 0.6;
// In a slender end that sphere is almost as far as the last one, and very many would have to
// follow. There a smaller one is taken, tied to the place by this length, a fraction of the desired
// standoff.
constexpr double kTether = 0.5;
// Starting points for both, as fractions of the desired standoff: from the place, which may be on
// an edge or a tip, towards the middle of its facet.
constexpr double kInsets[] = {0, 0.25, 0.5};
constexpr double kSmallerStart = 0.125;  // of the radius that the ball before began with

}  // namespace

// Gives spheres to places of the surface that are left behind, the farthest first.
void Packer::reach_ends() {
  if (done_ || packing_.spheres.size() < next_look_) return;
  next_look_ = packing_.spheres.size() + packing_.spheres.size() / kMorePerLook;
  if (!watch_) watch_.emplace(solid_, spheres_, pool_);
  const auto [p80, p95] = watch_->quantiles();
  const double desired = kReachMargin * standoff_bound(std::min(p95, kMaxOfP80 * p80), extent_);
  auto places = watch_->beyond(desired);
  std::erase_if(places, [&](const SurfaceWatch::Place& place) {
    return place.id < hopeless_.size() && hopeless_[place.id] != 0;
  });
  num_new_ = 0;
  while (!places.empty() && !done_) {
    const auto farthest =
        std::max_element(places.begin(), places.end(),
                         [](const auto& a, const auto& b) { return a.standoff < b.standoff; });
    const Sphere sphere = sphere_near(*farthest, desired);
    if (sphere.radius == 0) {
      if (hopeless_.size() <= farthest->id) hopeless_.resize(farthest->id + 1, 0);
      hopeless_[farthest->id] = 1;
      places.erase(farthest);
      continue;
    }
    insert(sphere);
    const Vec3d c = to_double(sphere.center);
    const double r = sphere.radius;
    std::erase_if(places, [&](SurfaceWatch::Place& place) {
      place.standoff = std::min(place.standoff, norm(place.point - c) - r);
      return place.standoff <= desired;
    });
    if (++num_new_ == kBatch) {
      find_holes();
      num_new_ = 0;
    }
  }
  find_holes();
  if (!done_ && options_.standoff > 0 && packing_.spheres.size() >= kReachingSpheres &&
      p95 <= options_.standoff) {
    stop(PackStop::standoff);
  }
}

// A large sphere near the place that brings its standoff well down; radius 0 if none fits.
Sphere Packer::sphere_near(const SurfaceWatch::Place& place, double desired) {
  const Vec3d& p = place.point;
  const Triangle& t =
      mesh_.triangle(mesh_.closest(p, std::numeric_limits<double>::infinity()).triangle);
  const Vec3d inward = -normalized(cross(t.b - t.a, t.c - t.a));
  const Vec3d to_middle = (t.a + t.b + t.c) / 3.0 - p;
  const Ascent::Tether tether{p, kTether * desired};
  Ascent& ascent = searches_.front().ascent();
  Sphere natural, near;
  for (const double inset : kInsets) {
    const double share = std::min(1.0, inset * desired / norm(to_middle));
    // A ball that starts much larger than the end is thick may not find the wall in its way.
    Ball start;
    for (double radius = std::min(desired, options_.max_radius);
         radius >= smallest_ && !(start.radius > 0); radius *= kSmallerStart) {
      start = space_.tangent_ball(p + to_middle * share, inward, radius);
    }
    if (!(start.radius > 0)) continue;
    const double reach = 1.1 * start.radius;
    const auto grow = [&](const Ascent::Tether* limit, double farthest, Sphere& best) {
      const Ball ball = ascent.climb(start.center, reach, limit);
      if (ball.radius < smallest_) return;
      const Sphere sphere = stored(ball);
      const double r = sphere.radius;
      if (r < smallest_ || norm(p - to_double(sphere.center)) - r > farthest) return;
      if (sphere.radius > best.radius) best = sphere;
    };
    grow(nullptr, std::max(desired, kNaturalStep * place.standoff), natural);
    grow(&tether, desired, near);
  }
  return natural.radius > 0 ? natural : near;
}

}}  // namespace palpate::v0
