// Untouched spheres take from all boundary spheres (thesis Alg. 3.3), on a GPU.
//
// A warp takes a few neighboring spheres. If some plane reaches their cluster, its lanes share the
// donors; each donor is compared with four spheres at a time, so that it is read once for four.
#pragma once

#include <cstdint>

#include "src/contact/points/donors/assignment_context.cuh"

namespace palpate { inline namespace v0 {

/// 1 / sqrt(v), relative error below 2e-7. Here v is a normal number.
__device__ inline float inverse_sqrt(float v) {
#if defined(PALPATE_EMULATE_CUDA)
  return 1.0f / std::sqrt(v);
#else
  float result;
  asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(result) : "f"(v));
  return result;
#endif
}

class AverageAssignment {
 public:
  __device__ explicit AverageAssignment(const AssignmentContext& context)
      : context_(context), q_(context.q) {}

  /// There is at least one donor. Any priority but `path`.
  template <Priority kPriority>
  __device__ MeasureSums run() {
    const std::int32_t num_slots = q_.clusters.num_slots();
    const int warps = num_grid_warps(), lane = gpu::lane_id();
    // As many spheres at a time as leave enough work for every warp.
    int size = SphereClusters::kSize;
    while (size > kAtOnce && num_slots / size < 2 * warps) size /= 2;
    for (std::int32_t first = spread_warp() * size; first < num_slots; first += warps * size) {
      const std::int32_t slot = first + lane;
      std::int32_t id = -1;
      Ball ball{};
      if (lane < size) {
        id = q_.clusters.sphere_id[slot];
        ball = {q_.clusters.x[slot], q_.clusters.y[slot], q_.clusters.z[slot],
                q_.clusters.radius[slot]};
      }
      const std::uint32_t touched = context_.touched_word(id);
      const bool reached = is_reached(q_.clusters.clusters[first / SphereClusters::kSize]);
      const bool is_untouched = context_.is_untouched(id, touched);
      const bool is_mine = is_untouched && !context_.is_one_by_one(id);
      const unsigned mine = __ballot_sync(gpu::kWholeWarp, is_mine);
      Assigned assigned;
      if (reached) assigned = average<kPriority>(ball, mine);
      if (is_untouched) q_.donor[slot] = -1;
      if (is_mine) {
        context_.add_untouched(sums_, slot, {ball.x, ball.y, ball.z},
                               context_.scaled(id, assigned));
      }
    }
    return sums_;
  }

 private:
  static constexpr int kAtOnce = 4;  // spheres

  // Sums of donors for one sphere, without factors common to all.
  struct Share {
    float weight = 0, volume = 0, force_x = 0, force_y = 0, force_z = 0;
  };
  struct Ball {
    float x, y, z, radius;
  };

  // True if the plane of any donor reaches the cluster.
  __device__ bool is_reached(const Cluster& cluster) const {
    const BoundaryList& b = q_.boundary;
    const Vec3f m = cluster.center;
    const float limit = one_lane::reach_with_slack(cluster);
    const std::int32_t num = context_.donors.num;
    constexpr int kUnrolled = 4, kStep = kUnrolled * gpu::kWarpSize;
    for (std::int32_t begin = 0; begin < num; begin += kStep) {
      bool reached = false;
#pragma unroll
      for (int part = 0; part < kUnrolled; ++part) {
        const std::int32_t l = begin + part * gpu::kWarpSize + gpu::lane_id();
        if (l < num) {
          const float distance = b.nx[l] * m.x + b.ny[l] * m.y + b.nz[l] * m.z - b.offset[l];
          reached |= distance < limit && b.weight[l] > 0;
        }
      }
      if (__any_sync(gpu::kWholeWarp, reached)) return true;
    }
    return false;
  }

  // Averages the donors for the balls of the lanes in `mine`.
  template <Priority kPriority>
  __device__ Assigned average(const Ball& ball, unsigned mine) const {
    Assigned result;
    while (mine != 0) {
      int lanes[kAtOnce];
      Ball balls[kAtOnce];
#pragma unroll
      for (int k = 0; k < kAtOnce; ++k) {
        lanes[k] = __ffs(static_cast<int>(mine)) - 1;
        if (k + 1 == kAtOnce || (mine & (mine - 1)) != 0) mine &= mine - 1;  // the last one again
        balls[k] = {__shfl_sync(gpu::kWholeWarp, ball.x, lanes[k]),
                    __shfl_sync(gpu::kWholeWarp, ball.y, lanes[k]),
                    __shfl_sync(gpu::kWholeWarp, ball.z, lanes[k]),
                    __shfl_sync(gpu::kWholeWarp, ball.radius, lanes[k])};
      }
      Share shares[kAtOnce];
      sum_over_donors<kPriority>(balls, shares);
      const Share sums = sum_of_warp(shares);
      // Ball k belongs to lane lanes[k], and lane k has its sums.
      int from = -1;
#pragma unroll
      for (int k = 0; k < kAtOnce; ++k) from = lanes[k] == gpu::lane_id() ? k : from;
      const auto own = [&](float value) {
        return static_cast<double>(__shfl_sync(gpu::kWholeWarp, value, from & (kAtOnce - 1)));
      };
      const double weight = own(sums.weight), volume = own(sums.volume);
      const Vec3d force{own(sums.force_x), own(sums.force_y), own(sums.force_z)};
      if (from >= 0 && weight > 0) {
        const double factor = kPi / 3.0 / weight;
        result = {factor * volume, factor * force};
      }
    }
    return result;
  }

  // Returns the sums over all lanes of ball number lane % 4: in the first two steps, a lane hands
  // over the half that it does not keep.
  __device__ static Share sum_of_warp(const Share (&shares)[kAtOnce]) {
    static_assert(kAtOnce == 4);
    const bool is_odd = (gpu::lane_id() & 1) != 0, is_upper = (gpu::lane_id() & 2) != 0;
    const Share low = traded(shares[0], shares[1], is_odd, 1);
    const Share high = traded(shares[2], shares[3], is_odd, 1);
    Share sum = traded(low, high, is_upper, 2);
#pragma unroll
    for (int step = kAtOnce; step < gpu::kWarpSize; step *= 2) sum = traded(sum, sum, false, step);
    return sum;
  }
  __device__ static Share traded(const Share& a, const Share& b, bool keeps_b, int step) {
    const auto sum = [&](float of_a, float of_b) {
      const float kept = keeps_b ? of_b : of_a, given = keeps_b ? of_a : of_b;
      return kept + __shfl_xor_sync(gpu::kWholeWarp, given, step);
    };
    return {sum(a.weight, b.weight), sum(a.volume, b.volume), sum(a.force_x, b.force_x),
            sum(a.force_y, b.force_y), sum(a.force_z, b.force_z)};
  }

  // Adds the donors of this lane. cap_volume without its factor pi / 3, with fused multiply-add.
  template <Priority kPriority>
  __device__ void sum_over_donors(const Ball (&balls)[kAtOnce], Share (&shares)[kAtOnce]) const {
    const BoundaryList& b = q_.boundary;
    const std::int32_t num = context_.donors.num;
    const float doublings = static_cast<float>(kDoublings * q_.priority.per_square);
#pragma unroll 2
    for (std::int32_t l = gpu::lane_id(); l < num; l += gpu::kWarpSize) {
      const float nx = b.nx[l], ny = b.ny[l], nz = b.nz[l], offset = b.offset[l];
      float x = 0, y = 0, z = 0, common = b.presence[l];
      if (kPriority == Priority::count) {
        common *= b.weight[l];
      } else {
        x = b.x[l], y = b.y[l], z = b.z[l];
      }
#pragma unroll
      for (int k = 0; k < kAtOnce; ++k) {
        const Ball& ball = balls[k];
        Share& share = shares[k];
        float weight = common;
        if (kPriority != Priority::count) {
          const float dx = x - ball.x, dy = y - ball.y, dz = z - ball.z;
          const float squared = fmaf(dx, dx, fmaf(dy, dy, dz * dz));
          if (kPriority == Priority::gaussian) {
            weight *= one_lane::gaussian_weight(squared, doublings);
          } else {
            const float inverse = inverse_sqrt(squared);
            weight *= kPriority == Priority::square ? inverse * inverse
                      : kPriority == Priority::agreement
                          ? one_lane::agreement_weight(fmaf(nx, dx, fmaf(ny, dy, nz * dz)), inverse)
                          : inverse;
          }
        }
        // The height of the part behind the plane.
        const float in_front = fmaf(nx, ball.x, fmaf(ny, ball.y, fmaf(nz, ball.z, -offset)));
        const float h = fminf(fmaxf(ball.radius - in_front, 0.0f), ball.radius + ball.radius);
        const float volume = weight * (h * h * (3.0f * ball.radius - h));
        share.weight += weight;
        share.volume += volume;
        share.force_x = fmaf(volume, nx, share.force_x);
        share.force_y = fmaf(volume, ny, share.force_y);
        share.force_z = fmaf(volume, nz, share.force_z);
      }
    }
  }

  const AssignmentContext& context_;
  const PointQuery& q_;
  MeasureSums sums_;
};

}}  // namespace palpate::v0
