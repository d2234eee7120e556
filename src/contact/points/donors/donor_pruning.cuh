// Selection of donors that can be the nearest to some sphere of a neighborhood, on a GPU.
#pragma once

#include <cstdint>

#include "src/contact/points/donors/assignment_rule.h"
#include "src/contact/points/donors/plane_assignment.h"
#include "src/contact/points/point_query.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {

struct alignas(16) DonorCenter {
  float x, y, z;
  std::int32_t donor;
};

/// Donors to choose from: a list in shared memory or, without one, [first, first + num) of all.
struct DonorCenters {
  const DonorCenter* list = nullptr;
  std::int32_t first = 0, num = 0;

  __device__ DonorCenter at(const BoundaryList& boundary, int i) const {
    if (list != nullptr) return list[i];
    const std::int32_t l = first + i;
    return {boundary.x[l], boundary.y[l], boundary.z[l], l};
  }
};

/// The nearest donor of one sphere; squared distances of it and of the next one.
struct NearestDonor {
  float least = 1e30f, second = 1e30f;
  std::int32_t donor = -1;

  __device__ void offer(float squared, std::int32_t its_donor) {
    donor = squared < least ? its_donor : donor;
    second = fminf(second, fmaxf(squared, least));
    least = fminf(squared, least);
  }
  __device__ void join(const NearestDonor& other) {
    donor = other.least < least ? other.donor : donor;
    second = fminf(fminf(second, other.second), fmaxf(least, other.least));
    least = fminf(least, other.least);
  }
};

struct AssignmentShared {
  static constexpr int kWarps = kQueryThreads / gpu::kWarpSize;
  static constexpr int kOfRun = 2048, kOfTile = 1024, kOfWarp = 2 * gpu::kWarpSize;

  DonorCenter of_run[kOfRun], of_tile[kOfTile], of_warp[kWarps][kOfWarp];
  NearestDonor found[kWarps][gpu::kWarpSize];
  one_lane::NearestToMiddle nearest[kWarps];
  int num, is_reached;
};

/// Selection among donors by a block, and by a warp of it.
class DonorPruning {
 protected:
  __device__ explicit DonorPruning(const PointQuery& q)
      : q_(q), shared_(gpu::shared_memory<AssignmentShared>()) {}

  struct Pruned {
    DonorCenters donors;
    bool is_reached;
  };

  __device__ static int min_of(int a, int b) { return a < b ? a : b; }
  __device__ static int divided(int a, int b) { return (a + b - 1) / b; }

  __device__ static float squared_distance(const DonorCenter& donor, const Vec3f& p) {
    return one_lane::squared_length(p.x - donor.x, p.y - donor.y, p.z - donor.z);
  }
  __device__ bool may_be_nearest(const DonorCenter& c, const one_lane::NearestToMiddle& best,
                                 const Cluster& box) const {
    return one_lane::may_be_nearest(c.x, c.y, c.z, squared_distance(c, box.center), best, box);
  }
  __device__ Plane<float> plane_of(std::int32_t donor) const {
    const BoundaryList& b = q_.boundary;
    return {{b.nx[donor], b.ny[donor], b.nz[donor]}, b.offset[donor]};
  }
  __device__ static bool reaches(const Plane<float>& plane, const Cluster& box, float limit) {
    return dot(plane.normal, box.center) - plane.offset < limit;
  }
  // Returns the first lane that has the least value; none is negative.
  __device__ static int lane_of_min(float value) {
    const auto bits = static_cast<unsigned>(__float_as_int(value));
    unsigned least = bits;
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    least = __reduce_min_sync(gpu::kWholeWarp, bits);
#else
    for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
      const unsigned other = __shfl_xor_sync(gpu::kWholeWarp, least, step);
      least = other < least ? other : least;
    }
#endif
    return __ffs(static_cast<int>(__ballot_sync(gpu::kWholeWarp, bits == least))) - 1;
  }
  __device__ static one_lane::NearestToMiddle from_lane(const one_lane::NearestToMiddle& value,
                                                        int lane) {
    return {__shfl_sync(gpu::kWholeWarp, value.x, lane),
            __shfl_sync(gpu::kWholeWarp, value.y, lane),
            __shfl_sync(gpu::kWholeWarp, value.z, lane),
            __shfl_sync(gpu::kWholeWarp, value.squared_distance, lane)};
  }
  __device__ static void offer(one_lane::NearestToMiddle& best, const DonorCenter& c,
                               const Cluster& box) {
    const float squared = squared_distance(c, box.center);
    if (squared < best.squared_distance) best = {c.x, c.y, c.z, squared};
  }

  // Encloses clusters [first, last); each warp finds the box for itself.
  __device__ Cluster enclose(int first, int last) const {
    if (last - first == 1) return q_.clusters.clusters[first];
    Vec3f low{1e30f, 1e30f, 1e30f}, high = -low;
    for (int c = first + gpu::lane_id(); c < last; c += gpu::kWarpSize) {
      const Cluster& cluster = q_.clusters.clusters[c];
      for (int axis = 0; axis < 3; ++axis) {
        low[axis] = fminf(low[axis], cluster.center[axis] - cluster.half_size[axis]);
        high[axis] = fmaxf(high[axis], cluster.center[axis] + cluster.half_size[axis]);
      }
    }
    Cluster box;
    for (int axis = 0; axis < 3; ++axis) {
      const float from = -warp_max(-low[axis]), to = warp_max(high[axis]);
      box.center[axis] = (from + to) * 0.5f;
      box.half_size[axis] = (to - from) * 0.50001f + 1e-6f * (fabsf(from) + fabsf(to));
    }
    for (int c = first + gpu::lane_id(); c < last; c += gpu::kWarpSize) {
      const Cluster& cluster = q_.clusters.clusters[c];
      box.reach = fmaxf(box.reach, (norm(cluster.center - box.center) + cluster.reach) * 1.00001f);
    }
    box.reach = warp_max(box.reach);
    return box;
  }
  __device__ static float warp_max(float value) {
    for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
      value = fmaxf(value, __shfl_xor_sync(gpu::kWholeWarp, value, step));
    }
    return value;
  }

  // Keeps, by the block, the donors of `from` that may be nearest to some center of clusters
  // [first, last) in `list`, or all of `from` if they are too many for it; and checks if the plane
  // of one reaches them. Memory latency dominates, so each thread prefetches its first donor and
  // its plane at once.
  __device__ Pruned prune(const DonorCenters& from, int first, int last, DonorCenter* list,
                          int capacity) {
    const int thread = static_cast<int>(threadIdx.x), threads = static_cast<int>(blockDim.x);
    const int lane = gpu::lane_id();
    DonorCenter first_one{1e12f, 1e12f, 1e12f, -1};
    Plane<float> its_plane;
    if (thread < from.num) {
      first_one = from.at(q_.boundary, thread);
      its_plane = plane_of(first_one.donor);
    }
    const Cluster box = enclose(first, last);
    one_lane::NearestToMiddle best{0, 0, 0, 1e30f};
    offer(best, first_one, box);
#pragma unroll 4
    for (int i = thread + threads; i < from.num; i += threads) {
      offer(best, from.at(q_.boundary, i), box);
    }
    const int nearest_lane = lane_of_min(best.squared_distance);
    __syncthreads();  // all threads have read the result of the last call
    if (lane == nearest_lane) shared_.nearest[gpu::warp_id()] = best;
    if (thread == 0) shared_.num = shared_.is_reached = 0;
    __syncthreads();
    best = shared_.nearest[lane % gpu::warps_per_block()];
    best = from_lane(best, lane_of_min(best.squared_distance));

    const float limit = one_lane::reach_with_slack(box);
    bool is_reached = false;
    for (int begin = 0; begin < from.num; begin += threads) {
      const int i = begin + thread;
      DonorCenter c = first_one;
      if (begin > 0 && i < from.num) c = from.at(q_.boundary, i);
      const bool stays = i < from.num && may_be_nearest(c, best, box);
      const unsigned bits = __ballot_sync(gpu::kWholeWarp, stays);
      if (bits == 0) continue;
      int end = 0;
      if (lane == 0) end = atomicAdd(&shared_.num, __popc(bits));
      end = __shfl_sync(gpu::kWholeWarp, end, 0) + __popc(bits & ((1u << lane) - 1));
      if (!stays) continue;
      if (end < capacity) list[end] = c;
      is_reached = is_reached || reaches(begin > 0 ? plane_of(c.donor) : its_plane, box, limit);
    }
    if (is_reached) shared_.is_reached = 1;  // all writers write the same
    __syncthreads();
    const int num = shared_.num;
    return {num <= capacity ? DonorCenters{list, 0, num} : from, shared_.is_reached != 0};
  }

  const PointQuery& q_;
  AssignmentShared& shared_;
};

}}  // namespace palpate::v0
