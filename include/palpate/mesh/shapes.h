// Closed meshes as code: the tools of the thesis and what tests need. Centred at the origin.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/core/result.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

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
/// Where a bar along z is how thick: the sides of its rectangle.
struct BarSection {
  double z, x, y;
};
/// A straight bar along z with flat walls from section to section, in ascending z.
TriangleMesh make_bar(std::initializer_list<BarSection> sections);
/// Teeth of the width `tooth_width` that hang `pitch` apart from a back along x and taper to
/// `tip_width` at the lowest z; `thickness` is along y.
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
/// A hand-sized shape whose longest side is `size` metres. Error: unknown name, size not > 0.
Result<TriangleMesh> make_shape(std::string_view name, double size);

}  // namespace palpate
