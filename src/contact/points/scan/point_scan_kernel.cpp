// The point loop, compiled once per instruction set. Two steps on short runs of a row: look up the
// grid cells of a few points at a time and keep those that matter; then, one by one, find the
// sphere that contains the point and add it up in fixed point.
#include <algorithm>
#include <bit>

#include "src/contact/points/edges/edge_points.h"
#include "src/contact/points/scan/point_lookup.h"
#include "src/contact/points/scan/point_scan.h"
#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

constexpr int kRun = 256;  // points per run: all scratch stays in the L1 cache

typedef float Vec4F __attribute__((vector_size(16)));
typedef double Vec4D __attribute__((vector_size(32)));
typedef std::int64_t Vec4L __attribute__((vector_size(32)));
typedef float Vec8F __attribute__((vector_size(32), aligned(32)));
typedef std::int32_t Vec8I __attribute__((vector_size(32), aligned(32)));

// Points of a run whose cell is not empty.
struct Survivors {
  alignas(64) std::int32_t index[kRun + kLanes];
  alignas(64) std::int32_t tag[kRun + kLanes];
  alignas(64) float x[kRun + kLanes], y[kRun + kLanes], z[kRun + kLanes];  // grid units
  int num = 0;
};

inline std::uint32_t mask_bits_8(Vec8I mask) {
#if PALPATE_LANES >= 8
  return static_cast<std::uint32_t>(_mm256_movemask_ps(reinterpret_cast<__m256>(mask)));
#else
  std::uint32_t bits = 0;
  for (int i = 0; i < 8; ++i) bits |= static_cast<std::uint32_t>(mask[i] & 1) << i;
  return bits;
#endif
}

// Step 1: cells of the points [begin, end) of the cloud.
void find_cells(const PointScan& scan, const GridTransform& to_grid, std::size_t begin,
                std::size_t end, Survivors& out) {
  const SphereGridView& grid = scan.grid;
  const GridPoint<VecF> limit{splat(static_cast<float>(grid.num_x)),
                              splat(static_cast<float>(grid.num_y)),
                              splat(static_cast<float>(grid.num_z))};
  out.num = 0;
  for (std::size_t i = begin; i < end; i += kLanes) {
    const GridPoint<VecF> g = to_grid_units(to_grid, load(scan.cloud.x + i), load(scan.cloud.y + i),
                                            load(scan.cloud.z + i));
    VecI inside = is_in_grid(g, limit);
    inside &= lane_ids() < splat(static_cast<std::int32_t>(std::min<std::size_t>(end - i, kLanes)));
    if (mask_bits(inside) == 0) continue;
    const VecF zero = splat(0.0f);
    const VecI cell =
        (to_int(select(inside, g.z, zero)) * grid.num_y + to_int(select(inside, g.y, zero))) *
            grid.num_x +
        to_int(select(inside, g.x, zero));
    const VecI tag = gather(grid.tags, cell);
    const std::uint32_t bits = mask_bits(inside & (tag != 0));
    if (bits == 0) continue;
    compress_store(out.index + out.num, lane_ids() + static_cast<std::int32_t>(i), bits);
    compress_store(out.tag + out.num, tag, bits);
    compress_store(out.x + out.num, g.x, bits);
    compress_store(out.y + out.num, g.y, bits);
    compress_store(out.z + out.num, g.z, bits);
    out.num += std::popcount(bits);
  }
}

inline void add_to(std::int64_t* sum, Vec4L value) {
  Vec4L total;
  std::memcpy(&total, sum, sizeof total);
  total += value;
  std::memcpy(sum, &total, sizeof total);
}

// Destination of sums. Holds copies of the pointers: the sums are written through memcpy, which may
// alias anything as far as the compiler knows.
struct Accumulator {
  const float *x, *y, *z, *nx, *ny, *nz;
  Vec4D translation_W;
  double scale;
  PointSums* sums;
  std::uint8_t* touched;

  // Adds the three coordinates and the count at once.
  void add(std::int32_t i, std::int32_t id) const {
    const Vec4F p{x[i], y[i], z[i], 1.0f};
    const Vec4F n{nx[i], ny[i], nz[i], 0.0f};
    add_to(sums[id].offset_W,
           to_fixed<Vec4L>(__builtin_convertvector(p, Vec4D) - translation_W, scale));
    add_to(sums[id].normal_W, to_fixed<Vec4L>(__builtin_convertvector(n, Vec4D), scale));
    touched[id] = 1;
  }
};

// The same with kernel weights.
struct WeightedAccumulator {
  Accumulator plain;
  const PointScan* scan;

  void add(std::int32_t i, std::int32_t id) const {
    const Vec3d offset_W = Vec3d{plain.x[i], plain.y[i], plain.z[i]} - scan->translation_W;
    const double weight = kernel_weight(*scan, offset_W, id);
    const double factor = scan->weights == PointWeights::in_sums ? weight : 1;
    const Vec4D offset{offset_W.x * factor, offset_W.y * factor, offset_W.z * factor, 1.0};
    const Vec4D normal{plain.nx[i] * factor, plain.ny[i] * factor, plain.nz[i] * factor, weight};
    add_to(plain.sums[id].offset_W, to_fixed<Vec4L>(offset, plain.scale));
    add_to(plain.sums[id].normal_W, to_fixed<Vec4L>(normal, plain.scale));
    plain.touched[id] = 1;
  }
};

// Adds edge points to their sphere's edge sums as well.
template <class Surface>
struct EdgeAccumulator {
  Surface surface;
  EdgePoints points;
  EdgeSums* edges;
  Vec3d translation_W;
  double scale;

  void add_shared(std::int64_t* sum, const Vec3d& v, double last) const {
    const Vec4L value = to_fixed<Vec4L>(Vec4D{v.x, v.y, v.z, last}, scale);
    for (int k = 0; k < 4; ++k) __atomic_fetch_add(sum + k, value[k], __ATOMIC_RELAXED);
  }

  void add(std::int32_t i, std::int32_t id) const {
    surface.add(i, id);
    const int width = points.cloud->width, height = points.cloud->height;
    const int row = i / width, column = i % width;
    const Vec3d own = points.change(i, row, column);
    if (!EdgePoints::is_edge(own)) return;
    constexpr int kRadius = EdgeSums::kRadius;
    const int low = std::max(column - kRadius, 0), high = std::min(column + kRadius, width - 1);
    EdgeMean mean;
    for (int v = std::max(row - kRadius, 0); v <= std::min(row + kRadius, height - 1); ++v) {
      for (int u = low; u <= high; ++u) {
        const std::int32_t q = v * width + u;
        const Vec3d other = points.change(q, v, u);
        if (points.belong_together(i, own, q, other)) mean.add(points.point(q), other);
      }
    }
    PointSums& sums = edges[id].towards[mean.direction()];
    add_shared(sums.offset_W, mean.offset(translation_W), 1.0);
    add_shared(sums.normal_W, mean.unit_change(), 0.0);
  }
};

// Tests a point against the spheres of a block, all at once.
struct PointInBlock {
  Vec8F x, y, z;

  static Vec8F eight(const float* from) { return *reinterpret_cast<const Vec8F*>(from); }
  Vec8F squared_distances(const CandidateBlock& block) const {
    const Vec8F dx = x - eight(block.x), dy = y - eight(block.y), dz = z - eight(block.z);
    return dx * dx + dy * dy + dz * dz;
  }
  std::uint32_t up_to(Vec8F squared_distances, const float* limits) const {
    return mask_bits_8(squared_distances <= eight(limits));
  }
};

// Step 2: finds the sphere of each point.
template <class To>
void add_points(const PointScan& scan, const Survivors& in, const To& to) {
  constexpr int kAhead = 6;  // blocks come from the L2 or L3 cache
  for (int s = 0; s < in.num; ++s) {
    const std::int32_t next_tag = in.tag[std::min(s + kAhead, in.num - 1)];
    if (next_tag < 0) {
      const char* next = reinterpret_cast<const char*>(scan.grid.blocks - (next_tag + 1));
      __builtin_prefetch(next);
      __builtin_prefetch(next + 64);
      __builtin_prefetch(next + 128);
    }
    const std::int32_t tag = in.tag[s];
    // The cell is wholly inside a sphere, or has candidates.
    const PointInBlock test{in.x[s] - Vec8F{}, in.y[s] - Vec8F{}, in.z[s] - Vec8F{}};
    const std::int32_t id =
        tag > 0 ? tag - 1 : find_sphere(scan, scan.grid.blocks - (tag + 1), in.index[s], test);
    if (id >= 0) to.add(in.index[s], id);
  }
}

// A part of the window.
struct Pixels {
  int row_begin, row_end, column_begin, column_end;
};

template <class To>
void scan_pixels(const PointScan& scan, const Pixels& pixels, const To& to) {
  const GridTransform to_grid = grid_transform(scan);
  Survivors survivors;
  for (int row = pixels.row_begin; row < pixels.row_end; ++row) {
    const std::size_t row_start =
        static_cast<std::size_t>(row) * static_cast<std::size_t>(scan.cloud.width);
    const std::size_t last = row_start + static_cast<std::size_t>(pixels.column_end);
    for (std::size_t begin = row_start + static_cast<std::size_t>(pixels.column_begin);
         begin < last; begin += kRun) {
      find_cells(scan, to_grid, begin, std::min(begin + kRun, last), survivors);
      add_points(scan, survivors, to);
    }
  }
}

template <class Surface>
void scan_with_edges(const PointScan& scan, const Pixels& pixels, const Surface& to) {
  if (scan.edges == nullptr) return scan_pixels(scan, pixels, to);
  scan_pixels(
      scan, pixels,
      EdgeAccumulator<Surface>{to, {&scan.cloud}, scan.edges, scan.translation_W, scan.sum_scale});
}

}  // namespace

void scan_points(const PointScan& scan, int row_begin, int row_end, int column_begin,
                 int column_end, PointSums* sums, std::uint8_t* touched) {
  const Accumulator accumulator{
      scan.cloud.x,
      scan.cloud.y,
      scan.cloud.z,
      scan.cloud.nx,
      scan.cloud.ny,
      scan.cloud.nz,
      {scan.translation_W.x, scan.translation_W.y, scan.translation_W.z, 0.0},
      scan.sum_scale,
      sums,
      touched};
  const Pixels pixels{row_begin, row_end, column_begin, column_end};
  if (scan.weights == PointWeights::none) {
    scan_with_edges(scan, pixels, accumulator);
  } else {
    scan_with_edges(scan, pixels, WeightedAccumulator{accumulator, &scan});
  }
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
