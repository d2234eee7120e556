// The depth field made on a GPU, with the same bits as DepthField.
#pragma once

#include <cstdint>
#include <utility>

#include "palpate/cloud/point_cloud.h"
#include "palpate/field/depth_field.h"
#include "src/field/field_pyramid.h"
#include "src/gpu/runtime.h"

namespace palpate {

/// What the kernels of a field work on; arrays on the GPU.
struct FieldJob {
  PyramidLayout layout;
  int num_filled = 0;    ///< over so many levels holes are filled
  bool goes_on = false;  ///< beyond the image: the surface of its outermost pixels, not nothing
  TangentPlane* planes = nullptr;   ///< of all levels
  TangentPlane* nearest = nullptr;  ///< likewise, from level 1 on: Choice::nearest, for filling
  Silhouette* silhouettes = nullptr;
  std::uint8_t* near_silhouette = nullptr;
  DepthTile* tiles = nullptr;
  int* has_hole = nullptr;  ///< of each block's square of level 0
  int squares_wide = 0, squares_high = 0;
  /// The first block that looks for silhouettes in a level; the last entry is their number.
  int first_rim_block[DepthFieldView::kMaxLevels + 1] = {};
};

/// Owns the images on the GPU.
class DepthFieldCuda {
 public:
  /// Errors: as DepthField::create; too little memory on the GPU.
  static Result<DepthFieldCuda> create(int width, int height, const DepthFieldOptions& options,
                                       int gpu);

  /// Rebuilds the field from an organised pinhole cloud in the memory of this GPU, of the size
  /// given at construction. Three kernels, no allocation; can be recorded.
  void enqueue(const PointCloudView& cloud, gpu::Stream& stream);

  /// Arrays on the GPU, with the values of the last enqueued update that is done; no levels before
  /// the first one.
  const DepthFieldView& view() const { return view_; }

 private:
  DepthFieldCuda(gpu::Memory memory, const FieldJob& job, const DepthFieldOptions& options)
      : memory_(std::move(memory)), job_(job), options_(options) {}

  gpu::Memory memory_;
  FieldJob job_;
  DepthFieldOptions options_;
  DepthFieldView view_;
};

}  // namespace palpate
