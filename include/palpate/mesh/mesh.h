// Triangle meshes: checks for watertight solids, mass properties, closed caps, generated shapes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

// Triangle meshes in meters.

/// Indexed triangles; counter-clockwise seen from outside.
struct TriangleMesh {
  std::vector<Vec3d> vertices;                          ///< meters
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< vertex indices
};

/// Axis-aligned box.
struct Bounds {
  Vec3d low, high;
};

/// Smallest box around all vertices; zero box for an empty mesh.
Bounds bounds(const TriangleMesh& mesh);

// Checks that a mesh bounds a solid. All later steps rely on it.

/// Limits of check_solid.
struct MeshCheckOptions {
  /// Vertices closer than this fraction of the bounding box diagonal are merged.
  double weld_fraction = 1e-7;
  /// A tool with a longer box side (m) is rejected: its unit is probably wrong.
  double max_extent = 2.0;
  /// A tool whose longest box side (m) is shorter is rejected too.
  double min_extent = 1e-4;
};

/// A mesh that bounds a solid, and the repairs that were made (one sentence each).
struct SolidMesh {
  TriangleMesh mesh;
  std::vector<std::string> warnings;
};

/// Welds vertices, drops unused ones and zero-area faces, then checks: finite coordinates, indices
/// in range, every edge in exactly two faces with opposite directions, positive volume (an
/// inside-out mesh is flipped, with a warning), no self-intersection, no overlapping or nested
/// shells with the wrong orientation, a plausible extent. The first defect is returned as an Error
/// that says what is wrong, where, and what to do. O(n log n).
Result<SolidMesh> check_solid(const TriangleMesh& raw, const MeshCheckOptions& options = {});

// Volume, center of mass and inertia of solids.

/// Mass properties at density 1 kg/m3: mass equals volume.
struct MassProperties {
  double volume = 0;     ///< m3
  Vec3d center_of_mass;  ///< m
  Mat3d inertia;         ///< kg m2 about the center of mass, axes of the given frame
};

/// Mass properties of a closed mesh, exact (divergence theorem). O(triangles).
MassProperties mass_properties(const TriangleMesh& mesh);

/// Mass properties of disjoint balls of density 1 (thesis eqs. 3.4-3.6). O(spheres).
MassProperties mass_properties(std::span<const Sphere> spheres);

// The part of a sphere behind a plane as triangles, for display (thesis section 4.3.1).

/// A cap flatter than this share of the radius is omitted, and a ball that misses no more is whole:
/// 1e-12 of the volume. Its corners would nearly coincide.
inline constexpr double kFlattestCap = 1e-6;

/// The closed surface, facing outward, of the points of the ball with normal . x <= offset: a disc
/// on the plane, rings of triangles about as high as wide, and a pole (Alg. 4.1 corrected). The
/// normal may have any length; a zero normal cuts nothing. The whole ball if all of it lies behind
/// the plane; empty if none does. All vertices except the disc center lie on the sphere, and those
/// of the disc also on the plane. So the volume is smaller than cap_volume, by at most 20 /
/// segments^2 of it. `segments`, at least 3, is the number of triangles around.
TriangleMesh cap_mesh(const Sphere& sphere, const Plane<double>& plane, int segments);

/// cap_mesh of every sphere and its plane, appended to one mesh: closed shells without shared
/// vertices. As many planes as spheres; fewer than 2^32 vertices in total.
TriangleMesh inside_mesh(std::span<const Sphere> spheres, std::span<const Plane<double>> planes,
                         int segments);

/// Upper bound of the number of triangles of a cap.
constexpr std::size_t max_cap_triangles(int segments) {
  const auto n = static_cast<std::size_t>(segments);
  return n * (n + 1);
}

// Generated closed meshes: the tools of the thesis and shapes for tests. Centered at the origin.

TriangleMesh make_box(const Vec3d& size);
/// Regular octahedron; `diameter` is the distance of opposite vertices, which lie on the axes.
TriangleMesh make_octahedron(double diameter);
/// Regular tetrahedron with the given edge; one vertex on +z, the opposite face at the bottom.
TriangleMesh make_tetrahedron(double edge);
/// Geodesic sphere: an icosahedron split `subdivisions` times (20 * 4^n triangles).
TriangleMesh make_icosphere(double radius, int subdivisions);
/// Closed cylinder along z.
TriangleMesh make_cylinder(double radius, double height, int segments);
/// A pen: cylinder along z that ends in a cone with its tip at the lowest z.
TriangleMesh make_stylus(double radius, double length, double tip_length, int segments);
/// Thickness of a bar at a height z: the sides of its rectangle, m.
struct BarSection {
  double z, x, y;
};
/// A straight bar along z with flat walls from section to section, in ascending z.
TriangleMesh make_bar(std::initializer_list<BarSection> sections);
/// A comb: teeth of width `tooth_width`, `pitch` apart along x, that hang from a back and taper to
/// `tip_width` at the lowest z; `thickness` is along y. All in m.
TriangleMesh make_comb(int num_teeth, double pitch, double tooth_width, double tip_width,
                       double tooth_length, double back_height, double thickness);
/// Helix of round wire with flat ends (thesis Fig. 3.6), axis z.
TriangleMesh make_spiral(double helix_radius, double wire_radius, double pitch, double turns,
                         int segments_per_turn, int wire_segments);
TriangleMesh make_torus(double ring_radius, double tube_radius, int ring_segments,
                        int tube_segments);

/// Names accepted by make_shape: box, octahedron, tetrahedron, sphere, cylinder, stylus, spiral,
/// torus, finger, comb, needle, blade.
std::vector<std::string> shape_names();
/// A hand-sized shape whose longest side is `size` (m). Errors: unknown name, size not > 0.
Result<TriangleMesh> make_shape(std::string_view name, double size);

}}  // namespace palpate::v0
