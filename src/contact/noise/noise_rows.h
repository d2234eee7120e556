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

/// Most rows that a warp of a GPU keeps of a cluster: its elements, and the ball that stands for
/// them.
inline constexpr int kRowsOfCluster = SphereClusters::kSize + 1;

/// Rows of the warps of a GPU that keep elements: each has a part of them.
struct KeptRows {
  NoiseRows rows;
  int num_parts = 0;
  std::ptrdiff_t capacity = 0;  ///< of a part

  /// Returns those of one of several blocks, which follow each other.
  PALPATE_HOSTDEV KeptRows of_block(int block) const {
    KeptRows mine = *this;
    mine.rows.first += block * num_parts * capacity;
    mine.rows.num += block * num_parts;
    return mine;
  }
};
/// Returns the rows that a part needs if so many share the clusters of a tool.
constexpr std::ptrdiff_t rows_of_part(int num_clusters, int num_parts) {
  return std::ptrdiff_t{kRowsOfCluster} * ((num_clusters + num_parts - 1) / num_parts);
}

}}  // namespace palpate::v0
