// The places of a depth field's levels in memory, the same on CPU and GPU.
#pragma once

#include <cstddef>
#include <cstdint>

#include "palpate/core/core.h"
#include "src/field/pyramid/field_pixels.h"

namespace palpate { inline namespace v0 {

/// Distance beyond the image up to which silhouettes are found, pixels.
inline constexpr int kSilhouetteBorder = static_cast<int>(-DepthFieldLevel::kFirst);
static_assert(kSilhouetteBorder + DepthFieldLevel::kSilhouetteReach + 2 <=
              DepthFieldLevel::kBorder);

/// Layout of a field's levels: all of one stride, one below the other, each with its border.
struct PyramidLayout {
  struct Level {
    int width = 0, height = 0;
    int first_row = 0;  ///< of its border
  };
  Level levels[DepthFieldView::kMaxLevels];
  int num_levels = 0;
  int stride = 0;
  int num_rows = 0;

  std::size_t num_pixels() const {
    return static_cast<std::size_t>(num_rows) * static_cast<std::size_t>(stride);
  }
  /// Index of pixel (0, 0) of a level.
  PALPATE_HOSTDEV std::ptrdiff_t origin(int level) const {
    return static_cast<std::ptrdiff_t>(levels[level].first_row + DepthFieldLevel::kBorder) *
               stride +
           DepthFieldLevel::kBorder;
  }
  // Room for vectors that read past the end, and for bytes read four at a time.
  std::size_t num_planes() const { return num_pixels() + 32; }
  std::size_t num_bytes() const { return num_pixels() + 3; }
  PALPATE_HOSTDEV int tiles_wide() const { return tiles_over(levels[0].width); }
  PALPATE_HOSTDEV int tiles_high() const { return tiles_over(levels[0].height); }
  std::size_t num_tiles() const {
    return static_cast<std::size_t>(tiles_wide()) * static_cast<std::size_t>(tiles_high());
  }
  /// Returns the levels as queries read them; the arrays may be on the CPU or on a GPU.
  DepthFieldView view(const TangentPlane* planes, const Silhouette* silhouettes,
                      const std::uint8_t* near_silhouette, const DepthTile* tiles,
                      const DepthFieldOptions& options) const;
  /// Number of pixels around the image that show its outermost surface.
  static int going_on(const DepthFieldOptions& options) {
    return options.unknown == UnknownSpace::free ? DepthFieldLevel::kGoesOn : 0;
  }
  /// Number of levels over which holes are filled.
  int num_filled(const DepthFieldOptions& options) const;
  /// True if surfaces go on behind others where nothing was measured (gap_rules.h). Blocked space
  /// is not known to be free there.
  bool fills_runs(const DepthFieldOptions& options) const {
    return num_filled(options) > 0 && options.unknown != UnknownSpace::blocked;
  }

 private:
  PALPATE_HOSTDEV static int tiles_over(int size) {
    return (size + DepthFieldView::kTileSize - 1) / DepthFieldView::kTileSize;
  }
};

/// Errors: as DepthField::create.
Result<PyramidLayout> pyramid_layout(int width, int height, const DepthFieldOptions& options);

}}  // namespace palpate::v0
