// The pixels of each level of a depth field that queries in a window of the image need.
#pragma once

#include "src/field/pyramid/field_pyramid.h"

namespace palpate { inline namespace v0 {

/// Windows of level k, in its own pixels. Columns of level 0 begin and end at multiples of
/// kColumnStep or at the end of the image. Those of silhouettes reach beyond the image, all others
/// are inside of it.
struct FieldWindows {
  static constexpr int kColumnStep = 16;

  /// Pixels that have silhouettes.
  PixelWindow silhouettes[DepthFieldView::kMaxLevels];
  /// Planes, of which level 0 has no holes.
  PixelWindow planes[DepthFieldView::kMaxLevels];
  /// Planes by Choice::nearest, from which holes are filled, and where they are filled themselves.
  PixelWindow nearest[DepthFieldView::kMaxLevels], filled[DepthFieldView::kMaxLevels];
  /// The points of the cloud that all this is made from.
  PixelWindow points;
};

/// `requested` as PixelWindow at(...): at least one pixel, inside of the image.
FieldWindows field_windows(const PyramidLayout& layout, const DepthFieldOptions& options,
                           const PixelWindow& requested);

}}  // namespace palpate::v0
