// Body against body on a GPU. Instead of descending two trees, warps take clusters of 32
// neighboring spheres of A and find the near clusters of B, group by group: all lanes do the same
// at the same time. Pairs of spheres are chosen in single precision with room for rounding, and
// decided in double as on the CPU.
#include "src/contact/bodies/body_contact_cuda.h"

#include <algorithm>
#include <cmath>

#include "src/contact/bodies/body_pair.h"
#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/index/tool_parts.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kThreads = 256, kWarps = kThreads / gpu::kWarpSize;
/// Warps that share a cluster of A: each takes every kWarpsPerCluster-th of the near clusters of B.
constexpr int kWarpsPerCluster = 4;
constexpr int kSize = SphereClusters::kSize, kClustersPerGroup = SphereClusters::kClustersPerGroup;
static_assert(kSize == gpu::kWarpSize && 2 * kClustersPerGroup == gpu::kWarpSize);

struct alignas(16) Ball {
  float x = 0, y = 0, z = 0, radius = 0;

  __host__ __device__ Vec3d center() const { return to_double(Vec3f{x, y, z}); }
};

/// SphereClusters of one body on the GPU.
struct BodyView {
  const Ball* spheres = nullptr;   // of each slot; a negative radius is padding
  const Ball* clusters = nullptr;  // around their surfaces
  const Ball* groups = nullptr;
  std::int32_t num_clusters = 0, num_groups = 0;
  std::uint32_t* touched = nullptr;  // per slot: the last query in which it overlapped something
};

struct BodyJob {
  BodyView a, b;
  Mat3d R_AB;
  Vec3d p_AB, C_A;  // B's origin and A's center of mass, in A

  __device__ Vec3d in_A(const Ball& ball_B) const { return R_AB * ball_B.center() + p_AB; }
};

/// Sums of one thread. Each touched sphere is counted by one thread alone.
struct BodyShare {
  double volume = 0;
  Vec3d force_A, torque_A;
  std::int64_t num_pairs = 0;
  int num_touched_a = 0, num_touched_b = 0;
};

struct Scratch {
  FinishScratch finish;
  Ball balls[kWarps][kSize];  // one cluster of B for each warp
};

/// Returns 1 for the first thread that finds this sphere touched.
__device__ int touch(std::uint32_t* touched, std::uint32_t query) {
  if (gpu::read_now(touched) == query) return 0;
  return atomicExch(touched, query) != query;
}

__device__ bool are_near(const Ball& ball_A, const BodyJob& job, const Ball& ball_B) {
  return SpherePair(static_cast<double>(ball_A.radius), static_cast<double>(ball_B.radius),
                    ball_A.center() - job.in_A(ball_B))
      .overlaps();
}

/// Returns a bit for each ball k that this lane's sphere may overlap. Balls are in A, their radii
/// have room for rounding.
__device__ unsigned candidates(const Ball& mine, const Ball (&balls)[kSize]) {
  if (mine.radius < 0) return 0;
  const float radius = mine.radius * 1.000001f;
  unsigned found = 0;
#pragma unroll 8
  for (int k = 0; k < kSize; ++k) {
    const Ball ball = balls[k];
    const float dx = mine.x - ball.x, dy = mine.y - ball.y, dz = mine.z - ball.z;
    const float reach = radius + ball.radius;
    if (dx * dx + dy * dy + dz * dz < reach * reach) found |= 1u << k;
  }
  return found;
}

/// Measures one sphere of A per lane against one cluster of B. True if this lane's overlaps any.
__device__ bool measure_cluster(const BodyJob& job, const Ball& mine, const Ball& cluster_A,
                                std::int32_t cluster_b, std::uint32_t query, Ball (&balls)[kSize],
                                BodyShare& share, Vec3d& force_A) {
  const std::int32_t first = cluster_b * kSize;
  const Ball theirs = job.b.spheres[first + gpu::lane_id()];
  const Vec3d p = job.in_A(theirs);
  // Overlapping spheres lie no farther from A's origin; floats are off by 1e-7 of that.
  const float reach = cluster_A.radius + job.b.clusters[cluster_b].radius;
  const double largest = norm(cluster_A.center()) + 2 * static_cast<double>(reach);
  const float room = static_cast<float>(1e-6 * largest);
  const bool is_padding = theirs.radius < 0;
  __syncwarp();  // all lanes have read the previous cluster
  balls[gpu::lane_id()] = {is_padding ? 1e30f : static_cast<float>(p.x), static_cast<float>(p.y),
                           static_cast<float>(p.z), theirs.radius * 1.000001f + room};
  __syncwarp();
  unsigned overlapped = 0;
  for (unsigned rest = candidates(mine, balls); rest != 0; rest &= rest - 1) {
    const int k = __ffs(static_cast<int>(rest)) - 1;
    const Ball ball = job.b.spheres[first + k];
    const SpherePair pair(static_cast<double>(mine.radius), static_cast<double>(ball.radius),
                          mine.center() - job.in_A(ball));
    if (!pair.overlaps()) continue;
    const SharedLens lens(pair);
    share.volume += lens.volume;
    force_A += lens.force;
    ++share.num_pairs;
    overlapped |= 1u << k;
  }
  // Lane k knows whether some lane has touched sphere k of the cluster.
  unsigned by_any = overlapped;
  for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
    by_any |= __shfl_xor_sync(gpu::kWholeWarp, by_any, step);
  }
  if ((by_any >> gpu::lane_id() & 1u) != 0) {
    share.num_touched_b += touch(job.b.touched + first + gpu::lane_id(), query);
  }
  return overlapped != 0;
}

/// Calls visit(cluster of B) for all near a cluster of A, in a fixed order; all lanes call.
template <class Visit>
__device__ void for_each_near(const BodyJob& job, const Ball& cluster_A, const Visit& visit) {
  const int lane = gpu::lane_id();
  for (std::int32_t first = 0; first < job.b.num_groups; first += gpu::kWarpSize) {
    const std::int32_t group = first + lane;
    const bool is_near = group < job.b.num_groups && are_near(cluster_A, job, job.b.groups[group]);
    unsigned groups = __ballot_sync(gpu::kWholeWarp, is_near);
    while (groups != 0) {
      // Half a warp for each of two groups.
      const unsigned others = groups & (groups - 1);
      const unsigned mine = lane < kClustersPerGroup ? groups : others;
      const std::int32_t cluster = (first + __ffs(static_cast<int>(mine)) - 1) * kClustersPerGroup +
                                   lane % kClustersPerGroup;
      unsigned near =
          __ballot_sync(gpu::kWholeWarp, mine != 0 && cluster < job.b.num_clusters &&
                                             are_near(cluster_A, job, job.b.clusters[cluster]));
      for (; near != 0; near &= near - 1) {
        visit(__shfl_sync(gpu::kWholeWarp, cluster, __ffs(static_cast<int>(near)) - 1));
      }
      groups = others & (others - 1);
    }
  }
}

__global__ void __launch_bounds__(kThreads, 2)
    measure_bodies(const __grid_constant__ BodyJob job, const __grid_constant__ MeasureOutput out) {
  auto& scratch = gpu::shared_memory<Scratch>();
  Ball(&balls)[kSize] = scratch.balls[gpu::warp_id()];
  const int num_warps = gpu::grid_threads() / gpu::kWarpSize;
  const std::int32_t num_items = job.a.num_clusters * kWarpsPerCluster;
  BodyShare share;
  for (std::int32_t item = gpu::grid_thread() / gpu::kWarpSize; item < num_items;
       item += num_warps) {
    const std::int32_t cluster_a = item / kWarpsPerCluster;
    const Ball cluster_A = job.a.clusters[cluster_a];
    const std::int32_t slot = cluster_a * kSize + gpu::lane_id();
    const Ball mine = job.a.spheres[slot];
    Vec3d force_A;
    bool is_touched = false;
    int turn = item % kWarpsPerCluster;
    for_each_near(job, cluster_A, [&](std::int32_t cluster_b) {
      if (turn == 0) {
        is_touched |=
            measure_cluster(job, mine, cluster_A, cluster_b, out.query, balls, share, force_A);
      }
      turn = (turn + kWarpsPerCluster - 1) % kWarpsPerCluster;
    });
    if (!is_touched) continue;
    share.num_touched_a += touch(job.a.touched + slot, out.query);
    share.force_A += force_A;
    share.torque_A += cross(mine.center() - job.C_A, force_A);
  }
  MeasureTerms terms;
  terms.volume = share.volume;
  for (int axis = 0; axis < 3; ++axis) {
    terms.force[axis] = share.force_A[axis];
    terms.torque[axis] = share.torque_A[axis];
  }
  terms.num_boundary = share.num_touched_a;
  terms.num_inside = share.num_touched_b;
  terms.num_points = static_cast<double>(share.num_pairs);
  finish_measure(out, terms, scratch.finish);
}

BodyView view_of(gpu::Memory& memory, const SphereClusters& c) {
  std::vector<Ball> spheres(c.x.size());
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    spheres[i] = {c.x[i], c.y[i], c.z[i], c.sphere_id[i] < 0 ? -1.0f : c.radius[i]};
  }
  const auto balls_of = [](const std::vector<Cluster>& clusters) {
    std::vector<Ball> balls;
    for (const Cluster& cluster : clusters) {
      balls.push_back({cluster.center.x, cluster.center.y, cluster.center.z, cluster.reach});
    }
    return balls;
  };
  return {memory.copy_of(spheres),
          memory.copy_of(balls_of(c.clusters)),
          memory.copy_of(balls_of(c.groups)),
          c.num_clusters(),
          c.num_groups(),
          memory.take<std::uint32_t>(c.x.size())};
}

int blocks_for(int gpu, const Tool& a) {
  const int most = gpu::resident_blocks(gpu, reinterpret_cast<const void*>(measure_bodies),
                                        kThreads, sizeof(Scratch));
  const auto num_clusters = (a.spheres().size() + kSize - 1) / kSize;
  const auto desired = (num_clusters * kWarpsPerCluster + kWarps - 1) / kWarps;
  return static_cast<int>(std::clamp<std::size_t>(desired, 1, std::max<std::size_t>(most, 1)));
}

class BodyContactCuda final : public BodyPairQuery {
 public:
  BodyContactCuda(std::shared_ptr<const ToolIndex> a, std::shared_ptr<const ToolIndex> b, int gpu)
      : a_(std::move(a)),
        b_(std::move(b)),
        memory_(gpu),
        stream_(gpu, gpu::Priority::high),
        answers_(gpu, blocks_for(gpu, a_->tool())) {
    job_.a = view_of(memory_, parts_of(*a_).clusters());
    job_.b = view_of(memory_, parts_of(*b_).clusters());
    job_.C_A = a_->tool().sphere_mass().center_of_mass;
  }

  const Status& status() const {
    for (const Status* status : {&memory_.status(), &answers_.status()}) {
      if (!*status) return *status;
    }
    return stream_.status();
  }

  void start(const Pose& X_WA, const Pose& X_WB, bool) noexcept override {
    X_WA_ = X_WA;
    X_WB_ = X_WB;
    nothing_ = {};
    if (is_non_finite(X_WA, X_WB, nothing_) || !status()) return;
    const Pose X_AB = relative_pose(X_WA, X_WB);
    job_.R_AB = rotation_matrix(X_AB.rotation);
    job_.p_AB = X_AB.translation;
    gpu::launch(
        stream_,
        {.blocks = answers_.num_blocks(), .threads = kThreads, .shared_bytes = sizeof(Scratch)},
        measure_bodies, job_, answers_.next());
  }

  BodyPenetration finish() noexcept override {
    if (nothing_.on_a.status.bits != 0 || nothing_.on_b.status.bits != 0) return nothing_;
    if (!status() || !answers_.await(stream_)) {
      nothing_.on_a.status = nothing_.on_b.status = StepStatus::backend_failed;
      return nothing_;
    }
    const QueryAnswer& answer = answers_.answer();
    BodySums sums;
    sums.volume = answer.volume;
    sums.force_A = {answer.force[0], answer.force[1], answer.force[2]};
    sums.torque_A = {answer.torque[0], answer.torque[1], answer.torque[2]};
    sums.num_pairs = static_cast<std::int64_t>(answer.num_points);
    sums.num_touched_a = static_cast<int>(answer.num_boundary);
    sums.num_touched_b = static_cast<int>(answer.num_inside);
    return body_penetration(sums, a_->tool(), b_->tool(), X_WA_, X_WB_);
  }

 private:
  std::shared_ptr<const ToolIndex> a_, b_;
  gpu::Memory memory_;
  gpu::Stream stream_;
  AnswerBox answers_;
  BodyJob job_;
  Pose X_WA_, X_WB_;
  BodyPenetration nothing_;  // status of an impossible measurement
};

}  // namespace

Result<std::unique_ptr<BodyPairQuery>> make_body_contact_cuda(std::shared_ptr<const ToolIndex> a,
                                                              std::shared_ptr<const ToolIndex> b,
                                                              int gpu) {
  if (const Status status = gpu::check_gpu(gpu); !status) return status.error();
  auto query = std::make_unique<BodyContactCuda>(std::move(a), std::move(b), gpu);
  if (!query->status()) return query->status().error();
  return std::unique_ptr<BodyPairQuery>(std::move(query));
}

}}  // namespace palpate::v0
