// Second stage of the graph method: finds the untouched spheres that are inside, and their planes
// (thesis section 3.3.2; Algs. 3.5 and 3.6 corrected).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/math/geometry.h"
#include "src/contact/index/sorted_graph.h"
#include "src/contact/points/edges/edge_pieces.h"
#include "src/contact/points/graph/graph_rule.h"

namespace palpate { inline namespace v0 {

/// Breadth-first from all boundary spheres at once. An edge i -> j is walked only if it points away
/// from the collision normal of i's *reference* boundary sphere, (c_j - c_i) . n_b < 0, at every
/// step: that is what keeps the search inside. The reference of a sphere is the boundary sphere
/// that reaches it over the fewest edges; among those of the same round, the one with the shortest
/// path, then the lowest index. So the result does not depend on any order of execution.
class GraphTraversal {
 public:
  /// In the order of `graph`, neighbors in space are neighbors in memory: the search stays within
  /// a few cache lines. `graph` must outlive it.
  GraphTraversal(std::span<const Sphere> spheres, const SortedGraph& graph);

  /// A boundary sphere, its unit normal in the tool frame and, for edges, its mean point; a zero
  /// normal starts no search.
  struct Seed {
    std::int32_t sphere_id;
    Vec3d normal;
    DonorPoint point{};
  };

  /// A sphere that the search found, the seed whose plane is its reference (an index into the
  /// seeds) and the length of the path from there.
  struct Visit {
    double path_length;
    std::int32_t sphere_id;
    std::int32_t seed;
  };

  /// Returns the spheres reached, seeds not among them, in the order of their rounds. `seeds` are
  /// all boundary spheres, ascending. O(edges of the spheres reached). No allocation. The search
  /// does not walk into a sphere that `edge_planes` (may be null) forbids to its reference.
  std::span<const Visit> run(std::span<const Seed> seeds, const EdgesView* edge_planes = nullptr);

 private:
  // Inside, a sphere is known by its slot in the spatial order.
  using Slot = std::int32_t;

  // One byte a sphere: most edges lead to a settled one, and the bytes of all stay in the L1 cache.
  enum State : std::uint8_t { kUnreached, kReachedThisRound, kSettled };

  template <bool kWithEdgePlanes>
  std::size_t walk_edges(const Visit& from, Slot slot, const Seed& seed,
                         const EdgesView* edge_planes, std::size_t num_visits);

  std::vector<Vec3f> centers_;  // of each slot
  const SortedGraph& graph_;
  std::vector<Slot> ahead_;    // of one sphere: neighbors not settled and in its direction
  std::vector<State> states_;  // of each slot
  std::vector<Offer> offers_;  // of each slot: the best one it has had in this round
  std::vector<Visit> visits_;  // seeds, then the spheres reached
  std::vector<Slot> slots_;    // of each visit
  std::size_t num_visits_ = 0;
};

}}  // namespace palpate::v0
