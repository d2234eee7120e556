// Greedy sphere packing in the spirit of Protosphere (thesis section 2.4): always insert the
// largest sphere that fits. Candidates are balls that touch obstacles on all sides; they wait in a
// heap. The largest few are inserted at once, and around each new sphere a search finds the holes
// it left, which are the next candidates. Void and void alone is ever looked at, so the cost per
// sphere does not depend on their number.
#include "src/packing/packer.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "src/packing/seeds.h"

namespace palpate { inline namespace v0 {
namespace {

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

// A call of its own: GCC 12 forgets the rounding of double -> float -> double when it vectorizes
// the pair.
[[gnu::noinline]] Vec3f rounded(const Vec3d& p) { return to_float(p); }

// The largest float that is less than x, or the one before it.
float just_below(double x) {
  const float nearest = static_cast<float>(x);
  return std::nextafter(static_cast<double>(nearest) > x ? std::nextafter(nearest, 0.0f) : nearest,
                        0.0f);
}

}  // namespace

Packer::Packer(const TriangleMesh& solid, const PackOptions& options)
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

Result<SpherePacking> Packer::run() {
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

void Packer::stop(PackStop why) {
  packing_.stop = why;
  done_ = true;
}

bool Packer::report() {
  if (!options_.progress || elapsed() < next_report_) return true;
  next_report_ = elapsed() + kProgressPeriod;
  const auto& spheres = packing_.spheres;
  return options_.progress({static_cast<int>(spheres.size()), volume_ / packing_.mesh_volume,
                            spheres.empty() ? 0 : static_cast<double>(spheres.back().radius)});
}

double Packer::priority(double radius, bool grown) const {
  return grown ? radius : std::min(radius + head_start_, options_.max_radius);
}

void Packer::push(const Ball& ball, bool grown) {
  if (ball.radius < smallest_) return;
  const double radius = std::min(ball.radius, options_.max_radius);
  heap_.push_back({{ball.center, radius}, priority(radius, grown), next_id_++, grown});
  std::push_heap(heap_.begin(), heap_.end());
}

void Packer::take_batch() {
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
void Packer::in_parallel(std::size_t num, Work&& work) {
  const std::size_t num_tasks = (num + kTaskSize - 1) / kTaskSize;
  pool_.parallel_for(static_cast<int>(num_tasks), [&](int task) {
    const std::size_t begin = static_cast<std::size_t>(task) * kTaskSize;
    for (std::size_t i = begin; i < std::min(begin + kTaskSize, num); ++i) {
      work(searches_[static_cast<std::size_t>(task)], i);
    }
  });
}

// Brings every candidate of the batch up to date with the spheres inserted since it was found.
void Packer::grow_batch() {
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
Sphere Packer::stored(const Ball& ball) const {
  const Vec3f center = rounded(ball.center);
  const double free = space_.clearance(to_double(center), 1.01 * ball.radius);
  return {center, just_below(std::min(free, options_.max_radius))};
}

void Packer::insert_batch() {
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

void Packer::insert(const Sphere& sphere) {
  packing_.spheres.push_back(sphere);
  spheres_.insert(sphere);
  volume_ += sphere_volume(static_cast<double>(sphere.radius));
  if (volume_ >= options_.max_fill * packing_.mesh_volume) stop(PackStop::fill);
  if (packing_.spheres.size() >= static_cast<std::size_t>(options_.max_spheres)) {
    stop(PackStop::count);
  }
}

void Packer::find_holes() {
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

namespace {

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
