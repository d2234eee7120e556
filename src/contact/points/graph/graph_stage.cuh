// Graph stage of a query on a GPU: finds the untouched spheres that are inside, and their planes
// (thesis section 3.3.2; Algs. 3.5 to 3.7 corrected). The result is that of GraphTraversal.
//
// In a round, each slot that the round before has *reached* is settled: it takes the best of the
// offers made to it as its reference. Then it offers that reference to those of its neighbors that
// no earlier round has reached, if the reference lets it walk there. The first to make an offer to
// a slot puts it on the list for the next round. Offers and lists are unordered, but all offers of
// a round are compared, and all slots of a list are settled.
//
// Rows of neighbors are processed in parts, each by some lanes of a warp: the fewer parts, the more
// lanes. Many parts are shared by all blocks in a round, and a barrier ends it. A few are faster by
// one block alone, which continues round by round until there are many again; the others wait at
// the barrier meanwhile. The data of the round before was complete at the barrier.
#pragma once

#include <cstdint>

#include "src/contact/points/donors/plane_assignment.h"
#include "src/contact/points/graph/graph_rule.h"
#include "src/contact/points/point_query.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {

/// The search of one query, as one thread sees it.
class GraphStage {
 public:
  /// Shared memory of a block.
  struct Scratch {
    std::int32_t num_listed[3];
  };

  __device__ GraphStage(const PointQuery& q, bool with_edges)
      : graph_(q.graph),
        search_(q.search),
        boundary_(q.boundary),
        slot_of_(q.clusters.slot_of),
        reference_(q.donor),
        sphere_ids_(q.clusters.sphere_id),
        edges_(q.edges_view()),
        with_edges_(with_edges && *q.num_pieces > 0) {}

  /// Returns the number of rounds after the first.
  __device__ int run(unsigned long long* barrier) {
    const Team grid{gpu::warp_id() * static_cast<int>(gridDim.x) + static_cast<int>(blockIdx.x),
                    gpu::grid_threads() / gpu::kWarpSize, search_.num_listed};
    settle_boundary(grid);
    bool was_alone = false;
    for (int rounds = 1, turn = 1;; ++turn) {
      gpu::grid_barrier(barrier);
      const std::int32_t num = gpu::read_now(grid.num_listed + turn % 3);
      if (was_alone) rounds = gpu::read_now(search_.num_rounds);
      if (gpu::grid_thread() == 0) write_now(grid.num_listed + (turn + 2) % 3, 0);
      if (num == 0) return rounds - 1;
      was_alone = num <= kFew;
      if (!was_alone) {
        settle_listed(grid, turn, num, search_.first_round + rounds++);
      } else if (blockIdx.x == 0) {
        go_on_alone(turn, num, rounds);
      }
    }
  }

 private:
  static constexpr int kFew = 64;      // parts of rows
  static constexpr int kBatch = 2;     // neighbors that a lane reads at the same time
  static constexpr int kMinLanes = 3;  // for each part, as the exponent of 2

  /// Warps that share a round, and the counters of the parts that they list.
  struct Team {
    int warp, num_warps;
    std::int32_t* num_listed;
  };
  /// Number of lanes that share a part: 2^log2.
  struct Lanes {
    int log2;
    __device__ int num() const { return 1 << log2; }
    __device__ int at_once() const { return gpu::kWarpSize >> log2; }
    __device__ int number_of_group() const { return gpu::lane_id() >> log2; }
    __device__ int number_of_this() const { return gpu::lane_id() & (num() - 1); }
  };
  /// Destination of the slots that a round reaches.
  struct Reached {
    std::int32_t round;
    RowPart* parts;
    std::int32_t* num;
  };
  /// Some neighbors, read together.
  struct Ahead {
    std::int32_t slot[kBatch], round[kBatch], row_begin[kBatch], row_end[kBatch];
    SlotSphere sphere[kBatch];
  };

  __device__ static void write_now(std::int32_t* to, std::int32_t value) {
    *static_cast<volatile std::int32_t*>(to) = value;
  }

  /// Runs rounds by this block, from the list of this turn to that of the next: few slots are left.
  __device__ void go_on_alone(int turn, std::int32_t num, int rounds) const {
    std::int32_t* const num_listed = gpu::shared_memory<Scratch>().num_listed;
    const Team block{gpu::warp_id(), gpu::warps_per_block(), num_listed};
    if (threadIdx.x < 3) num_listed[threadIdx.x] = 0;
    __syncthreads();
    // Each round uses the lists of a turn; the last one has to be that of the next turn.
    int from = turn;
    do {
      settle_listed(block, from, num, search_.first_round + rounds++);
      __syncthreads();
      ++from;
      num = gpu::read_now(num_listed + from % 3);
      if (threadIdx.x == 0) write_now(num_listed + (from + 2) % 3, 0);
    } while ((num > 0 && num <= kFew) || (num > kFew && (from - turn) % 2 == 0));
    if (threadIdx.x != 0) return;
    *search_.num_rounds = rounds;
    search_.num_listed[(turn + 1) % 3] = num;
  }

  __device__ void settle_boundary(const Team& team) const {
    const std::int32_t num = *boundary_.num, all = num + graph_.num_more_parts;
    const Reached reached = reached_from(team, 0, search_.first_round);
    const Lanes lanes = lanes_for_each(all, team);
    for (std::int32_t first = team.warp * lanes.at_once(); first < all;
         first += team.num_warps * lanes.at_once()) {
      const std::int32_t i = first + lanes.number_of_group();
      RowPart part;
      if (i < num) {
        part.slot = slot_of_[boundary_.sphere_id[i]];
        part.begin = part.row_begin = graph_.row_starts[part.slot];
        part.end = end_of_part(part.begin, graph_.row_starts[part.slot + 1]);
      } else if (i < all) {
        part = graph_.more_parts[i - num];
        if (gpu::read_now(&search_.slots[part.slot].round) != search_.first_round) {
          part.end = part.begin;
        }
      }
      if (!__any_sync(gpu::kWholeWarp, part.begin < part.end)) continue;
      const std::int32_t seed = part.begin < part.end ? reference_[part.slot] : -1;
      walk(part, lanes, {0, seed}, look_ahead(part, lanes), reached);
    }
  }

  __device__ void settle_listed(const Team& team, int turn, std::int32_t num,
                                std::int32_t round) const {
    const RowPart* const parts = search_.listed[turn % 2];
    const Reached reached = reached_from(team, turn, round);
    const Lanes lanes = lanes_for_each(num, team);
    for (std::int32_t first = team.warp * lanes.at_once(); first < num;
         first += team.num_warps * lanes.at_once()) {
      const std::int32_t i = first + lanes.number_of_group();
      settle(i < num ? parts[i] : RowPart{}, lanes, reached);
    }
  }

  __device__ Reached reached_from(const Team& team, int turn, std::int32_t round) const {
    return {round + 1, search_.listed[(turn + 1) % 2], team.num_listed + (turn + 1) % 3};
  }
  __device__ static Lanes lanes_for_each(std::int32_t num, const Team& team) {
    Lanes lanes{5};
    while (lanes.log2 > kMinLanes && num > team.num_warps * lanes.at_once()) --lanes.log2;
    return lanes;
  }
  __device__ static std::int32_t end_of_part(std::int32_t begin, std::int32_t row_end) {
    const std::int32_t end = begin + SortedGraphView::kPart;
    return end < row_end ? end : row_end;
  }

  /// Settles one part; lanes without one pass an empty part. All lanes of the warp call.
  __device__ void settle(const RowPart& part, const Lanes& lanes, const Reached& reached) const {
    const bool has_part = part.begin < part.end;
    // Loads all that does not depend on the reference first.
    const Offer* const offers = search_.offers + part.row_begin;
    const int num = has_part ? gpu::read_now(&search_.slots[part.slot].num_offers) : 0;
    Offer first[GraphSearch::kFirstOffers];
#pragma unroll
    for (int i = 0; i < GraphSearch::kFirstOffers; ++i) first[i] = offers[i];
    const Ahead ahead = look_ahead(part, lanes);
    Offer best{1e300, INT32_MAX};
#pragma unroll
    for (int i = 0; i < GraphSearch::kFirstOffers; ++i) {
      if (i < num && first[i].beats(best)) best = first[i];
    }
    if (__any_sync(gpu::kWholeWarp, num > GraphSearch::kFirstOffers)) {
      best = best_of_many(best, offers, num, lanes);
    }
    if (!has_part) best = Offer{};
    if (has_part && part.begin == part.row_begin && lanes.number_of_this() == 0) {
      reference_[part.slot] = best.seed;
      search_.path_length[part.slot] = best.path_length;
    }
    walk(part, lanes, best, ahead, reached);
  }

  /// Returns the best of the offers after the first ones. All lanes of the warp call.
  __device__ static Offer best_of_many(Offer best, const Offer* offers, int num,
                                       const Lanes& lanes) {
#pragma unroll 4
    for (int i = GraphSearch::kFirstOffers + lanes.number_of_this(); i < num; i += lanes.num()) {
      const Offer offer = offers[i];
      if (offer.beats(best)) best = offer;
    }
    for (int step = lanes.num() / 2; step > 0; step /= 2) {
      const Offer other{__shfl_xor_sync(gpu::kWholeWarp, best.path_length, step),
                        __shfl_xor_sync(gpu::kWholeWarp, best.seed, step)};
      if (other.beats(best)) best = other;
    }
    return best;
  }

  /// Loads neighbors of the part, from `begin` on, as many as its lanes read together. Behind its
  /// end: one that is never open.
  __device__ Ahead look_ahead(const RowPart& part, const Lanes& lanes) const {
    Ahead ahead;
#pragma unroll
    for (int b = 0; b < kBatch; ++b) {
      const std::int32_t e = part.begin + lanes.number_of_this() + b * lanes.num();
      ahead.slot[b] = e < part.end ? graph_.neighbors[e] : -1;
    }
#pragma unroll
    for (int b = 0; b < kBatch; ++b) {
      const std::int32_t slot = ahead.slot[b];
      ahead.round[b] = INT32_MAX;
      if (slot < 0) continue;
      ahead.round[b] = gpu::read_now(&search_.slots[slot].round);
      ahead.row_begin[b] = graph_.row_starts[slot];
      ahead.row_end[b] = graph_.row_starts[slot + 1];
      ahead.sphere[b] = graph_.spheres[slot];
    }
    return ahead;
  }

  /// Offers the reference of a slot, if it has one, to those neighbors to which it leads.
  /// `ahead`: the first of them. All lanes of the warp call.
  __device__ void walk(RowPart part, const Lanes& lanes, const Offer& from, Ahead ahead,
                       const Reached& reached) const {
    const bool has_seed = from.seed >= 0;
    const Donor& donor = boundary_.donors[has_seed ? from.seed : 0];
    const Vec3d c = graph_.spheres[part.slot].center(), normal = donor.plane_T.normal;
    for (;;) {
      bool walks[kBatch];
      int slot[kBatch], num_slots = 0;
      double length[kBatch];
#pragma unroll
      for (int b = 0; b < kBatch; ++b) {
        // Other slots may have reached some in this round.
        walks[b] = has_seed &&
                   (ahead.round[b] < search_.first_round || ahead.round[b] == reached.round) &&
                   leads_inside(ahead.sphere[b].center() - c, normal) &&
                   !(with_edges_ && edges_.forbids(sphere_ids_[ahead.slot[b]], donor.point));
        const unsigned all = __ballot_sync(gpu::kWholeWarp, walks[b]);
        slot[b] = num_slots + __popc(all & ((1u << gpu::lane_id()) - 1));
        num_slots += __popc(all);
      }
      if (num_slots > 0) {
        // Not all will be the first to reach the slot, but waiting for that would take longer.
        int number[kBatch], base = 0;
#pragma unroll
        for (int b = 0; b < kBatch; ++b) {
          number[b] = walks[b] ? atomicAdd(&search_.slots[ahead.slot[b]].num_offers, 1) : 0;
        }
        if (gpu::lane_id() == 0) base = atomicAdd(reached.num, num_slots);
#pragma unroll
        for (int b = 0; b < kBatch; ++b) {
          if (walks[b]) length[b] = from.path_length + norm(ahead.sphere[b].center() - c);
        }
        base = __shfl_sync(gpu::kWholeWarp, base, 0);
#pragma unroll
        for (int b = 0; b < kBatch; ++b) {
          if (!walks[b]) continue;
          const std::int32_t row_begin = ahead.row_begin[b];
          search_.offers[row_begin + number[b]] = {length[b], from.seed};
          RowPart row{ahead.slot[b], row_begin, row_begin, row_begin};
          if (number[b] == 0) reach(row, ahead.row_end[b], reached);
          reached.parts[base + slot[b]] = row;
        }
      }
      part.begin += kBatch * lanes.num();
      if (!__any_sync(gpu::kWholeWarp, has_seed && part.begin < part.end)) return;
      ahead = look_ahead(part, lanes);
    }
  }

  /// Gives the slot's row its first part, and lists the others.
  __device__ void reach(RowPart& row, std::int32_t row_end, const Reached& reached) const {
    write_now(&search_.slots[row.slot].round, reached.round);
    row.end = end_of_part(row.begin, row_end);
    if (row.end == row_end) return;
    constexpr int kPart = SortedGraphView::kPart;
    RowPart* to = reached.parts + atomicAdd(reached.num, (row_end - row.end + kPart - 1) / kPart);
    for (std::int32_t begin = row.end; begin < row_end; begin += kPart) {
      *to++ = {row.slot, row.row_begin, begin, end_of_part(begin, row_end)};
    }
  }

  SortedGraphView graph_;
  GraphSearch search_;
  BoundaryList boundary_;
  const std::int32_t* slot_of_;  // of each sphere
  std::int32_t* reference_;      // of each slot
  const std::int32_t* sphere_ids_;
  EdgesView edges_;
  bool with_edges_;
};

inline constexpr std::size_t kGraphSharedBytes = sizeof(GraphStage::Scratch);

/// Finds all slots that the boundary spheres, whose round is first_round, reach; `with_edges` if
/// edges matter. Called by all threads of a cooperative grid, after a barrier behind the boundary
/// and edge stages; the results are visible to all when it returns. Returns the number of rounds
/// after the first. Shared memory: kGraphSharedBytes.
__device__ inline int search_graph(const PointQuery& q, unsigned long long* barrier,
                                   bool with_edges) {
  if (*q.boundary.num == 0) return 0;
  return GraphStage(q, with_edges).run(barrier);
}

/// Returns this thread's share of the sums over the reached spheres: V_s n_s, with the sphere's
/// center as lever. Fills in donor and assigned_volume of all spheres that no point touches.
__device__ inline MeasureSums measure_reached(const PointQuery& q, bool with_edges) {
  const DonorsView donors = q.donors_view();
  const EdgesView edges = q.edges_view();
  const bool has_pieces = with_edges && *q.num_pieces > 0;
  MeasureSums sums;
  for (std::int32_t slot = gpu::grid_thread(); slot < q.clusters.num_slots();
       slot += gpu::grid_threads()) {
    const SlotState state = q.search.slots[slot];
    double volume = 0;
    if (state.round > q.search.first_round) {
      q.search.slots[slot].num_offers = 0;  // for the next query
      const std::int32_t id = q.clusters.sphere_id[slot];
      const Donor& donor = donors.donors[q.donor[slot]];
      volume = q.scale(id) * (has_pieces ? reached_volume(donors, donor, id, q.inside, &edges)
                                         : reached_volume(donors, donor, id, q.inside, nullptr));
      const Vec3d force = volume * donor.plane_T.normal;
      sums.volume += volume;
      sums.force += force;
      sums.torque += cross(q.graph.spheres[slot].center() - q.origin, force);
      sums.num_inside += volume > 0;
    } else if (state.round < q.search.first_round) {
      q.donor[slot] = -1;
    }
    q.assigned_volume[slot] = static_cast<float>(volume);
  }
  return sums;
}

__device__ inline int search_graph(const PointQuery& q, unsigned long long* barrier) {
  return search_graph(q, barrier, q.edges != Edges::none);
}
__device__ inline MeasureSums measure_reached(const PointQuery& q) {
  return measure_reached(q, q.edges != Edges::none);
}

}}  // namespace palpate::v0
