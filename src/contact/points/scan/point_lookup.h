// Lookup of the sphere that contains a point, and the point's terms of its sums (thesis section
// 3.2.1 and eq. 3.3). Shared code for the vector kernels and the device; only their loops differ.
#pragma once

#include <cstdint>
#include <cstring>

#include "src/contact/points/scan/point_scan.h"

namespace palpate { inline namespace v0 {

/// World to grid units: g = m (p - t) + offset, with the low part of the translation folded into
/// the offset.
struct GridTransform {
  float m[9];
  float t[3];
  float offset[3];
};

PALPATE_FORMULA GridTransform grid_transform(const PointScan& scan) {
  GridTransform to_grid;
  Vec3d t_low;
  for (int axis = 0; axis < 3; ++axis) {
    to_grid.t[axis] = static_cast<float>(scan.translation_W[axis]);
    t_low[axis] = scan.translation_W[axis] - static_cast<double>(to_grid.t[axis]);
  }
  const Vec3d shift = (-(scan.R_TW * t_low) - scan.grid.origin) * scan.grid.cells_per_meter;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      to_grid.m[3 * row + column] =
          static_cast<float>(scan.R_TW.m[row][column] * scan.grid.cells_per_meter);
    }
    to_grid.offset[row] = static_cast<float>(shift[row]);
  }
  return to_grid;
}

/// One point or a vector of them, in grid units.
template <class Number>
struct GridPoint {
  Number x, y, z;
};

template <class Number>
PALPATE_FORMULA GridPoint<Number> to_grid_units(const GridTransform& to_grid, Number x, Number y,
                                                Number z) {
  const float* const m = to_grid.m;
  const Number dx = x - to_grid.t[0], dy = y - to_grid.t[1], dz = z - to_grid.t[2];
  return {m[0] * dx + m[1] * dy + m[2] * dz + to_grid.offset[0],
          m[3] * dx + m[4] * dy + m[5] * dz + to_grid.offset[1],
          m[6] * dx + m[7] * dy + m[8] * dz + to_grid.offset[2]};
}

/// False for NaN (no measurement). `limit` is the number of cells along each axis.
template <class Number>
PALPATE_FORMULA auto is_in_grid(const GridPoint<Number>& g, const GridPoint<Number>& limit) {
  return (g.x >= 0.0f) & (g.x < limit.x) & (g.y >= 0.0f) & (g.y < limit.y) & (g.z >= 0.0f) &
         (g.z < limit.z);
}

/// True if |p - c| <= r in double, on the stored single-precision numbers.
PALPATE_FORMULA bool contains_exactly(const PointScan& scan, std::int32_t sphere_id,
                                      std::int32_t point) {
  const Vec3d p_W{scan.cloud.x[point], scan.cloud.y[point], scan.cloud.z[point]};
  const Sphere& sphere = scan.spheres[sphere_id];
  const Vec3d d = scan.R_TW * (p_W - scan.translation_W) - to_double(sphere.center);
  const double r = sphere.radius;
  return dot(d, d) <= r * r;
}

PALPATE_FORMULA int lowest_bit(std::uint32_t bits) {
#if defined(__CUDA_ARCH__)
  return __ffs(static_cast<int>(bits)) - 1;
#else
  return __builtin_ctz(bits);
#endif
}

/// Returns the candidate of a cell that contains the point, or -1: at most one can, the packing is
/// disjoint. `test.squared_distances(block)` are those of the point to the spheres of a block, and
/// `test.up_to(distances, limits)` has a bit for each that is not above its limit.
template <class BlockTest>
PALPATE_FORMULA std::int32_t find_sphere(const PointScan& scan, const CandidateBlock* block,
                                         std::int32_t point, const BlockTest& test) {
  for (;; ++block) {
    const auto distances = test.squared_distances(*block);
    const std::uint32_t surely = test.up_to(distances, block->surely_inside);
    if (surely != 0) return block->id(lowest_bit(surely));
    // Close calls.
    for (std::uint32_t maybe = test.up_to(distances, block->maybe_inside); maybe != 0;
         maybe &= maybe - 1) {
      const std::int32_t id = block->id(lowest_bit(maybe));
      if (contains_exactly(scan, id, point)) return id;
    }
    if (!block->goes_on()) return -1;
  }
}

/// Rounds v * scale to whole numbers by adding 1.5 * 2^52, which leaves them in the low bits.
template <class Int, class Real>
PALPATE_FORMULA Int to_fixed(Real v, double scale) {
  static_assert(sizeof(Int) == sizeof(Real));
  constexpr double kMagic = 6755399441055744.0;
  constexpr std::int64_t kMagicBits = 0x4338000000000000;
  const Real shifted = v * scale + kMagic;
  Int bits;
  std::memcpy(&bits, &shifted, sizeof bits);
  return bits - kMagicBits;
}

/// Returns (1 - |p - c|^2 / r^2)^2 of a point at `offset_W` from the tool's translation.
PALPATE_FORMULA double kernel_weight(const PointScan& scan, const Vec3d& offset_W,
                                     std::int32_t sphere_id) {
  const Sphere& sphere = scan.spheres[sphere_id];
  const Vec3d d = scan.R_TW * offset_W - to_double(sphere.center);
  const double r = sphere.radius, rim = 1.0 - dot(d, d) / (r * r);
  return rim > 0 ? rim * rim : 0;
}

}}  // namespace palpate::v0
