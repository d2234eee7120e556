// Graph stage of a query on a GPU: which untouched spheres are inside, and whose plane is theirs
// (thesis section 3.3.2; Algs. 3.5 to 3.7 corrected). The result is that of GraphTraversal.
//
// In a round, each place that the round before has *reached* is settled: it takes the best of the
// offers that were left for it. Now that it knows its reference, it offers it to those of its
// neighbours that no earlier round has reached, if the reference lets it walk there. The first to
// make an offer to a place puts it on the list for the next round. Offers and lists lie in any
// order, but all offers of a round are compared, and all of a list are settled.
//
// Rows of neighbours are worked at in parts, each by some lanes of a warp: as many as there are for
// each part. With many parts all blocks share a round, and a barrier ends it. Few are quicker done
// by one block alone, which goes on from round to round until there are many again; the others wait
// at the barrier meanwhile. What a round reads of the round before was complete at the barrier.
#pragma once

#include <cstdint>

#include "src/contact/graph_rule.h"
#include "src/contact/plane_borrowing.h"
#include "src/contact/point_query.h"
#include "src/gpu/team.cuh"

namespace palpate {

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
        place_of_(q.clusters.place_of),
        reference_(q.lender),
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
  static constexpr int kFew = 128;  // parts of rows
  static constexpr int kBatch = 4;  // neighbours that a lane asks about at the same time
  static constexpr int kLeastLanes = 4;

  /// Those who share a round, and where they count the parts that they list.
  struct Team {
    int warp, num_warps;
    std::int32_t* num_listed;
  };
  /// Where what a round reaches is listed.
  struct Reached {
    std::int32_t round;
    RowPart* parts;
    std::int32_t* num;
  };
  /// Some neighbours, asked about together.
  struct Ahead {
    std::int32_t place[kBatch], round[kBatch], row_begin[kBatch], row_end[kBatch];
    PlaceSphere sphere[kBatch];
  };

  __device__ static void write_now(std::int32_t* to, std::int32_t value) {
    *static_cast<volatile std::int32_t*>(to) = value;
  }

  /// Rounds by this block, from the list of this turn to that of the next.
  __device__ void go_on_alone(int turn, std::int32_t num, int rounds) const {
    std::int32_t* const num_listed = gpu::shared_memory<Scratch>().num_listed;
    const Team block{gpu::warp_id(), gpu::warps_per_block(), num_listed};
    if (threadIdx.x < 3) num_listed[threadIdx.x] = 0;
    __syncthreads();
    // Lists lie as if each round were a turn; the last one has to be that of the next turn.
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
    const int width = lanes_for_each(all, team), at_once = gpu::kWarpSize / width;
    for (std::int32_t first = team.warp * at_once; first < all;
         first += team.num_warps * at_once) {
      const std::int32_t i = first + gpu::lane_id() / width;
      RowPart part;
      if (i < num) {
        part.place = place_of_[boundary_.sphere_id[i]];
        part.begin = part.row_begin = graph_.row_starts[part.place];
        part.end = graph_.row_starts[part.place + 1];
        if (part.end > part.begin + PlaceGraphView::kPart) {
          part.end = part.begin + PlaceGraphView::kPart;
        }
      } else if (i < all) {
        part = graph_.more_parts[i - num];
        if (gpu::read_now(&search_.places[part.place].round) != search_.first_round) {
          part.end = part.begin;
        }
      }
      if (!__any_sync(gpu::kWholeWarp, part.begin < part.end)) continue;
      const std::int32_t seed = part.begin < part.end ? reference_[part.place] : -1;
      walk(part, width, {0, seed}, look_ahead(part, width), reached);
    }
  }

  __device__ void settle_listed(const Team& team, int turn, std::int32_t num,
                                std::int32_t round) const {
    const RowPart* const parts = search_.listed[turn % 2];
    const Reached reached = reached_from(team, turn, round);
    const int width = lanes_for_each(num, team), at_once = gpu::kWarpSize / width;
    for (std::int32_t first = team.warp * at_once; first < num;
         first += team.num_warps * at_once) {
      const std::int32_t i = first + gpu::lane_id() / width;
      settle(i < num ? parts[i] : RowPart{}, width, reached);
    }
  }

  __device__ Reached reached_from(const Team& team, int turn, std::int32_t round) const {
    return {round + 1, search_.listed[(turn + 1) % 2], team.num_listed + (turn + 1) % 3};
  }
  __device__ static int lanes_for_each(std::int32_t num, const Team& team) {
    int width = gpu::kWarpSize;
    while (width > kLeastLanes && num > team.num_warps * (gpu::kWarpSize / width)) width /= 2;
    return width;
  }

  /// One part by `width` lanes; an empty one by those that have none. All lanes of the warp call.
  __device__ void settle(const RowPart& part, int width, const Reached& reached) const {
    const bool has_part = part.begin < part.end;
    const int sub = gpu::lane_id() % width;
    // All that does not need the reference is asked for before it is known.
    const Offer* const offers = search_.offers + part.row_begin;
    const int num = has_part ? gpu::read_now(&search_.places[part.place].num_offers) : 0;
    const Offer first = has_part && sub < part.end - part.row_begin ? offers[sub] : Offer{};
    const Ahead ahead = look_ahead(part, width);
    const Offer best =
        best_offer(sub < num ? first : Offer{1e300, INT32_MAX}, offers, num, sub, width);
    if (has_part && part.begin == part.row_begin && sub == 0) {
      reference_[part.place] = best.seed;
      search_.path_length[part.place] = best.path_length;
    }
    walk(part, width, has_part ? best : Offer{}, ahead, reached);
  }

  /// The best of some offers, in all lanes of each `width`. All lanes of the warp call.
  __device__ static Offer best_offer(Offer best, const Offer* offers, int num, int sub, int width) {
#pragma unroll 4
    for (int i = sub + width; i < num; i += width) {
      const Offer offer = offers[i];
      if (offer.beats(best)) best = offer;
    }
    for (int step = width / 2; step > 0; step /= 2) {
      const Offer other{__shfl_xor_sync(gpu::kWholeWarp, best.path_length, step),
                        __shfl_xor_sync(gpu::kWholeWarp, best.seed, step)};
      if (other.beats(best)) best = other;
    }
    return best;
  }

  /// Neighbours of the part, from `begin` on, as many as its lanes look at together. Behind its end:
  /// one that is never open.
  __device__ Ahead look_ahead(const RowPart& part, int width) const {
    Ahead ahead;
#pragma unroll
    for (int b = 0; b < kBatch; ++b) {
      const std::int32_t e = part.begin + gpu::lane_id() % width + b * width;
      ahead.place[b] = e < part.end ? graph_.neighbours[e] : -1;
      ahead.round[b] = INT32_MAX;
    }
#pragma unroll
    for (int b = 0; b < kBatch; ++b) {
      const std::int32_t place = ahead.place[b];
      if (place < 0) continue;
      ahead.round[b] = gpu::read_now(&search_.places[place].round);
      ahead.row_begin[b] = graph_.row_starts[place];
      ahead.row_end[b] = graph_.row_starts[place + 1];
      ahead.sphere[b] = graph_.spheres[place];
    }
    return ahead;
  }

  /// Offers the reference of a place, if it has one, to those neighbours to which it leads. `ahead`:
  /// the first of them. All lanes of the warp call.
  __device__ void walk(RowPart part, int width, const Offer& from, Ahead ahead,
                       const Reached& reached) const {
    if (from.seed < 0) part.end = part.begin;
    const Lender& lender = boundary_.lenders[from.seed < 0 ? 0 : from.seed];
    const Vec3d c = graph_.spheres[part.place].centre(), normal = lender.plane_T.normal;
    while (__any_sync(gpu::kWholeWarp, part.begin < part.end)) {
      int number[kBatch];
      Vec3d edge[kBatch];
#pragma unroll
      for (int b = 0; b < kBatch; ++b) {
        number[b] = -1;
        if (from.seed < 0) continue;
        // Some may have been reached by others in this round.
        if (ahead.round[b] >= search_.first_round && ahead.round[b] != reached.round) continue;
        edge[b] = ahead.sphere[b].centre() - c;
        if (!leads_inside(edge[b], normal)) continue;
        const std::int32_t to = ahead.place[b];
        if (with_edges_ && edges_.forbids(sphere_ids_[to], lender.point)) continue;
        number[b] = atomicAdd(&search_.places[to].num_offers, 1);
      }
      list(ahead, number, reached);
#pragma unroll
      for (int b = 0; b < kBatch; ++b) {
        if (number[b] < 0) continue;
        search_.offers[ahead.row_begin[b] + number[b]] = {from.path_length + norm(edge[b]),
                                                          from.seed};
      }
      part.begin += kBatch * width;
      ahead = look_ahead(part, width);
    }
  }

  /// Those that get their first offer are reached. All lanes of the warp call.
  __device__ static int num_parts(std::int32_t row_begin, std::int32_t row_end) {
    return (row_end - row_begin + PlaceGraphView::kPart - 1) / PlaceGraphView::kPart;
  }
  __device__ void list(const Ahead& ahead, const int (&number)[kBatch],
                       const Reached& reached) const {
    int num = 0;
#pragma unroll
    for (int b = 0; b < kBatch; ++b) {
      if (number[b] == 0) num += num_parts(ahead.row_begin[b], ahead.row_end[b]);
    }
    if (!__any_sync(gpu::kWholeWarp, num > 0)) return;
    int sum = num;  // of the lanes up to this one
    for (int step = 1; step < gpu::kWarpSize; step *= 2) {
      const int below = __shfl_up_sync(gpu::kWholeWarp, sum, static_cast<unsigned>(step));
      if (gpu::lane_id() >= step) sum += below;
    }
    constexpr int kLast = gpu::kWarpSize - 1;
    int before = gpu::lane_id() == kLast ? atomicAdd(reached.num, sum) : 0;
    before = __shfl_sync(gpu::kWholeWarp, before, kLast);
    RowPart* to = reached.parts + before + sum - num;
#pragma unroll
    for (int b = 0; b < kBatch; ++b) {
      if (number[b] != 0) continue;
      write_now(&search_.places[ahead.place[b]].round, reached.round);
      const std::int32_t row_end = ahead.row_end[b];
      for (std::int32_t begin = ahead.row_begin[b]; begin < row_end;) {
        const std::int32_t next = begin + PlaceGraphView::kPart;
        *to++ = {ahead.place[b], ahead.row_begin[b], begin, next < row_end ? next : row_end};
        begin = next;
      }
    }
  }

  PlaceGraphView graph_;
  GraphSearch search_;
  BoundaryList boundary_;
  const std::int32_t* place_of_;  // of each sphere
  std::int32_t* reference_;       // of each place
  const std::int32_t* sphere_ids_;
  EdgesView edges_;
  bool with_edges_;
};

inline constexpr std::size_t kGraphSharedBytes = sizeof(GraphStage::Scratch);

/// Finds all places that the boundary spheres reach, whose round is first_round; `with_edges` if
/// edges matter. Called by all threads of a cooperative grid, after a barrier behind the boundary
/// stage and that of the edges; what it writes is visible to all when it returns. Returns the number
/// of rounds after the first. Shared memory: kGraphSharedBytes.
__device__ inline int search_graph(const PointQuery& q, unsigned long long* barrier,
                                   bool with_edges) {
  if (*q.boundary.num == 0) return 0;
  return GraphStage(q, with_edges).run(barrier);
}

/// This thread's part of the measure of what was reached: V_s n_s, with the sphere's centre as
/// lever. Fills in lender and borrowed_volume of all spheres that no point touches.
__device__ inline MeasureSums measure_reached(const PointQuery& q, bool with_edges) {
  const LendersView lenders = q.lenders_view();
  const EdgesView edges = q.edges_view();
  const bool has_pieces = with_edges && *q.num_pieces > 0;
  MeasureSums sums;
  for (std::int32_t place = gpu::grid_thread(); place < q.clusters.num_places();
       place += gpu::grid_threads()) {
    const PlaceState state = q.search.places[place];
    double volume = 0;
    if (state.round > q.search.first_round) {
      q.search.places[place].num_offers = 0;  // for the next query
      const std::int32_t id = q.clusters.sphere_id[place];
      const Lender& lender = lenders.lenders[q.lender[place]];
      volume = q.scale(id) * (has_pieces ? reached_volume(lenders, lender, id, q.inside, &edges)
                                         : reached_volume(lenders, lender, id, q.inside, nullptr));
      const Vec3d force = volume * lender.plane_T.normal;
      sums.volume += volume;
      sums.force += force;
      sums.torque += cross(q.graph.spheres[place].centre() - q.origin, force);
      sums.num_inside += volume > 0;
    } else if (state.round < q.search.first_round) {
      q.lender[place] = -1;
    }
    q.borrowed_volume[place] = static_cast<float>(volume);
  }
  return sums;
}

__device__ inline int search_graph(const PointQuery& q, unsigned long long* barrier) {
  return search_graph(q, barrier, q.edges != Edges::none);
}
__device__ inline MeasureSums measure_reached(const PointQuery& q) {
  return measure_reached(q, q.edges != Edges::none);
}

}  // namespace palpate
