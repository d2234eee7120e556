// Fills a solid with disjoint spheres; represented volumes; the distance field of a mesh.
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

namespace palpate { inline namespace v0 {

// Fills a solid with disjoint spheres of many sizes (Protosphere in the thesis).

/// Passed to the progress callback a few times per second.
struct PackProgress {
  int num_spheres = 0;
  double fill = 0;         ///< sphere volume / mesh volume so far
  double last_radius = 0;  ///< meters
};

/// Packing stops at the first limit reached.
struct PackOptions {
  int max_spheres = 5000;
  /// m: stop when 95 % of the surface are at most this far from the nearest sphere. Checked from
  /// kReachingSpheres spheres on, each time their number has grown by a twentieth. 0: no limit.
  double standoff = 0;
  double max_radius = 1000;  ///< meters
  double min_radius = 0;     ///< meters, at most max_radius
  double max_fill = 1;       ///< sphere volume / mesh volume
  double max_seconds = 1e9;
  std::uint64_t seed = 0;  ///< jitters the starting grid; 0 is the plain grid
  int num_threads = 0;     ///< 0: one per core. The result has the same bits for any number.
  /// Called on the packing thread; return false to cancel. May be empty.
  std::function<bool(const PackProgress&)> progress = {};
};
/// Limits of a packing, as settings.
inline void add_settings(SettingTable& t, PackOptions& o) {
  t.section("packing");
  // Two million spheres need 2.5 GB while they are packed.
  t.add("spheres", o.max_spheres, {1, 2e6, "spheres"}, "maximum number");
  t.add("standoff", o.standoff, {0, 1000, "m"},
        "stop when 95 % of the surface are this near to a sphere; 0: no limit");
  t.add("max_radius", o.max_radius, {1e-9, 1000, "m"}, "maximum radius");
  t.add("min_radius", o.min_radius, {0, 1000, "m"}, "stop at smaller spheres");
  t.add("max_fill", o.max_fill, {1e-9, 1}, "stop at this fraction of the mesh volume");
  t.add("max_seconds", o.max_seconds, {1e-3, 1e9, "s"}, "stop after this time");
}

/// The limit that ended the packing.
enum class PackStop { count, fill, radius, time, exhausted, standoff };

/// The standoff of a surface point is its distance to the nearest sphere; a contact is measured
/// late by it. Greedy packing alone leaves ends empty that are thinner than its smallest spheres.
/// So from kReachingSpheres spheres on, no standoff exceeds standoff_bound(95 % quantile, longest
/// side of the solid), checked at kStandoffSamples surface points, unless a limit of PackOptions or
/// single precision excludes spheres there.
inline constexpr int kReachingSpheres = 1000;
inline constexpr int kStandoffSamples = 20000;
inline double standoff_bound(double p95, double size) { return std::max(4 * p95, 0.01 * size); }

/// Spheres in insertion order: every prefix is the packing of that smaller number. Roughly the
/// largest first, except for those in thin ends.
struct SpherePacking {
  std::vector<Sphere> spheres;  ///< mesh frame, meters
  double mesh_volume = 0;       ///< m3
  PackStop stop = PackStop::count;
};

/// Packs a mesh that passed check_solid. Spheres are strictly inside and disjoint, verified in
/// double precision on the stored single-precision numbers. Errors: cancelled; invalid options; no
/// sphere fits. Fewer spheres than requested is not an error (see `stop`).
Result<SpherePacking> pack_spheres(const TriangleMesh& solid, const PackOptions& options);

// The part of a solid that each sphere of its packing represents.

/// One entry for each sphere.
struct RepresentedParts {
  std::vector<float> volumes;  ///< m3
  /// Ball with the centroid of the part and its second moment about it (the sum over three axes),
  /// mesh frame, m. Its radius is at most 1.5 times that of the ball of the part's volume.
  std::vector<Sphere> balls;
};

/// Shares a solid among the spheres of its packing. Spheres fill 80 to 90 % of a solid; the rest is
/// assigned to them. A part is the sphere's power cell (the points x where |x - c|^2 - r^2 is
/// smallest), clipped to the solid. The sphere itself is exact; the rest of the cell is measured
/// along at least 512 rays, to .5 % rms of the volume or better, and over 10 % for single cells
/// that reach into a sharp edge. The measured parts are scaled so that the sum of the volumes is
/// the volume of the mesh. No volume is below the sphere's if the spheres are disjoint and inside.
/// Same bits for any number of threads. Errors: the mesh encloses no volume; no spheres.
Result<RepresentedParts> represented_parts(const TriangleMesh& solid,
                                           std::span<const Sphere> spheres, ThreadPool& pool);

// Distance field of a solid: a smooth scalar field in the frame of its mesh.

/// Signed distances to a closed mesh, negative inside, at the nodes of a few grids over one box.
/// The first grid is the finest; each next spacing is twice as large. The field of a grid is the
/// quadratic B-spline with the distances as coefficients: C1, exact where the surface is flat,
/// elsewhere the mean of the distance over about a ball of 1.12 times the spacing. So a sphere gets
/// the distance averaged over its own extent, and is cut correctly at edges, not only at faces
/// (docs/decisions/0030-bodies-as-fields.md).
///
/// Node (i, j, k) of a level lies at origin + spacing (i, j, k). Each grid has kMargin extra nodes
/// around the box on all sides, so a sphere is known to be in free space before it leaves the grid.
class SolidField {
 public:
  static constexpr int kMargin = 4;
  static constexpr int kMaxLevels = 8;
  /// Nodes of the finest grid with margins: limits the size of a tool and the resolution.
  static constexpr std::size_t kMaxNodes = std::size_t(1) << 19;

  /// Determines the grids.
  struct Layout {
    Vec3d origin;                             ///< lower corner of the mesh's box, m
    double spacing = 0;                       ///< of the finest grid, m
    std::array<std::int32_t, 3> num_cells{};  ///< of the finest grid, to cover the box
  };
  /// One grid of the field.
  struct Level {
    double spacing = 0;                       ///< m
    std::array<std::int32_t, 3> num_nodes{};  ///< including both margins
    std::size_t first = 0;                    ///< in values(); x runs fastest, then y
  };

  /// Computes the field of a mesh that bounds a solid (check_solid). Near the surface the sign is
  /// the majority of three rays; elsewhere it follows from the distances. O(kMaxNodes)
  /// nearest-triangle searches: about a second. Same bits for any number of threads.
  static SolidField of(const TriangleMesh& solid, ThreadPool& pool);
  /// From stored parts. Errors: inconsistent sizes, or values that are not distances.
  static Result<SolidField> restore(const Layout& layout, std::span<const float> values);

  /// Position, spacing and size of the grids.
  const Layout& layout() const { return layout_; }
  /// From the finest to the coarsest grid.
  std::span<const Level> levels() const { return levels_; }
  /// Signed distances of all levels, m, negative inside.
  std::span<const float> values() const {
    return std::span(values_).first(values_.size() - kSpareValues);
  }
  /// Values of one level.
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

}}  // namespace palpate::v0
