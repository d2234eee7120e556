// Polygons become triangles.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "src/io/meshes/mesh_parsers.h"

namespace palpate { inline namespace v0 {
namespace {

using Index = std::uint32_t;

constexpr std::int64_t kTestsPerCorner = 10;  // that a file may need at any size

/// A polygon in space, seen along its mean normal.
class Polygon {
 public:
  /// Takes off `tests_left` how often it looks for ears at corners.
  Polygon(const std::vector<Vec3d>& points, std::vector<Index> corners, std::int64_t& tests_left)
      : points_(points), corners_(std::move(corners)), tests_left_(tests_left) {
    const Vec3d& origin = points_[corners_[0]];
    for (std::size_t i = 1; i + 1 < corners_.size(); ++i) {
      normal_ += cross(points_[corners_[i]] - origin, points_[corners_[i + 1]] - origin);
    }
  }

  /// False: it takes too much time.
  bool triangulate(TriangleMesh& mesh) && {
    constexpr std::size_t kMaxForClipping = 1000;  // Clipping ears takes cubic time at worst.
    while (corners_.size() > 3 && corners_.size() <= kMaxForClipping && !is_convex()) {
      const std::size_t ear = find_ear();
      if (tests_left_ < 0) return false;
      const auto [a, b, c] = at(ear);
      mesh.triangles.push_back({a, b, c});
      corners_.erase(corners_.begin() + static_cast<std::ptrdiff_t>(ear));
    }
    for (std::size_t i = 1; i + 1 < corners_.size(); ++i) {
      mesh.triangles.push_back({corners_[0], corners_[i], corners_[i + 1]});
    }
    return true;
  }

 private:
  /// Corner i between its neighbors.
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
  std::size_t find_ear() {
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const std::array<Index, 3> ear = at(i);
      --tests_left_;
      if (!(turn(ear[0], ear[1], ear[2]) > 0)) continue;
      const auto inside = std::find_if(corners_.begin(), corners_.end(),
                                       [&](Index p) { return is_inside(ear, p); });
      tests_left_ -= inside - corners_.begin();
      if (inside == corners_.end() || tests_left_ < 0) return i;
    }
    return 0;
  }

  const std::vector<Vec3d>& points_;
  std::vector<Index> corners_;
  std::int64_t& tests_left_;
  Vec3d normal_;
};

}  // namespace

std::optional<Error> PolygonCutter::add(std::span<const double> indices, const std::string& where) {
  if (indices.size() < 3) {
    return Error{Errc::bad_input,
                 "has a face with only " + std::to_string(indices.size()) + " corners" + where};
  }
  tests_left_ += kTestsPerCorner * static_cast<std::int64_t>(indices.size());
  std::vector<Index> corners;
  for (const double index : indices) {
    if (!(index >= 0 && index < static_cast<double>(mesh_.vertices.size()) &&
          index == std::floor(index))) {
      char text[64];
      std::snprintf(text, sizeof text, "%.17g", index);
      return Error{Errc::bad_input, "has an index out of range" + where + ": vertex " + text +
                                        " of " + std::to_string(mesh_.vertices.size()) +
                                        " (counted from 0)"};
    }
    corners.push_back(static_cast<Index>(index));
  }
  if (Polygon(mesh_.vertices, std::move(corners), tests_left_).triangulate(mesh_)) {
    return std::nullopt;
  }
  return Error{Errc::bad_input,
               "has too many concave faces of hundreds of corners; make triangles of its faces"};
}

}}  // namespace palpate::v0
