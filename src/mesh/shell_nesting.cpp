#include "src/mesh/shell_nesting.h"

#include <algorithm>
#include <cmath>

#include "palpate/math/geometry.h"
#include "src/mesh/mesh_topology.h"

namespace palpate::inline v0 {
namespace {

bool contains(const Bounds& box, const Vec3d& p) {
  return box.low.x <= p.x && p.x <= box.high.x && box.low.y <= p.y && p.y <= box.high.y &&
         box.low.z <= p.z && p.z <= box.high.z;
}

/// How often the shell winds around p: +-1 inside, 0 outside. Sums the solid angles of the faces
/// (van Oosterom and Strackee 1983), which needs no ray and thus has no unlucky direction.
double winding_number(const TriangleMesh& mesh, const Shell& shell, const Vec3d& p) {
  double solid_angle = 0;
  for (const std::uint32_t face : shell.faces) {
    const Triangle& t = mesh.triangles[face];
    const Vec3d a = mesh.vertices[t[0]] - p, b = mesh.vertices[t[1]] - p,
                c = mesh.vertices[t[2]] - p;
    const double la = norm(a), lb = norm(b), lc = norm(c);
    solid_angle += 2 * std::atan2(dot(a, cross(b, c)),
                                  la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
  }
  return solid_angle / (4 * kPi);
}

}  // namespace

std::vector<Shell> find_shells(const TriangleMesh& mesh) {
  std::vector<Shell> shells;
  const std::vector<std::uint32_t> shell_of = shell_of_faces(mesh.triangles);
  for (std::uint32_t face = 0; face < shell_of.size(); ++face) {
    const Triangle& t = mesh.triangles[face];
    const Vec3d &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    if (shell_of[face] == shells.size()) {
      shells.push_back({{}, {a, a}, 0, 0, a + ((b - a) + (c - a)) / 3});
    }
    Shell& shell = shells[shell_of[face]];
    shell.faces.push_back(face);
    for (const Vec3d& p : {a, b, c}) {
      for (int axis = 0; axis < 3; ++axis) {
        shell.box.low[axis] = std::min(shell.box.low[axis], p[axis]);
        shell.box.high[axis] = std::max(shell.box.high[axis], p[axis]);
      }
    }
    const Vec3d& origin = shell.sample;  // Close by, so that far meshes lose no digits.
    shell.signed_volume += dot(a - origin, cross(b - origin, c - origin)) / 6;
    shell.area += norm(cross(b - a, c - a)) / 2;
  }
  return shells;
}

std::vector<std::vector<std::size_t>> find_enclosing_shells(const TriangleMesh& mesh,
                                                            const std::vector<Shell>& shells) {
  std::vector<std::vector<std::size_t>> enclosing(shells.size());
  for (std::size_t inner = 0; inner < shells.size(); ++inner) {
    const Vec3d& p = shells[inner].sample;
    for (std::size_t outer = 0; outer < shells.size(); ++outer) {
      if (inner != outer && contains(shells[outer].box, p) &&
          std::abs(winding_number(mesh, shells[outer], p)) > 0.5) {
        enclosing[inner].push_back(outer);
      }
    }
  }
  return enclosing;
}

}  // namespace palpate::inline v0
