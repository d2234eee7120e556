// How far the surface of a solid is: a smooth scalar field in the frame of its mesh.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/core/result.h"
#include "palpate/core/thread_pool.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

/// Signed distances to a closed mesh, negative inside, at the nodes of a few grids over one box:
/// the first with the finest spacing, each further one twice as wide. A grid's field is the
/// quadratic B-spline with the distances as coefficients: once continuously differentiable, exact
/// where the surface is flat, elsewhere the mean of the distance over about a ball of 1.12 times
/// its spacing. So a sphere is told the distance as it is over its own extent, and is cut rightly
/// at edges, not only at faces (docs/decisions/0030-bodies-as-fields.md).
///
/// Node (i, j, k) of a level lies at origin + spacing (i, j, k). Each grid has kMargin nodes around
/// the box on all sides, so that a ball that asks it is known to be free before it has left it.
class SolidField {
 public:
  static constexpr int kMargin = 4;
  static constexpr int kMostLevels = 8;
  /// Of the finest grid, with its margins: what bounds the size of a tool, and the resolution.
  static constexpr std::size_t kMostNodes = std::size_t(1) << 19;

  /// What decides the grids.
  struct Layout {
    Vec3d origin;                             ///< lower corner of the mesh's box, m
    double spacing = 0;                       ///< of the finest grid, m
    std::array<std::int32_t, 3> num_cells{};  ///< that the finest grid needs to cover the box
  };
  struct Level {
    double spacing = 0;                       ///< m
    std::array<std::int32_t, 3> num_nodes{};  ///< with both margins
    std::size_t first = 0;                    ///< in values(); x runs fastest, then y
  };

  /// Of a mesh that bounds a solid (check_solid). The sign is that of the majority of three rays
  /// near the surface, and follows from the distances elsewhere. O(kMostNodes) searches of the
  /// nearest triangle: about a second. Same bits for any number of threads.
  static SolidField of(const TriangleMesh& solid, ThreadPool& pool);
  /// From stored parts. Error: they do not belong together, or are no distances.
  static Result<SolidField> restore(const Layout& layout, std::span<const float> values);

  const Layout& layout() const { return layout_; }
  std::span<const Level> levels() const { return levels_; }
  std::span<const float> values() const {
    return std::span(values_).first(values_.size() - kSpareValues);
  }
  /// Values of a level.
  std::span<const float> values(int level) const;

  std::size_t num_bytes() const { return values_.size() * sizeof(float); }
  friend bool operator==(const SolidField& a, const SolidField& b);

 private:
  static constexpr std::size_t kSpareValues = 1;  // which kernels may read

  explicit SolidField(const Layout& layout);

  Layout layout_;
  std::vector<Level> levels_;
  std::vector<float> values_;
};

}  // namespace palpate
