// Fills a solid with non-overlapping spheres of many sizes (the job of Protosphere in the thesis).
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

#include "palpate/core/result.h"
#include "palpate/math/sphere.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

/// Seen by the progress callback a few times a second.
struct PackProgress {
  int num_spheres = 0;
  double fill = 0;         ///< sphere volume / mesh volume so far
  double last_radius = 0;  ///< metres
};

/// Packing stops at the first limit reached.
struct PackOptions {
  int max_spheres = 5000;
  double max_radius = std::numeric_limits<double>::infinity();  ///< metres
  double min_radius = 0;                                        ///< metres
  double max_fill = 1;                                          ///< sphere volume / mesh volume
  double max_seconds = std::numeric_limits<double>::infinity();
  std::uint64_t seed = 0;  ///< jitters the starting grid; 0 is the plain grid
  int num_threads = 0;     ///< 0: one per core. The result has the same bits for any number.
  /// Called on the packing thread; return false to cancel. May be empty.
  std::function<bool(const PackProgress&)> progress;
};

/// Why packing ended.
enum class PackStop { count, fill, radius, time, exhausted };

/// Spheres in insertion order: every prefix is the packing for that smaller number.
struct SpherePacking {
  std::vector<Sphere> spheres;  ///< mesh frame, metres
  double mesh_volume = 0;       ///< m3
  PackStop stop = PackStop::count;
};

/// Packs a mesh that passed check_solid. Spheres are strictly inside and disjoint, verified in
/// double on the stored single-precision numbers. Errors: cancelled; invalid options; no sphere
/// fits. Fewer spheres than asked for is not an error (`stop` says why).
Result<SpherePacking> pack_spheres(const TriangleMesh& solid, const PackOptions& options);

}  // namespace palpate
