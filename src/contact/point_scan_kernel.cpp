// The point loop, compiled once per instruction set. Two steps on short runs of a row: look up the
// grid cells of a few points at a time and keep those that matter; then, one by one, find the
// sphere that contains the point and add it up in fixed point.
#include <algorithm>
#include <bit>

#include "src/contact/point_scan.h"
#include "src/core/simd.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
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

// World to grid units: g = M (p - t_high) + offset, with the low part of t folded into the offset.
struct GridTransform {
  float m[9];
  float t[3];
  float offset[3];

  explicit GridTransform(const PointScan& scan) {
    Vec3d t_low;
    for (int axis = 0; axis < 3; ++axis) {
      t[axis] = static_cast<float>(scan.translation_W[axis]);
      t_low[axis] = scan.translation_W[axis] - static_cast<double>(t[axis]);
    }
    const Vec3d shift = (-(scan.R_TW * t_low) - scan.grid.origin) * scan.grid.cells_per_metre;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        m[3 * row + column] =
            static_cast<float>(scan.R_TW.m[row][column] * scan.grid.cells_per_metre);
      }
      offset[row] = static_cast<float>(shift[row]);
    }
  }
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
  const VecF limit_x = splat(static_cast<float>(grid.num_x));
  const VecF limit_y = splat(static_cast<float>(grid.num_y));
  const VecF limit_z = splat(static_cast<float>(grid.num_z));
  const float* m = to_grid.m;
  out.num = 0;
  for (std::size_t i = begin; i < end; i += kLanes) {
    const VecF dx = load(scan.cloud.x + i) - to_grid.t[0];
    const VecF dy = load(scan.cloud.y + i) - to_grid.t[1];
    const VecF dz = load(scan.cloud.z + i) - to_grid.t[2];
    const VecF gx = m[0] * dx + m[1] * dy + m[2] * dz + to_grid.offset[0];
    const VecF gy = m[3] * dx + m[4] * dy + m[5] * dz + to_grid.offset[1];
    const VecF gz = m[6] * dx + m[7] * dy + m[8] * dz + to_grid.offset[2];
    // NaN (no measurement) fails every comparison.
    VecI inside = (gx >= 0.0f) & (gx < limit_x) & (gy >= 0.0f) & (gy < limit_y) & (gz >= 0.0f) &
                  (gz < limit_z);
    inside &= lane_ids() < splat(static_cast<std::int32_t>(std::min<std::size_t>(end - i, kLanes)));
    if (mask_bits(inside) == 0) continue;
    const VecF zero = splat(0.0f);
    const VecI cell =
        (to_int(select(inside, gz, zero)) * grid.num_y + to_int(select(inside, gy, zero))) *
            grid.num_x +
        to_int(select(inside, gx, zero));
    const VecI tag = gather(grid.tags, cell);
    const std::uint32_t bits = mask_bits(inside & (tag != 0));
    if (bits == 0) continue;
    compress_store(out.index + out.num, lane_ids() + static_cast<std::int32_t>(i), bits);
    compress_store(out.tag + out.num, tag, bits);
    compress_store(out.x + out.num, gx, bits);
    compress_store(out.y + out.num, gy, bits);
    compress_store(out.z + out.num, gz, bits);
    out.num += std::popcount(bits);
  }
}

// |p - c| <= r in double, on the stored single-precision numbers.
bool contains_exactly(const PointScan& scan, std::int32_t sphere_id, std::size_t i) {
  const Vec3d p_W{scan.cloud.x[i], scan.cloud.y[i], scan.cloud.z[i]};
  const Sphere& sphere = scan.spheres[sphere_id];
  const Vec3d d = scan.R_TW * (p_W - scan.translation_W) - to_double(sphere.centre);
  const double r = sphere.radius;
  return dot(d, d) <= r * r;
}

// A close call: of the lanes in `bits`, the candidate that contains the point exactly, or -1.
std::int32_t decide(const PointScan& scan, const CandidateBlock& block, std::uint32_t bits,
                    std::int32_t point) {
  for (; bits != 0; bits &= bits - 1) {
    const std::int32_t id = block.id(std::countr_zero(bits));
    if (contains_exactly(scan, id, static_cast<std::size_t>(point))) return id;
  }
  return -1;
}

// Rounds v * 2^40 to whole numbers by adding 1.5 * 2^52, which leaves them in the low bits.
inline Vec4L to_fixed(Vec4D v) {
  constexpr double kMagic = 6755399441055744.0;
  const Vec4D shifted = v * PointSums::kScale + kMagic;
  return reinterpret_cast<Vec4L>(shifted) - std::bit_cast<std::int64_t>(kMagic);
}

inline void add_to(std::int64_t* sum, Vec4L value) {
  Vec4L total;
  std::memcpy(&total, sum, sizeof total);
  total += value;
  std::memcpy(sum, &total, sizeof total);
}

// Where sums go. Holds copies of the pointers: the sums are written through memcpy, which might be
// writing anything as far as the compiler knows.
struct Accumulator {
  const float *x, *y, *z, *nx, *ny, *nz;
  Vec4D translation_W;
  PointSums* sums;
  std::uint8_t* touched;

  // The three coordinates and the count at once.
  void add(std::int32_t i, std::int32_t id) const {
    const Vec4F p{x[i], y[i], z[i], 1.0f};
    const Vec4F n{nx[i], ny[i], nz[i], 0.0f};
    add_to(sums[id].offset_W, to_fixed(__builtin_convertvector(p, Vec4D) - translation_W));
    add_to(sums[id].normal_W, to_fixed(__builtin_convertvector(n, Vec4D)));
    touched[id] = 1;
  }
};

// The same with kernel weights.
struct WeightedAccumulator {
  Accumulator plain;
  const PointScan* scan;

  void add(std::int32_t i, std::int32_t id) const {
    const Vec3d offset_W = Vec3d{plain.x[i], plain.y[i], plain.z[i]} - scan->translation_W;
    const Sphere& sphere = scan->spheres[id];
    const Vec3d d = scan->R_TW * offset_W - to_double(sphere.centre);
    const double r = sphere.radius, rim = 1.0 - dot(d, d) / (r * r);
    const double weight = rim > 0 ? rim * rim : 0;
    const double factor = scan->weights == PointWeights::in_sums ? weight : 1;
    const Vec4D offset{offset_W.x * factor, offset_W.y * factor, offset_W.z * factor, 1.0};
    const Vec4D normal{plain.nx[i] * factor, plain.ny[i] * factor, plain.nz[i] * factor, weight};
    add_to(plain.sums[id].offset_W, to_fixed(offset));
    add_to(plain.sums[id].normal_W, to_fixed(normal));
    plain.touched[id] = 1;
  }
};

// Adds edge points to their sphere's edge sums as well.
template <class Surface>
struct EdgeAccumulator {
  Surface surface;
  const PointCloudView* cloud;
  EdgeSums* edges;
  Vec4D translation_W;

  bool is_point(std::int32_t i) const { return cloud->z[i] == cloud->z[i]; }

  // Depth-change vector, across missing pixels where nothing is known beside the point.
  Vec4D change(std::int32_t i, int row, int column) const {
    const Vec4D known{cloud->edge_x[i], cloud->edge_y[i], cloud->edge_z[i], 0.0};
    if (known[0] != 0 || known[1] != 0 || !is_point(i)) return known;
    const int width = cloud->width;
    const int steps[4] = {1, -1, width, -width};
    const int room[4] = {width - 1 - column, column, cloud->height - 1 - row, row};
    Vec4D l{};
    for (int k = 0; k < 4; ++k) {
      if (room[k] == 0 || is_point(i + steps[k])) continue;
      const int end = std::min(room[k], EdgeSums::kMaxHole);
      int n = 2;
      while (n <= end && !is_point(i + n * steps[k])) ++n;
      if (n > end) continue;
      const double z = cloud->z[i], beyond = cloud->z[i + n * steps[k]];
      const double more = beyond - z - EdgeSums::kMinStep;
      if (more > 0) l[k / 2] += k % 2 == 0 ? more : -more;
    }
    if (l[0] == 0 && l[1] == 0) return l;
    const Vec4D p = point(i);
    return l - dot(l, p) / dot(p, p) * p * Vec4D{1.0, 1.0, 1.0, 0.0};
  }
  Vec4D point(std::int32_t i) const { return Vec4D{cloud->x[i], cloud->y[i], cloud->z[i], 1.0}; }
  static double dot(Vec4D a, Vec4D b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
  static void add_shared(std::int64_t* sum, Vec4L value) {
    for (int k = 0; k < 4; ++k) __atomic_fetch_add(sum + k, value[k], __ATOMIC_RELAXED);
  }

  void add(std::int32_t i, std::int32_t id) const {
    surface.add(i, id);
    const int row = i / cloud->width, column = i % cloud->width;
    const Vec4D own = change(i, row, column);
    if (!(dot(own, own) > EdgeSums::kMinChange * EdgeSums::kMinChange)) return;
    // Edge points of the same surface around it that look in about the same direction.
    constexpr int kRadius = EdgeSums::kRadius;
    const int low = std::max(column - kRadius, 0);
    const int high = std::min(column + kRadius, cloud->width - 1);
    Vec4D p{}, l{};
    for (int v = std::max(row - kRadius, 0); v <= std::min(row + kRadius, cloud->height - 1); ++v) {
      for (int u = low; u <= high; ++u) {
        const std::int32_t q = v * cloud->width + u;
        const Vec4D other = change(q, v, u);
        if (!(dot(own, other) > 0)) continue;
        const float step = cloud->z[q] - cloud->z[i];
        constexpr float kSame = static_cast<float>(EdgeSums::kSameSurface);
        if (!(step < kSame && step > -kSame)) continue;  // nor if it is no point
        p += point(q);
        l += other;
      }
    }
    const bool sideways = __builtin_fabs(l[0]) >= __builtin_fabs(l[1]);
    const int direction = sideways ? (l[0] > 0 ? 0 : 1) : (l[1] > 0 ? 2 : 3);
    PointSums& sums = edges[id].towards[direction];
    add_shared(sums.offset_W, to_fixed(p / p[3] - translation_W));
    add_shared(sums.normal_W, to_fixed(l / __builtin_sqrt(dot(l, l))));
  }
};

// The candidate of a cell that contains the point, or -1.
inline std::int32_t find_sphere(const PointScan& scan, const CandidateBlock* block, float px,
                                float py, float pz, std::int32_t point) {
  const Vec8F x = px - Vec8F{}, y = py - Vec8F{}, z = pz - Vec8F{};
  for (;; ++block) {
    const Vec8F dx = x - *reinterpret_cast<const Vec8F*>(block->x);
    const Vec8F dy = y - *reinterpret_cast<const Vec8F*>(block->y);
    const Vec8F dz = z - *reinterpret_cast<const Vec8F*>(block->z);
    const Vec8F squared_distance = dx * dx + dy * dy + dz * dz;
    const std::uint32_t surely =
        mask_bits_8(squared_distance <= *reinterpret_cast<const Vec8F*>(block->surely_inside));
    if (surely != 0) return block->id(std::countr_zero(surely));
    const std::uint32_t maybe =
        mask_bits_8(squared_distance <= *reinterpret_cast<const Vec8F*>(block->maybe_inside));
    if (maybe != 0) {
      const std::int32_t found = decide(scan, *block, maybe, point);
      if (found >= 0) return found;
    }
    if (!block->goes_on()) return -1;
  }
}

// Step 2: at most one sphere can contain a point, the packing is disjoint.
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
    const std::int32_t id = tag > 0 ? tag - 1  // the cell is wholly inside a sphere
                                    : find_sphere(scan, scan.grid.blocks - (tag + 1), in.x[s],
                                                  in.y[s], in.z[s], in.index[s]);
    if (id >= 0) to.add(in.index[s], id);
  }
}

// Part of the window.
struct Pixels {
  int row_begin, row_end, column_begin, column_end;
};

template <class To>
void scan_pixels(const PointScan& scan, const Pixels& pixels, const To& to) {
  const GridTransform to_grid(scan);
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
  const Vec4D translation_W{scan.translation_W.x, scan.translation_W.y, scan.translation_W.z, 0.0};
  scan_pixels(scan, pixels, EdgeAccumulator<Surface>{to, &scan.cloud, scan.edges, translation_W});
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
      sums,
      touched};
  const Pixels pixels{row_begin, row_end, column_begin, column_end};
  if (scan.weights == PointWeights::none) {
    scan_with_edges(scan, pixels, accumulator);
  } else {
    scan_with_edges(scan, pixels, WeightedAccumulator{accumulator, &scan});
  }
}

}  // namespace palpate::PALPATE_ISA_NAMESPACE
