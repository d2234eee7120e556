// What the parts of the borrow stage share: how spheres borrow in this query, which places have
// been touched, and how measures are added up.
#pragma once

#include <cstdint>

#include "src/contact/points/donors/borrow_rule.h"
#include "src/contact/points/donors/plane_borrowing.h"
#include "src/contact/points/point_query.h"
#include "src/gpu/team.cuh"

namespace palpate {

/// Warps are numbered so that neighbouring numbers are in different blocks: work lies together.
__device__ inline int spread_warp() {
  return gpu::warp_id() * static_cast<int>(gridDim.x) + static_cast<int>(blockIdx.x);
}
__device__ inline int num_grid_warps() { return gpu::grid_threads() / gpu::kWarpSize; }

class BorrowContext {
 public:
  __device__ BorrowContext(const PointQuery& query, InsideMethod its_method, bool with_edges)
      : q(query),
        method(its_method),
        lenders(query.lenders_view()),
        edges(query.edges_view()),
        has_edges(with_edges && query.edges != Edges::none && *query.num_pieces > 0) {}
  BorrowContext(const BorrowContext&) = delete;

  const PointQuery& q;
  const InsideMethod method;
  const LendersView lenders;
  const EdgesView edges;
  const bool has_edges;

  __device__ BorrowRule rule() const {
    return {method == InsideMethod::weighted, q.priority == Priority::count,
            has_edges ? &edges : nullptr};
  }
  __device__ bool fades_in() const { return q.plane_rule.fades_in; }
  /// Do untouched spheres lay lenders over each other?
  __device__ bool overlays() const { return fades_in() && method == InsideMethod::simplified; }
  __device__ bool is_at_edge(std::int32_t id) const { return has_edges && edges.concerns(id); }
  /// Untouched spheres for which a warp looks at all lenders in double.
  __device__ bool is_one_by_one(std::int32_t id) const {
    return overlays() || (method == InsideMethod::weighted && is_at_edge(id));
  }

  /// The word of PointQuery::touched that tells about a sphere, and what it tells.
  __device__ std::uint32_t touched_word(std::int32_t id) const {
    return id < 0 ? 0 : q.touched[id / 32];
  }
  __device__ static bool is_untouched(std::int32_t id, std::uint32_t word) {
    return id >= 0 && (word >> (id % 32) & 1u) == 0;
  }

  /// Adds V_s n_s; the lever is the centre of the sphere.
  __device__ void add(MeasureSums& sums, const Vec3f& centre, const Borrowed& measured) const {
    sums.volume += measured.volume;
    sums.force += measured.force;
    sums.torque += cross(to_double(centre) - q.origin, measured.force);
  }
  /// The same for an untouched sphere, and keeps its volume.
  __device__ void add_untouched(MeasureSums& sums, std::int32_t place, const Vec3f& centre,
                                const Borrowed& borrowed) const {
    q.borrowed_volume[place] = static_cast<float>(borrowed.volume);
    if (!(borrowed.volume > 0)) return;
    add(sums, centre, borrowed);
    ++sums.num_inside;
  }
  __device__ Borrowed scaled(std::int32_t id, const Borrowed& borrowed) const {
    const double scale = q.scale(id);
    return {scale * borrowed.volume, scale * borrowed.force};
  }

  /// Untouched spheres of places [first, last) have nothing inside. By threads of the block, or of
  /// the grid.
  __device__ void leave_outside(std::int32_t first, std::int32_t last, int thread,
                                int num_threads) const {
    for (std::int32_t place = first + thread; place < last; place += num_threads) {
      const std::int32_t id = q.clusters.sphere_id[place];
      if (!is_untouched(id, touched_word(id))) continue;
      q.lender[place] = -1;
      if (!overlays()) q.borrowed_volume[place] = 0;
    }
  }

  /// LendersView::borrow by a warp, all lanes of which ask the same and get the answer.
  __device__ Borrowed borrow_by_warp(std::int32_t id) const {
    const BorrowRule asked = rule();
    if (has_edges && edges.cuts_off(id)) return {};
    if (asked.average) {
      LenderAverage sum;
      for (std::int32_t l = gpu::lane_id(); l < lenders.num; l += gpu::kWarpSize) {
        lenders.add_to(sum, l, id, asked);
      }
      sum.weights = gpu::warp_sum(sum.weights);
      sum.sum.volume = gpu::warp_sum(sum.sum.volume);
      for (int axis = 0; axis < 3; ++axis) sum.sum.force[axis] = gpu::warp_sum(sum.sum.force[axis]);
      return sum.value();
    }
    LenderChoices mine;
    for (std::int32_t l = gpu::lane_id(); l < lenders.num; l += gpu::kWarpSize) {
      lenders.offer_to(mine, l, id, asked);
    }
    return lenders.laid_over(best_of_warp(mine), id, asked);
  }

 private:
  // The best of all lanes' choices, the same in all lanes. Ties go to the lowest index.
  __device__ static LenderChoices best_of_warp(LenderChoices mine) {
    constexpr int kMost = LenderChoices::kMost;
    LenderChoices best;
#pragma unroll
    for (int place = 0; place < kMost; ++place) {
      double badness = mine.badness[0];
      std::int32_t lender = mine.lender[0];
      for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
        const double other_badness = __shfl_xor_sync(gpu::kWholeWarp, badness, step);
        const std::int32_t other = __shfl_xor_sync(gpu::kWholeWarp, lender, step);
        if (other_badness < badness || (other_badness == badness && other < lender)) {
          badness = other_badness;
          lender = other;
        }
      }
      best.badness[place] = badness;
      best.lender[place] = lender;
      if (lender < 0 || lender != mine.lender[0]) continue;
        // It was this lane's: its next one comes up.
#pragma unroll
      for (int i = 0; i + 1 < kMost; ++i) {
        mine.badness[i] = mine.badness[i + 1];
        mine.lender[i] = mine.lender[i + 1];
      }
      mine.badness[kMost - 1] = 1e300;
      mine.lender[kMost - 1] = -1;
    }
    return best;
  }
};

}  // namespace palpate
