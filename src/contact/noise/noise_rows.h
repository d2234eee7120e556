// Numbers that a query keeps of each element that touches a surface, if it is asked how sure it is
// (noise_grid.h): where its camera sees it, and what a change of the depth there would change.
#pragma once

#include <cstddef>

#include "palpate/core/core.h"
#include "src/contact/index/sphere_clusters.h"

namespace palpate { inline namespace v0 {

/// The numbers, each in a row over all elements.
enum class NoiseRow {
  u,              ///< pixels of level 0
  v,              ///< the same
  inverse_depth,  ///< 1/m
  footprint,      ///< width of the sampled pixels, in those of level 0
  volume,         ///< m3, times the change of the field by the depth of the surface
  nx,             ///< gradient of the field in W, not longer than what a force follows
  ny,
  nz,
  lx,  ///< lever from C in W, m
  ly,
  lz,
  camera,  ///< number of the camera that decided
  change,  ///< of volume, force and torque by that depth: m2 and m3, seven rows
};
inline constexpr int kNumChanges = 7;
inline constexpr int kNumNoiseRows = static_cast<int>(NoiseRow::change) + kNumChanges;

/// Place of a group's first element in each row; its clusters may be kept as one each, too.
PALPATE_HOSTDEV constexpr std::ptrdiff_t first_noise_row(int group) {
  return std::ptrdiff_t{group} * SphereClusters::kClustersPerGroup * (SphereClusters::kSize + 1);
}

/// Rows for the elements of a tool, group by group.
struct NoiseRows {
  float* first = nullptr;
  std::ptrdiff_t apart = 0;  ///< from one row to the next
  int* num = nullptr;        ///< elements that are kept of each group; null: nobody asked

  PALPATE_HOSTDEV float* row(NoiseRow which) const {
    return first + static_cast<int>(which) * apart;
  }
  PALPATE_HOSTDEV float at(NoiseRow which, std::ptrdiff_t element) const {
    return row(which)[element];
  }
  PALPATE_HOSTDEV float change(int number, std::ptrdiff_t element) const {
    return first[(static_cast<int>(NoiseRow::change) + number) * apart + element];
  }
};

}}  // namespace palpate::v0
