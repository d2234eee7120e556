#include "eval/studies/common_volume.h"

#include <algorithm>
#include <span>
#include <vector>

#include "palpate/math/geometry.h"
#include "scenes/mesh_faces.h"

namespace palpate::eval {
namespace {

std::vector<Plane<double>> planes_of(const TriangleMesh& mesh, const Pose& X_WB) {
  std::vector<Plane<double>> planes;
  scenes::for_each_face(mesh, X_WB, [&](const scenes::Triangle& face) {
    const Vec3d normal = normalized(scenes::doubled_area(face));
    planes.push_back({normal, dot(normal, face[0])});
  });
  return planes;
}

/// Calls visit(triangle) for triangles of the part of a face behind all planes. At most three
/// planes at a time: a polygon holds no more corners.
template <class Visit>
void cut(const scenes::Triangle& face, std::span<const Plane<double>> planes, const Visit& visit) {
  const auto now = planes.first(std::min<std::size_t>(3, planes.size()));
  const auto later = planes.subspan(now.size());
  scenes::Polygon polygon(face);
  for (const Plane<double>& plane : now) polygon.clip(plane);
  polygon.for_each_triangle([&](const scenes::Triangle& part) {
    if (later.empty()) {
      visit(part);
    } else {
      cut(part, later, visit);
    }
  });
}

}  // namespace

// The parts of either surface within the other body bound the common volume: it is the sum of the
// cones over them from any apex.
double common_volume(const TriangleMesh& a, const Pose& X_WA, const TriangleMesh& b,
                     const Pose& X_WB) {
  const Vec3d apex = X_WA.translation;
  double sum = 0;
  const auto add = [&](const TriangleMesh& mesh, const Pose& X_WM,
                       const std::vector<Plane<double>>& within) {
    scenes::for_each_face(mesh, X_WM, [&](const scenes::Triangle& face) {
      cut(face, within, [&](const scenes::Triangle& t) {
        sum += dot(t[0] - apex, cross(t[1] - apex, t[2] - apex)) / 6;
      });
    });
  };
  add(a, X_WA, planes_of(b, X_WB));
  add(b, X_WB, planes_of(a, X_WA));
  return sum;
}

}  // namespace palpate::eval
