// The part of a tool in a closed mesh, and its outward direction: by brute force over points, in
// double. The reference where the scene is a mesh.
#pragma once

#include <vector>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate::eval {

/// Point-in-mesh test for a closed mesh. O(triangles of a column) per point.
class MeshInside {
 public:
  explicit MeshInside(const TriangleMesh& mesh);
  bool contains(const Vec3d& p) const;
  /// Returns the sum of the outward normals of the surface nearest to each point. O(points x
  /// triangles nearby); points have to be inside.
  Vec3d outward(const std::vector<Vec3d>& inside) const;

 private:
  struct Face {
    Vec3d a, b, c;
  };
  Bounds box_;
  double cell_ = 0;  ///< m, of the columns along z
  int columns_ = 0, rows_ = 0;
  std::vector<Face> faces_;                  ///< of the mesh
  std::vector<std::vector<int>> by_column_;  ///< faces above and below each cell of the xy plane
};

/// Returns the points of a grid of this spacing (m) inside a closed mesh, off its symmetries.
std::vector<Vec3d> points_inside(const TriangleMesh& mesh, double spacing);

/// Shares of the tool, in the frame of the mesh: the volume inside, and the sum of its outward
/// normals.
struct SampledPenetration {
  double share = 0;
  Vec3d force;
};
/// Measures; `points_T` fill the tool evenly; every `every`-th of those inside gives a normal.
SampledPenetration sampled_penetration(const std::vector<Vec3d>& points_T, const Pose& X_BT,
                                       const MeshInside& body, std::size_t every = 8);

}  // namespace palpate::eval
