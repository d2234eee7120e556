#include "src/contact/points/graph/graph_traversal.h"

#include <algorithm>
#include <utility>

namespace palpate { inline namespace v0 {

GraphTraversal::GraphTraversal(std::span<const Sphere> spheres, const SortedGraph& graph)
    : centers_(graph.sphere_ids.size()),
      graph_(graph),
      states_(centers_.size(), kUnreached),
      offers_(centers_.size()),
      visits_(spheres.size() + 1),
      slots_(spheres.size() + 1) {
  std::int32_t longest_row = 0;
  for (std::size_t slot = 0; slot < centers_.size(); ++slot) {
    if (graph_.sphere_ids[slot] < 0) continue;
    centers_[slot] = spheres[static_cast<std::size_t>(graph_.sphere_ids[slot])].center;
    longest_row = std::max(longest_row, graph_.row_starts[slot + 1] - graph_.row_starts[slot]);
  }
  ahead_.resize(static_cast<std::size_t>(longest_row));
}

// Offers the reference of one sphere to its neighbors and appends those it is the first to reach.
template <bool kWithEdgePlanes>
std::size_t GraphTraversal::walk_edges(const Visit& from, Slot slot, const Seed& seed,
                                       const EdgesView* edge_planes, std::size_t num_visits) {
  const Vec3d c = to_double(centers_[static_cast<std::size_t>(slot)]);
  const Slot* const neighbors = graph_.neighbors.data();
  const Vec3f* const centers = centers_.data();
  State* const states = states_.data();
  Offer* const offers = offers_.data();
  Slot* const slots = slots_.data();
  Slot* const ahead = ahead_.data();
  const std::int32_t end = graph_.row_starts[static_cast<std::size_t>(slot) + 1];
  // Kept entries advance the end, others are overwritten: a branch per edge would be mispredicted
  // too often.
  std::size_t num_ahead = 0;
  for (std::int32_t e = graph_.row_starts[static_cast<std::size_t>(slot)]; e < end; ++e) {
    const Slot to = neighbors[e];
    ahead[num_ahead] = to;
    num_ahead += states[to] != kSettled;
  }
  const std::size_t num_open = std::exchange(num_ahead, 0);
  for (std::size_t k = 0; k < num_open; ++k) {
    const Slot to = ahead[k];
    ahead[num_ahead] = to;
    num_ahead += leads_inside(to_double(centers[to]) - c, seed.normal);
  }
  for (std::size_t k = 0; k < num_ahead; ++k) {
    const auto to = static_cast<std::size_t>(ahead[k]);
    if (kWithEdgePlanes && edge_planes->forbids(graph_.sphere_ids[to], seed.point)) continue;
    const Offer offer{from.path_length + norm(to_double(centers[to]) - c), from.seed};
    Offer& best = offers[to];
    if (states[to] == kUnreached) {
      states[to] = kReachedThisRound;
      slots[num_visits++] = static_cast<Slot>(to);
      best = offer;
    } else if (offer.beats(best)) {
      best = offer;
    }
  }
  return num_visits;
}

std::span<const GraphTraversal::Visit> GraphTraversal::run(std::span<const Seed> seeds,
                                                           const EdgesView* edge_planes) {
  for (std::size_t v = 0; v < num_visits_; ++v) {
    states_[static_cast<std::size_t>(slots_[v])] = kUnreached;
  }
  std::size_t num_visits = seeds.size();
  for (std::size_t s = 0; s < seeds.size(); ++s) {
    visits_[s] = {0.0, seeds[s].sphere_id, static_cast<std::int32_t>(s)};
    slots_[s] = graph_.slot_of[static_cast<std::size_t>(seeds[s].sphere_id)];
    states_[static_cast<std::size_t>(slots_[s])] = kSettled;
  }
  for (std::size_t round_begin = 0; round_begin < num_visits;) {
    const std::size_t round_end = num_visits;
    for (std::size_t v = round_begin; v < round_end; ++v) {
      constexpr std::size_t kAhead = 6;  // rows come from the L2 cache or farther
      const auto later = static_cast<std::size_t>(slots_[std::min(v + kAhead, round_end - 1)]);
      __builtin_prefetch(&graph_.neighbors[static_cast<std::size_t>(graph_.row_starts[later])]);
      __builtin_prefetch(&centers_[later]);
      const Seed& seed = seeds[static_cast<std::size_t>(visits_[v].seed)];
      num_visits = edge_planes == nullptr
                       ? walk_edges<false>(visits_[v], slots_[v], seed, nullptr, num_visits)
                       : walk_edges<true>(visits_[v], slots_[v], seed, edge_planes, num_visits);
    }
    // Settles the spheres that the round reached.
    for (std::size_t v = round_end; v < num_visits; ++v) {
      const auto slot = static_cast<std::size_t>(slots_[v]);
      states_[slot] = kSettled;
      visits_[v] = {offers_[slot].path_length, graph_.sphere_ids[slot], offers_[slot].seed};
    }
    round_begin = round_end;
  }
  num_visits_ = num_visits;
  return std::span(visits_).subspan(seeds.size(), num_visits - seeds.size());
}

}}  // namespace palpate::v0
