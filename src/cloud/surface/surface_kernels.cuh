// The kernels of surface estimation. A block does one tile: a strip of rows, kTileWidth columns
// wide; with the window's margin it lies in shared memory. Strips are those of the CPU, and so are
// all formulas: the bits are the same.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include "src/cloud/average/depth_change.h"
#include "src/cloud/frames/raw_depth.h"
#include "src/cloud/internal/raw_frame_cuda.h"
#include "src/cloud/internal/tangent_plane.h"
#include "src/cloud/surface/bilateral.h"
#include "src/cloud/surface/flying_pixel.h"
#include "src/cloud/surface/window_moments.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 { namespace one_lane {
/// Tiles of a launch: block b is tile first_tile + b of the image, row by row. With several images
/// each has num_tiles of these blocks.
struct Tiling {
  int width, height;
  int tiles_per_row;
  int first_tile;
  int num_tiles;
  std::ptrdiff_t points_apart;  // from one image to the next, of all arrays but what is raw

  /// The word of FilterJob::far for row v in the column of tiles `column`.
  PALPATE_HOSTDEV std::ptrdiff_t word(int image, int v, int column) const {
    return (static_cast<std::ptrdiff_t>(image) * height + v) * tiles_per_row + column;
  }
};

inline constexpr int kMaxTaps = (2 * kMaxWindowRadius + 1) * (2 * kMaxWindowRadius + 1);

struct FilterJob {
  Tiling tiling;
  RawFrameView raw;
  const float* meters = nullptr;              // instead of the raw frame, or null
  const std::uint32_t* raw_pixels = nullptr;  // as RawPass
  float* depth = nullptr;                     // filtered, NaN where invalid, kFar where free
  unsigned* far = nullptr;   // of each row of a tile: bits of the pixels that are too far
  int* num_valid = nullptr;  // of each tile
  float min_depth, max_depth;
  int radius;  // 0: no filter
  float range;
  float flying_gap;
  float space[kMaxTaps];

  /// Margin of a tile, pixels: the reach of the filter.
  PALPATE_HOSTDEV int margin() const { return radius == 0 && flying_gap > 0 ? 1 : radius; }
};

struct NormalJob {
  Tiling tiling;
  const float* depth = nullptr;  // filtered
  float max_depth = 0;
  NormalPass pass;                 // without an image
  TangentPlane* planes = nullptr;  // output instead of points and normals, or null
  float* change[3] = {};           // null: not requested
  float min_step = 0;
  int* num_points = nullptr;  // of each tile
};

namespace {

inline constexpr int kTileWidth = gpu::kWarpSize;
inline constexpr int kTileThreads = 128;
inline constexpr int kWarps = kTileThreads / gpu::kWarpSize;
inline constexpr int kRowsPerWarp = kStripRows / kWarps;
inline constexpr float kInvalid = std::numeric_limits<float>::quiet_NaN();

/// Position of a block.
struct Tile {
  int image;
  int index;   // in the image
  int u0, v0;  // of its first pixel

  __device__ Tile(const Tiling& tiling, int block)
      : image(block / tiling.num_tiles), index(tiling.first_tile + block % tiling.num_tiles) {
    const int strip = index / tiling.tiles_per_row;
    u0 = (index - strip * tiling.tiles_per_row) * kTileWidth;
    v0 = strip * kStripRows;
  }
};

/// Size of a tile with a margin of `radius` pixels.
PALPATE_HOSTDEV constexpr int padded(int size, int radius) { return size + 2 * radius; }
inline constexpr int kMaxTileDepths =
    padded(kTileWidth, kMaxWindowRadius) * padded(kStripRows, kMaxWindowRadius);

/// Fills `depths` by depth_at(u, v), kNoDepth around the image. All threads call. Several loads are
/// on their way at once.
template <class DepthAt>
__device__ void load_tile(const Tiling& tiling, const Tile& tile, int radius, float* depths,
                          const DepthAt& depth_at) {
  constexpr int kAtOnce = 7;
  const int stride = padded(kTileWidth, radius), num = stride * padded(kStripRows, radius);
  for (int begin = static_cast<int>(threadIdx.x); begin < num; begin += kAtOnce * kTileThreads) {
    float z[kAtOnce];
#pragma unroll
    for (int k = 0; k < kAtOnce; ++k) {
      const int i = begin + k * kTileThreads, row = i / stride;
      const int u = tile.u0 - radius + (i - row * stride), v = tile.v0 - radius + row;
      const bool inside = i < num && u >= 0 && v >= 0 && u < tiling.width && v < tiling.height;
      z[k] = inside ? depth_at(u, v) : kNoDepth;
    }
#pragma unroll
    for (int k = 0; k < kAtOnce; ++k) {
      if (begin + k * kTileThreads < num) depths[begin + k * kTileThreads] = z[k];
    }
  }
}

// --- Read and filter ---------------------------------------------------------------------------

struct FilterShared {
  int num_valid;
  float depths[kMaxTileDepths];
};

/// Raw depth of a pixel: kNoDepth, kFarDepth or meters.
__device__ inline float raw_depth(const FilterJob& job, int image, int u, int v) {
  const Tiling& tiling = job.tiling;
  auto pixel = static_cast<std::uint32_t>(v * tiling.width + u);
  if (job.raw_pixels != nullptr) {
    pixel = job.raw_pixels[pixel];
    if (pixel >= static_cast<std::uint32_t>(tiling.width * tiling.height)) return kNoDepth;
  }
  const std::ptrdiff_t i =
      static_cast<std::ptrdiff_t>(image) * tiling.width * tiling.height + pixel;
  const float z =
      job.meters != nullptr ? job.meters[i] : depth_of(job.raw.pixels[i], *job.raw.unit);
  return is_usable_depth(z, job.min_depth, job.max_depth) ? z
         : z > job.max_depth                              ? kFarDepth
                                                          : kNoDepth;
}

/// kRadius < 0: job.radius. 0: no neighbor is read.
template <int kRadius>
__global__ void __launch_bounds__(kTileThreads)
    read_and_filter(const __grid_constant__ FilterJob job) {
  FilterShared& shared = gpu::shared_memory<FilterShared>();
  const Tile tile(job.tiling, static_cast<int>(blockIdx.x));
  const int radius = kRadius < 0 ? job.radius : kRadius;
  const int margin = kRadius < 0 ? job.margin() : kRadius;
  const int stride = padded(kTileWidth, margin);
  float* const filtered_depth = job.depth + tile.image * job.tiling.points_apart;
  if (threadIdx.x == 0) shared.num_valid = 0;
  load_tile(job.tiling, tile, margin, shared.depths,
            [&](int at_u, int at_v) { return raw_depth(job, tile.image, at_u, at_v); });
  __syncthreads();

  const int column = gpu::lane_id(), u = tile.u0 + column;
  int num_valid = 0;
  for (int k = 0; k < kRowsPerWarp; ++k) {
    const int row = gpu::warp_id() * kRowsPerWarp + k, v = tile.v0 + row;
    const float* const center = shared.depths + (row + margin) * stride + column + margin;
    const float z = *center;
    const unsigned far = __ballot_sync(gpu::kWholeWarp, z > kNoDepth);
    if (v < job.tiling.height && column == 0) {
      job.far[job.tiling.word(tile.image, v, tile.u0 / kTileWidth)] = far;
    }
    if (u >= job.tiling.width || v >= job.tiling.height) continue;
    float result = kInvalid;
    num_valid += z < kAnyDepth;
    if (z < kAnyDepth && !(job.flying_gap > 0 && is_flying(center, stride, z, job.flying_gap))) {
      result = radius > 0 ? filtered(center, stride, z, radius, job.space, job.range) : z;
    }
    filtered_depth[v * job.tiling.width + u] = result;
  }
  num_valid = gpu::warp_sum(num_valid);
  if (gpu::lane_id() == 0) atomicAdd(&shared.num_valid, num_valid);
  __syncthreads();
  if (threadIdx.x == 0 && tile.image == 0) job.num_valid[tile.index] = shared.num_valid;
}

// --- Normals and depth change ------------------------------------------------------------------

/// Four numbers that travel together.
struct alignas(16) Quad {
  float a, b, c, d;
};

/// The row moments of a tile: neighboring columns side by side.
struct RowStore {
  Quad first[kTileWidth], second[kTileWidth];

  __device__ void set(int column, const WindowRow& row) {
    first[column] = {row.t.s, row.t.u, row.t.uu, row.min};
    second[column] = {row.tt.s, row.tt.u, row.tt.uu, row.max};
  }
  __device__ WindowRow get(int column) const {
    const Quad t = first[column], tt = second[column];
    return {{t.a, t.b, t.c}, {tt.a, tt.b, tt.c}, t.d, tt.d};
  }
};

struct NormalShared {
  int num_points;
  int num_left;  // pixels whose window is not whole
  std::uint16_t left[kStripRows * kTileWidth];
  float depths[kMaxTileDepths];
};
/// Behind it: a RowStore of each row of the tile and its margin.
inline constexpr std::size_t kRowStores = (sizeof(NormalShared) + 15) / 16 * 16;
inline std::size_t normal_shared_bytes(const NormalPass& pass) {
  return kRowStores + static_cast<std::size_t>(padded(kStripRows, pass.radius)) * sizeof(RowStore);
}

/// The rows of one column around a pixel.
struct StoredRows {
  const RowStore* center;
  int column;

  __device__ WindowRow operator()(int k) const { return center[k].get(column); }
};

/// The first valid depth of a column from the middle row on, as on the CPU.
__device__ inline float column_reference(const float* depths, int stride, int num_rows) {
  float reference = kNoDepth;
  for (int i = 0; i < num_rows && !(reference < kAnyDepth); ++i) {
    reference = depths[reference_row(i, num_rows) * stride];
  }
  return reference;
}

__device__ inline void store_point(const NormalJob& job, std::ptrdiff_t at, float z,
                                   const PixelFrame& frame, const Vector& n, bool valid) {
  if (job.planes != nullptr) {
    const TangentPlane plane =
        valid ? tangent_plane<TangentPlane>(frame.ray_x * z, frame.ray_y * z, z, n.x, n.y, n.z)
              : TangentPlane{};
    job.planes[at] = plane_or_far(plane, job.depth[at], job.max_depth);
    return;
  }
  const NormalPass& pass = job.pass;
  pass.cloud[0][at] = valid ? frame.ray_x * z : kInvalid;
  pass.cloud[1][at] = valid ? frame.ray_y * z : kInvalid;
  pass.cloud[2][at] = valid ? z : kInvalid;
  pass.cloud[3][at] = valid ? n.x : kInvalid;
  pass.cloud[4][at] = valid ? n.y : kInvalid;
  pass.cloud[5][at] = valid ? n.z : kInvalid;
}

/// kRadius < 0: job.pass.radius. kPlain: no anchoring, weighting or normalization.
template <int kRadius, bool kPlain>
__global__ void __launch_bounds__(kTileThreads)
    find_normals(const __grid_constant__ NormalJob job) {
  NormalShared& shared = gpu::shared_memory<NormalShared>();
  RowStore* const rows =
      reinterpret_cast<RowStore*>(reinterpret_cast<unsigned char*>(&shared) + kRowStores);
  const Tile tile(job.tiling, static_cast<int>(blockIdx.x));
  const int width = job.tiling.width;
  const int num_rows =
      job.tiling.height - tile.v0 < kStripRows ? job.tiling.height - tile.v0 : kStripRows;
  const int radius = kRadius < 0 ? job.pass.radius : kRadius;
  const int stride = padded(kTileWidth, radius);
  NormalPass pass = job.pass;
  pass.radius = radius;
  pass.in.stride = stride;
  if (kPlain) pass.anchoring = pass.weighting = pass.normalization = false;

  const int column = gpu::lane_id(), u = tile.u0 + column;
  const float ray_x = pass.ray_x[u < width ? u : width - 1];
  const std::ptrdiff_t first_point = tile.image * job.tiling.points_apart;
  if (threadIdx.x == 0) shared.num_points = shared.num_left = 0;
  load_tile(job.tiling, tile, radius, shared.depths, [&](int u_in, int v_in) {
    const float z = job.depth[first_point + v_in * width + u_in];
    return z < kAnyDepth ? z : kNoDepth;  // NaN is not
  });
  __syncthreads();

  const float* const first = shared.depths + radius * stride + radius;  // pixel (u0, v0)
  float reference = kNoDepth;
  if (kPlain) {
    reference = column_reference(first + column, stride, num_rows);
    for (int row = gpu::warp_id(); row < num_rows + 2 * radius; row += kWarps) {
      rows[row].set(column,
                    sum_row(shared.depths + row * stride + column + radius, reference, radius));
    }
    __syncthreads();
  }

  // Whole windows; the others are put on a list, so that full warps go through it.
  int num_points = 0;
#pragma unroll 2
  for (int k = 0; k < kRowsPerWarp; ++k) {
    const int row = gpu::warp_id() * kRowsPerWarp + k, v = tile.v0 + row;
    if (u >= width || row >= num_rows) continue;
    const float* const center = first + row * stride + column;
    const std::ptrdiff_t at = first_point + static_cast<std::ptrdiff_t>(v) * width + u;
    const float z = *center;
    const PixelFrame frame{ray_x, pass.ray_y[v], pass.pixel_x, pass.pixel_y};
    if (job.change[0] != nullptr) {
      const Around around = depths_around(center, stride);
      DepthChange change{0, 0, 0};
      if (farthest(around) > z + job.min_step) {
        change = depth_change(around, z, frame.ray_x, frame.ray_y, job.min_step);
      }
      job.change[0][at] = change.x;
      job.change[1][at] = change.y;
      job.change[2][at] = change.z;
    }
    bool is_left = z < kAnyDepth;
    if (kPlain && is_left) {
      const WholeWindow window =
          sum_columns(StoredRows{rows + row + radius, column}, reference, radius);
      if (is_whole(window, z, pass.max_depth_change)) {
        is_left = false;
        const UnitNormal normal =
            unit_normal(covariance(window.sums, mean_of(window.sums)), frame, pass.along_ray);
        store_point(job, at, z, frame, normal.n, normal.exists);
        num_points += normal.exists;
      }
    }
    if (is_left) {
      shared.left[atomicAdd(&shared.num_left, 1)] =
          static_cast<std::uint16_t>(row * kTileWidth + column);
    } else if (!(z < kAnyDepth)) {
      store_point(job, at, z, frame, {}, false);
    }
  }
  __syncthreads();

  for (int i = static_cast<int>(threadIdx.x); i < shared.num_left; i += kTileThreads) {
    const int row = shared.left[i] / kTileWidth, left_column = shared.left[i] % kTileWidth;
    const int left_u = tile.u0 + left_column, v = tile.v0 + row;
    const float* const center = first + row * stride + left_column;
    const PixelFrame frame{pass.ray_x[left_u], pass.ray_y[v], pass.pixel_x, pass.pixel_y};
    const Neighbors neighbors = gather_directly(pass, center, frame, radius);
    const UnitNormal normal = unit_normal(neighbors.e, frame, pass.along_ray);
    const bool valid = neighbors.valid & normal.exists;
    store_point(job, first_point + static_cast<std::ptrdiff_t>(v) * width + left_u, *center, frame,
                normal.n, valid);
    num_points += valid;
  }
  num_points = gpu::warp_sum(num_points);
  if (gpu::lane_id() == 0) atomicAdd(&shared.num_points, num_points);
  __syncthreads();
  if (threadIdx.x == 0 && tile.image == 0) job.num_points[tile.index] = shared.num_points;
}

}  // namespace
}}}  // namespace palpate::v0::one_lane
