// The wrapped inner sphere tree: leaves are the spheres of the packing, every inner node is a ball
// that contains all *leaves* below it (thesis section 3.1.1, Fig. 3.2c).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/core/result.h"
#include "palpate/math/sphere.h"

namespace palpate {

/// One node. Inner nodes have `num_children` children stored next to each other from
/// `first_child`; leaves have num_children = 0 and name their sphere.
struct IstNode {
  Sphere bound;
  std::int32_t first_child = -1;
  std::int32_t num_children = 0;
  std::int32_t sphere_id = -1;  ///< leaves: index into the packing
  std::int32_t parent = -1;     ///< -1 for the root
};

/// Owns the nodes; node 0 is the root. Built once per tool, O(n log n).
class InnerSphereTree {
 public:
  static constexpr int kBranching = 4;
  /// Halves differ by at most one leaf, so 2^30 spheres make at most 16 levels.
  static constexpr int kMaxLevels = 16;
  /// Room a depth-first traversal needs on its stack: each level leaves at most three siblings.
  static constexpr int kMaxWaiting = kMaxLevels * (kBranching - 1) + 1;

  InnerSphereTree() = default;
  explicit InnerSphereTree(std::span<const Sphere> spheres);
  /// Of nodes that were stored. Error: they are not laid out as nodes() are (breadth first,
  /// siblings side by side), a sphere is missing or does not lie in all nodes above it. O(n log n).
  static Result<InnerSphereTree> restore(std::vector<IstNode> nodes,
                                         std::span<const Sphere> spheres);

  std::span<const IstNode> nodes() const { return nodes_; }

  /// The sphere that contains p (|p - c| <= r, double precision on the stored numbers), or -1. At
  /// most one can: the packing is disjoint (thesis Alg. 3.2, corrected). No allocation.
  int find_leaf(const Vec3d& p) const;

 private:
  std::vector<IstNode> nodes_;
};

}  // namespace palpate
