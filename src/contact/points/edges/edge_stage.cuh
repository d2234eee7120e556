// Edge stage of a query on a GPU: the pieces of edges that cut spheres (thesis section 3.5). The
// result is that of EdgePlanes: the first of the nearest pieces in the image.
#pragma once

#include <cstddef>
#include <cstdint>

#include "src/contact/points/point_query.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {

/// Run by all threads of blocks of kQueryThreads.
class EdgeStage {
 public:
  /// Shared memory of a block: donors that are compared with all pieces.
  struct Scratch {
    DonorPoint donors[kQueryThreads];
  };

  __device__ explicit EdgeStage(const PointQuery& q)
      : q_(q), shared_(gpu::shared_memory<Scratch>()), num_pieces_(*q.num_pieces) {}

  __device__ void run() const {
    if (num_pieces_ == 0) return;
    const int warps = gpu::grid_threads() / gpu::kWarpSize;
    for (int cluster = gpu::warp_id() * static_cast<int>(gridDim.x) + static_cast<int>(blockIdx.x);
         cluster < q_.clusters.num_clusters; cluster += warps) {
      find_nearest(cluster);
    }
    note_donors();
  }

 private:
  static_assert(SphereClusters::kSize == gpu::kWarpSize);

  // A piece or a sphere as the camera sees it.
  struct Seen {
    double u, v;

    __device__ double squared_distance(const Seen& other) const {
      const double du = other.u - u, dv = other.v - v;
      return du * du + dv * dv;
    }
    __device__ Seen of_lane(int lane) const {
      return {__shfl_sync(gpu::kWholeWarp, u, lane), __shfl_sync(gpu::kWholeWarp, v, lane)};
    }
  };
  __device__ Seen seen_piece(int i) const { return {q_.seen_pieces.u[i], q_.seen_pieces.v[i]}; }

  // Finds the pieces for the spheres of a cluster, one per lane. A piece is nearest to some sphere
  // only if its distance from the middle exceeds that of the nearest one by at most twice the
  // radius of the cluster in the image.
  __device__ void find_nearest(int cluster) const {
    const int lane = gpu::lane_id();
    const std::int32_t id = q_.clusters.sphere_id[cluster * SphereClusters::kSize + lane];
    Vec3d c_T, c_W;  // behind the camera if there is no sphere
    if (id >= 0) {
      c_T = to_double(q_.scan.spheres[id].center);
      c_W = q_.R_WT * c_T + q_.scan.translation_W;
    }
    const unsigned visible = __ballot_sync(gpu::kWholeWarp, c_W.z > 0);
    const bool is_visible = (visible >> lane & 1u) != 0;
    if (id >= 0 && !is_visible) q_.edge_side[id] = EdgeSide::behind;  // no pixel sees it
    if (visible == 0) return;
    const Seen sphere = is_visible ? Seen{c_W.x / c_W.z, c_W.y / c_W.z} : Seen{0, 0};
    const unsigned later = visible >> 16 << 16;
    const Seen middle = sphere.of_lane(__ffs(static_cast<int>(later != 0 ? later : visible)) - 1);

    double least = 1e300, squared_radius = is_visible ? sphere.squared_distance(middle) : 0;
#pragma unroll 4
    for (int i = lane; i < num_pieces_; i += gpu::kWarpSize) {
      const double squared = seen_piece(i).squared_distance(middle);
      least = squared < least ? squared : least;
    }
    for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
      const double other_min = __shfl_xor_sync(gpu::kWholeWarp, least, step);
      const double other_radius = __shfl_xor_sync(gpu::kWholeWarp, squared_radius, step);
      least = other_min < least ? other_min : least;
      squared_radius = other_radius > squared_radius ? other_radius : squared_radius;
    }
    constexpr double kSlack = 1 + 1e-9;
    const double reach = (std::sqrt(least) + 2 * std::sqrt(squared_radius)) * kSlack;

    double nearest = 1e300;
    std::int32_t nearest_number = -1;
    for (int begin = 0; begin < num_pieces_; begin += gpu::kWarpSize) {
      const int i = begin + lane;
      const bool is_piece = i < num_pieces_;
      const Seen piece = is_piece ? seen_piece(i) : Seen{0, 0};
      const bool is_near = is_piece && piece.squared_distance(middle) <= reach * reach;
      unsigned near = __ballot_sync(gpu::kWholeWarp, is_near);
      const std::int32_t number = is_near ? q_.seen_pieces.number[i] : -1;
      for (; near != 0; near &= near - 1) {
        const int from = __ffs(static_cast<int>(near)) - 1;
        const double squared = piece.of_lane(from).squared_distance(sphere);
        const std::int32_t its_number = __shfl_sync(gpu::kWholeWarp, number, from);
        // The list is unordered: among the nearest, the first by number.
        if (squared < nearest || (squared == nearest && its_number < nearest_number)) {
          nearest = squared;
          nearest_number = its_number;
        }
      }
    }
    if (!is_visible) return;
    if (nearest_number < 0) {  // too far to tell
      q_.edge_side[id] = EdgeSide::behind;
      return;
    }
    const Plane<double>& plane = q_.pieces[nearest_number].plane_T;
    const double distance = dot(plane.normal, c_T) - plane.offset;
    q_.piece_of[id] = nearest_number;
    q_.edge_distance[id] = distance;
    q_.edge_side[id] =
        edge_side(distance, static_cast<double>(q_.scan.spheres[id].radius), q_.edges);
  }

  // Marks the pieces that cannot cut off a donor: each block compares its share of the donors with
  // all pieces. Several may find one for the same piece and write the same.
  __device__ void note_donors() const {
    const std::int64_t num = *q_.boundary.num;
    const auto begin = static_cast<int>(num * blockIdx.x / gridDim.x);
    const auto end = static_cast<int>(num * (blockIdx.x + 1) / gridDim.x);
    const int thread = static_cast<int>(threadIdx.x);
    for (int first = begin; first < end; first += kQueryThreads) {
      // One without plane has range 0: no piece is before it.
      if (first + thread < end) {
        shared_.donors[thread] = q_.boundary.donors[first + thread].point;
      }
      __syncthreads();
      const int shown = end - first < kQueryThreads ? end - first : kQueryThreads;
      for (int i = thread; i < num_pieces_; i += kQueryThreads) {
        const std::int32_t number = q_.seen_pieces.number[i];
        const EdgePiece piece = q_.pieces[number];
        bool found = false;
        for (int l = 0; l < shown && !found; ++l) found = piece.is_before(shared_.donors[l]);
        if (found) q_.pieces[number].has_beyond = true;
      }
      __syncthreads();
    }
  }

  const PointQuery& q_;
  Scratch& shared_;
  int num_pieces_;
};

/// Call after find_boundary and a barrier, if q.edges is not `none`: finds the piece of each
/// sphere, and the pieces with donors beyond. Does nothing if *q.num_pieces is 0: then edges
/// concern no sphere. Shared memory: kEdgeSharedBytes.
__device__ inline void find_edges(const PointQuery& q) { EdgeStage(q).run(); }

inline constexpr std::size_t kEdgeSharedBytes = sizeof(EdgeStage::Scratch);

}}  // namespace palpate::v0
