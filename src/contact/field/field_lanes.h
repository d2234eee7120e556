// Queries of a depth field by elements of a tool, as many at once as a vector has lanes. Included
// by kernel files only.
#pragma once

#include <algorithm>
#include <limits>

#include "src/contact/field/field_contact.h"
#include "src/core/internal/simd.h"
#include "src/core/internal/simd_rows.h"
#include "src/field/internal/field_sampler.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

inline constexpr int kSize = SphereClusters::kSize;

// Camera and level sizes of a query; the levels' places lie ready to be looked up.
struct Grid : FieldGrid {
  Grid() = default;
  explicit Grid(const DepthFieldView& view) : FieldGrid(grid_of(view)) {
    std::copy(std::begin(start), std::end(start), starts.entries);
  }
  LaneTable<std::int32_t> starts;
};
using Pixels = FieldPixels;

// As many elements as a vector has lanes (field_sampler.h).
struct Vectors {
  using Real = VecF;
  using Int = VecI;
  using Mask = VecI;
  using Grid = PALPATE_ISA_NAMESPACE::Grid;
  static constexpr bool kHasMany = true;

  [[gnu::always_inline]] static bool is_any(VecI mask) { return mask_bits(mask) != 0; }
  [[gnu::always_inline]] static VecI whole(VecF numbers) { return to_int(numbers); }
  [[gnu::always_inline]] static VecF real(VecI numbers) { return to_float(numbers); }
  [[gnu::always_inline]] static VecI exponent(VecF numbers) {
    return (bits_of(numbers) >> 23) - 127;
  }
  [[gnu::always_inline]] static VecF inverse_power(VecI exponent) {
    return from_bits((127 - exponent) << 23);
  }
  [[gnu::always_inline]] static VecI start(const Grid& grid, VecI level) {
    return look_up(grid.starts, level);
  }
  [[gnu::always_inline]] static VecI is_near_silhouette(const Pixels& pixels, VecI pixel) {
    if (!any_byte(pixels.near_silhouette, pixel)) return VecI{};
    return gather_bytes(pixels.near_silhouette, pixel) != 0;
  }
  [[gnu::always_inline]] static void read_planes(const float* planes, VecI pixel,
                                                 VecF (&pairs)[6]) {
    gather_three_pairs(planes, pixel, pairs);
  }
  [[gnu::always_inline]] static void read_silhouette(const Silhouette* from, VecI number,
                                                     VecF (&numbers)[4]) {
    gather_fours(&from->side, number, numbers);
  }

  /// Limits the values of nine pixels by their silhouettes where elements are near one. Pixels that
  /// have one are few in most vectors, and limiting is dear: so those of all elements are packed
  /// into full vectors, limited, and put back.
  template <bool kBends>
  [[gnu::always_inline]] static void limit(const Grid& grid, const Pixels& pixels, VecI pixel,
                                           VecI is_near, VecF depth, VecF k_by,
                                           Curved<VecF> (&values)[3][3]) {
    alignas(64) float packed[kBends ? 8 : 7][10 * kLanes];
    std::uint32_t limited[3][3];
    int num = 0;
    for (int q = 0; q < 3; ++q) {
      for (int p = 0; p < 3; ++p) {
        const Curved<VecF>& own = values[q][p];
        // Memory of other pixels may be stale.
        const VecI at = is_near ? pixel + ((q - 1) * grid.stride + p - 1) : VecI{};
        VecF silhouette[4];
        read_silhouette(pixels.silhouettes, silhouette_of(at, own.value), silhouette);
        limited[q][p] = mask_bits(is_near & (silhouette[0] != VecF{}));
        const VecF numbers[] = {own.value,     own.slope, silhouette[0], silhouette[1],
                                silhouette[2], depth,     k_by,          own.bend};
        for (std::size_t i = 0; i < std::size(packed); ++i) {
          compress_store(&packed[i][num], numbers[i], limited[q][p]);
        }
        num += __builtin_popcount(limited[q][p]);
      }
    }
    for (int first = 0; first < num; first += kLanes) {
      const auto number = [&](int i) { return load(&packed[i][first]); };
      const VecF silhouette[4] = {number(2), number(3), number(4)};
      const Curved<VecF> own{number(0), number(1), kBends ? number(7) : VecF{}};
      const Curved<VecF> value = limited_by(silhouette, own, grid.thickness, number(5), number(6));
      store(&packed[0][first], value.value);
      store(&packed[1][first], value.slope);
      if constexpr (kBends) store(&packed[7][first], value.bend);
    }
    num = 0;
    for (int q = 0; q < 3; ++q) {
      for (int p = 0; p < 3; ++p) {
        Curved<VecF>& value = values[q][p];
        expand_load(&packed[0][num], limited[q][p], value.value);
        expand_load(&packed[1][num], limited[q][p], value.slope);
        if constexpr (kBends) expand_load(&packed[7][num], limited[q][p], value.bend);
        num += __builtin_popcount(limited[q][p]);
      }
    }
  }
};
using Look = PixelLook<Vectors>;

/// True if all planes of a field in the tiles of a window are well behind a ball.
inline bool are_behind(const DepthFieldView& field, const BallWindow& window, float distance) {
  for (int v = window.top; v <= window.bottom; ++v) {
    const DepthTile* const row = field.tiles + v * field.tiles_wide;
    for (int u = window.left; u <= window.right; ++u) {
      if (!is_behind(row[u], window.farthest, distance)) return false;
    }
  }
  return true;
}
/// Bound of these planes; none if it does not show that the front half of the ball is free, or if
/// it costs more than it is worth.
inline DepthTile bound_of(const DepthFieldView& field, const BallWindow& window, float distance) {
  constexpr float kFar = std::numeric_limits<float>::infinity();
  constexpr int kMaxTiles = 24;
  if (window.num_tiles() > kMaxTiles) return {};
  const float middle = 0.5f * (window.nearest + window.farthest);
  DepthTile all{kFar, kFar};
  for (int v = window.top; v <= window.bottom; ++v) {
    const DepthTile* const row = field.tiles + v * field.tiles_wide;
    for (int u = window.left; u <= window.right; ++u) {
      all = {std::min(all.nearest, row[u].nearest), std::min(all.min_slope, row[u].min_slope)};
      if (!is_behind(all, middle, distance)) return {};
    }
  }
  return all;
}
inline bool is_known(const DepthTile& bound) { return bound.nearest > 0; }

/// Fields near a ball: the tiles that its elements can sample are not all well behind it. In the
/// others every plane is at least the largest radius away from every element.
template <int kFields>
struct NearFields {
  std::uint32_t bits = 0;
  DepthTile bounds[kFields];  ///< of those near, for elements in the front of the ball
};
template <int kFields>
void find_near(const MeasureJob& job, const Cluster& ball, float largest_radius, bool wants_bounds,
               NearFields<kFields>& near) {
  const DepthFieldView& field = job.fields[0];
  const BallWindow window =
      window_of(job.frame, ball, largest_radius, field.tiles_wide, field.tiles_high);
  if (!window.is_before_camera()) {
    if (!(window.farthest < kMinDepth)) near.bits = (1u << kFields) - 1;
    return;
  }
  for (int k = 0; k < kFields; ++k) {
    if (are_behind(job.fields[k], window, largest_radius)) continue;
    near.bits |= 1u << k;
    if (wants_bounds) near.bounds[k] = bound_of(job.fields[k], window, largest_radius);
  }
}

/// Finds the fields near each cluster of a group. Returns false if none is, by the group.
template <int kFields>
[[gnu::always_inline]] inline bool find_near(
    const MeasureJob& job, int group,
    NearFields<kFields> (&near)[SphereClusters::kClustersPerGroup]) {
  const SphereClusters& clusters = *job.clusters;
  const int first = group * SphereClusters::kClustersPerGroup;
  const int last = std::min(first + SphereClusters::kClustersPerGroup, clusters.num_clusters());
  const float* const largest = job.largest_radius;
  NearFields<kFields> around;
  find_near(job, clusters.groups[static_cast<std::size_t>(group)],
            *std::max_element(largest + first, largest + last), false, around);
  if (around.bits == 0) return false;
  std::uint32_t any = 0;
  for (int cluster = first; cluster < last; ++cluster) {
    find_near(job, clusters.clusters[static_cast<std::size_t>(cluster)], largest[cluster], true,
              near[cluster - first]);
    any |= near[cluster - first].bits;
  }
  return any != 0;
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
