// Which spheres of a packing are neighbours (thesis section 3.3.1).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "palpate/math/sphere.h"

namespace palpate {

/// The rule that makes two spheres neighbours, by the gap between their surfaces.
enum class GapRule {
  absolute,  ///< gap < 2 * smallest radius of the packing: the thesis' rule
  relative,  ///< gap <= 0.5 * smaller of the two radii: scale-free, stable under prefixes
};
constexpr auto names_of(GapRule) { return std::array{"absolute", "relative"}; }

/// Undirected graph over the spheres, 1-connected. Stored as compressed rows: the neighbours of
/// sphere i are neighbours()[row_starts()[i] ... row_starts()[i+1]), ascending.
class LeafGraph {
 public:
  LeafGraph() = default;
  /// Edges by the gap rule, then the shortest bridges (smallest gap, ties by lower indices) until
  /// one component is left. O(n log n) for packings.
  LeafGraph(std::span<const Sphere> spheres, GapRule rule);
  /// A graph that was stored; edges as (a, b) with a < b.
  LeafGraph(std::size_t num_spheres, std::span<const std::pair<int, int>> edges, int num_bridges,
            int num_components_before_bridging);

  std::span<const std::int32_t> row_starts() const { return row_starts_; }
  std::span<const std::int32_t> neighbours() const { return neighbours_; }

  int num_edges() const { return static_cast<int>(neighbours_.size() / 2); }
  int num_bridges() const { return num_bridges_; }
  int num_components_before_bridging() const { return num_components_before_bridging_; }
  /// Each edge once, (a, b) with a < b, sorted.
  std::vector<std::pair<int, int>> edges() const;

 private:
  void set_edges(std::size_t num_spheres, std::span<const std::pair<int, int>> edges);

  std::vector<std::int32_t> row_starts_, neighbours_;
  int num_bridges_ = 0;
  int num_components_before_bridging_ = 0;
};

}  // namespace palpate
