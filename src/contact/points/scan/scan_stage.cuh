// Scan stage of a query on a GPU: finds the points in each sphere, and their sums (thesis section
// 3.2.1 and eq. 3.3). The sums are the CPU's, bit for bit: integers that are added in any order.
//
// Warps take tiles of the image window, so that their points lie close together and most of them in
// few spheres: these are added up in the warp first. Edge points need their neighbors as well;
// they are few, lie in rows and cost much, so they are only listed here and, after a barrier,
// looked at by a warp each (scan_edges).
#pragma once

#include <cstdint>

#include "src/contact/points/edges/edge_points.h"
#include "src/contact/points/point_query.h"
#include "src/contact/points/scan/point_lookup.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {

/// Terms of one point in a sphere's sums, as the eight numbers of PointSums.
struct FixedPoint {
  static constexpr int kSize = 8;
  static_assert(sizeof(PointSums) == kSize * sizeof(unsigned long long));
  std::int64_t values[kSize] = {};

  FixedPoint() = default;
  __device__ FixedPoint(const Vec3d& offset, const Vec3d& normal, double weight, double scale)
      : values{to_fixed<std::int64_t>(offset.x, scale), to_fixed<std::int64_t>(offset.y, scale),
               to_fixed<std::int64_t>(offset.z, scale), to_fixed<std::int64_t>(1.0, scale),
               to_fixed<std::int64_t>(normal.x, scale), to_fixed<std::int64_t>(normal.y, scale),
               to_fixed<std::int64_t>(normal.z, scale), to_fixed<std::int64_t>(weight, scale)} {}

  __device__ static void add(PointSums* sums, int which, std::int64_t value) {
    atomicAdd(reinterpret_cast<unsigned long long*>(sums) + which,
              static_cast<unsigned long long>(value));
  }
  __device__ void add_to(PointSums* sums) const {
#pragma unroll
    for (int i = 0; i < kSize; ++i) add(sums, i, values[i]);
  }
};

/// The window in tiles of one warp each: eight columns (one sector of memory) by four rows, or a
/// row of 32 where there is but one. They begin at whole sectors.
class WindowTiles {
 public:
  __device__ explicit WindowTiles(const PointQuery& q)
      : window_(q.window),
        cloud_width_(q.scan.cloud.width),
        log_width_(q.scan.cloud.height > 1 ? 3 : 5) {
    const int width = 1 << log_width_, height = gpu::kWarpSize >> log_width_;
    first_column_ = window_.column_begin & -width;
    per_row_ = (window_.column_end - first_column_ + width - 1) >> log_width_;
    rows_ = (window_.row_end - window_.row_begin + height - 1) >> (5 - log_width_);
  }
  __device__ int num() const { return per_row_ > 0 && rows_ > 0 ? per_row_ * rows_ : 0; }

  /// Returns the point of this lane, or -1 if it lies outside the window.
  __device__ std::int32_t point(int tile) const {
    const int lane = gpu::lane_id(), tile_row = tile / per_row_;
    const int row = window_.row_begin + (tile_row << (5 - log_width_)) + (lane >> log_width_);
    const int column = first_column_ + ((tile - tile_row * per_row_) << log_width_) +
                       (lane & ((1 << log_width_) - 1));
    const bool inside =
        row < window_.row_end && column >= window_.column_begin && column < window_.column_end;
    return inside ? row * cloud_width_ + column : -1;
  }

 private:
  ImageWindow window_;
  int cloud_width_, log_width_;
  int first_column_, per_row_, rows_;
};

class ScanStage {
 public:
  __device__ explicit ScanStage(const PointQuery& q)
      : q_(q), scan_(q.scan), edges_{&q.scan.cloud} {}

  __device__ void run(bool with_edges) const {
    const WindowTiles tiles(q_);
    const int num_tiles = tiles.num();
    // Neighboring tiles go to different blocks: those on the tool cost much more than the others.
    const int warps = gpu::warps_per_block() * static_cast<int>(gridDim.x);
    int tile = gpu::warp_id() * static_cast<int>(gridDim.x) + static_cast<int>(blockIdx.x);
    // The next tile is loaded while this one is processed.
    Point next = tile < num_tiles ? load(tiles.point(tile)) : Point{};
    while (tile < num_tiles) {
      const Point point = next;
      tile += warps;
      if (tile < num_tiles) next = load(tiles.point(tile));
      look_at(point, with_edges);
    }
  }

  /// Adds the mean edge around each edge point to the edge sums of its sphere. A warp looks at the
  /// neighbors at the same time and adds them one after the other, in the order of their pixels,
  /// like the CPU.
  __device__ void add_edges() const {
    const int warps = gpu::grid_threads() / gpu::kWarpSize;
    for (int c = gpu::grid_thread() / gpu::kWarpSize; c < *q_.num_edge_candidates; c += warps) {
      const EdgeCandidate candidate = q_.edge_candidates[c];
      const int width = scan_.cloud.width, i = candidate.point;
      const int row = i / width, column = i % width;
      const Vec3d own = edges_.change(i, row, column);
      if (!EdgePoints::is_edge(own)) continue;  // the same in all lanes
      const EdgeMean mean = mean_around(i, row, column, own);
      if (gpu::lane_id() != 0) continue;
      FixedPoint(mean.offset(scan_.translation_W), mean.unit_change(), 0.0, scan_.sum_scale)
          .add_to(&q_.edge_sums[candidate.sphere_id].towards[mean.direction()]);
    }
  }

 private:
  struct Point {
    std::int32_t index = -1;
    float x = 0, y = 0, z = 0;
  };

  // Tests the point against the spheres of a block, one after the other.
  struct PointInBlock {
    struct Distances {
      float squared[CandidateBlock::kSize];
    };
    GridPoint<float> g;

    __device__ Distances squared_distances(const CandidateBlock& block) const {
      Distances distances;
#pragma unroll
      for (int i = 0; i < CandidateBlock::kSize; ++i) {
        const float dx = g.x - block.x[i], dy = g.y - block.y[i], dz = g.z - block.z[i];
        distances.squared[i] = dx * dx + dy * dy + dz * dz;
      }
      return distances;
    }
    __device__ std::uint32_t up_to(const Distances& distances, const float* limits) const {
      std::uint32_t bits = 0;
#pragma unroll
      for (int i = 0; i < CandidateBlock::kSize; ++i) {
        bits |= static_cast<std::uint32_t>(distances.squared[i] <= limits[i]) << i;
      }
      return bits;
    }
  };

  __device__ Point load(std::int32_t i) const {
    if (i < 0) return {};
    return {i, scan_.cloud.x[i], scan_.cloud.y[i], scan_.cloud.z[i]};
  }

  // All lanes of the warp call.
  __device__ void look_at(const Point& point, bool with_edges) const {
    const SphereGridView& grid = scan_.grid;
    const GridPoint<float> g = to_grid_units(q_.to_grid, point.x, point.y, point.z);
    std::int32_t tag = 0;
    if (point.index >= 0 &&
        is_in_grid(g, {static_cast<float>(grid.num_x), static_cast<float>(grid.num_y),
                       static_cast<float>(grid.num_z)})) {
      tag = grid.tags[(static_cast<int>(g.z) * grid.num_y + static_cast<int>(g.y)) * grid.num_x +
                      static_cast<int>(g.x)];
    }
    if (!__any_sync(gpu::kWholeWarp, tag != 0)) return;
    std::int32_t id = -1;
    FixedPoint value;
    if (tag != 0) {
      const PointCloudView& cloud = scan_.cloud;
      const Vec3d normal{cloud.nx[point.index], cloud.ny[point.index], cloud.nz[point.index]};
      id = tag > 0 ? tag - 1
                   : find_sphere(scan_, grid.blocks - (tag + 1), point.index, PointInBlock{g});
      if (id >= 0) value = value_of(point, normal, id);
    }
    add(id, value);
    if (with_edges && scan_.edges != nullptr) list_edge(point.index, id);
  }

  __device__ FixedPoint value_of(const Point& point, const Vec3d& normal, std::int32_t id) const {
    const Vec3d offset = Vec3d{point.x, point.y, point.z} - scan_.translation_W;
    if (scan_.weights == PointWeights::none) return {offset, normal, 0.0, scan_.sum_scale};
    const double weight = kernel_weight(scan_, offset, id);
    const double factor = scan_.weights == PointWeights::in_sums ? weight : 1;
    return {offset * factor, normal * factor, weight, scan_.sum_scale};
  }

  // Adds the values of all lanes with id >= 0. More lanes than kFew with the same sphere are added
  // up first.
  __device__ void add(std::int32_t id, const FixedPoint& value) const {
    constexpr int kFew = 4;
    unsigned rest = __ballot_sync(gpu::kWholeWarp, id >= 0), of_few = 0;
    bool is_first = false;
    while (rest != 0) {
      const int first = lowest_bit(rest);
      const std::int32_t sphere_id = __shfl_sync(gpu::kWholeWarp, id, first);
      const unsigned same = __ballot_sync(gpu::kWholeWarp, id == sphere_id);
      rest &= ~same;
      is_first |= gpu::lane_id() == first;
      if (__popc(same) <= kFew) {
        of_few |= same;
      } else {
        add_together(sphere_id, id == sphere_id, value);
      }
    }
    if ((of_few >> gpu::lane_id() & 1u) != 0) value.add_to(q_.sums + id);
    if (is_first) atomicOr(q_.touched + id / 32, 1u << (id % 32));
  }

  // Adds up the lanes of one sphere: lanes exchange halves of their sums, until each set of four
  // has one of the eight numbers.
  __device__ void add_together(std::int32_t sphere_id, bool is_member,
                               const FixedPoint& value) const {
    const int lane = gpu::lane_id();
    std::int64_t sums[FixedPoint::kSize];
#pragma unroll
    for (int i = 0; i < FixedPoint::kSize; ++i) sums[i] = is_member ? value.values[i] : 0;
#pragma unroll
    for (int half = FixedPoint::kSize / 2; half > 0; half /= 2) {
      const int step = half * 4;
      const bool upper = (lane & step) != 0;
#pragma unroll
      for (int i = 0; i < half; ++i) {
        const std::int64_t given = upper ? sums[i] : sums[i + half];
        const std::int64_t kept = upper ? sums[i + half] : sums[i];
        sums[i] = kept + __shfl_xor_sync(gpu::kWholeWarp, given, step);
      }
    }
    sums[0] += __shfl_xor_sync(gpu::kWholeWarp, sums[0], 2);
    sums[0] += __shfl_xor_sync(gpu::kWholeWarp, sums[0], 1);
    if (lane % 4 == 0) FixedPoint::add(q_.sums + sphere_id, lane / 4, sums[0]);
  }

  // Lists the points of the warp that may be edge points.
  __device__ void list_edge(std::int32_t i, std::int32_t id) const {
    const int width = scan_.cloud.width;
    const bool listed = id >= 0 && edges_.may_be_edge(i, i / width, i % width);
    const unsigned all = __ballot_sync(gpu::kWholeWarp, listed);
    if (all == 0) return;
    std::int32_t slot = 0;
    if (gpu::lane_id() == 0) slot = atomicAdd(q_.num_edge_candidates, __popc(all));
    slot = __shfl_sync(gpu::kWholeWarp, slot, 0);
    if (listed) q_.edge_candidates[slot + __popc(all & ((1u << gpu::lane_id()) - 1))] = {i, id};
  }

  __device__ EdgeMean mean_around(std::int32_t i, int row, int column, const Vec3d& own) const {
    constexpr int kRadius = EdgeSums::kRadius, kSide = 2 * kRadius + 1;
    const int width = scan_.cloud.width, height = scan_.cloud.height;
    EdgeMean mean;
    for (int begin = 0; begin < kSide * kSide; begin += gpu::kWarpSize) {
      const int n = begin + gpu::lane_id();
      const int v = row - kRadius + n / kSide, u = column - kRadius + n % kSide;
      Vec3d p, change;
      bool belongs = n < kSide * kSide && v >= 0 && v < height && u >= 0 && u < width;
      if (belongs) {
        const std::int32_t other = v * width + u;
        change = edges_.change(other, v, u);
        p = edges_.point(other);
        belongs = edges_.belong_together(i, own, other, change);
      }
      for (unsigned rest = __ballot_sync(gpu::kWholeWarp, belongs); rest != 0; rest &= rest - 1) {
        const int from = lowest_bit(rest);
        mean.add(of_lane(p, from), of_lane(change, from));
      }
    }
    return mean;
  }
  __device__ static Vec3d of_lane(const Vec3d& v, int lane) {
    return {__shfl_sync(gpu::kWholeWarp, v.x, lane), __shfl_sync(gpu::kWholeWarp, v.y, lane),
            __shfl_sync(gpu::kWholeWarp, v.z, lane)};
  }

  const PointQuery& q_;
  const PointScan& scan_;
  EdgePoints edges_;
};

/// Adds up the points of the window in q.sums and q.touched, lists points that may be edge points,
/// and clears q.touched_before. Kernels for clouds without edges pass a constant.
__device__ inline void scan_points(const PointQuery& q, bool with_edges) {
  ScanStage(q).run(with_edges);
  const int num_words = (q.num_spheres + 31) / 32;
  for (int w = gpu::grid_thread(); w < num_words; w += gpu::grid_threads()) {
    q.touched_before[w] = 0;
  }
}

/// Call only if q.scan.edges is not null, after scan_points and a barrier: fills q.edge_sums.
__device__ inline void scan_edges(const PointQuery& q) { ScanStage(q).add_edges(); }

}}  // namespace palpate::v0
