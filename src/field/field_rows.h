// The loops over the rows of a depth field, for a CPU. Rows do not depend on each other, so any
// number of threads gives the same bits, and so does every instruction set.
#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/isa.h"
#include "src/field/field_pyramid.h"

namespace palpate {

/// One level.
struct FieldImage {
  TangentPlane* planes = nullptr;  ///< pixel (0, 0)
  std::uint8_t* is_step = nullptr;
  int width = 0, height = 0;
  std::ptrdiff_t stride = 0;

  TangentPlane* row(int v) const { return planes + v * stride; }
};

/// Each does row v of the image named last.
struct FieldRows {
  /// Level 0: the tangent plane of every point. True if there is none in a pixel.
  bool (*take_planes)(const PointCloudView& cloud, const FieldImage& image, int v);
  /// A level from the one before: one pixel of two by two.
  void (*widen)(const FieldImage& fine, int level, Choice choice, const FieldImage& coarse, int v);
  /// Gives the pixels without surface what the next wider level, `level`, knows there.
  void (*fill)(const FieldImage& coarse, int level, const FieldImage& fine, int v);
  /// Where the nine planes around a pixel do not belong to one smooth surface.
  void (*find_steps)(float limit, const FieldImage& image, int v);
  /// What is nearest in each tile of the row of tiles v, of level 0.
  void (*find_tiles)(const FieldImage& image, int v, DepthTile* tiles);
};
/// An instruction set that the processor lacks is lowered.
FieldRows field_rows(Isa isa);

}  // namespace palpate
