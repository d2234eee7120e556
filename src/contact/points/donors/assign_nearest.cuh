// Untouched spheres take from the best boundary sphere (thesis Alg. 3.4), on a GPU.
//
// A block takes a run of neighboring clusters and keeps the donors that can be the nearest one to
// some center of the run; the same for each tile of the run; then each warp, or several if
// clusters are few, does so for a cluster and compares what is left with each center, a sphere per
// lane. Lists of donors are sets: their order, which is that of arrival, changes nothing.
#pragma once

#include <cstdint>

#include "src/contact/points/donors/assignment_context.cuh"
#include "src/contact/points/donors/donor_pruning.cuh"

namespace palpate { inline namespace v0 {

class NearestAssignment : private DonorPruning {
 public:
  __device__ explicit NearestAssignment(const AssignmentContext& context)
      : DonorPruning(context.q), context_(context) {}

  /// `from` holds at least one donor.
  __device__ MeasureSums run(const DonorCenters& from) {
    const int num_clusters = q_.clusters.num_clusters, blocks = static_cast<int>(gridDim.x);
    // Neighboring clusters lie close together. Many are best taken in runs of a power of two.
    const int tile_size = min_of(divided(num_clusters, blocks), kMaxPerTile);
    int run_size = tile_size;
    while (run_size < kMaxPerRun && run_size * blocks < num_clusters) run_size *= 2;
    for (int first = static_cast<int>(blockIdx.x) * run_size; first < num_clusters;
         first += blocks * run_size) {
      const int last = min_of(first + run_size, num_clusters);
      DonorCenters of_run = from;
      if (run_size > tile_size) {
        const Pruned pruned = prune(from, first, last, shared_.of_run, AssignmentShared::kOfRun);
        if (!pruned.is_reached) {
          leave_outside(first, last);
          continue;
        }
        of_run = pruned.donors;
      }
      for (int tile = first; tile < last; tile += tile_size) {
        measure_tile(of_run, tile, min_of(tile + tile_size, last));
      }
    }
    return sums_;
  }

 private:
  static constexpr int kMaxPerTile = 32, kMaxPerRun = 128;  // clusters
  static constexpr int kFew = 48;                           // donors that a warp does not prune

  // A sphere of the tool.
  struct Ball {
    std::int32_t slot = 0, id = -1;
    Vec3f center;
    float radius = 0;
  };

  __device__ void leave_outside(int first, int last) const {
    context_.leave_outside(first * SphereClusters::kSize, last * SphereClusters::kSize,
                           static_cast<int>(threadIdx.x), static_cast<int>(blockDim.x));
  }
  __device__ Ball ball_of_lane(int cluster) const {
    const ClustersView& c = q_.clusters;
    const std::int32_t slot = cluster * SphereClusters::kSize + gpu::lane_id();
    return {slot, c.sphere_id[slot], {c.x[slot], c.y[slot], c.z[slot]}, c.radius[slot]};
  }

  // Measures clusters [first, last) by the block.
  __device__ void measure_tile(const DonorCenters& from, int first, int last) {
    const int warp = gpu::warp_id(), warps = gpu::warps_per_block(), num = last - first;
    const int shares = num >= warps ? 1 : warps / num;
    const int share = warp % shares;
    int cluster = first + warp / shares;
    Ball ball;
    if (cluster < last) ball = ball_of_lane(cluster);  // loads in the meantime
    const Pruned pruned = from.num <= kFew * shares ? Pruned{from, true}
                                                    : prune(from, first, last, shared_.of_tile,
                                                            AssignmentShared::kOfTile);
    if (!pruned.is_reached) {
      leave_outside(first, last);
      return;
    }
    // A warp for each cluster in turn; or several warps, and then one cluster for each.
    for (;;) {
      NearestDonor found;
      bool is_reached = false;
      const std::uint32_t touched = context_.touched_word(ball.id);
      if (cluster < last) {
        is_reached = find_nearest(pruned.donors, cluster, ball.center, share, shares, found);
      }
      if (shares > 1) {
        shared_.found[warp][gpu::lane_id()] = found;
        __syncthreads();
        if (share != 0 || cluster >= last) return;
        for (int w = 1; w < shares; ++w) found.join(shared_.found[warp + w][gpu::lane_id()]);
      }
      if (cluster >= last) return;
      settle(pruned.donors, ball, touched, is_reached, found);
      cluster += warps;
      if (shares > 1 || cluster >= last) return;
      ball = ball_of_lane(cluster);
    }
  }

  // Finds the nearest of this share of the donors, by a warp with a lane per center. Returns false,
  // the same for all shares, if no plane that may be needed reaches the cluster.
  __device__ bool find_nearest(const DonorCenters& from, int cluster, const Vec3f& center,
                               int share, int num_shares, NearestDonor& found) {
    const int lane = gpu::lane_id();
    DonorCenter* const list = shared_.of_warp[gpu::warp_id()];
    if (from.num <= kFew * num_shares) {
      const int most = divided(from.num, num_shares), begin = share * most;
      const int num = min_of(most, from.num - begin);
      for (int i = lane; i < num; i += gpu::kWarpSize) list[i] = from.at(q_.boundary, begin + i);
      compare(list, num, center, found);
      return true;
    }
    const Cluster box = q_.clusters.clusters[cluster];
    const float limit = one_lane::reach_with_slack(box);
    one_lane::NearestToMiddle best{0, 0, 0, 1e30f};
#pragma unroll 4
    for (int i = lane; i < from.num; i += gpu::kWarpSize) {
      offer(best, from.at(q_.boundary, i), box);
    }
    best = from_lane(best, lane_of_min(best.squared_distance));

    const int num_chunks = divided(from.num, gpu::kWarpSize);
    bool is_reached = false;
    for (int chunk = 0; chunk < num_chunks && !is_reached; ++chunk) {
      const int i = chunk * gpu::kWarpSize + lane;
      bool reaching = false;
      if (i < from.num) {
        const DonorCenter c = from.at(q_.boundary, i);
        reaching = may_be_nearest(c, best, box) && reaches(plane_of(c.donor), box, limit);
      }
      is_reached = __any_sync(gpu::kWholeWarp, reaching) != 0;
    }
    if (!is_reached) return false;

    int num = 0;
    for (int chunk = share; chunk < num_chunks; chunk += num_shares) {
      const int i = chunk * gpu::kWarpSize + lane;
      DonorCenter c{};
      bool stays = false;
      if (i < from.num) {
        c = from.at(q_.boundary, i);
        stays = may_be_nearest(c, best, box);
      }
      const unsigned bits = __ballot_sync(gpu::kWholeWarp, stays);
      if (stays) list[num + __popc(bits & ((1u << lane) - 1))] = c;
      num += __popc(bits);
      if (num > AssignmentShared::kOfWarp - gpu::kWarpSize || chunk + num_shares >= num_chunks) {
        compare(list, num, center, found);
        num = 0;
      }
    }
    return true;
  }
  // Compares donors that other lanes have just put into the list.
  __device__ static void compare(const DonorCenter* list, int num, const Vec3f& center,
                                 NearestDonor& found) {
    __syncwarp();
#pragma unroll 4
    for (int i = 0; i < num; ++i) {
      const DonorCenter c = list[i];
      found.offer(squared_distance(c, center), c.donor);
    }
    __syncwarp();
  }

  // Adds V_s of each lane's sphere, by a warp. Its nearest donor is known but for close calls.
  __device__ void settle(const DonorCenters& from, const Ball& ball, std::uint32_t touched,
                         bool is_reached, NearestDonor found) {
    const bool is_untouched = context_.is_untouched(ball.id, touched);
    const bool needs_donor = is_untouched && is_reached;
    unsigned close = __ballot_sync(
        gpu::kWholeWarp, needs_donor && one_lane::is_close_call(found.least, found.second));
    for (; close != 0; close &= close - 1) {
      const int lane = __ffs(static_cast<int>(close)) - 1;
      const Vec3f center{__shfl_sync(gpu::kWholeWarp, ball.center.x, lane),
                         __shfl_sync(gpu::kWholeWarp, ball.center.y, lane),
                         __shfl_sync(gpu::kWholeWarp, ball.center.z, lane)};
      const std::int32_t exact = nearest_exactly(from, to_double(center));
      if (lane == gpu::lane_id()) found.donor = exact;
    }
    if (!is_untouched) return;
    q_.donor[ball.slot] = is_reached ? found.donor : -1;
    if (context_.overlays()) return;
    Assigned assigned;
    if (needs_donor) assigned = assign_from(q_.boundary.donors[found.donor], ball);
    context_.add_untouched(sums_, ball.slot, ball.center, assigned);
  }
  // Cut by the donor's plane in double, the rest in single precision as on the CPU.
  __device__ Assigned assign_from(const Donor& donor, const Ball& ball) const {
    if (context_.is_at_edge(ball.id)) {
      return context_.scaled(ball.id, context_.donors.assign_from(donor, ball.id, context_.rule()));
    }
    const Plane<double>& plane = donor.plane_T;
    const double cap = cap_volume(static_cast<double>(ball.radius),
                                  dot(plane.normal, to_double(ball.center)) - plane.offset);
    const float volume = static_cast<float>(cap) * q_.volume_scale[ball.id];
    return {static_cast<double>(volume), to_double(volume * to_float(plane.normal))};
  }

  // Returns the nearest donor by distance in double, ties to the lowest sphere id; by a warp.
  __device__ std::int32_t nearest_exactly(const DonorCenters& from, const Vec3d& center) const {
    double least = 1e300;
    std::int32_t donor = 0x7fffffff;
    const auto take = [&](double squared, std::int32_t its_donor) {
      if (squared < least || (squared == least && its_donor < donor)) {
        least = squared;
        donor = its_donor;
      }
    };
    for (int i = gpu::lane_id(); i < from.num; i += gpu::kWarpSize) {
      const DonorCenter c = from.at(q_.boundary, i);
      const Vec3d d = to_double(Vec3f{c.x, c.y, c.z}) - center;
      take(dot(d, d), c.donor);
    }
    for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
      const double squared = __shfl_xor_sync(gpu::kWholeWarp, least, step);
      const std::int32_t other = __shfl_xor_sync(gpu::kWholeWarp, donor, step);
      take(squared, other);
    }
    return donor;
  }

  const AssignmentContext& context_;
  MeasureSums sums_;
};

}}  // namespace palpate::v0
