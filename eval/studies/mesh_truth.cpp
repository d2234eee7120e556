#include "eval/studies/mesh_truth.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate::eval {
namespace {

constexpr double kMaxCells = 200;  // along an axis

/// Returns the point of a triangle nearest to p (Ericson, Real-Time Collision Detection, 5.1.5).
Vec3d nearest_on(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& p) {
  const Vec3d ab = b - a, ac = c - a, ap = p - a, bp = p - b, cp = p - c;
  const double d1 = dot(ab, ap), d2 = dot(ac, ap), d3 = dot(ab, bp), d4 = dot(ac, bp),
               d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d1 <= 0 && d2 <= 0) return a;
  if (d3 >= 0 && d4 <= d3) return b;
  if (d6 >= 0 && d5 <= d6) return c;
  const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
  if (va <= 0 && d4 >= d3 && d5 >= d6) return b + (d4 - d3) / (d4 - d3 + d5 - d6) * (c - b);
  return a + vb / (va + vb + vc) * ab + vc / (va + vb + vc) * ac;
}

void extend(Bounds& box, const Vec3d& p) {
  for (int i = 0; i < 3; ++i) {
    box.low[i] = std::min(box.low[i], p[i]);
    box.high[i] = std::max(box.high[i], p[i]);
  }
}

}  // namespace

MeshInside::MeshInside(const TriangleMesh& mesh) : box_(bounds(mesh)) {
  const Vec3d size = box_.high - box_.low;
  cell_ = std::max(size.x, size.y) / kMaxCells;
  columns_ = static_cast<int>(size.x / cell_) + 1;
  rows_ = static_cast<int>(size.y / cell_) + 1;
  by_column_.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
  for (const auto& t : mesh.triangles) {
    const Face face{mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]};
    Bounds its{face.a, face.a};
    extend(its, face.b), extend(its, face.c);
    const auto cell = [&](double x, double low) { return static_cast<int>((x - low) / cell_); };
    for (int y = cell(its.low.y, box_.low.y); y <= cell(its.high.y, box_.low.y); ++y) {
      for (int x = cell(its.low.x, box_.low.x); x <= cell(its.high.x, box_.low.x); ++x) {
        by_column_[static_cast<std::size_t>(y * columns_ + x)].push_back(
            static_cast<int>(faces_.size()));
      }
    }
    faces_.push_back(face);
  }
}

bool MeshInside::contains(const Vec3d& p) const {
  for (int i = 0; i < 3; ++i) {
    if (p[i] < box_.low[i] || p[i] > box_.high[i]) return false;
  }
  const auto x = static_cast<int>((p.x - box_.low.x) / cell_);
  const auto y = static_cast<int>((p.y - box_.low.y) / cell_);
  bool is_inside = false;
  for (const int f : by_column_[static_cast<std::size_t>(y * columns_ + x)]) {
    const Face& face = faces_[static_cast<std::size_t>(f)];
    // Crossing of a ray along +z, by areas in the xy plane.
    const auto area = [&](const Vec3d& q, const Vec3d& r) {
      return (q.x - p.x) * (r.y - p.y) - (q.y - p.y) * (r.x - p.x);
    };
    const double a = area(face.b, face.c), b = area(face.c, face.a), c = area(face.a, face.b);
    const bool is_met = (a > 0 && b > 0 && c > 0) || (a < 0 && b < 0 && c < 0);
    if (is_met && (a * face.a.z + b * face.b.z + c * face.c.z) / (a + b + c) > p.z) {
      is_inside = !is_inside;
    }
  }
  return is_inside;
}

Vec3d MeshInside::outward(const std::vector<Vec3d>& inside) const {
  if (inside.empty()) return {};
  Bounds box{inside.front(), inside.front()};
  for (const Vec3d& p : inside) extend(box, p);
  const auto way_to = [](const Face& face, const Vec3d& p) {
    return nearest_on(face.a, face.b, face.c, p) - p;
  };
  double reach = std::numeric_limits<double>::infinity();
  for (const Face& face : faces_) reach = std::min(reach, norm(way_to(face, inside.front())));
  reach += norm(box.high - box.low);  // from the first point to another and back
  std::vector<const Face*> near;
  for (const Face& face : faces_) {
    Bounds its{face.a, face.a};
    extend(its, face.b), extend(its, face.c);
    bool is_near = true;
    for (int i = 0; i < 3; ++i) {
      is_near = is_near && its.low[i] <= box.high[i] + reach && its.high[i] >= box.low[i] - reach;
    }
    if (is_near) near.push_back(&face);
  }
  Vec3d sum;
  for (const Vec3d& p : inside) {
    double least = std::numeric_limits<double>::infinity();
    Vec3d way;
    for (const Face* face : near) {
      const Vec3d to = way_to(*face, p);
      if (dot(to, to) < least) least = dot(to, to), way = to;
    }
    if (least > 0 && std::isfinite(least)) sum += 1 / std::sqrt(least) * way;
  }
  return sum;
}

std::vector<Vec3d> points_inside(const TriangleMesh& mesh, double spacing) {
  const MeshInside inside(mesh);
  const Bounds box = bounds(mesh);
  std::vector<Vec3d> points;
  for (double x = box.low.x + 0.3711 * spacing; x < box.high.x; x += spacing) {
    for (double y = box.low.y + 0.6173 * spacing; y < box.high.y; y += spacing) {
      for (double z = box.low.z + 0.4587 * spacing; z < box.high.z; z += spacing) {
        if (inside.contains({x, y, z})) points.push_back({x, y, z});
      }
    }
  }
  return points;
}

SampledPenetration sampled_penetration(const std::vector<Vec3d>& points_T, const Pose& X_BT,
                                       const MeshInside& body, std::size_t every) {
  std::size_t num = 0;
  std::vector<Vec3d> used;
  for (const Vec3d& p_T : points_T) {
    const Vec3d p = X_BT * p_T;
    if (body.contains(p) && num++ % every == 0) used.push_back(p);
  }
  const auto all = static_cast<double>(points_T.size());
  const double each = static_cast<double>(num) / std::max<double>(1, used.size());
  return {static_cast<double>(num) / all, each / all * body.outward(used)};
}

}  // namespace palpate::eval
