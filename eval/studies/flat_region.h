// The largest flat region of a depth frame, and the plane that fits it.
#pragma once

#include <optional>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/math/geometry.h"

namespace palpate::eval {

struct FlatRegion {
  static constexpr int kCell = 8;  ///< pixels: side of the cells of a region

  Plane<double> plane_C;            ///< normal towards the camera
  int columns = 0, rows = 0;        ///< of cells
  std::vector<int> within;          ///< per cell: 0 outside, else distance from the border in cells
  std::vector<std::size_t> pixels;  ///< with depth, in the cells

  /// Returns points on the plane in the middle of cells at least `from_border` from the border.
  std::vector<Vec3d> places(const DepthStreamInfo& stream, int from_border) const;
  /// Largest distance of a cell from the border.
  int max_within() const;
};

/// Finds the largest flat region. The plane is the least-squares one in inverse depth, where planes
/// are linear and the noise of triangulating cameras is uniform; its cells have depth in all
/// pixels, within 0.8 % of the plane on average. nullopt: no flat region of a hundredth of the
/// image.
std::optional<FlatRegion> largest_flat_region(const DepthStreamInfo& stream,
                                              const DepthFrame& frame);

}  // namespace palpate::eval
