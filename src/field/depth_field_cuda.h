// The depth field made on a GPU, with the same bits as DepthField.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>

#include "palpate/cloud/point_cloud.h"
#include "palpate/field/depth_field.h"
#include "src/field/pyramid/field_pyramid.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// The arrays of one field on the GPU.
struct FieldArrays {
  TangentPlane* planes = nullptr;  ///< of all levels
  /// Likewise, for filling: of level 0 with the runs of rows filled, from level 1 on by
  /// Choice::nearest.
  TangentPlane* nearest = nullptr;
  Silhouette* silhouettes = nullptr;
  float* shares = nullptr;  ///< SharedPixel::share of all levels but level 0, likewise
  std::uint8_t* near_silhouette = nullptr;
  DepthTile* tiles = nullptr;
};

/// The tiles of a level in which a block looks for silhouettes, and the block's shared memory
/// (RimMemory).
struct RimTiling {
  int wide = 0, high = 0;  ///< pixels, with the level's border
  int num_planes = 0;
  int num_rows = 0, num_words = 0;
  std::size_t shared_bytes = 0;
};

/// Arguments of the kernels for some fields.
struct FieldJob {
  PyramidLayout layout;
  int num_filled = 0;              ///< number of levels over which holes are filled
  bool fills_runs = false;         ///< see PyramidLayout
  float width_u = 0, width_v = 0;  ///< of a pixel of level 0, over the focal lengths
  UnknownSpace unknown = UnknownSpace::free;
  int going_on = 0;                                  ///< see PyramidLayout
  FieldArrays arrays;                                ///< of the first field
  std::ptrdiff_t pixels_apart = 0, tiles_apart = 0;  ///< from one field to the next
  std::ptrdiff_t points_apart = 0;                   ///< from one image's points to the next
  const TangentPlane* given = nullptr;  ///< planes of all points, if they are not the cloud's
  int* has_hole = nullptr;              ///< of each block's square of level 0, field after field
  /// DepthFieldView::filled_behind: a word for each row of a square. Null: of many fields.
  std::uint32_t* filled = nullptr;
  int squares_wide = 0, squares_high = 0;
  RimTiling rims[DepthFieldView::kMaxLevels];
  int num_large_rims = 0;  ///< levels whose tiles are for large blocks
  /// The first block that looks for silhouettes in a level; the last entry is their number.
  int first_rim_block[DepthFieldView::kMaxLevels + 1] = {};

  PALPATE_HOSTDEV int num_squares() const { return squares_wide * squares_high; }
  /// Arrays of field `number`; those that fill holes are shared by some fields at a time.
  PALPATE_HOSTDEV FieldArrays arrays_of(int number) const {
    const std::ptrdiff_t pixels = number * pixels_apart;
    return {arrays.planes + pixels,          arrays.nearest + pixels,
            arrays.silhouettes + 2 * pixels, arrays.shares + pixels,
            arrays.near_silhouette + pixels, arrays.tiles + number * tiles_apart};
  }
};

/// Owns the images on the GPU.
class DepthFieldCuda {
 public:
  /// Room for `num_fields`, of which `num_at_once` are made by one `enqueue`. Errors: as
  /// DepthField::create; too little memory on the GPU.
  static Result<DepthFieldCuda> create(int width, int height, const DepthFieldOptions& options,
                                       int gpu, int num_fields = 1, int num_at_once = 1);

  /// Rebuilds the field from an organized pinhole cloud in the memory of this GPU, of the size
  /// given at construction. At most four kernels, no allocation; can be recorded.
  void enqueue(const PointCloudView& cloud, gpu::Stream& stream);
  /// The same from the planes of all points of a camera, row by row.
  void enqueue(const TangentPlane* planes, const PointCloudView& camera, gpu::Stream& stream);
  /// The same of `num` images, `points_apart` planes from one to the next, into the fields from
  /// `first` on.
  void enqueue(const TangentPlane* planes, std::ptrdiff_t points_apart,
               const PointCloudView& camera, int first, int num, gpu::Stream& stream);

  /// View of the first field: arrays on the GPU, with the values of the last enqueued update that
  /// is done; no levels before the first one.
  const DepthFieldView& view() const { return view_; }
  /// Distance from one field to the next.
  std::ptrdiff_t pixels_apart() const { return job_.pixels_apart; }
  std::ptrdiff_t tiles_apart() const { return job_.tiles_apart; }
  /// Memory that one field takes on the GPU.
  static std::size_t num_bytes(const PyramidLayout& layout);

 private:
  void enqueue(FieldJob job, const PointCloudView& cloud, int num, gpu::Stream& stream);
  DepthFieldCuda(gpu::Memory memory, const FieldJob& job, const DepthFieldOptions& options)
      : memory_(std::move(memory)), job_(job), options_(options) {}

  gpu::Memory memory_;
  FieldJob job_;
  DepthFieldOptions options_;
  DepthFieldView view_;
};

}}  // namespace palpate::v0
