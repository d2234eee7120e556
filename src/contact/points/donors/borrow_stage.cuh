// Borrow stage of a query on a GPU: the boundary spheres' own caps, and planes for the spheres that
// no point touches (thesis section 3.2.2, Algs. 3.1, 3.3 and 3.4 corrected). All threads of the
// grid call; each returns the sums of its share, which depends on the sizes of grid and tool alone.
//
// A kernel made for one method, or for clouds without edges, says so by constants.
#pragma once

#include <cstddef>
#include <cstdint>

#include "src/contact/points/donors/borrow_average.cuh"
#include "src/contact/points/donors/borrow_context.cuh"
#include "src/contact/points/donors/borrow_nearest.cuh"

namespace palpate {

inline constexpr std::size_t kBorrowSharedBytes = sizeof(BorrowShared);

/// The cap of a boundary sphere, cut by its own plane (Alg. 3.1) and, by `cut`, by its edge.
__device__ inline Borrowed own_cap(const BorrowContext& context, std::int32_t i) {
  const Lender& lender = context.q.boundary.lenders[i];
  if (lender.sphere_id < 0) return {};
  BorrowRule rule = context.rule();
  if (context.q.edges != Edges::cut) rule.edges = nullptr;
  return context.lenders.borrow_from(lender, lender.sphere_id, rule);
}

/// measure_boundary_spheres where they fade in. A sphere that a point has just entered is still
/// measured as if it were untouched: V = (1 - presence) V_state + presence V_cap. Rarely used, so
/// its code is kept out of the others' way.
__device__ __noinline__ inline MeasureSums measure_fading_spheres(const PointQuery& q,
                                                                  InsideMethod method,
                                                                  bool with_edges) {
  const BorrowContext context(q, method, with_edges);
  MeasureSums sums;
  for (std::int32_t i = spread_warp(); i < context.lenders.num; i += num_grid_warps()) {
    const std::int32_t id = q.boundary.sphere_id[i];
    const Borrowed cap = own_cap(context, i), state = context.borrow_by_warp(id);
    const Lender& lender = q.boundary.lenders[i];
    const double presence = lender.sphere_id >= 0 ? lender.presence : 0;
    const Borrowed measured{presence * cap.volume + (1 - presence) * state.volume,
                            presence * cap.force + (1 - presence) * state.force};
    if (gpu::lane_id() == 0)
      context.add(sums, q.scan.spheres[id].centre, context.scaled(id, measured));
  }
  return sums;
}

/// V_s n_s of the boundary spheres.
__device__ inline MeasureSums measure_boundary_spheres(const PointQuery& q, InsideMethod method,
                                                       bool with_edges) {
  if (q.plane_rule.fades_in) return measure_fading_spheres(q, method, with_edges);
  const BorrowContext context(q, method, with_edges);
  MeasureSums sums;
  // By the last blocks first: those that have the fewest untouched spheres, if any.
  const int blocks = static_cast<int>(gridDim.x), block = blocks - 1 - static_cast<int>(blockIdx.x);
  const int first = (gpu::warp_id() * blocks + block) * gpu::kWarpSize + gpu::lane_id();
  for (std::int32_t i = first; i < context.lenders.num; i += gpu::grid_threads()) {
    const std::int32_t id = q.boundary.sphere_id[i];
    context.add(sums, q.scan.spheres[id].centre, context.scaled(id, own_cap(context, i)));
  }
  return sums;
}

/// Untouched spheres for which all lenders are looked at in double; a warp for each. Rarely used,
/// so its code is kept out of the others' way.
__device__ __noinline__ inline MeasureSums measure_one_by_one(const PointQuery& q,
                                                              InsideMethod method,
                                                              bool with_edges) {
  const BorrowContext context(q, method, with_edges);
  MeasureSums sums;
  const std::int32_t num_places = q.clusters.num_places();
  const int warps = num_grid_warps();
  // Every so many: spheres that need it lie together.
  for (std::int32_t first = spread_warp(); first < num_places; first += warps * gpu::kWarpSize) {
    const std::int32_t place = first + warps * gpu::lane_id();
    const std::int32_t id = place < num_places ? q.clusters.sphere_id[place] : -1;
    const bool mine =
        context.is_untouched(id, context.touched_word(id)) && context.is_one_by_one(id);
    unsigned todo = __ballot_sync(gpu::kWholeWarp, mine);
    for (; todo != 0; todo &= todo - 1) {
      const int lane = __ffs(static_cast<int>(todo)) - 1;
      const Borrowed borrowed = context.borrow_by_warp(__shfl_sync(gpu::kWholeWarp, id, lane));
      if (lane == gpu::lane_id()) {
        context.add_untouched(sums, place, q.scan.spheres[id].centre, context.scaled(id, borrowed));
      }
    }
  }
  return sums;
}

/// Weighted and simplified: every untouched sphere borrows. Writes PointQuery::lender (-1 where
/// there is no single one, or nothing can be inside) and PointQuery::borrowed_volume of their
/// places.
__device__ inline MeasureSums borrow_planes(const PointQuery& q, InsideMethod method,
                                            bool with_edges) {
  const BorrowContext context(q, method, with_edges);
  MeasureSums sums;
  const bool is_weighted = method == InsideMethod::weighted;
  if (*q.boundary.num_lenders == 0) {
    context.leave_outside(0, q.clusters.num_places(), gpu::grid_thread(), gpu::grid_threads());
  } else if (is_weighted) {
    sums = AverageBorrowing(context).run();
  } else {
    LenderCentres from{nullptr, 0, context.lenders.num};
    if (q.priority == Priority::count) {
      // One lender for all.
      from.first = static_cast<std::int32_t>(0xffffffffu - (*q.boundary.heaviest & 0xffffffffu));
      from.num = 1;
    }
    sums = NearestBorrowing(context).run(from);
  }
  if (context.overlays() || (is_weighted && context.has_edges)) {
    sums.add(measure_one_by_one(q, method, with_edges));
  }
  return sums;
}

}  // namespace palpate
