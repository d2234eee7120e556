// Fills a solid with non-overlapping spheres of many sizes (the job of Protosphere in the thesis).
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <vector>

#include "palpate/core/result.h"
#include "palpate/math/sphere.h"
#include "palpate/mesh/triangle_mesh.h"
#include "palpate/settings/setting_table.h"

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
  /// Metres: enough spheres if 95 % of the surface are not farther than this from the nearest one.
  /// Looked at from kReachingSpheres on, whenever there are a twentieth more. 0: no such limit.
  double standoff = 0;
  double max_radius = 1000;  ///< metres
  double min_radius = 0;     ///< metres, at most max_radius
  double max_fill = 1;       ///< sphere volume / mesh volume
  double max_seconds = 1e9;
  std::uint64_t seed = 0;  ///< jitters the starting grid; 0 is the plain grid
  int num_threads = 0;     ///< 0: one per core. The result has the same bits for any number.
  /// Called on the packing thread; return false to cancel. May be empty.
  std::function<bool(const PackProgress&)> progress;
};
/// What limits a packing.
inline void add_settings(SettingTable& t, PackOptions& o) {
  t.section("packing");
  // Two million spheres need 2.5 GB while they are packed.
  t.add("spheres", o.max_spheres, {1, 2e6, "spheres"}, "at most so many");
  t.add("standoff", o.standoff, {0, 1000, "m"},
        "enough if 95 % of the surface are as near to a sphere; 0: no such limit");
  t.add("max_radius", o.max_radius, {1e-9, 1000, "m"}, "no larger sphere");
  t.add("min_radius", o.min_radius, {0, 1000, "m"}, "stop at smaller spheres");
  t.add("max_fill", o.max_fill, {1e-9, 1}, "stop at this fraction of the mesh volume");
  t.add("max_seconds", o.max_seconds, {1e-3, 1e9, "s"}, "stop after this time");
}

/// Why packing ended.
enum class PackStop { count, fill, radius, time, exhausted, standoff };

/// The standoff of a point of the surface is its distance to the nearest sphere: how late it is
/// felt. Greedy filling alone leaves ends empty that are thinner than its smallest spheres. So from
/// kReachingSpheres spheres on no standoff is beyond standoff_bound of what 95 % of the surface do
/// not exceed (at kStandoffSamples surface_points) and the longest side of the solid, unless a
/// limit of PackOptions or single precision keeps spheres out of there.
inline constexpr int kReachingSpheres = 1000;
inline constexpr int kStandoffSamples = 20000;
inline double standoff_bound(double p95, double size) { return std::max(4 * p95, 0.01 * size); }

/// Spheres in insertion order: every prefix is the packing for that smaller number. They are about
/// the largest first, but for those that reach for thin ends.
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
