#include "palpate/tool/tool.h"

#include <algorithm>
#include <optional>

#include "src/tool/components.h"
#include "src/tool/gap_search.h"

namespace palpate { inline namespace v0 {
namespace {

using Edge = std::pair<int, int>;

/// All pairs that the gap rule makes neighbors, sorted (thesis section 3.3.1). Nothing if they are
/// too many.
std::optional<std::vector<Edge>> edges_by_rule(std::span<const Sphere> spheres, GapRule rule,
                                               const GapSearch& search) {
  // Both ends of each, and of the bridges, are counted with 31 bits.
  constexpr std::size_t kMaxEdges = std::size_t(1) << 29;
  const std::size_t max_edges =
      std::min(kMaxEdges, spheres.size() * LeafGraph::kMaxMeanNeighbors / 2);
  float smallest_radius = std::numeric_limits<float>::infinity();
  for (const Sphere& sphere : spheres) smallest_radius = std::min(smallest_radius, sphere.radius);

  std::vector<Edge> edges;
  for (std::int32_t i = 0; i < static_cast<std::int32_t>(spheres.size()); ++i) {
    const bool absolute = rule == GapRule::absolute;
    const double limit = absolute ? 2 * double(smallest_radius) : 0.5 * double(spheres[i].radius);
    search.larger_neighbors(i, limit, [&](std::int32_t j) {
      const double g = gap(spheres, i, j);
      if (absolute ? g < limit : g <= limit) edges.emplace_back(std::min(i, j), std::max(i, j));
    });
    if (edges.size() > max_edges) return std::nullopt;
  }
  std::sort(edges.begin(), edges.end());
  return edges;
}

/// The shortest bridges that make one component, by Boruvka's rounds: every component but the
/// largest picks its shortest way out. Bridges are strictly ordered, so this is the one minimum
/// spanning tree over the components: what inserting the shortest bridge again and again gives.
std::vector<Edge> bridges(std::span<const Sphere> spheres, Components& components,
                          GapSearch& search) {
  const auto num_spheres = static_cast<std::int32_t>(spheres.size());
  std::vector<Edge> result;
  std::vector<std::int32_t> component_of(spheres.size()), sizes(spheres.size());
  std::vector<Bridge> best(spheres.size());
  while (components.count() > 1) {
    std::fill(sizes.begin(), sizes.end(), 0);
    for (std::int32_t i = 0; i < num_spheres; ++i) ++sizes[component_of[i] = components.find(i)];
    const auto giant =
        static_cast<std::int32_t>(std::max_element(sizes.begin(), sizes.end()) - sizes.begin());
    search.set_components(component_of);
    std::fill(best.begin(), best.end(), Bridge{});
    for (std::int32_t i = 0; i < num_spheres; ++i) {
      if (component_of[i] != giant) search.shortest_bridge(i, best[component_of[i]]);
    }
    for (const Bridge& bridge : best) {
      if (bridge.a >= 0 && components.join(bridge.a, bridge.b))
        result.emplace_back(bridge.a, bridge.b);
    }
  }
  return result;
}

}  // namespace

LeafGraph::LeafGraph(std::span<const Sphere> spheres, GapRule rule) {
  GapSearch search(spheres);
  std::optional<std::vector<Edge>> found = edges_by_rule(spheres, rule, search);
  if (!found) return;
  std::vector<Edge>& all_edges = *found;
  Components components(spheres.size());
  for (const auto& [a, b] : all_edges) components.join(a, b);
  num_components_before_bridging_ = components.count();
  const std::vector<Edge> added = bridges(spheres, components, search);
  num_bridges_ = static_cast<int>(added.size());
  all_edges.insert(all_edges.end(), added.begin(), added.end());
  set_edges(spheres.size(), all_edges);
}

LeafGraph::LeafGraph(std::size_t num_spheres, std::span<const Edge> edges, int num_bridges,
                     int num_components_before_bridging)
    : num_bridges_(num_bridges), num_components_before_bridging_(num_components_before_bridging) {
  set_edges(num_spheres, edges);
}

void LeafGraph::set_edges(std::size_t num_spheres, std::span<const Edge> edges) {
  row_starts_.assign(num_spheres + 1, 0);
  for (const auto& [a, b] : edges) {
    ++row_starts_[a + 1];
    ++row_starts_[b + 1];
  }
  for (std::size_t i = 0; i < num_spheres; ++i) row_starts_[i + 1] += row_starts_[i];

  neighbors_.resize(2 * edges.size());
  std::vector<std::int32_t> next(row_starts_.begin(), row_starts_.end() - 1);
  for (const auto& [a, b] : edges) {
    neighbors_[next[a]++] = b;
    neighbors_[next[b]++] = a;
  }
  for (std::size_t i = 0; i < num_spheres; ++i) {
    const auto row = neighbors_.begin() + row_starts_[i];
    const auto row_end = neighbors_.begin() + row_starts_[i + 1];
    if (!std::is_sorted(row, row_end)) std::sort(row, row_end);
  }
}

std::vector<std::pair<int, int>> LeafGraph::edges() const {
  std::vector<Edge> result;
  result.reserve(neighbors_.size() / 2);
  for (int a = 0; a + 1 < static_cast<int>(row_starts_.size()); ++a) {
    for (std::int32_t k = row_starts_[a]; k < row_starts_[a + 1]; ++k) {
      if (neighbors_[k] > a) result.emplace_back(a, neighbors_[k]);
    }
  }
  return result;
}

}}  // namespace palpate::v0
