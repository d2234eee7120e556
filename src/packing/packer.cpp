// Greedy sphere packing in the spirit of Protosphere (thesis section 2.4): always insert the
// largest sphere that fits. Candidates are balls that touch obstacles on all sides; they wait in a
// heap. The largest few are inserted at once, and around each new sphere a search finds the holes
// it left, which are the next candidates. Void and void alone is ever looked at, so the cost per
// sphere does not depend on their number.
//
// Greedy filling comes to an end that is thinner than its spheres only when they have become as
// small. Now and then, at numbers of spheres that depend on no limit, the surface is looked at:
// places much farther from the spheres than the rest get spheres of their own. They are part of
// the one sequence of which every packing is a prefix.
#include "palpate/packing/packing.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "palpate/core/core.h"
#include "palpate/mesh/mesh.h"
#include "src/packing/hole_search.h"
#include "src/packing/seeds.h"
#include "src/packing/solid/surface_watch.h"

namespace palpate { inline namespace v0 {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kBatch = 256;
constexpr std::size_t kTaskSize = 4;     // candidates per task of the thread pool
constexpr double kBatchRadius = 0.98;    // of the largest: those are inserted together
constexpr double kIntact = 1 - 1e-6;     // of its radius: such a candidate needs no new ascent
constexpr double kProgressPeriod = 0.2;  // seconds

// Below these a sphere no longer touches its neighbors once its center is rounded to float.
constexpr double kMinRadiusOfExtent = 2e-6;
constexpr double kMinRadiusOfCoordinate = 1e-6;

// Largest growth of a ball from a starting point, as fraction of the grid's spacing: starting
// points are examined that much before their own radius is due. The first hundred spheres decide
// about the fill of all later ones.
constexpr double kHeadStart = 0.75;

// The surface is looked at from so many spheres on, whenever there are a twentieth more. Until the
// next look the bound shrinks by about 2 %, so the requested value is well within it.
constexpr std::size_t kFirstLook = 700;
constexpr std::size_t kMorePerLook = 20;  // one part of so many
constexpr double kReachMargin = 0.8;      // of standoff_bound
// The standoffs of packings have much the same distribution: 80 % of the surface are within 0.70 to
// 0.76 of what 95 % are within. Only where more than 5 % are thinner than the spheres this is less,
// and then p95 falls within few spheres to its usual place once these 5 % are reached. So that it
// does not leave the ends behind, a p95 beyond this times p80 is not believed.
constexpr double kMaxOfP80 = 1.5;

// The largest sphere that fits near a place is taken if it brings the standoff down to this
// fraction: greedy filling would come to it too. In a slender end the next sphere is almost as far,
// and there would have to be very many, so there a smaller one is taken that is so far from the
// place, as fraction of the desired standoff.
constexpr double kNaturalStep = 0.6;
constexpr double kTether = 0.5;
// Starting points for it, as fractions of the same: from an edge or a tip towards the middle of a
// facet.
constexpr double kInsets[] = {0, 0.25, 0.5};
constexpr double kSmallerStart = 0.125;  // of the radius that the ball before began with

struct Candidate {
  Ball ball;
  double priority = 0;   ///< radius it has, or may grow to
  std::uint64_t id = 0;  ///< breaks ties
  bool grown = false;    ///< a local maximum when it was found, not just a point with clearance

  friend bool operator<(const Candidate& a, const Candidate& b) {
    return a.priority < b.priority || (a.priority == b.priority && a.id > b.id);
  }
};

// A call of its own: GCC 12 forgets the rounding of double -> float -> double when it vectorises
// the pair.
[[gnu::noinline]] Vec3f rounded(const Vec3d& p) { return to_float(p); }

// The largest float that is less than x, or the one before it.
float just_below(double x) {
  const float nearest = static_cast<float>(x);
  return std::nextafter(static_cast<double>(nearest) > x ? std::nextafter(nearest, 0.0f) : nearest,
                        0.0f);
}

class Packer {
 public:
  Packer(const TriangleMesh& solid, const PackOptions& options)
      : solid_(solid),
        options_(options),
        box_(bounds(solid)),
        mesh_(solid),
        pool_(options.num_threads) {
    packing_.mesh_volume = mass_properties(solid).volume;
    double coordinate = 0;
    for (int k = 0; k < 3; ++k) {
      extent_ = std::max(extent_, box_.high[k] - box_.low[k]);
      coordinate = std::max({coordinate, std::abs(box_.low[k]), std::abs(box_.high[k])});
    }
    smallest_ = std::max(kMinRadiusOfExtent * extent_, kMinRadiusOfCoordinate * coordinate);
    limited_by_radius_ = options.min_radius >= smallest_;
    smallest_ = std::max(smallest_, options.min_radius);
    for (std::size_t i = 0; i < kBatch / kTaskSize; ++i) searches_.emplace_back(space_);
  }

  Result<SpherePacking> run() {
    const Error cancelled{Errc::cancelled, "sphere packing was cancelled"};
    const auto start =
        starting_points(space_, box_, options_.seed, pool_, [this] { return report(); });
    if (!start) return cancelled;
    head_start_ = kHeadStart * start->spacing;
    for (const Ball& ball : start->balls) push(ball, false);
    while (!done_) {
      if (!report()) return cancelled;
      take_batch();
      if (batch_.empty()) {
        packing_.stop = limited_by_radius_ ? PackStop::radius : PackStop::exhausted;
        break;
      }
      grow_batch();
      insert_batch();
      find_holes();
      reach_ends();
      if (!done_ && elapsed() >= options_.max_seconds) stop(PackStop::time);
    }
    if (packing_.spheres.empty()) {
      return Error{Errc::bad_input,
                   "no sphere fits into the mesh; lower min_radius or check that the solid is not "
                   "thinner than a few millionths of its size"};
    }
    return std::move(packing_);
  }

 private:
  double elapsed() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }

  void stop(PackStop why) {
    packing_.stop = why;
    done_ = true;
  }

  bool report() {
    if (!options_.progress || elapsed() < next_report_) return true;
    next_report_ = elapsed() + kProgressPeriod;
    const auto& spheres = packing_.spheres;
    return options_.progress({static_cast<int>(spheres.size()), volume_ / packing_.mesh_volume,
                              spheres.empty() ? 0 : static_cast<double>(spheres.back().radius)});
  }

  double priority(double radius, bool grown) const {
    return grown ? radius : std::min(radius + head_start_, options_.max_radius);
  }

  void push(const Ball& ball, bool grown) {
    if (ball.radius < smallest_) return;
    const double radius = std::min(ball.radius, options_.max_radius);
    heap_.push_back({{ball.center, radius}, priority(radius, grown), next_id_++, grown});
    std::push_heap(heap_.begin(), heap_.end());
  }

  void take_batch() {
    batch_.clear();
    if (heap_.empty()) return;
    threshold_ = kBatchRadius * heap_.front().priority;
    while (!heap_.empty() && batch_.size() < kBatch && heap_.front().priority >= threshold_) {
      std::pop_heap(heap_.begin(), heap_.end());
      batch_.push_back({heap_.back(), {}});
      heap_.pop_back();
    }
  }

  // Runs work(search, i) for i < num in tasks of kTaskSize, each with its own search.
  template <class Work>
  void in_parallel(std::size_t num, Work&& work) {
    const std::size_t num_tasks = (num + kTaskSize - 1) / kTaskSize;
    pool_.parallel_for(static_cast<int>(num_tasks), [&](int task) {
      const std::size_t begin = static_cast<std::size_t>(task) * kTaskSize;
      for (std::size_t i = begin; i < std::min(begin + kTaskSize, num); ++i) {
        work(searches_[static_cast<std::size_t>(task)], i);
      }
    });
  }

  // Brings every candidate of the batch up to date with the spheres inserted since it was found.
  void grow_batch() {
    in_parallel(batch_.size(), [&](HoleSearch& search, std::size_t i) {
      Candidate& candidate = batch_[i].candidate;
      Ball& ball = candidate.ball;
      const double known = ball.radius;
      ball.radius = spheres_.clearance(ball.center, known);
      if (ball.radius < smallest_) return;
      if (!candidate.grown || ball.radius < kIntact * known) {
        if (!candidate.grown && priority(ball.radius, false) < threshold_) return;
        ball = search.ascent().climb(ball.center, known * 1.1);
        candidate.grown = true;
      }
      if (ball.radius >= threshold_) batch_[i].sphere = stored(ball);
    });
  }

  // The ball in single precision: its center is rounded first, then its radius is what is free
  // around that center, in double, less one or two units in the last place. This is the proof that
  // the stored sphere overlaps nothing.
  Sphere stored(const Ball& ball) const {
    const Vec3f center = rounded(ball.center);
    const double free = space_.clearance(to_double(center), 1.01 * ball.radius);
    return {center, just_below(std::min(free, options_.max_radius))};
  }

  void insert_batch() {
    std::sort(batch_.begin(), batch_.end(), [](const Entry& a, const Entry& b) {
      return a.sphere.radius > b.sphere.radius ||
             (a.sphere.radius == b.sphere.radius && a.candidate.id < b.candidate.id);
    });
    const std::size_t first = packing_.spheres.size();
    for (const Entry& entry : batch_) {
      const Ball& ball = entry.candidate.ball;
      if (entry.sphere.radius == 0) {
        push(ball, entry.candidate.grown);
        continue;
      }
      if (done_ || static_cast<double>(entry.sphere.radius) < smallest_) continue;
      double free = ball.radius;
      bool intact = true;
      const Vec3d c = to_double(entry.sphere.center);
      for (std::size_t i = first; i < packing_.spheres.size(); ++i) {
        const Sphere& other = packing_.spheres[i];
        const double gap = norm(c - to_double(other.center)) - static_cast<double>(other.radius);
        intact = intact && gap > static_cast<double>(entry.sphere.radius) * (1 + 1e-12);
        free = std::min(free, gap);
      }
      if (intact) {
        insert(entry.sphere);
      } else {
        push({ball.center, free}, false);
      }
    }
    num_new_ = packing_.spheres.size() - first;
  }

  void insert(const Sphere& sphere) {
    packing_.spheres.push_back(sphere);
    spheres_.insert(sphere);
    volume_ += sphere_volume(static_cast<double>(sphere.radius));
    if (volume_ >= options_.max_fill * packing_.mesh_volume) stop(PackStop::fill);
    if (packing_.spheres.size() >= static_cast<std::size_t>(options_.max_spheres)) {
      stop(PackStop::count);
    }
  }

  void find_holes() {
    if (done_) return;
    holes_.resize(std::max(holes_.size(), num_new_));
    const std::size_t first = packing_.spheres.size() - num_new_;
    in_parallel(num_new_, [&](HoleSearch& search, std::size_t i) {
      holes_[i].clear();
      search.find(packing_.spheres[first + i], smallest_, holes_[i]);
    });
    for (std::size_t i = 0; i < num_new_; ++i) {
      for (const Ball& hole : holes_[i]) push(hole, true);
    }
  }

  // Gives spheres to places of the surface that are left behind, the farthest first.
  void reach_ends() {
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
  Sphere sphere_near(const SurfaceWatch::Place& place, double desired) {
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

  struct Entry {
    Candidate candidate;
    Sphere sphere;  ///< radius 0: not to be inserted now
  };

  const TriangleMesh& solid_;
  const PackOptions& options_;
  const Clock::time_point start_ = Clock::now();
  Bounds box_;
  TriangleBvh mesh_;
  SphereLevels spheres_;
  ThreadPool pool_;
  FreeSpace space_{mesh_, spheres_, options_.max_radius};
  std::vector<HoleSearch> searches_;  ///< one per task of a batch
  double extent_ = 0;
  double smallest_ = 0;  ///< radius
  bool limited_by_radius_ = false;

  std::vector<Candidate> heap_;
  std::uint64_t next_id_ = 0;
  double head_start_ = 0;
  double threshold_ = 0;  ///< radius
  std::vector<Entry> batch_;
  std::vector<std::vector<Ball>> holes_;
  std::size_t num_new_ = 0;

  std::size_t next_look_ = kFirstLook;  ///< number of spheres
  std::optional<SurfaceWatch> watch_;   ///< from the first look on
  std::vector<char> hopeless_;          ///< by place: no sphere fits there

  SpherePacking packing_;
  double volume_ = 0;
  double next_report_ = 0;
  bool done_ = false;
};

Status check(const TriangleMesh& solid, const PackOptions& options) {
  const auto refuse = [](std::string message) {
    return Error{Errc::invalid_argument, std::move(message)};
  };
  if (const Status status = check_settings(options); !status) return status;
  if (options.min_radius > options.max_radius) {
    return refuse("packing.min_radius must not be greater than packing.max_radius");
  }
  if (options.num_threads < 0) return refuse("num_threads must not be negative; 0 is one per core");
  bool usable = true;
  for (const Vec3d& v : solid.vertices) usable = usable && std::isfinite(dot(v, v));
  for (const auto& triangle : solid.triangles) {
    for (std::uint32_t i : triangle) usable = usable && i < solid.vertices.size();
  }
  if (!usable) {
    return Error{
        Errc::bad_input,
        "the mesh to pack has a missing or infinite vertex; pass what check_solid returns"};
  }
  if (!(mass_properties(solid).volume > 0)) {
    return Error{Errc::bad_input,
                 "the mesh to pack encloses no volume; pass what check_solid returns"};
  }
  return Done{};
}

}  // namespace

Result<SpherePacking> pack_spheres(const TriangleMesh& solid, const PackOptions& options) {
  if (const Status status = check(solid, options); !status) return status.error();
  return Packer(solid, options).run();
}

}}  // namespace palpate::v0
