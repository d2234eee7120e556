// Distances from a point to a triangle mesh.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

struct Triangle {
  Vec3d a, b, c;
};

/// The point of the triangle that is closest to p.
Vec3d closest_point(const Triangle& triangle, const Vec3d& p);

/// Four-wide bounding volume hierarchy. Boxes are single precision and slightly too large, triangles
/// are exact: boxes only decide what is looked at.
class TriangleBvh {
 public:
  struct Closest {
    double distance = std::numeric_limits<double>::infinity();
    Vec3d point;
    int triangle = -1;  ///< -1: nothing within the asked distance
  };

  explicit TriangleBvh(const TriangleMesh& mesh);

  /// Closest point of the surface not farther than `max_distance`. With `tolerance` > 0 the
  /// distance may be too large by that fraction, which saves work where many triangles are
  /// almost equally far, as at the centre of a finely tessellated ball.
  Closest closest(const Vec3d& p, double max_distance, double tolerance = 0) const;

  /// Appends every triangle not farther than `distance` from p; false, with a part of them
  /// appended, as soon as they are more than `limit`.
  bool gather(const Vec3d& p, double distance, std::size_t limit, std::vector<int>& out) const;

  /// Whether p lies in the solid: majority of the parities of three rays.
  bool inside(const Vec3d& p) const;

  const Triangle& triangle(int i) const { return triangles_[static_cast<std::size_t>(i)]; }
  int num_triangles() const { return static_cast<int>(triangles_.size()); }

 private:
  // A child >= 0 is a node; below 0 it is the leaf of triangles [first, first + count).
  struct alignas(16) Node {
    float low[3][4], high[3][4];
    std::int32_t child[4];
    std::int32_t count[4];  ///< of a leaf; -1: no child
  };
  struct Builder;
  void distances2(const Node& node, const float p[3], float out[4]) const;
  std::array<float, 3> local(const Vec3d& p) const;
  int count_crossings(const Vec3d& p, const Vec3d& direction) const;

  Vec3d origin_;
  std::vector<Node> nodes_;
  std::vector<Triangle> triangles_;
};

}  // namespace palpate
