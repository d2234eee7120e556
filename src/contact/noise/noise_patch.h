// Patches of a surface that a query keeps if it is asked how sure it is (noise_grid.h): what the
// elements of one cluster change together by the depth that one camera sees there, and where and
// how far apart they are.
#pragma once

#include <cstddef>

#include "palpate/core/core.h"
#include "src/contact/index/sphere_clusters.h"

namespace palpate { inline namespace v0 {

/// Sums over elements. Weights are what elements change, roughly; n is the gradient of the field in
/// W, not longer than what a force follows.
struct NoisePatch {
  float disc;        ///< decrease of the volume by the depth of the surface, m2
  float moved;       ///< volume over depth, times the change of the field by that depth, m2
  float weight;      ///< m2
  float n[3];        ///< times weight
  float u, v;        ///< pixels of level 0 from the principal point, times weight
  float square;      ///< of that distance, and of the elements' own extent, times weight, pixels2
  float depth;       ///< times weight
  float at_u, at_v;  ///< u and v over weight, of one patch
  float camera;      ///< number of the camera that decided
  float unused[3];   ///< a patch is a power of two in size
};
inline constexpr int kNumNoiseSums = sizeof(NoisePatch) / sizeof(float);
static_assert(kNumNoiseSums == 16);

/// Patches of all groups of a tool.
struct NoisePatches {
  NoisePatch* first = nullptr;
  int* num = nullptr;  ///< patches of each group; null: nobody asked
  int num_groups = 0;
  int num_cameras = 1;  ///< that may decide

  /// A cluster has one by its elements, and one as a ball.
  static constexpr int kPerGroup = 2 * SphereClusters::kClustersPerGroup;

  PALPATE_HOSTDEV NoisePatch* of_group(int group) const {
    return first + std::ptrdiff_t{group} * kPerGroup * num_cameras;
  }
};

}}  // namespace palpate::v0
