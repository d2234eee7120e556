// The loops over the rows of a depth field, for a CPU. Rows do not depend on each other, so any
// number of threads gives the same bits, and so does every instruction set.
#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "src/field/pyramid/field_pyramid.h"

namespace palpate { inline namespace v0 {

/// The arrays of one level.
struct FieldImage {
  TangentPlane* planes = nullptr;  ///< pixel (0, 0)
  float* shares = nullptr;  ///< SharedPixel::share, likewise; 1 in level 0 and beyond the image
  Silhouette* silhouettes = nullptr;
  std::uint8_t* near_silhouette = nullptr;
  int width = 0, height = 0;
  std::ptrdiff_t stride = 0;

  TangentPlane* row(int v) const { return planes + v * stride; }
  float* share_row(int v) const { return shares + v * stride; }
};

/// Scratch of the search for a level's silhouettes; the memory serves all levels. Rows are cut into
/// segments of kSegment pixels, the first of which begins at the border.
struct SilhouetteScratch {
  static constexpr int kSegment = 16, kBorder = DepthFieldLevel::kBorder;

  /// Nearest silhouettes of each pixel's own row, as an exit and as an occluder: columns to there
  /// (0: none), offset and slope of the other surface.
  float* found[6] = {};
  std::uint8_t* has_any = nullptr;  ///< per pixel: some silhouette is near
  /// Per segment, a bit for each pixel: a surface ends between it and the next one to the right, or
  /// the one below. Each of these edges is looked at by all pixels within reach.
  std::uint16_t *edges_right = nullptr, *edges_down = nullptr;
  std::uint8_t* any_found = nullptr;  ///< per segment: has_any anywhere
  int num_segments = 0;               ///< in a row

  std::ptrdiff_t stride() const { return std::ptrdiff_t{num_segments} * kSegment; }
  std::ptrdiff_t segment(int v, int number) const {
    return std::ptrdiff_t{v + kBorder} * num_segments + number;
  }
  std::ptrdiff_t pixel(int v, int number) const { return segment(v, number) * kSegment; }
  /// True if a surface ends in a segment or beside it.
  bool is_active(int v, int number) const {
    return is_around(edges_right, v, number) || is_around(edges_down, v, number);
  }
  /// True if some silhouette is near in a segment or beside it.
  bool has_found(int v, int number) const { return is_around(any_found, v, number); }

 private:
  template <class Bits>
  bool is_around(const Bits* segments, int v, int number) const {
    const Bits* const at = segments + segment(v, number);
    return at[0] != 0 || (number > 0 && at[-1] != 0) || (number + 1 < num_segments && at[1] != 0);
  }
};

/// Each function does row v of the image named last, in the columns of a window (field_windows.h).
struct FieldRows {
  /// Level 0: the tangent plane of every point.
  void (*take_planes)(const PointCloudView& cloud, const FieldImage& image,
                      const PixelWindow& window, int v);
  /// Sets the bits of the pixels without surface, 64 to a word. True if there is one.
  bool (*find_holes)(const FieldImage& image, const PixelWindow& window, int v,
                     std::uint64_t* holes);
  /// Computes a level from the one before, a pixel of two by two; shares are of Choice::majority.
  void (*widen)(const FieldImage& fine, int level, Choice choice, const FieldImage& coarse,
                const PixelWindow& window, int v);
  /// Fills the pixels without surface from the next wider level, `level`.
  void (*fill)(const FieldImage& coarse, int level, const FieldImage& fine,
               const PixelWindow& window, int v);
  /// Finds the segments of a row in which surfaces end, towards the right or the next row; also in
  /// the segments beside the window.
  void (*find_edges)(const Intrinsics& k, const FieldImage& image, int level,
                     const PixelWindow& window, int v, const SilhouetteScratch& scratch);
  /// Finds SilhouetteScratch::found of a row.
  void (*find_in_row)(const Intrinsics& k, const FieldImage& image, int level,
                      const PixelWindow& window, int v, const SilhouetteScratch& scratch);
  /// Finds the silhouettes of a row, from those found in the rows around it.
  void (*find_silhouettes)(const Intrinsics& k, const FieldImage& image, int level,
                           const PixelWindow& window, int v, const SilhouetteScratch& scratch);
  /// Sets FieldImage::near_silhouette of a row.
  void (*mark_silhouettes)(const FieldImage& image, const PixelWindow& window, int v,
                           const SilhouetteScratch& scratch);
  /// Finds the nearest surface in each tile of the row of tiles v of level 0; a tile that is not
  /// wholly inside the window is unknown.
  void (*find_tiles)(const FieldImage& image, const PixelWindow& window, int v, DepthTile* tiles);
};
/// An instruction set that the processor lacks is lowered.
FieldRows field_rows(Isa isa);

}}  // namespace palpate::v0
