// Smooth bodies: signed distances of the parts, a soft minimum, and marching tetrahedra.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_map>
#include <vector>

#include "scenes/body_shapes.h"
#include "src/core/internal/assert.h"

namespace palpate { inline namespace v0 { namespace scenes {
namespace {

/// The hull of two neighboring balls of a chain.
struct Segment {
  Vec3d begin, axis;
  double radius, length, taper;
  double lean;    ///< of its normals: slope of the half angle of the cone
  Vec3d middle;   ///< of a ball around it,
  double around;  ///< with this radius

  Segment(const Ball& a, const Ball& b)
      : begin(a.center),
        axis(b.center - a.center),
        radius(a.radius),
        length(norm(axis)),
        taper(a.radius - b.radius),
        lean(taper / std::sqrt(length * length - taper * taper)),
        middle(a.center + axis * 0.5),
        around(length / 2 + std::max(a.radius, b.radius)) {}

  double distance(const Vec3d& p) const {
    const double along = dot(p - begin, axis) / length;
    const double across = norm(p - begin - axis * (along / length));
    // Following the normals back leads to the nearest ball.
    const double s = std::clamp(along - across * lean, 0.0, length);
    return std::hypot(across, along - s) - (radius - taper * s / length);
  }

  /// Returns whether every point of it is farther from p than that, for sure.
  bool is_beyond(double limit, const Vec3d& p) const {
    constexpr double kRounded = 1e-9;  // m, more than what rounding changes
    const Vec3d away = p - middle;
    const double reach = around + limit + kRounded;
    return reach > 0 && dot(away, away) > reach * reach;
  }
};

std::vector<Segment> segments_of(const BallChain& chain) {
  std::vector<Segment> segments;
  for (std::size_t i = 1; i < chain.size(); ++i) segments.emplace_back(chain[i - 1], chain[i]);
  return segments;
}

/// Returns the distance to a chain, or more than `limit` if it is farther than that.
double distance(const std::vector<Segment>& chain, const Vec3d& p, double limit) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const Segment& segment : chain) {
    if (segment.is_beyond(std::min(nearest, limit), p)) continue;
    nearest = std::min(nearest, segment.distance(p));
  }
  return nearest;
}

/// First order: exact on the surface, where it counts.
double distance(const Ellipsoid& ellipsoid, const Vec3d& p) {
  const Vec3d &r = ellipsoid.radii, d = p - ellipsoid.center;
  const Vec3d scaled{d.x / r.x, d.y / r.y, d.z / r.z};
  const double k = norm(scaled);
  const double slope = norm(Vec3d{scaled.x / r.x, scaled.y / r.y, scaled.z / r.z});
  return slope > 0 ? k * (k - 1) / slope : -std::min({r.x, r.y, r.z});
}

/// Returns the minimum, which rounds the crease between surfaces closer than `blend`: what is
/// farther changes nothing.
double soft_minimum(double a, double b, double blend) {
  const double h = std::max(0.0, blend - std::abs(a - b));
  return std::min(a, b) - h * h / (4 * blend);
}

/// Values at the nodes of a box of cubes.
struct Grid {
  Vec3d low;
  double cell;
  std::array<std::size_t, 3> nodes;  ///< per axis
  std::vector<double> values;

  std::size_t index(std::size_t i, std::size_t j, std::size_t k) const {
    return (k * nodes[1] + j) * nodes[0] + i;
  }
  Vec3d position(std::size_t node) const {
    const std::size_t row = node / nodes[0], i = node % nodes[0], j = row % nodes[1],
                      k = row / nodes[1];
    return low +
           Vec3d{static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)} * cell;
  }
};

/// Cuts each cube into six tetrahedra around its diagonal; a tetrahedron meets the surface in at
/// most four edges, so that, unlike with cubes, no case is ambiguous and the mesh is always closed.
class MarchingTetrahedra {
 public:
  explicit MarchingTetrahedra(const Grid& grid) : grid_(grid) {}

  TriangleMesh run() {
    // Corner bits x 1, y 2, z 4; every row has positive orientation.
    constexpr std::size_t kTetrahedra[6][4] = {{0, 1, 3, 7}, {0, 1, 7, 5}, {0, 2, 7, 3},
                                               {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 7, 6}};
    const auto& n = grid_.nodes;
    for (std::size_t k = 0; k + 1 < n[2]; ++k) {
      for (std::size_t j = 0; j + 1 < n[1]; ++j) {
        for (std::size_t i = 0; i + 1 < n[0]; ++i) {
          for (const auto& corners : kTetrahedra) {
            std::array<std::size_t, 4> tetrahedron;
            for (std::size_t c = 0; c < 4; ++c) {
              const std::size_t bits = corners[c];
              tetrahedron[c] = grid_.index(i + (bits & 1), j + (bits >> 1 & 1), k + (bits >> 2));
            }
            cut(tetrahedron);
          }
        }
      }
    }
    return std::move(mesh_);
  }

 private:
  using Tetrahedron = std::array<std::size_t, 4>;

  void cut(const Tetrahedron& t) {
    unsigned inside = 0;
    for (unsigned c = 0; c < 4; ++c) inside |= (grid_.values[t[c]] < 0 ? 1u : 0u) << c;
    if (inside == 0 || inside == 15u) return;
    // Even orders of the corners, the one alone (or the two inside) first.
    constexpr std::size_t kAlone[4][4] = {{0, 1, 2, 3}, {1, 0, 3, 2}, {2, 0, 1, 3}, {3, 0, 2, 1}};
    constexpr std::size_t kPairs[6][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2},
                                          {1, 2, 0, 3}, {1, 3, 2, 0}, {2, 3, 0, 1}};
    for (const auto& [a, b, c, d] : kAlone) {
      if (inside == 1u << a) add(vertex(t[a], t[b]), vertex(t[a], t[c]), vertex(t[a], t[d]));
      if (inside == (15u ^ 1u << a))
        add(vertex(t[a], t[b]), vertex(t[a], t[d]), vertex(t[a], t[c]));
    }
    for (const auto& [a, b, c, d] : kPairs) {
      if (inside != (1u << a | 1u << b)) continue;
      add(vertex(t[a], t[c]), vertex(t[a], t[d]), vertex(t[b], t[d]));
      add(vertex(t[a], t[c]), vertex(t[b], t[d]), vertex(t[b], t[c]));
    }
  }

  void add(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    mesh_.triangles.push_back({a, b, c});
  }

  /// Where the surface crosses the edge of two nodes.
  std::uint32_t vertex(std::size_t a, std::size_t b) {
    const auto [low, high] = std::minmax(a, b);
    const auto [entry, is_new] = vertices_.try_emplace(
        low * grid_.values.size() + high, static_cast<std::uint32_t>(mesh_.vertices.size()));
    if (is_new) {
      const double at_low = grid_.values[low], at_high = grid_.values[high];
      const Vec3d p = grid_.position(low), q = grid_.position(high);
      mesh_.vertices.push_back(p + (q - p) * (at_low / (at_low - at_high)));
    }
    return entry->second;
  }

  const Grid& grid_;
  TriangleMesh mesh_;
  std::unordered_map<std::size_t, std::uint32_t> vertices_;  ///< by edge
};

}  // namespace

TriangleMesh blended(std::span<const BallChain> chains, std::span<const Ellipsoid> ellipsoids,
                     double blend, double cell) {
  PALPATE_ASSERT(blend > 0 && cell > 0);
  TriangleMesh extremes;
  const auto reach = [&](const Vec3d& center, const Vec3d& radii) {
    extremes.vertices.push_back(center - radii);
    extremes.vertices.push_back(center + radii);
  };
  for (const BallChain& chain : chains) {
    for (const Ball& ball : chain) reach(ball.center, Vec3d{1, 1, 1} * ball.radius);
  }
  for (const Ellipsoid& e : ellipsoids) reach(e.center, e.radii);
  const Bounds box = bounds(extremes);
  const double margin = blend + 2 * cell;

  Grid grid{box.low - Vec3d{margin, margin, margin}, cell, {}, {}};
  for (int axis = 0; axis < 3; ++axis) {
    grid.nodes[static_cast<std::size_t>(axis)] =
        static_cast<std::size_t>((box.high[axis] - box.low[axis] + 2 * margin) / cell) + 1;
  }
  grid.values.resize(grid.nodes[0] * grid.nodes[1] * grid.nodes[2]);
  std::vector<std::vector<Segment>> parts;
  for (const BallChain& chain : chains) parts.push_back(segments_of(chain));
  for (std::size_t node = 0; node < grid.values.size(); ++node) {
    const Vec3d p = grid.position(node);
    double value = margin;
    for (const auto& part : parts) {
      value = soft_minimum(value, distance(part, p, value + blend), blend);
    }
    for (const Ellipsoid& e : ellipsoids) value = soft_minimum(value, distance(e, p), blend);
    grid.values[node] = value;
  }
  return MarchingTetrahedra(grid).run();
}

}}}  // namespace palpate::v0::scenes
