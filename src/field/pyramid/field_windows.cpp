#include "src/field/pyramid/field_windows.h"

#include "src/field/pyramid/gap_rules.h"

namespace palpate { inline namespace v0 {
namespace {

/// Finds the pixels of a level that samples between `left` and `right`, pixels of level 0, read:
/// rounded to either side, with the neighbors for the spline. Samples at the border go on beyond
/// it.
void find_columns(int level, int image_size, int size, int left, int right, int& first, int& end) {
  const int last = size + kSilhouetteBorder;
  first = left <= 0 ? -kSilhouetteBorder : ((left - 1) >> level) - 1;
  end = 1 + (right >= image_size ? last : std::min(((right + 1) >> level) + 1, last));
}

PixelWindow finer(const PixelWindow& w) {
  return {2 * w.left, 2 * w.top, 2 * w.right, 2 * w.bottom};
}
/// The pixels of the next wider level that a pixel's hole is filled from.
PixelWindow around_wider(const PixelWindow& w) {
  return PixelWindow{w.left / 2, w.top / 2, (w.right + 1) / 2, (w.bottom + 1) / 2}.grown(1);
}

}  // namespace

FieldWindows field_windows(const PyramidLayout& layout, const DepthFieldOptions& options,
                           const PixelWindow& requested) {
  constexpr int kReach = DepthFieldLevel::kSilhouetteReach;
  const int num_filled = layout.num_filled(options);
  const auto inside = [&](const PixelWindow& window, int level) {
    const auto [width, height, first_row] = layout.levels[level];
    PixelWindow columns = window.aligned(std::max(FieldWindows::kColumnStep >> level, 1));
    columns.top = window.top;
    columns.bottom = window.bottom;
    return columns.clipped(width, height);
  };
  FieldWindows windows;
  const PyramidLayout::Level& image = layout.levels[0];
  for (int level = layout.num_levels - 1; level >= 0; --level) {
    const PyramidLayout::Level& here = layout.levels[level];
    PixelWindow& rims = windows.silhouettes[level];
    find_columns(level, image.width, here.width, requested.left, requested.right, rims.left,
                 rims.right);
    find_columns(level, image.height, here.height, requested.top, requested.bottom, rims.top,
                 rims.bottom);
    PixelWindow planes = rims.grown(kReach);
    if (level + 1 < layout.num_levels) planes = planes.joined(finer(windows.planes[level + 1]));
    windows.planes[level] = inside(planes, level);
  }
  windows.points = windows.filled[0] = windows.planes[0];
  for (int level = 1; level <= num_filled; ++level) {
    windows.filled[level] = inside(around_wider(windows.filled[level - 1]), level);
  }
  for (int level = num_filled; level >= 1; --level) {
    PixelWindow& nearest = windows.nearest[level];
    nearest = windows.filled[level];
    if (level < num_filled) {
      nearest = inside(nearest.joined(finer(windows.nearest[level + 1])), level);
    }
  }
  if (num_filled > 0) {
    windows.points = inside(windows.points.joined(finer(windows.nearest[1])), 0);
  }
  if (layout.fills_runs(options)) {
    windows.points = inside(windows.points.joined(windows.planes[0].grown(kMaxRun)), 0);
  }
  return windows;
}

}}  // namespace palpate::v0
