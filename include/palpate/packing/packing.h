// Filling a solid with disjoint spheres; what each of them stands for; how far the surface is.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "palpate/settings/setting_table.h"

namespace palpate::inline v0 {

// Fills a solid with non-overlapping spheres of many sizes (the job of Protosphere in the thesis).

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

// The part of a solid that each sphere of its packing stands for.

/// Spheres fill 80 to 90 % of a solid; the rest belongs to them as well. The volume of each
/// sphere's power cell (the points x where |x - c|^2 - r^2 is least), clipped to the solid, in m3.
/// The sphere itself is known exactly; what its cell holds besides is measured along 512 rays or
/// more, to .5 % rms of the volume or better; over 10 % for single ones that reach into a sharp
/// edge. What is measured is scaled so that all together are the volume of the mesh. None is less
/// than its sphere as long as the spheres are disjoint and inside. Same bits for any number of
/// threads. Error: the mesh encloses no volume, there are no spheres.
Result<std::vector<float>> represented_volumes(const TriangleMesh& solid,
                                               std::span<const Sphere> spheres, ThreadPool& pool);

// How far the surface of a solid is: a smooth scalar field in the frame of its mesh.

/// Signed distances to a closed mesh, negative inside, at the nodes of a few grids over one box:
/// the first with the finest spacing, each further one twice as wide. A grid's field is the
/// quadratic B-spline with the distances as coefficients: once continuously differentiable, exact
/// where the surface is flat, elsewhere the mean of the distance over about a ball of 1.12 times
/// its spacing. So a sphere is told the distance as it is over its own extent, and is cut rightly
/// at edges, not only at faces (docs/decisions/0030-bodies-as-fields.md).
///
/// Node (i, j, k) of a level lies at origin + spacing (i, j, k). Each grid has kMargin nodes around
/// the box on all sides, so that a ball that asks it is known to be free before it has left it.
class SolidField {
 public:
  static constexpr int kMargin = 4;
  static constexpr int kMostLevels = 8;
  /// Of the finest grid, with its margins: what bounds the size of a tool, and the resolution.
  static constexpr std::size_t kMostNodes = std::size_t(1) << 19;

  /// What decides the grids.
  struct Layout {
    Vec3d origin;                             ///< lower corner of the mesh's box, m
    double spacing = 0;                       ///< of the finest grid, m
    std::array<std::int32_t, 3> num_cells{};  ///< that the finest grid needs to cover the box
  };
  struct Level {
    double spacing = 0;                       ///< m
    std::array<std::int32_t, 3> num_nodes{};  ///< with both margins
    std::size_t first = 0;                    ///< in values(); x runs fastest, then y
  };

  /// Of a mesh that bounds a solid (check_solid). The sign is that of the majority of three rays
  /// near the surface, and follows from the distances elsewhere. O(kMostNodes) searches of the
  /// nearest triangle: about a second. Same bits for any number of threads.
  static SolidField of(const TriangleMesh& solid, ThreadPool& pool);
  /// From stored parts. Error: they do not belong together, or are no distances.
  static Result<SolidField> restore(const Layout& layout, std::span<const float> values);

  const Layout& layout() const { return layout_; }
  std::span<const Level> levels() const { return levels_; }
  std::span<const float> values() const {
    return std::span(values_).first(values_.size() - kSpareValues);
  }
  /// Values of a level.
  std::span<const float> values(int level) const;

  std::size_t num_bytes() const { return values_.size() * sizeof(float); }
  friend bool operator==(const SolidField& a, const SolidField& b);

 private:
  static constexpr std::size_t kSpareValues = 1;  // which kernels may read

  explicit SolidField(const Layout& layout);

  Layout layout_;
  std::vector<Level> levels_;
  std::vector<float> values_;
};

}  // namespace palpate::inline v0
