// Distances from a point to a triangle mesh.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

struct Triangle {
  Vec3d a, b, c;
};

/// The point of the triangle that is closest to p.
Vec3d closest_point(const Triangle& triangle, const Vec3d& p);

/// Four-wide bounding volume hierarchy. Besides its box a child has a slab across its mean normal,
/// which stays thin on curved surfaces: seen from inside a round tool all boxes are about equally
/// near, slabs are not. Both are single precision and slightly too large, triangles are exact:
/// boxes and slabs only decide what is looked at.
class TriangleBvh {
 public:
  struct Closest {
    double distance = std::numeric_limits<double>::infinity();
    Vec3d point;
    int triangle = -1;  ///< -1: nothing within the given distance
  };

  explicit TriangleBvh(const TriangleMesh& mesh);

  /// Closest point of the surface not farther than `max_distance`. When a search grows long, as at
  /// the center of a finely tessellated ball where all triangles are about equally far, its result
  /// may be too far by the fraction `tolerance`.
  Closest closest(const Vec3d& p, double max_distance, double tolerance = 0) const;

  /// Appends every triangle not farther than `distance` from p; false, with a part of them
  /// appended, as soon as they are more than `limit`.
  bool gather(const Vec3d& p, double distance, std::size_t limit, std::vector<int>& out) const;

  /// True if p lies in the solid: majority of the parities of three rays.
  bool inside(const Vec3d& p) const;

  const Triangle& triangle(int i) const { return triangles_[static_cast<std::size_t>(i)]; }
  int num_triangles() const { return static_cast<int>(triangles_.size()); }

 private:
  // A child >= 0 is a node; below 0 it is the leaf of triangles [first, first + count).
  typedef float Float4 __attribute__((vector_size(16)));
  struct Node {
    Float4 low[3], high[3];
    Float4 normal[3], slab_low, slab_high;
    std::int32_t child[4];
    std::int32_t count[4];  ///< of a leaf; -1: no child
  };
  struct Builder;
  static Float4 distances2(const Node& node, const Vec3f& p);
  int count_crossings(const Vec3d& p, const Vec3d& direction) const;

  Vec3d origin_;
  std::vector<Node> nodes_;
  std::vector<Triangle> triangles_;
};

}}  // namespace palpate::v0
