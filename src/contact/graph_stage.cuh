// Graph stage of a query on a GPU: which untouched spheres are inside, and whose plane is theirs
// (thesis section 3.3.2; Algs. 3.5 to 3.7 corrected). The result is that of GraphTraversal.
//
// One barrier a round. In a round, each place that the round before has *stamped* is settled: it
// takes the best of the offers that were left for it. Now that it knows its reference, it stamps
// those of its neighbours that no earlier round has reached, if the reference lets it walk there,
// and leaves them its offer. A round stamps one number alone, so it does not matter who stamps
// first, and plain stores do. Offers lie in any order, but all of a round are compared. What a
// round reads of the round before was complete at the barrier.
//
// Places are looked at by warps, eight neighbouring ones (one sector of memory) at a time, in an
// assignment that does not depend on what happens. A warp shares its lanes among the places that it
// finds stamped. Long rows are shared by many warps, each of which compares all offers.
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
  __device__ GraphStage(const PointQuery& q, bool with_edges)
      : graph_(q.graph),
        search_(q.search),
        lenders_(q.boundary.lenders),
        reference_(q.lender),
        sphere_ids_(q.clusters.sphere_id),
        num_places_(q.clusters.num_places()),
        edges_(q.edges_view()),
        with_edges_(with_edges && *q.num_pieces > 0) {}

  /// Returns the number of rounds after the first.
  __device__ int run(unsigned long long* barrier) {
    const int warp = gpu::grid_thread() / gpu::kWarpSize;
    // Most warps have one of these parts or none: it is kept.
    const std::int32_t first_part = num_warps() - 1 - warp;
    const RowPart kept = more_part(first_part);
    for (int rounds = 0;; ++rounds) {
      const std::int32_t round = search_.first_round + rounds;
      if (rounds > 0) gpu::grid_barrier(barrier);
      const bool goes_on = rounds == 0 || gpu::read_now(flag(rounds - 1)) != 0;
      if (gpu::grid_thread() == 0) write_now(flag(rounds + 1), 0);  // read before this barrier
      Look look = look_at(warp);
      Look more = look_at(kept);
      if (!goes_on) return rounds - 1;
      bool has_stamped = false;
      for (std::int32_t sector = warp; sector * kSector < num_places_;) {
        sector += kSectorsPerLook * num_warps();
        const Look next = look_at(sector);  // on its way while these places are settled
        has_stamped |= settle(look, round, true);
        look = next;
      }
      for (std::int32_t part = first_part; part < graph_.num_more_parts;) {
        part += num_warps();
        const Look next = look_at(more_part(part));
        has_stamped |= settle(more, round, false);
        more = next;
      }
      if (has_stamped) write_now(flag(rounds), 1);
    }
  }

 private:
  static constexpr int kSector = 8;  // places
  static constexpr int kSectorsPerLook = gpu::kWarpSize / kSector;
  static constexpr int kBatch = 4;  // neighbours that a lane asks about at the same time

  /// What a lane sees of a place: its state, and the part of its row to be worked at.
  struct Look {
    PlaceState state;
    std::int32_t place = 0, offers_begin = 0, begin = 0, end = 0;
  };
  /// Some neighbours, asked about together. Behind the end of the row: one that is never open.
  struct Ahead {
    std::int32_t place[kBatch], round[kBatch], offers_begin[kBatch];
    PlaceSphere sphere[kBatch];
  };

  __device__ static int num_warps() { return gpu::grid_threads() / gpu::kWarpSize; }
  __device__ std::int32_t* flag(int rounds) const { return search_.any_reached + rounds % 3; }
  __device__ static void write_now(std::int32_t* to, std::int32_t value) {
    *static_cast<volatile std::int32_t*>(to) = value;
  }

  /// The places of four sectors, this one and others of this warp; the first part of their rows.
  __device__ Look look_at(std::int32_t sector) const {
    const int lane = gpu::lane_id();
    Look look;
    look.place = (sector + lane / kSector * num_warps()) * kSector + lane % kSector;
    if (look.place >= num_places_) return look;
    // All at once, though few places will turn out to be stamped.
    look.state = state_of(look.place);
    look.begin = look.offers_begin = graph_.row_starts[look.place];
    look.end = graph_.row_starts[look.place + 1];
    if (look.end > look.begin + PlaceGraphView::kPart) {
      look.end = look.begin + PlaceGraphView::kPart;
    }
    return look;
  }
  /// One further part of a row, by lane 0.
  __device__ Look look_at(const RowPart& part) const {
    Look look;
    look.place = part.place;
    look.begin = part.begin;
    look.end = part.end;
    if (part.begin == part.end || gpu::lane_id() != 0) return look;
    look.state = state_of(part.place);
    look.offers_begin = graph_.row_starts[part.place];
    return look;
  }
  __device__ RowPart more_part(std::int32_t part) const {
    return part < graph_.num_more_parts ? graph_.more_parts[part] : RowPart{};
  }
  __device__ PlaceState state_of(std::int32_t place) const {
    const PlaceState& state = search_.places[place];
    return {gpu::read_now(&state.round), gpu::read_now(&state.num_offers)};
  }

  /// Settles the stamped places of a warp, several at a time. All lanes call.
  __device__ bool settle(const Look& look, std::int32_t round, bool is_first_part) const {
    const bool is_stamped = look.state.round == round;
    const unsigned stamped = __ballot_sync(gpu::kWholeWarp, is_stamped);
    if (stamped == 0) return false;
    const int num = __popc(stamped), length = look.end - look.begin;
    int width = num > 4 ? 4 : (num > 2 ? 8 : (num > 1 ? 16 : 32));  // lanes for each place
    if (width < 16 && __any_sync(gpu::kWholeWarp, is_stamped && length > 16)) width = 16;
    if (__any_sync(gpu::kWholeWarp, is_stamped && length >= PlaceGraphView::kPart)) width = 32;
    const int at_once = gpu::kWarpSize / width, group = gpu::lane_id() / width;
    bool has_stamped = false;
    for (int begin = 0; begin < num; begin += at_once) {
      const bool has_place = begin + group < num;
      unsigned rest = stamped;
      for (int i = 0; has_place && i < begin + group; ++i) rest &= rest - 1;
      const int from = __ffs(static_cast<int>(rest)) - 1;
      Look mine;
      mine.state.num_offers = __shfl_sync(gpu::kWholeWarp, look.state.num_offers, from);
      mine.place = __shfl_sync(gpu::kWholeWarp, look.place, from);
      mine.offers_begin = __shfl_sync(gpu::kWholeWarp, look.offers_begin, from);
      mine.begin = __shfl_sync(gpu::kWholeWarp, look.begin, from);
      mine.end = __shfl_sync(gpu::kWholeWarp, look.end, from);
      if (!has_place) mine.end = mine.begin;
      has_stamped |= settle_one(mine, width, round, is_first_part && has_place);
    }
    return has_stamped;
  }

  /// Settles one place with `width` lanes. All lanes of the warp call.
  __device__ bool settle_one(const Look& mine, int width, std::int32_t round,
                             bool tells_result) const {
    const int sub = gpu::lane_id() % width;
    const Vec3d c = graph_.spheres[mine.place].centre();
    // All that does not need the reference is asked for before it is known.
    const Offer* const offers = search_.offers + mine.offers_begin;
    const bool has_offer = sub < mine.state.num_offers;
    Offer best = has_offer ? offers[sub] : Offer{1e300, INT32_MAX};
    Ahead ahead = look_ahead(mine.begin + sub, mine.end, width);
    if (round == search_.first_round) {
      best = {0, reference_[mine.place]};  // a boundary sphere: itself, or -1
    } else {
      best = best_offer(best, offers, mine.state.num_offers, sub, width);
      if (tells_result && sub == 0) {
        reference_[mine.place] = best.seed;
        search_.path_length[mine.place] = best.path_length;
      }
    }
    if (best.seed < 0) return false;
    const Lender& lender = lenders_[best.seed];
    const Vec3d normal = lender.plane_T.normal;
    bool has_stamped = false;
    for (std::int32_t e = mine.begin + sub; e < mine.end;) {
#pragma unroll
      for (int b = 0; b < kBatch; ++b) {
        // Some may have been stamped for the next round by now.
        if (ahead.round[b] >= search_.first_round && ahead.round[b] != round + 1) continue;
        const std::int32_t to = ahead.place[b];
        const Vec3d edge = ahead.sphere[b].centre() - c;
        if (!leads_inside(edge, normal)) continue;
        if (with_edges_ && edges_.forbids(sphere_ids_[to], lender.point)) continue;
        write_now(&search_.places[to].round, round + 1);
        const std::int32_t number = atomicAdd(&search_.places[to].num_offers, 1);
        search_.offers[ahead.offers_begin[b] + number] = {best.path_length + norm(edge), best.seed};
        has_stamped = true;
      }
      e += kBatch * width;
      if (e < mine.end) ahead = look_ahead(e, mine.end, width);
    }
    return has_stamped;
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

  __device__ Ahead look_ahead(std::int32_t e, std::int32_t end, int width) const {
    Ahead ahead;
#pragma unroll
    for (int b = 0; b < kBatch; ++b) {
      const std::int32_t edge = e + b * width;
      ahead.place[b] = edge < end ? graph_.neighbours[edge] : -1;
    }
#pragma unroll
    for (int b = 0; b < kBatch; ++b) {
      const std::int32_t place = ahead.place[b] < 0 ? 0 : ahead.place[b];
      ahead.round[b] = gpu::read_now(&search_.places[place].round);
      ahead.offers_begin[b] = graph_.row_starts[place];
      ahead.sphere[b] = graph_.spheres[place];
      if (ahead.place[b] < 0) ahead.round[b] = INT32_MAX;
    }
    return ahead;
  }

  PlaceGraphView graph_;
  GraphSearch search_;
  const Lender* lenders_;
  std::int32_t* reference_;  // of each place
  const std::int32_t* sphere_ids_;
  std::int32_t num_places_;
  EdgesView edges_;
  bool with_edges_;
};

/// Finds all places that the boundary spheres reach, whose round is first_round; `with_edges` if
/// edges matter. Called by all threads of a cooperative grid, after a barrier behind the boundary
/// stage and that of the edges;
/// what it writes is visible to all when it returns. Returns the number of rounds after the first.
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
