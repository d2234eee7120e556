// Searches over the gaps between a sphere and all others, with the inner sphere tree as index.
#pragma once

#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

/// Distance between the surfaces of spheres i and j, negative if they overlap. The same bits
/// for (i, j) and (j, i).
inline double gap(std::span<const Sphere> spheres, std::int32_t i, std::int32_t j) {
  const Sphere &a = spheres[i < j ? i : j], &b = spheres[i < j ? j : i];
  return norm(to_double(b.center) - to_double(a.center)) - double(a.radius) - double(b.radius);
}

/// A possible bridge. Ordered by gap, then by lower indices: no two are equal, so the shortest
/// one is always unique.
struct Bridge {
  double gap = std::numeric_limits<double>::infinity();
  std::int32_t a = -1, b = -1;  ///< a < b

  friend auto operator<=>(const Bridge&, const Bridge&) = default;
};

class GapSearch {
 public:
  explicit GapSearch(std::span<const Sphere> spheres) : spheres_(spheres), tree_(spheres) {
    largest_radius_.resize(tree_.nodes().size());
    summarise(
        largest_radius_, [&](std::int32_t id) { return spheres_[id].radius; },
        [](float a, float b) { return a > b ? a : b; });
  }

  /// Calls visit(j) for every sphere j that comes after i in the order "smaller radius first, then
  /// lower index" and whose gap to i may be as small as `max_gap` (the caller decides exactly).
  /// Searching from the smaller sphere of a pair keeps hubs cheap: the others find them.
  template <class Visit>
  void larger_neighbors(std::int32_t i, double max_gap, Visit&& visit) const {
    const Sphere& sphere = spheres_[i];
    const std::span<const IstNode> nodes = tree_.nodes();
    std::array<std::int32_t, InnerSphereTree::kMaxWaiting> waiting;
    int num_waiting = 0;
    waiting[num_waiting++] = 0;
    while (num_waiting > 0) {
      const std::int32_t k = waiting[--num_waiting];
      if (largest_radius_[k] < sphere.radius || lower_bound(sphere, k) > max_gap) continue;
      const IstNode& node = nodes[k];
      for (int c = 0; c < node.num_children; ++c) waiting[num_waiting++] = node.first_child + c;
      const std::int32_t j = node.sphere_id;
      if (j >= 0 && (spheres_[j].radius > sphere.radius || j > i)) visit(j);
    }
  }

  /// Tells the search which component each sphere is in, for shortest_bridge.
  void set_components(std::span<const std::int32_t> component_of) {
    component_of_ = component_of;
    common_component_.resize(tree_.nodes().size());
    summarise(
        common_component_, [&](std::int32_t id) { return component_of[id]; },
        [](std::int32_t a, std::int32_t b) { return a == b ? a : kMixed; });
  }

  /// Replaces `best` by the shortest bridge from sphere i to another component, if that is shorter.
  void shortest_bridge(std::int32_t i, Bridge& best) const {
    const Sphere& sphere = spheres_[i];
    const std::int32_t own = component_of_[i];
    const std::span<const IstNode> nodes = tree_.nodes();
    struct Waiting {
      double lower_bound;
      std::int32_t node;
    };
    std::array<Waiting, InnerSphereTree::kMaxWaiting> waiting;
    int num_waiting = 0;
    waiting[num_waiting++] = {lower_bound(sphere, 0), 0};
    while (num_waiting > 0) {
      const auto [bound, k] = waiting[--num_waiting];
      if (bound > best.gap || common_component_[k] == own) continue;
      const IstNode& node = nodes[k];
      if (node.num_children == 0) {
        const std::int32_t j = node.sphere_id;
        best = std::min(best, Bridge{gap(spheres_, i, j), std::min(i, j), std::max(i, j)});
        continue;
      }
      // The nearest child goes on top, so that `best` shrinks early.
      const int first = num_waiting;
      for (int c = 0; c < node.num_children; ++c) {
        const Waiting child{lower_bound(sphere, node.first_child + c), node.first_child + c};
        int place = num_waiting++;
        for (; place > first && waiting[place - 1].lower_bound < child.lower_bound; --place)
          waiting[place] = waiting[place - 1];
        waiting[place] = child;
      }
    }
  }

 private:
  static constexpr std::int32_t kMixed = -1;

  /// No leaf below the node has a smaller gap to the sphere; the slack covers rounding.
  double lower_bound(const Sphere& sphere, std::int32_t node) const {
    constexpr double kRoundingSlack = 1e-9;
    const Sphere& bound = tree_.nodes()[node].bound;
    const double distance = norm(to_double(bound.center) - to_double(sphere.center));
    const double reach = double(bound.radius) + double(sphere.radius);
    return distance - reach - kRoundingSlack * (distance + reach);
  }

  /// Fills one value per node, from the leaves up: children lie behind their parents.
  template <class T, class OfSphere, class Combine>
  void summarise(std::vector<T>& values, OfSphere of_sphere, Combine combine) const {
    const std::span<const IstNode> nodes = tree_.nodes();
    for (std::size_t k = nodes.size(); k-- > 0;) {
      const IstNode& node = nodes[k];
      if (node.num_children == 0) {
        values[k] = of_sphere(node.sphere_id);
        continue;
      }
      values[k] = values[node.first_child];
      for (int c = 1; c < node.num_children; ++c)
        values[k] = combine(values[k], values[node.first_child + c]);
    }
  }

  std::span<const Sphere> spheres_;
  InnerSphereTree tree_;
  std::vector<float> largest_radius_;
  std::span<const std::int32_t> component_of_;
  std::vector<std::int32_t> common_component_;
};

}}  // namespace palpate::v0
