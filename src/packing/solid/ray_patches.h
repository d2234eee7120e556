// Bundles of ray directions.
#pragma once

#include <cstddef>
#include <vector>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

typedef float Float4 __attribute__((vector_size(16)));

/// Sixteen neighboring unit vectors.
struct RayPatch {
  static constexpr std::size_t kSize = 16;
  static constexpr std::size_t kParts = 4;
  Float4 x[kParts], y[kParts], z[kParts];
  Vec3f axis;
  float spread = 0;  ///< no ray is farther from the axis

  /// a . u of four rays.
  Float4 along(const Vec3f& a, std::size_t part) const {
    return x[part] * a.x + y[part] * a.y + z[part] * a.z;
  }

  /// No ray u of the patch has a . u above this; `length` is |a|.
  float bound(const Vec3f& a, float length) const { return dot(a, axis) + length * spread; }
};

/// At least one patch; together evenly spread over the sphere.
std::vector<RayPatch> make_ray_patches(std::size_t num);

}}  // namespace palpate::v0
