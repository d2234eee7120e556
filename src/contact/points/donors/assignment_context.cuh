// State that the parts of the assignment stage share: the rule of this query, the touched slots,
// and the sums.
#pragma once

#include <cstdint>

#include "src/contact/points/donors/assignment_rule.h"
#include "src/contact/points/donors/plane_assignment.h"
#include "src/contact/points/point_query.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {

/// Neighboring numbers of warps are in different blocks, which spreads work that lies together.
__device__ inline int spread_warp() {
  return gpu::warp_id() * static_cast<int>(gridDim.x) + static_cast<int>(blockIdx.x);
}
__device__ inline int num_grid_warps() { return gpu::grid_threads() / gpu::kWarpSize; }

class AssignmentContext {
 public:
  __device__ AssignmentContext(const PointQuery& query, MethodKind its_method, bool with_edges)
      : q(query),
        method(its_method),
        donors(query.donors_view()),
        edges(query.edges_view()),
        has_edges(with_edges && query.edges != Edges::none && *query.num_pieces > 0) {}
  AssignmentContext(const AssignmentContext&) = delete;

  const PointQuery& q;
  const MethodKind method;
  const DonorsView donors;
  const EdgesView edges;
  const bool has_edges;

  __device__ AssignmentRule rule() const {
    return {method == MethodKind::weighted, q.priority, has_edges ? &edges : nullptr};
  }
  __device__ bool fades_in() const { return q.plane_rule.fades_in; }
  /// True if untouched spheres composite donors.
  __device__ bool overlays() const { return fades_in() && method == MethodKind::simplified; }
  /// True if untouched spheres compare all donors.
  __device__ bool compares_all() const {
    return q.priority.compares_all(method == MethodKind::weighted);
  }
  __device__ bool is_at_edge(std::int32_t id) const { return has_edges && edges.concerns(id); }
  /// True for untouched spheres for which a warp reads all donors in double.
  __device__ bool is_one_by_one(std::int32_t id) const {
    return overlays() || compares_all() || (method == MethodKind::weighted && is_at_edge(id));
  }

  /// The word of PointQuery::touched of a sphere, and its bit there.
  __device__ std::uint32_t touched_word(std::int32_t id) const {
    return id < 0 ? 0 : q.touched[id / 32];
  }
  __device__ static bool is_untouched(std::int32_t id, std::uint32_t word) {
    return id >= 0 && (word >> (id % 32) & 1u) == 0;
  }

  /// Adds V_s n_s; the lever is the center of the sphere.
  __device__ void add(MeasureSums& sums, const Vec3f& center, const Assigned& measured) const {
    sums.volume += measured.volume;
    sums.force += measured.force;
    sums.torque += cross(to_double(center) - q.origin, measured.force);
  }
  /// The same for an untouched sphere, and keeps its volume.
  __device__ void add_untouched(MeasureSums& sums, std::int32_t slot, const Vec3f& center,
                                const Assigned& assigned) const {
    q.assigned_volume[slot] = static_cast<float>(assigned.volume);
    if (!(assigned.volume > 0)) return;
    add(sums, center, assigned);
    ++sums.num_inside;
  }
  __device__ Assigned scaled(std::int32_t id, const Assigned& assigned) const {
    const double scale = q.scale(id);
    return {scale * assigned.volume, scale * assigned.force};
  }

  /// Leaves untouched spheres of slots [first, last) outside. By threads of the block, or of the
  /// grid.
  __device__ void leave_outside(std::int32_t first, std::int32_t last, int thread,
                                int num_threads) const {
    for (std::int32_t slot = first + thread; slot < last; slot += num_threads) {
      const std::int32_t id = q.clusters.sphere_id[slot];
      if (!is_untouched(id, touched_word(id))) continue;
      q.donor[slot] = -1;
      if (!overlays()) q.assigned_volume[slot] = 0;
    }
  }

  /// DonorsView::assign by a warp, all lanes of which pass the same arguments and get the result.
  /// Without an average `best_donor` is the donor that counts most, -1 if there is none.
  __device__ Assigned assign_by_warp(std::int32_t id, std::int32_t& best_donor) const {
    const AssignmentRule requested = rule();
    best_donor = -1;
    if (has_edges && edges.cuts_off(id)) return {};
    if (requested.average) {
      DonorAverage sum;
      for (std::int32_t l = gpu::lane_id(); l < donors.num; l += gpu::kWarpSize) {
        donors.add_to(sum, l, id, requested);
      }
      sum.weights = gpu::warp_sum(sum.weights);
      sum.sum.volume = gpu::warp_sum(sum.sum.volume);
      for (int axis = 0; axis < 3; ++axis) sum.sum.force[axis] = gpu::warp_sum(sum.sum.force[axis]);
      return sum.value();
    }
    DonorChoices mine;
    for (std::int32_t l = gpu::lane_id(); l < donors.num; l += gpu::kWarpSize) {
      donors.offer_to(mine, l, id, requested);
    }
    const DonorChoices best = best_of_warp(mine);
    best_donor = best.donor[0];
    return donors.composite(best, id, requested);
  }

 private:
  // Returns the best of all lanes' choices, the same in all lanes. Ties go to the lowest index.
  __device__ static DonorChoices best_of_warp(DonorChoices mine) {
    constexpr int kMaxDonors = DonorChoices::kMaxDonors;
    DonorChoices best;
#pragma unroll
    for (int slot = 0; slot < kMaxDonors; ++slot) {
      double cost = mine.cost[0];
      std::int32_t donor = mine.donor[0];
      for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
        const double other_cost = __shfl_xor_sync(gpu::kWholeWarp, cost, step);
        const std::int32_t other = __shfl_xor_sync(gpu::kWholeWarp, donor, step);
        if (other_cost < cost || (other_cost == cost && other < donor)) {
          cost = other_cost;
          donor = other;
        }
      }
      best.cost[slot] = cost;
      best.donor[slot] = donor;
      if (donor < 0 || donor != mine.donor[0]) continue;
        // It was this lane's: the next one moves up.
#pragma unroll
      for (int i = 0; i + 1 < kMaxDonors; ++i) {
        mine.cost[i] = mine.cost[i + 1];
        mine.donor[i] = mine.donor[i + 1];
      }
      mine.cost[kMaxDonors - 1] = 1e300;
      mine.donor[kMaxDonors - 1] = -1;
    }
    return best;
  }
};

}}  // namespace palpate::v0
