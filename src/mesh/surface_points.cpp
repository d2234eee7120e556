#include "src/mesh/internal/surface_points.h"

#include <array>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

/// The fractional part.
double fraction(double x) { return x - std::floor(x); }

}  // namespace

// Equal steps along the triangles laid end to end, and within each triangle the low-discrepancy
// sequence of the plastic number g, g^3 = g + 1.
std::vector<Vec3d> surface_points(const TriangleMesh& mesh, int num) {
  const auto corners = [&mesh](std::size_t i) {
    const auto& t = mesh.triangles[i];
    return std::array{mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]};
  };
  std::vector<double> area_up_to;  // of triangles 0 ... i
  double area = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto [a, b, c] = corners(i);
    area += norm(cross(b - a, c - a)) / 2;
    area_up_to.push_back(area);
  }
  std::vector<Vec3d> points;
  std::size_t i = 0;
  for (int k = 0; k < num; ++k) {
    while (i + 1 < area_up_to.size() && area_up_to[i] <= area * (k + 0.5) / num) ++i;
    const auto [a, b, c] = corners(i);
    constexpr double kPlastic = 1.32471795724474602596;
    double u = fraction(0.5 + k / kPlastic), v = fraction(0.5 + k / (kPlastic * kPlastic));
    if (u + v > 1) u = 1 - u, v = 1 - v;
    points.push_back(a + (b - a) * u + (c - a) * v);
  }
  return points;
}

}}  // namespace palpate::v0
