// The point loop, compiled once per instruction set. Three steps on short runs of a row: look up the
// grid cells of a few points at a time and keep those that matter; decide the sphere of each; add
// them up in fixed point.
#include <algorithm>
#include <bit>

#include "src/contact/point_scan.h"
#include "src/core/simd.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

constexpr int kRun = 256;  // points per run: all scratch stays in the L1 cache

// Doubles fill a register with half as many lanes.
constexpr int kWide = kLanes / 2;
typedef float VecN __attribute__((vector_size(PALPATE_LANES * 2), aligned(PALPATE_LANES * 2)));
typedef double VecD __attribute__((vector_size(PALPATE_LANES * 4), aligned(PALPATE_LANES * 4)));
typedef std::int64_t VecL __attribute__((vector_size(PALPATE_LANES * 4), aligned(PALPATE_LANES * 4)));
typedef float Vec8F __attribute__((vector_size(32), aligned(32)));
typedef std::int32_t Vec8I __attribute__((vector_size(32), aligned(32)));

// Points of a run whose cell is not empty.
struct Survivors {
  alignas(64) std::int32_t index[kRun + kLanes];
  alignas(64) std::int32_t tag[kRun + kLanes];
  alignas(64) float x[kRun + kLanes], y[kRun + kLanes], z[kRun + kLanes];  // grid units
  int num = 0;
};

// Points of a run that are inside a sphere.
struct Hits {
  alignas(64) std::int32_t index[kRun + kLanes];
  alignas(64) std::int32_t sphere_id[kRun + kLanes];
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
    const VecI cell = (to_int(select(inside, gz, zero)) * grid.num_y +
                       to_int(select(inside, gy, zero))) * grid.num_x +
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
    const std::int32_t id = block.sphere_id[std::countr_zero(bits)];
    if (contains_exactly(scan, id, static_cast<std::size_t>(point))) return id;
  }
  return -1;
}

// Step 2: the sphere of each survivor. At most one can contain it: the packing is disjoint.
void find_spheres(const PointScan& scan, const Survivors& in, Hits& out) {
  constexpr int kAhead = 6;  // blocks come from the L2 or L3 cache
  out.num = 0;
  for (int s = 0; s < in.num; ++s) {
    const std::int32_t next_tag = in.tag[s + kAhead < in.num ? s + kAhead : s];
    if (next_tag < 0) {
      const char* next = reinterpret_cast<const char*>(scan.grid.blocks - (next_tag + 1));
      __builtin_prefetch(next);
      __builtin_prefetch(next + 64);
      __builtin_prefetch(next + 128);
    }
    const std::int32_t tag = in.tag[s];
    std::int32_t found = tag - 1;  // wholly inside a sphere
    if (tag < 0) {
      const Vec8F x = Vec8F{} + in.x[s], y = Vec8F{} + in.y[s], z = Vec8F{} + in.z[s];
      const CandidateBlock* block = scan.grid.blocks - (tag + 1);
      for (;; ++block) {
        const Vec8F dx = x - *reinterpret_cast<const Vec8F*>(block->x);
        const Vec8F dy = y - *reinterpret_cast<const Vec8F*>(block->y);
        const Vec8F dz = z - *reinterpret_cast<const Vec8F*>(block->z);
        const Vec8F squared_distance = dx * dx + dy * dy + dz * dz;
        const std::uint32_t surely = mask_bits_8(
            squared_distance <= *reinterpret_cast<const Vec8F*>(block->surely_inside));
        if (surely != 0) {
          found = block->sphere_id[std::countr_zero(surely)];
          break;
        }
        const std::uint32_t maybe = mask_bits_8(
            squared_distance <= *reinterpret_cast<const Vec8F*>(block->maybe_inside));
        found = maybe != 0 ? decide(scan, *block, maybe, in.index[s]) : -1;
        if (found >= 0 || block->goes_on == 0) break;
      }
    }
    out.index[out.num] = in.index[s];
    out.sphere_id[out.num] = found;
    out.num += found >= 0;
  }
}

// Rounds v * 2^40 to whole numbers by adding 1.5 * 2^52, which leaves them in the low bits.
inline VecL to_fixed(VecD v) {
  constexpr double kMagic = 6755399441055744.0;
  const VecD shifted = v * PointSums::kScale + kMagic;
  return reinterpret_cast<VecL>(shifted) - std::bit_cast<std::int64_t>(kMagic);
}

// Step 3: fixed-point sums. Neighbouring pixels mostly hit the same sphere, so sums stay in registers
// until the sphere changes.
void add_hits(const PointScan& scan, Hits& hits, PointSums* sums, std::uint64_t* touched) {
  alignas(64) std::int64_t fixed[6][kRun + kLanes];
  const float* channels[6] = {scan.cloud.x,  scan.cloud.y,  scan.cloud.z,
                              scan.cloud.nx, scan.cloud.ny, scan.cloud.nz};
  for (int i = 0; i < kWide; ++i) hits.index[hits.num + i] = hits.num > 0 ? hits.index[0] : 0;
  for (int begin = 0; begin < hits.num; begin += kWide) {
    const std::int32_t* index = hits.index + begin;
    const bool neighbours = index[kWide - 1] - index[0] == kWide - 1;  // indices ascend
    for (int channel = 0; channel < 6; ++channel) {
      VecN value;
      if (neighbours) {
        std::memcpy(&value, channels[channel] + index[0], sizeof value);
      } else {
        for (int i = 0; i < kWide; ++i) value[i] = channels[channel][index[i]];
      }
      VecD wide = __builtin_convertvector(value, VecD);
      if (channel < 3) wide -= scan.translation_W[channel];
      *reinterpret_cast<VecL*>(fixed[channel] + begin) = to_fixed(wide);
    }
  }
  for (int begin = 0; begin < hits.num;) {
    const std::int32_t id = hits.sphere_id[begin];
    std::int64_t sum[6] = {0, 0, 0, 0, 0, 0};
    int end = begin;
    for (; end < hits.num && hits.sphere_id[end] == id; ++end) {
      for (int channel = 0; channel < 6; ++channel) sum[channel] += fixed[channel][end];
    }
    PointSums& total = sums[id];
    for (int axis = 0; axis < 3; ++axis) {
      total.offset_W[axis] += sum[axis];
      total.normal_W[axis] += sum[3 + axis];
    }
    total.num_points += end - begin;
    touched[id / 64] |= std::uint64_t{1} << (id % 64);
    begin = end;
  }
}

}  // namespace

void scan_points(const PointScan& scan, int row_begin, int row_end, int column_begin,
                 int column_end, PointSums* sums, std::uint64_t* touched) {
  const GridTransform to_grid(scan);
  Survivors survivors;
  Hits hits;
  for (int row = row_begin; row < row_end; ++row) {
    const std::size_t row_start =
        static_cast<std::size_t>(row) * static_cast<std::size_t>(scan.cloud.width);
    const std::size_t last = row_start + static_cast<std::size_t>(column_end);
    for (std::size_t begin = row_start + static_cast<std::size_t>(column_begin); begin < last;
         begin += kRun) {
      find_cells(scan, to_grid, begin, std::min(begin + kRun, last), survivors);
      if (survivors.num == 0) continue;
      find_spheres(scan, survivors, hits);
      add_hits(scan, hits, sums, touched);
    }
  }
}

}  // namespace palpate::PALPATE_ISA_NAMESPACE
