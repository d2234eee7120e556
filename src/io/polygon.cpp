// Polygons become triangles.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "src/io/mesh_parsers.h"

namespace palpate::inline v0 {
namespace {

using Index = std::uint32_t;

/// A polygon in space, seen along its mean normal.
class Polygon {
 public:
  Polygon(const std::vector<Vec3d>& points, std::vector<Index> corners)
      : points_(points), corners_(std::move(corners)) {
    const Vec3d& origin = points_[corners_[0]];
    for (std::size_t i = 1; i + 1 < corners_.size(); ++i) {
      normal_ += cross(points_[corners_[i]] - origin, points_[corners_[i + 1]] - origin);
    }
  }

  void triangulate(TriangleMesh& mesh) && {
    constexpr std::size_t kMaxForClipping = 1000;  // Clipping ears takes cubic time at worst.
    while (corners_.size() > 3 && corners_.size() <= kMaxForClipping && !is_convex()) {
      const std::size_t ear = find_ear();
      const auto [a, b, c] = at(ear);
      mesh.triangles.push_back({a, b, c});
      corners_.erase(corners_.begin() + static_cast<std::ptrdiff_t>(ear));
    }
    for (std::size_t i = 1; i + 1 < corners_.size(); ++i) {
      mesh.triangles.push_back({corners_[0], corners_[i], corners_[i + 1]});
    }
  }

 private:
  /// Corner i between its neighbours.
  std::array<Index, 3> at(std::size_t i) const {
    const std::size_t n = corners_.size();
    return {corners_[(i + n - 1) % n], corners_[i], corners_[(i + 1) % n]};
  }

  double turn(Index a, Index b, Index c) const {
    return dot(cross(points_[b] - points_[a], points_[c] - points_[b]), normal_);
  }

  bool is_convex() const {
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const auto [a, b, c] = at(i);
      if (turn(a, b, c) < 0) return false;
    }
    return true;
  }

  /// Is p in the triangle, but none of its corners?
  bool is_inside(const std::array<Index, 3>& t, Index p) const {
    return std::find(t.begin(), t.end(), p) == t.end() && turn(t[0], t[1], p) >= 0 &&
           turn(t[1], t[2], p) >= 0 && turn(t[2], t[0], p) >= 0;
  }

  /// A convex corner whose triangle holds no other corner; the first corner if there is none.
  std::size_t find_ear() const {
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const std::array<Index, 3> ear = at(i);
      if (!(turn(ear[0], ear[1], ear[2]) > 0)) continue;
      const bool is_empty = std::none_of(corners_.begin(), corners_.end(),
                                         [&](Index p) { return is_inside(ear, p); });
      if (is_empty) return i;
    }
    return 0;
  }

  const std::vector<Vec3d>& points_;
  std::vector<Index> corners_;
  Vec3d normal_;
};

}  // namespace

std::optional<Error> add_polygon(TriangleMesh& mesh, std::span<const double> indices,
                                 const std::string& where) {
  if (indices.size() < 3) {
    return Error{Errc::bad_input,
                 "has a face with only " + std::to_string(indices.size()) + " corners" + where};
  }
  std::vector<Index> corners;
  for (const double index : indices) {
    if (!(index >= 0 && index < static_cast<double>(mesh.vertices.size()) &&
          index == std::floor(index))) {
      char text[64];
      std::snprintf(text, sizeof text, "%.17g", index);
      return Error{Errc::bad_input, "has an index out of range" + where + ": vertex " + text +
                                        " of " + std::to_string(mesh.vertices.size()) +
                                        " (counted from 0)"};
    }
    corners.push_back(static_cast<Index>(index));
  }
  Polygon(mesh.vertices, std::move(corners)).triangulate(mesh);
  return std::nullopt;
}

}  // namespace palpate::inline v0
