// Assignment of donor planes in a query on a GPU: the boundary spheres' own caps, and planes for
// the spheres that no point touches (thesis section 3.2.2, Algs. 3.1, 3.3 and 3.4 corrected). All
// threads of the grid call; each returns the sums of its share, which depends on the sizes of grid
// and tool alone.
//
// Kernels for one method, or for clouds without edges, pass constants.
#pragma once

#include <cstddef>
#include <cstdint>

#include "src/contact/points/donors/assign_average.cuh"
#include "src/contact/points/donors/assign_nearest.cuh"
#include "src/contact/points/donors/assignment_context.cuh"

namespace palpate { inline namespace v0 {

inline constexpr std::size_t kAssignmentSharedBytes = sizeof(AssignmentShared);

/// The cap of a boundary sphere, cut by its own plane (Alg. 3.1) and, by `cut`, by its edge.
__device__ inline Assigned own_cap(const AssignmentContext& context, std::int32_t i) {
  const Donor& donor = context.q.boundary.donors[i];
  if (donor.sphere_id < 0) return {};
  AssignmentRule rule = context.rule();
  if (context.q.edges != Edges::cut) rule.edges = nullptr;
  return context.donors.assign_from(donor, donor.sphere_id, rule);
}

/// measure_boundary_spheres with fading. A sphere that a point has just entered is still measured
/// as if it were untouched: V = (1 - presence) V_state + presence V_cap. Rarely used, so its code
/// is kept out of line.
__device__ __noinline__ inline MeasureSums measure_fading_spheres(const PointQuery& q,
                                                                  MethodKind method,
                                                                  bool with_edges) {
  const AssignmentContext context(q, method, with_edges);
  MeasureSums sums;
  for (std::int32_t i = spread_warp(); i < context.donors.num; i += num_grid_warps()) {
    const std::int32_t id = q.boundary.sphere_id[i];
    std::int32_t best;
    const Assigned cap = own_cap(context, i), state = context.assign_by_warp(id, best);
    const Donor& donor = q.boundary.donors[i];
    const double presence = donor.sphere_id >= 0 ? donor.presence : 0;
    const Assigned measured{presence * cap.volume + (1 - presence) * state.volume,
                            presence * cap.force + (1 - presence) * state.force};
    if (gpu::lane_id() == 0)
      context.add(sums, q.scan.spheres[id].center, context.scaled(id, measured));
  }
  return sums;
}

/// Sums V_s n_s over the boundary spheres.
__device__ inline MeasureSums measure_boundary_spheres(const PointQuery& q, MethodKind method,
                                                       bool with_edges) {
  if (q.plane_rule.fades_in) return measure_fading_spheres(q, method, with_edges);
  const AssignmentContext context(q, method, with_edges);
  MeasureSums sums;
  // The last blocks begin: they have the fewest untouched spheres, if any.
  const int blocks = static_cast<int>(gridDim.x), block = blocks - 1 - static_cast<int>(blockIdx.x);
  const int first = (gpu::warp_id() * blocks + block) * gpu::kWarpSize + gpu::lane_id();
  for (std::int32_t i = first; i < context.donors.num; i += gpu::grid_threads()) {
    const std::int32_t id = q.boundary.sphere_id[i];
    context.add(sums, q.scan.spheres[id].center, context.scaled(id, own_cap(context, i)));
  }
  return sums;
}

/// Measures the untouched spheres that read all donors in double; a warp for each. Rarely used, so
/// its code is kept out of line.
__device__ __noinline__ inline MeasureSums measure_one_by_one(const PointQuery& q,
                                                              MethodKind method, bool with_edges) {
  const AssignmentContext context(q, method, with_edges);
  MeasureSums sums;
  const std::int32_t num_slots = q.clusters.num_slots();
  const int warps = num_grid_warps();
  // Strided: spheres that need it lie together.
  for (std::int32_t first = spread_warp(); first < num_slots; first += warps * gpu::kWarpSize) {
    const std::int32_t slot = first + warps * gpu::lane_id();
    const std::int32_t id = slot < num_slots ? q.clusters.sphere_id[slot] : -1;
    const bool mine =
        context.is_untouched(id, context.touched_word(id)) && context.is_one_by_one(id);
    unsigned todo = __ballot_sync(gpu::kWholeWarp, mine);
    for (; todo != 0; todo &= todo - 1) {
      const int lane = __ffs(static_cast<int>(todo)) - 1;
      std::int32_t best;
      const Assigned assigned =
          context.assign_by_warp(__shfl_sync(gpu::kWholeWarp, id, lane), best);
      if (lane == gpu::lane_id()) {
        if (context.compares_all()) q.donor[slot] = best;
        context.add_untouched(sums, slot, q.scan.spheres[id].center, context.scaled(id, assigned));
      }
    }
  }
  return sums;
}

/// Averages by a priority that is not in the thesis. Kept out of line likewise.
__device__ __noinline__ inline MeasureSums average_by_other_priorities(const PointQuery& q,
                                                                       bool with_edges) {
  const AssignmentContext context(q, MethodKind::weighted, with_edges);
  AverageAssignment assignment(context);
  if (q.priority.by == Priority::square) return assignment.run<Priority::square>();
  if (q.priority.by == Priority::gaussian) return assignment.run<Priority::gaussian>();
  return assignment.run<Priority::agreement>();
}

/// Weighted and simplified: assigns a plane to every untouched sphere. Writes PointQuery::donor (-1
/// where there is no single one, or nothing can be inside) and PointQuery::assigned_volume of their
/// slots.
__device__ inline MeasureSums assign_planes(const PointQuery& q, MethodKind method,
                                            bool with_edges) {
  const AssignmentContext context(q, method, with_edges);
  MeasureSums sums;
  const bool is_weighted = method == MethodKind::weighted;
  if (*q.boundary.num_donors == 0) {
    context.leave_outside(0, q.clusters.num_slots(), gpu::grid_thread(), gpu::grid_threads());
  } else if (context.compares_all()) {
    // One by one.
  } else if (is_weighted) {
    AverageAssignment assignment(context);
    sums = q.priority.by == Priority::distance ? assignment.run<Priority::distance>()
           : q.priority.by == Priority::count  ? assignment.run<Priority::count>()
                                               : average_by_other_priorities(q, with_edges);
  } else {
    DonorCenters from{nullptr, 0, context.donors.num};
    if (q.priority.by == Priority::count) {
      // One donor for all.
      from.first = static_cast<std::int32_t>(0xffffffffu - (*q.boundary.heaviest & 0xffffffffu));
      from.num = 1;
    }
    sums = NearestAssignment(context).run(from);
  }
  if (context.overlays() || context.compares_all() || (is_weighted && context.has_edges)) {
    sums.add(measure_one_by_one(q, method, with_edges));
  }
  return sums;
}

}}  // namespace palpate::v0
