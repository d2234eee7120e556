// Distances of the surface from the spheres inserted so far.
#pragma once

#include <cstdint>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/mesh/mesh.h"
#include "src/packing/sphere_levels.h"

namespace palpate { inline namespace v0 {

/// Keeps the standoff of points spread over the surface and of all corners. Spheres are only ever
/// added, so an old distance is an upper bound: only what may matter is measured again.
class SurfaceWatch {
 public:
  /// A point of the surface and its distance to the nearest sphere.
  struct Place {
    Vec3d point;
    double standoff = 0;
    std::size_t id = 0;
  };

  SurfaceWatch(const TriangleMesh& solid, const SphereLevels& spheres, ThreadPool& pool);

  /// Standoffs that 80 % and 95 % of the points spread over the surface do not exceed (nearest
  /// rank).
  struct Quantiles {
    double p80 = 0, p95 = 0;
  };
  Quantiles quantiles();

  /// All points and corners whose standoff is beyond `bound`.
  std::vector<Place> beyond(double bound);

 private:
  void measure_beyond(double bound, std::size_t num);

  const SphereLevels& spheres_;
  ThreadPool& pool_;
  std::vector<Vec3d> points_;     ///< first those spread evenly, then the corners
  std::vector<double> standoff_;  ///< upper bounds, exact just after they were measured
  std::size_t num_even_ = 0;
  double p80_ = 0;  ///< last one known
  std::vector<std::size_t> stale_;
  std::vector<double> sorted_;
};

}}  // namespace palpate::v0
