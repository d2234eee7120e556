// Boundary stage of a query on a GPU: the touched spheres in ascending order, their planes
// (boundary_plane.h) and their pieces of edges (edge_pieces.h).
//
// Each block has its share of the words of q.touched. The position of its spheres in the list
// follows from the number of bits before its share, which each block counts for itself: no barrier
// is needed.
#pragma once

#include <cstddef>
#include <cstdint>

#include "src/contact/points/point_query.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {

/// Run by all threads of blocks of kQueryThreads.
class BoundaryStage {
 public:
  /// Touched spheres before a block's share, and in it.
  struct alignas(8) Count {
    std::int32_t before_share, in_share;
  };
  /// Shared memory of a block.
  struct Scratch {
    Count counts[kQueryThreads / gpu::kWarpSize];  ///< of each warp
    std::uint32_t words[kQueryThreads];            ///< read at the same time by a block
    std::int32_t slots[kQueryThreads];             ///< of the first sphere of each word
    std::int32_t sphere_ids[kQueryThreads];        ///< processed at the same time
  };

  __device__ BoundaryStage(const PointQuery& q, bool with_edges)
      : q_(q),
        shared_(gpu::shared_memory<Scratch>()),
        thread_(static_cast<int>(threadIdx.x)),
        num_parts_(with_edges && q.scan.edges != nullptr ? 1 + EdgeSums::kDirections : 1) {}

  __device__ void run() {
    const int num_words = (q_.num_spheres + 31) / 32, blocks = static_cast<int>(gridDim.x);
    const int share = (num_words + blocks - 1) / blocks;
    const int begin = min_of(static_cast<int>(blockIdx.x) * share, num_words);
    const int end = min_of(begin + share, num_words);
    std::int32_t before = 0;
#pragma unroll 4
    for (int w = thread_; w < begin; w += kQueryThreads) before += __popc(q_.touched[w]);
    std::int32_t first = 0;
    int pass = begin;
    do {
      const int w = pass + thread_, num = min_of(end - pass, kQueryThreads);
      const std::uint32_t word = w < end ? q_.touched[w] : 0;
      const Slots slots = count(before, __popc(word));
      before = 0;
      first += slots.before_share;
      shared_.words[thread_] = word;
      shared_.slots[thread_] = slots.of_thread;
      __syncthreads();
      for (std::int32_t from = 0; from < slots.num; from += kQueryThreads) {
        list_spheres(pass, num, from);
        __syncthreads();
        take_spheres(first + from, min_of(slots.num - from, kQueryThreads));
        __syncthreads();
      }
      first += slots.num;
      pass += kQueryThreads;
    } while (pass < end);
    if (blockIdx.x == gridDim.x - 1 && thread_ == 0) {
      *q_.boundary.num = first;
      *q_.num_edge_candidates = 0;  // for the next query: no thread reads it any more
    }
    hand_in();
  }

 private:
  struct Slots {
    std::int32_t before_share, of_thread, num;
  };

  __device__ static int min_of(int a, int b) { return a < b ? a : b; }

  // Returns sums over the threads of the block: of all counts before the share, and of the counts
  // in it up to this thread. The result of the last call has been read: a barrier follows it.
  __device__ Slots count(std::int32_t before_share, std::int32_t in_share) {
    std::int32_t up_to_here = in_share;
    for (int step = 1; step < gpu::kWarpSize; step *= 2) {
      const std::int32_t below =
          __shfl_up_sync(gpu::kWholeWarp, up_to_here, static_cast<unsigned>(step));
      if (gpu::lane_id() >= step) up_to_here += below;
    }
    before_share = gpu::warp_sum(before_share);
    if (gpu::lane_id() == gpu::kWarpSize - 1) {
      shared_.counts[gpu::warp_id()] = {before_share, up_to_here};
    }
    __syncthreads();
    Slots slots{0, up_to_here - in_share, 0};
#pragma unroll
    for (int warp = 0; warp < kQueryThreads / gpu::kWarpSize; ++warp) {
      const Count its = shared_.counts[warp];
      slots.before_share += its.before_share;
      slots.of_thread += warp < gpu::warp_id() ? its.in_share : 0;
      slots.num += its.in_share;
    }
    return slots;
  }

  // Lists the spheres of this pass with slots from `from` on. A warp reads a word at a time.
  __device__ void list_spheres(int first_word, int num_words, std::int32_t from) {
    const int lane = gpu::lane_id();
    for (int w = gpu::warp_id(); w < num_words; w += kQueryThreads / gpu::kWarpSize) {
      const std::uint32_t word = shared_.words[w], bit = 1u << lane;
      const std::int32_t slot = shared_.slots[w] + __popc(word & (bit - 1)) - from;
      if ((word & bit) != 0 && slot >= 0 && slot < kQueryThreads) {
        shared_.sphere_ids[slot] = (first_word + w) * 32 + lane;
      }
    }
  }

  // Computes all planes first, then the pieces of each side.
  __device__ void take_spheres(std::int32_t first, int num) {
    if (thread_ < num) take_plane(first + thread_, shared_.sphere_ids[thread_]);
    for (int item = num + thread_; item < num * num_parts_; item += kQueryThreads) {
      const int part = item / num, i = item - part * num;
      take_piece(first + i, shared_.sphere_ids[i], part - 1);
    }
  }

  __device__ void take_plane(std::int32_t i, std::int32_t id) {
    // Loads all from memory at once.
    const PointSums sums = q_.sums[id];
    const Vec3f its_center = q_.scan.spheres[id].center;
    const std::int32_t slot = q_.clusters.slot_of[id];
    q_.sums[id] = PointSums{};
    const BoundarySphere sphere = boundary_sphere(id, sums, q_.scan.sum_scale, q_.plane_rule,
                                                  q_.scan.R_TW, q_.scan.translation_W);
    const BoundaryList& list = q_.boundary;
    const Donor& donor = sphere.donor;
    const bool lends = sphere.has_plane();
    const Vec3f center = lends ? its_center : Vec3f{1e12f, 1e12f, 1e12f};
    const Vec3f normal = to_float(donor.plane_T.normal);
    const float weight = static_cast<float>(donor.weight);
    list.sphere_id[i] = id;
    list.donors[i] = donor;
    list.x[i] = center.x;
    list.y[i] = center.y;
    list.z[i] = center.z;
    list.nx[i] = normal.x;
    list.ny[i] = normal.y;
    list.nz[i] = normal.z;
    list.offset[i] = static_cast<float>(donor.plane_T.offset);
    list.weight[i] = weight;
    list.presence[i] = lends ? static_cast<float>(donor.presence) : 0.0f;
    q_.donor[slot] = lends ? i : -1;
    q_.assigned_volume[slot] = 0;
    if (q_.method == MethodKind::graph) {
      q_.search.slots[slot].round = q_.search.first_round;
    }

    any_ = true;
    ambiguous_ |= sphere.is_ambiguous;
    num_points_ += sphere.num_points;
    if (!lends) return;
    ++num_donors_;
    const auto bits = static_cast<std::uint32_t>(__float_as_int(weight));
    const unsigned long long rank =
        static_cast<unsigned long long>(bits) << 32 | (0xffffffffu - static_cast<std::uint32_t>(i));
    if (rank > heaviest_) heaviest_ = rank;
  }

  __device__ void take_piece(std::int32_t i, std::int32_t id, int direction) {
    PointSums& sums = q_.edge_sums[id].towards[direction];
    const EdgePiece piece =
        edge_piece(sums, q_.scan.sum_scale, q_.scan.R_TW, q_.scan.translation_W);
    const std::int32_t number = EdgeSums::kDirections * i + direction;
    q_.pieces[number] = piece;
    if (sums.has_points()) sums = PointSums{};
    if (!piece.exists()) return;
    const std::int32_t slot = atomicAdd(q_.num_pieces, 1);
    q_.seen_pieces.u[slot] = piece.u;
    q_.seen_pieces.v[slot] = piece.v;
    q_.seen_pieces.number[slot] = number;
  }

  // Adds the counts of the threads of a warp to the list's counters.
  __device__ void hand_in() {
    if (!__any_sync(gpu::kWholeWarp, any_)) return;
    const std::int32_t num_donors = gpu::warp_sum(num_donors_);
    const std::int32_t num_points = gpu::warp_sum(num_points_);
    const bool ambiguous = __any_sync(gpu::kWholeWarp, ambiguous_);
    for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
      const unsigned long long other = __shfl_xor_sync(gpu::kWholeWarp, heaviest_, step);
      if (other > heaviest_) heaviest_ = other;
    }
    if (gpu::lane_id() != 0) return;
    atomicAdd(q_.boundary.num_donors, num_donors);
    atomicAdd(q_.boundary.num_points, num_points);
    atomicMax(q_.boundary.heaviest, heaviest_);
    if (ambiguous) {
      atomicOr(q_.boundary.status, static_cast<std::uint32_t>(StepStatus::ambiguous_normals));
    }
  }

  const PointQuery& q_;
  Scratch& shared_;
  const int thread_, num_parts_;
  // Counts of the spheres that this thread took.
  bool any_ = false, ambiguous_ = false;
  std::int32_t num_donors_ = 0, num_points_ = 0;
  unsigned long long heaviest_ = 0;
};

/// Call after scan_points (and scan_edges) and a barrier: fills q.boundary and, with edges,
/// q.pieces and q.seen_pieces. Leaves sums and edge sums zero. Shared memory: kBoundarySharedBytes.
/// Kernels for clouds without edges pass a constant.
__device__ inline void find_boundary(const PointQuery& q, bool with_edges) {
  BoundaryStage(q, with_edges).run();
}

inline constexpr std::size_t kBoundarySharedBytes = sizeof(BoundaryStage::Scratch);

/// Resets the counters, by one thread, before the barrier that find_boundary waits for.
__device__ inline void reset_counters(const PointQuery& q) {
  *q.boundary.num_donors = 0;
  *q.boundary.num_points = 0;
  *q.boundary.status = 0;
  *q.boundary.heaviest = 0;
  *q.num_pieces = 0;
}

}}  // namespace palpate::v0
