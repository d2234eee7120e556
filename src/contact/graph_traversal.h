// Second stage of the graph method: which untouched spheres are inside, and whose plane is theirs
// (thesis section 3.3.2; Algs. 3.5 and 3.6 corrected).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/ist/leaf_graph.h"
#include "palpate/math/sphere.h"

namespace palpate {

/// Breadth-first from all boundary spheres at once. An edge i -> j is walked only if it points away
/// from the collision normal of i's *reference* boundary sphere, (c_j - c_i) . n_b < 0, at every
/// step: that is what keeps the search inside. The reference of a sphere is the boundary sphere that
/// reaches it over the fewest edges; among those of the same round, the one with the shortest path,
/// then the lowest index. So the result does not depend on any order of execution.
class GraphTraversal {
 public:
  GraphTraversal(std::span<const Sphere> spheres, const LeafGraph& graph);

  /// A boundary sphere and its unit normal in the tool frame; a zero normal starts no search.
  struct Seed {
    std::int32_t sphere_id;
    Vec3d normal;
  };

  /// Returns the spheres reached, seeds not among them, in the order of their rounds. `seeds` are all
  /// boundary spheres, ascending. O(edges of the spheres reached). No allocation.
  std::span<const std::int32_t> run(std::span<const Seed> seeds);

  /// Index into the seeds of the last run, for a sphere that was reached.
  std::int32_t reference(std::int32_t sphere_id) const {
    return reached_[static_cast<std::size_t>(sphere_id)].seed;
  }

 private:
  struct Reached {
    std::int32_t round = kUnreached;
    std::int32_t seed = -1;
    double path_length = 0;
  };
  static constexpr std::int32_t kUnreached = -1;

  std::span<const Sphere> spheres_;
  const LeafGraph* graph_;
  std::vector<Reached> reached_;
  std::vector<std::int32_t> queue_;  // seeds, then the spheres reached
  std::size_t num_queued_ = 0;
};

}  // namespace palpate
