// Boundary stage of a query on a GPU: the touched spheres in ascending order, their planes
// (boundary_plane.h) and their pieces of edges (edge_pieces.h).
//
// Each block has its share of the words of q.touched. Where its spheres stand in the list follows
// from the number of bits before its share, which each block counts for itself: no barrier is
// needed.
#pragma once

#include <cstddef>
#include <cstdint>

#include "src/contact/point_query.h"
#include "src/gpu/team.cuh"

namespace palpate {

/// Run by all threads of blocks of kQueryThreads.
class BoundaryStage {
 public:
  /// Shared memory of a block.
  struct Scratch {
    std::int32_t sums_of_warps[kQueryThreads / gpu::kWarpSize];
    std::uint32_t words[kQueryThreads];      ///< that a block looks at at the same time
    std::int32_t places[kQueryThreads];      ///< of the first sphere of each, among theirs
    std::int32_t sphere_ids[kQueryThreads];  ///< taken at the same time
  };

  __device__ explicit BoundaryStage(const PointQuery& q)
      : q_(q),
        shared_(gpu::shared_memory<Scratch>()),
        thread_(static_cast<int>(threadIdx.x)),
        num_parts_(q.scan.edges != nullptr ? 1 + EdgeSums::kDirections : 1) {}

  __device__ void run() {
    const std::int64_t num_words = (q_.num_spheres + 31) / 32;
    const auto begin = static_cast<int>(num_words * blockIdx.x / gridDim.x);
    const auto end = static_cast<int>(num_words * (blockIdx.x + 1) / gridDim.x);
    std::int32_t before = 0;
#pragma unroll 8
    for (int w = thread_; w < begin; w += kQueryThreads) before += __popc(q_.touched[w]);
    std::int32_t first = sum_before(before).of_all;
    for (int pass = begin; pass < end; pass += kQueryThreads) {
      const int w = pass + thread_, num = end - pass < kQueryThreads ? end - pass : kQueryThreads;
      const std::uint32_t word = w < end ? q_.touched[w] : 0;
      const Sum place = sum_before(__popc(word));
      shared_.words[thread_] = word;
      shared_.places[thread_] = place.of_those_before;
      __syncthreads();
      for (std::int32_t from = 0; from < place.of_all; from += kQueryThreads) {
        const std::int32_t rest = place.of_all - from;
        list_spheres(pass, num, from);
        __syncthreads();
        take_spheres(first + from, rest < kQueryThreads ? rest : kQueryThreads);
        __syncthreads();
      }
      first += place.of_all;
    }
    if (blockIdx.x == gridDim.x - 1 && thread_ == 0) {
      *q_.boundary.num = first;
      *q_.num_edge_candidates = 0;  // for the next query: nobody reads it any more
    }
    hand_in();
  }

 private:
  struct Sum {
    std::int32_t of_those_before, of_all;
  };

  // Over the threads of the block.
  __device__ Sum sum_before(std::int32_t value) {
    std::int32_t sum = value;  // of the lanes up to this one
    for (int step = 1; step < gpu::kWarpSize; step *= 2) {
      const std::int32_t below = __shfl_up_sync(gpu::kWholeWarp, sum, static_cast<unsigned>(step));
      if (gpu::lane_id() >= step) sum += below;
    }
    __syncthreads();  // the last sum has been read
    if (gpu::lane_id() == gpu::kWarpSize - 1) shared_.sums_of_warps[gpu::warp_id()] = sum;
    __syncthreads();
    Sum result{sum - value, 0};
    for (int warp = 0; warp < kQueryThreads / gpu::kWarpSize; ++warp) {
      if (warp < gpu::warp_id()) result.of_those_before += shared_.sums_of_warps[warp];
      result.of_all += shared_.sums_of_warps[warp];
    }
    return result;
  }

  // The spheres of this pass with places from `from` on. A warp looks at a word at a time.
  __device__ void list_spheres(int first_word, int num_words, std::int32_t from) {
    const int lane = gpu::lane_id();
    for (int w = gpu::warp_id(); w < num_words; w += kQueryThreads / gpu::kWarpSize) {
      const std::uint32_t word = shared_.words[w], bit = 1u << lane;
      const std::int32_t place = shared_.places[w] + __popc(word & (bit - 1)) - from;
      if ((word & bit) != 0 && place >= 0 && place < kQueryThreads) {
        shared_.sphere_ids[place] = (first_word + w) * 32 + lane;
      }
    }
  }

  // All planes first, then the pieces of each side.
  __device__ void take_spheres(std::int32_t first, int num) {
    for (int item = thread_; item < num * num_parts_; item += kQueryThreads) {
      const int part = item / num, i = item % num;
      const std::int32_t id = shared_.sphere_ids[i];
      if (part == 0) {
        take_plane(first + i, id);
      } else {
        take_piece(first + i, id, part - 1);
      }
    }
  }

  __device__ void take_plane(std::int32_t i, std::int32_t id) {
    const BoundarySphere sphere =
        boundary_sphere(id, q_.sums[id], q_.plane_rule, q_.scan.R_TW, q_.scan.translation_W);
    q_.sums[id] = PointSums{};
    const BoundaryList& list = q_.boundary;
    const Lender& lender = sphere.lender;
    const bool lends = sphere.has_plane();
    const Vec3f centre = lends ? q_.scan.spheres[id].centre : Vec3f{1e12f, 1e12f, 1e12f};
    const Vec3f normal = to_float(lender.plane_T.normal);
    const float weight = static_cast<float>(lender.weight);
    list.sphere_id[i] = id;
    list.lenders[i] = lender;
    list.x[i] = centre.x;
    list.y[i] = centre.y;
    list.z[i] = centre.z;
    list.nx[i] = normal.x;
    list.ny[i] = normal.y;
    list.nz[i] = normal.z;
    list.offset[i] = static_cast<float>(lender.plane_T.offset);
    list.weight[i] = weight;
    list.presence[i] = lends ? static_cast<float>(lender.presence) : 0.0f;
    const std::int32_t place = q_.clusters.place_of[id];
    q_.lender[place] = lends ? i : -1;
    q_.borrowed_volume[place] = 0;
    if (q_.method == InsideMethod::graph) {
      q_.search.places[place].round = q_.search.first_round;
    }

    any_ = true;
    ambiguous_ |= sphere.is_ambiguous;
    num_points_ += sphere.num_points;
    if (!lends) return;
    ++num_lenders_;
    const auto bits = static_cast<std::uint32_t>(__float_as_int(weight));
    const unsigned long long rank =
        static_cast<unsigned long long>(bits) << 32 | (0xffffffffu - static_cast<std::uint32_t>(i));
    if (rank > heaviest_) heaviest_ = rank;
  }

  __device__ void take_piece(std::int32_t i, std::int32_t id, int direction) {
    PointSums& sums = q_.edge_sums[id].towards[direction];
    const EdgePiece piece = edge_piece(sums, q_.scan.R_TW, q_.scan.translation_W);
    const std::int32_t number = EdgeSums::kDirections * i + direction;
    q_.pieces[number] = piece;
    if (sums.num_points() != 0) sums = PointSums{};
    if (!piece.exists()) return;
    const std::int32_t place = atomicAdd(q_.num_pieces, 1);
    q_.seen_pieces.u[place] = piece.u;
    q_.seen_pieces.v[place] = piece.v;
    q_.seen_pieces.number[place] = number;
  }

  // What the threads of a warp counted goes to the list's counters.
  __device__ void hand_in() {
    if (!__any_sync(gpu::kWholeWarp, any_)) return;
    const std::int32_t num_lenders = gpu::warp_sum(num_lenders_);
    const std::int32_t num_points = gpu::warp_sum(num_points_);
    const bool ambiguous = __any_sync(gpu::kWholeWarp, ambiguous_);
    for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
      const unsigned long long other = __shfl_xor_sync(gpu::kWholeWarp, heaviest_, step);
      if (other > heaviest_) heaviest_ = other;
    }
    if (gpu::lane_id() != 0) return;
    atomicAdd(q_.boundary.num_lenders, num_lenders);
    atomicAdd(q_.boundary.num_points, num_points);
    atomicMax(q_.boundary.heaviest, heaviest_);
    if (ambiguous) {
      atomicOr(q_.boundary.status, static_cast<std::uint32_t>(StepStatus::ambiguous_normals));
    }
  }

  const PointQuery& q_;
  Scratch& shared_;
  const int thread_, num_parts_;
  // Of the spheres that this thread took.
  bool any_ = false, ambiguous_ = false;
  std::int32_t num_lenders_ = 0, num_points_ = 0;
  unsigned long long heaviest_ = 0;
};

/// After scan_points (and scan_edges) and a barrier: fills q.boundary and, with edges, q.pieces and
/// q.seen_pieces. Leaves sums and edge sums zero. Shared memory: kBoundarySharedBytes.
__device__ inline void find_boundary(const PointQuery& q) { BoundaryStage(q).run(); }

inline constexpr std::size_t kBoundarySharedBytes = sizeof(BoundaryStage::Scratch);

/// By one thread, before the barrier that find_boundary waits for: counters of the query before.
__device__ inline void reset_counters(const PointQuery& q) {
  *q.boundary.num_lenders = 0;
  *q.boundary.num_points = 0;
  *q.boundary.status = 0;
  *q.boundary.heaviest = 0;
  *q.num_pieces = 0;
}

}  // namespace palpate
