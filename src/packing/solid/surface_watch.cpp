#include "src/packing/solid/surface_watch.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/packing/packing.h"
#include "src/mesh/internal/surface_points.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kPlacesPerTask = 256;
// First guess of the factor by which p80 has shrunk since it was last known.
constexpr double kShrunk = 0.93;

}  // namespace

SurfaceWatch::SurfaceWatch(const TriangleMesh& solid, const SphereLevels& spheres, ThreadPool& pool)
    : spheres_(spheres), pool_(pool), points_(surface_points(solid, kStandoffSamples)) {
  num_even_ = points_.size();
  std::vector<char> is_used(solid.vertices.size(), 0);
  for (const auto& triangle : solid.triangles) {
    for (const std::uint32_t corner : triangle) {
      if (is_used[corner] == 0) points_.push_back(solid.vertices[corner]);
      is_used[corner] = 1;
    }
  }
  p80_ = std::numeric_limits<double>::infinity();
  standoff_.assign(points_.size(), p80_);
}

// Measures those of the first `num` places again whose last standoff is beyond `bound`.
void SurfaceWatch::measure_beyond(double bound, std::size_t num) {
  stale_.clear();
  for (std::size_t i = 0; i < num; ++i) {
    if (standoff_[i] > bound) stale_.push_back(i);
  }
  const std::size_t num_tasks = (stale_.size() + kPlacesPerTask - 1) / kPlacesPerTask;
  pool_.parallel_for(static_cast<int>(num_tasks), [&](int task) {
    const std::size_t begin = static_cast<std::size_t>(task) * kPlacesPerTask;
    for (std::size_t k = begin; k < std::min(begin + kPlacesPerTask, stale_.size()); ++k) {
      const std::size_t i = stale_[k];
      standoff_[i] = spheres_.clearance(points_[i], standoff_[i]);
    }
  });
}

// Standoffs that were not measured again are below the guess. Quantiles above it are therefore
// exact.
SurfaceWatch::Quantiles SurfaceWatch::quantiles() {
  const auto value_at = [&](double share) {
    const double rank = std::ceil(share * static_cast<double>(num_even_)) - 1;
    const auto desired = sorted_.begin() + static_cast<std::ptrdiff_t>(rank);
    std::nth_element(sorted_.begin(), desired, sorted_.end());
    return *desired;
  };
  for (double guess = std::isfinite(p80_) ? kShrunk * p80_ : 0;; guess *= kShrunk) {
    measure_beyond(guess, num_even_);
    sorted_.assign(standoff_.begin(), standoff_.begin() + static_cast<std::ptrdiff_t>(num_even_));
    p80_ = value_at(0.80);
    if (p80_ > guess || p80_ <= 0) return {p80_, value_at(0.95)};
  }
}

std::vector<SurfaceWatch::Place> SurfaceWatch::beyond(double bound) {
  measure_beyond(bound, points_.size());
  std::vector<Place> places;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    if (standoff_[i] > bound) places.push_back({points_[i], standoff_[i], i});
  }
  return places;
}

}}  // namespace palpate::v0
