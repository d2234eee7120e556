// Queries of a depth field by elements of a tool, as many at once as a vector has lanes. Included
// by kernel files only.
#pragma once

#include <algorithm>

#include "src/contact/field/field_contact.h"
#include "src/core/internal/simd.h"
#include "src/core/internal/simd_rows.h"
#include "src/field/internal/field_sampler.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

inline constexpr int kSize = SphereClusters::kSize;

// Camera and level sizes of a query; the levels' places lie ready to be looked up.
struct Grid : FieldGrid {
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
    return gather_bytes(pixels.near_silhouette, pixel) != 0;
  }
  [[gnu::always_inline]] static bool is_any_near_silhouette(const Pixels& pixels, VecI pixel) {
    return any_byte(pixels.near_silhouette, pixel) && is_any(is_near_silhouette(pixels, pixel));
  }
  [[gnu::always_inline]] static void read_planes(const float* planes, VecI pixel,
                                                 VecF (&pairs)[6]) {
    gather_three_pairs(planes, pixel, pairs);
  }
  [[gnu::always_inline]] static void read_silhouette(const Silhouette* from, VecI number,
                                                     VecF (&numbers)[4]) {
    gather_fours(&from->side, number, numbers);
  }
};
using Look = PixelLook<Vectors>;

// Bits of the fields near a ball: the tiles that its elements can sample are not all well behind
// it. In the others every plane is at least the largest radius away from every element.
template <int kFields>
std::uint32_t fields_near(const MeasureJob& job, const Cluster& ball, float largest_radius) {
  constexpr std::uint32_t kAll = (1u << kFields) - 1;
  const int tiles_wide = job.fields[0].tiles_wide, tiles_high = job.fields[0].tiles_high;
  const BallWindow window = window_of(job.frame, ball, largest_radius, tiles_wide, tiles_high);
  if (!window.is_before_camera()) return window.farthest < kMinDepth ? 0 : kAll;
  std::uint32_t near = 0;
  for (int v = window.top; v <= window.bottom && near != kAll; ++v) {
    for (int u = window.left; u <= window.right; ++u) {
      for (int k = 0; k < kFields; ++k) {
        const DepthTile& tile = job.fields[k].tiles[v * tiles_wide + u];
        if (!is_behind(tile, window.farthest, largest_radius)) near |= 1u << k;
      }
    }
  }
  return near;
}

/// Finds the fields near each cluster of a group, as bits. Returns false if none is, by the group.
template <int kFields>
[[gnu::always_inline]] inline bool find_near(
    const MeasureJob& job, int group, std::uint32_t (&near)[SphereClusters::kClustersPerGroup]) {
  const SphereClusters& clusters = *job.clusters;
  const int first = group * SphereClusters::kClustersPerGroup;
  const int last = std::min(first + SphereClusters::kClustersPerGroup, clusters.num_clusters());
  const float* const largest = job.largest_radius;
  if (fields_near<kFields>(job, clusters.groups[static_cast<std::size_t>(group)],
                           *std::max_element(largest + first, largest + last)) == 0) {
    return false;
  }
  std::uint32_t any = 0;
  std::fill(std::begin(near), std::end(near), 0);
  for (int cluster = first; cluster < last; ++cluster) {
    near[cluster - first] = fields_near<kFields>(
        job, clusters.clusters[static_cast<std::size_t>(cluster)], largest[cluster]);
    any |= near[cluster - first];
  }
  return any != 0;
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
