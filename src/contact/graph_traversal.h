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

  /// A sphere that the search found, the seed whose plane is its reference (an index into the seeds)
  /// and the length of the path from there.
  struct Visit {
    double path_length;
    std::int32_t sphere_id;
    std::int32_t seed;
  };

  /// Returns the spheres reached, seeds not among them, in the order of their rounds. `seeds` are all
  /// boundary spheres, ascending. O(edges of the spheres reached). No allocation.
  std::span<const Visit> run(std::span<const Seed> seeds);

 private:
  // The best offer a sphere has had in this round. Nothing beats the offer of a settled sphere, and
  // anything finite beats that of an unreached one.
  struct Offer {
    double path_length;
    std::int32_t seed;
  };
  // Four edges of one sphere: one cache line.
  struct alignas(64) EdgeBlock {
    static constexpr int kSize = 4;
    float x[kSize], y[kSize], z[kSize];  // unit direction to the neighbour; zero for padding
    std::int32_t neighbour[kSize];       // one past the last sphere for padding
  };

  bool points_away_exactly(std::int32_t from, std::int32_t to, const Vec3d& normal) const;
  void walk_edges(const Visit& from, const Vec3d& normal);

  std::span<const Sphere> spheres_;
  std::vector<std::int32_t> first_block_;  // of each sphere, and one past the last
  std::vector<EdgeBlock> blocks_;
  std::vector<double> lengths_;            // of each slot of the blocks
  std::vector<Offer> offers_;              // of each sphere, and one for padding
  std::vector<Visit> visits_;              // seeds, then the spheres reached
  std::size_t num_visits_ = 0;
};

}  // namespace palpate
