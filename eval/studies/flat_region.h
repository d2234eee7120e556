// The largest flat region of a depth frame, and the plane that fits it.
#pragma once

#include <optional>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/math/geometry.h"

namespace palpate::eval {

struct FlatRegion {
  static constexpr int kCell = 8;  ///< pixels: regions are made of such squares

  Plane<double> plane_C;            ///< normal towards the camera
  int columns = 0, rows = 0;        ///< of cells
  std::vector<int> within;          ///< of a cell: 0 outside, else how many cells from the border
  std::vector<std::size_t> pixels;  ///< with depth, in the cells

  /// Points on the plane seen in the middle of cells at least so far from the border.
  std::vector<Vec3d> places(const DepthStreamInfo& stream, int from_border) const;
  /// As far from the border as any place is.
  int max_within() const;
};

/// The plane is the least-squares one in inverse depth, in which planes are linear and the noise of
/// triangulating cameras is alike everywhere; cells belong to it whose pixels are all measured and
/// within 0.8 % of it on average. nullopt: no flat region of a hundredth of the image.
std::optional<FlatRegion> largest_flat_region(const DepthStreamInfo& stream,
                                              const DepthFrame& frame);

}  // namespace palpate::eval
