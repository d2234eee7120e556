#include "palpate/field/depth_field.h"

#include <algorithm>
#include <vector>

#include "src/core/internal/assert.h"
#include "src/core/internal/for_rows.h"
#include "src/core/internal/stamp.h"
#include "src/field/pyramid/field_rows.h"
#include "src/field/pyramid/field_windows.h"
#include "src/field/pyramid/gap_rules.h"
#include "src/field/pyramid/hole_runs.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kBorder = DepthFieldLevel::kBorder;

}  // namespace

struct DepthField::Impl {
  DepthFieldOptions options;
  PyramidLayout layout;
  std::vector<TangentPlane> planes;           // of all levels
  std::vector<float> shares;                  // likewise
  std::vector<Silhouette> silhouettes;        // two a pixel, likewise
  std::vector<std::uint8_t> near_silhouette;  // likewise
  std::vector<float> found;                   // of `scratch`
  std::vector<std::uint8_t> has_any, any_found;
  std::vector<std::uint16_t> edges_right, edges_down;
  SilhouetteScratch scratch;
  FieldImage images[DepthFieldView::kMaxLevels];
  FieldRows rows;
  std::vector<char> row_has_hole;  // of level 0, likewise
  HoleRuns runs{0, 0};
  std::vector<DepthTile> tiles;
  DepthFieldView view;

  const FieldImage& image(int level) const { return images[level]; }
  FieldWindows windows_for(const PixelWindow& requested) const {
    return field_windows(layout, options, requested.clipped(image(0).width, image(0).height));
  }
  /// take(window, v) fills a row of level 0.
  template <class Take>
  void make(const Intrinsics& k, const PixelWindow& requested, ThreadPool& pool, const Take& take);
  void widen(int level, Choice choice, const PixelWindow& window, ThreadPool& pool);
  void fill_holes(const Intrinsics& k, const FieldWindows& windows, ThreadPool& pool);
  void fill_runs(const Intrinsics& k, const PixelWindow& window, ThreadPool& pool);
  void block_holes(const PixelWindow& window, ThreadPool& pool);
  void let_surfaces_go_on(int level, const PixelWindow& window) const;
  void join_border(int level, const PixelWindow& window);
  void extend_border(int level, const PixelWindow& window);
  void find_silhouettes(const Intrinsics& k, int level, const PixelWindow& window,
                        ThreadPool& pool);
  void find_tiles(const PixelWindow& window, ThreadPool& pool);
};

void DepthField::Impl::widen(int level, Choice choice, const PixelWindow& window,
                             ThreadPool& pool) {
  const FieldImage &fine = image(level - 1), &coarse = image(level);
  for_rows(pool, window.top, window.bottom,
           [&](int v) { rows.widen(fine, level, choice, coarse, window, v); });
}

/// Fills runs between separate surfaces: in rows, then those that are left in columns.
void DepthField::Impl::fill_runs(const Intrinsics& k, const PixelWindow& window, ThreadPool& pool) {
  for_rows(pool, window.top, window.bottom, [&](int v) {
    if (row_has_hole[static_cast<std::size_t>(v)]) runs.fill_row(k, image(0), window, v);
  });
  pool.parallel_for(runs.words_in_row(),
                    [&](int number) { runs.fill_columns(k, image(0), window, number); });
}

/// Closes holes from the outside in, beginning with the widest level that is needed, which is made
/// of the measured pixels.
void DepthField::Impl::fill_holes(const Intrinsics& k, const FieldWindows& windows,
                                  ThreadPool& pool) {
  if (std::find(row_has_hole.begin(), row_has_hole.end(), 1) == row_has_hole.end()) return;
  const int num_filled = layout.num_filled(options);
  for (int level = 1; level <= num_filled; ++level) {
    widen(level, Choice::nearest, windows.nearest[level], pool);
  }
  if (layout.fills_runs(options)) fill_runs(k, windows.points, pool);
  for (int level = num_filled - 1; level >= 0; --level) {
    const PixelWindow& window = windows.filled[level];
    for_rows(pool, window.top, window.bottom, [&](int v) {
      if (level == 0 && !row_has_hole[static_cast<std::size_t>(v)]) return;
      rows.fill(image(level + 1), level + 1, image(level), window, v);
    });
  }
}

/// Blocks the holes that could not be filled.
void DepthField::Impl::block_holes(const PixelWindow& window, ThreadPool& pool) {
  if (options.unknown != UnknownSpace::blocked) return;
  for_rows(pool, window.top, window.bottom, [&](int v) {
    if (!row_has_hole[static_cast<std::size_t>(v)]) return;
    TangentPlane* const row = image(0).row(v);
    for (int u = window.left; u < window.right; ++u) row[u] = completed(row[u], options.unknown);
  });
}

/// Continues the outermost surfaces around the image for a few pixels, to the left and right of the
/// rows of a window, then above and below.
void DepthField::Impl::let_surfaces_go_on(int level, const PixelWindow& window) const {
  const FieldImage& of = image(level);
  const auto from = [&](TangentPlane* last, std::ptrdiff_t step) {
    const GoingOn surface({last[0], last[-step], last[-2 * step], last[-3 * step]}, level);
    for (int i = 1; i <= DepthFieldLevel::kGoesOn; ++i) last[i * step] = surface.at(i);
  };
  for (int v = window.top; v < window.bottom; ++v) {
    from(of.row(v), -1);
    from(of.row(v) + of.width - 1, 1);
  }
  for (int u = window.left - DepthFieldLevel::kGoesOn; u < window.right + DepthFieldLevel::kGoesOn;
       ++u) {
    from(of.row(0) + u, -of.stride);
    from(of.row(of.height - 1) + u, of.stride);
  }
}

/// Joins what lies beyond the image into the tiles at its border. The outermost pixels bound those
/// between them and the image, which change evenly. A tile whose pixels of this level are not all
/// inside the window becomes unknown.
void DepthField::Impl::join_border(int level, const PixelWindow& window) {
  constexpr int kSize = DepthFieldView::kTileSize, kGoesOn = DepthFieldLevel::kGoesOn;
  const FieldImage& of = image(level);
  const int last_u = view.tiles_wide - 1, last_v = view.tiles_high - 1;
  for (int v = 0; v <= last_v; ++v) {
    const bool is_inner = v > 0 && v < last_v;
    for (int u = 0; u <= last_u; u += is_inner && u < last_u ? last_u : 1) {
      DepthTile& tile = tiles[static_cast<std::size_t>(v * view.tiles_wide + u)];
      PixelWindow at{u * kSize >> level, v * kSize >> level, (((u + 1) * kSize - 1) >> level) + 1,
                     (((v + 1) * kSize - 1) >> level) + 1};
      at = at.clipped(of.width, of.height);
      if (!window.contains(at)) tile = unknown_tile<DepthTile>();
      if (u == 0) at.left = -kGoesOn;
      if (v == 0) at.top = -kGoesOn;
      if (u == last_u) at.right = of.width + kGoesOn;
      if (v == last_v) at.bottom = of.height + kGoesOn;
      const auto take = [&](int column, int row) {
        tile = join(tile, tile_of<DepthTile>(of.row(row)[column]));
      };
      for (int row = at.top; row < at.bottom; ++row) {
        if (u == 0) take(at.left, row);
        if (u == last_u) take(at.right - 1, row);
      }
      for (int column = at.left; column < at.right; ++column) {
        if (v == 0) take(column, at.top);
        if (v == last_v) take(column, at.bottom - 1);
      }
    }
  }
}

/// Fills the border around the image, as far as it changes from frame to frame.
void DepthField::Impl::extend_border(int level, const PixelWindow& window) {
  if (PyramidLayout::going_on(options) > 0) {
    let_surfaces_go_on(level, window);
    join_border(level, window);
  }
  if (options.unknown != UnknownSpace::solid) return;
  const int w = image(level).width, h = image(level).height;
  for (int v = -kBorder; v < h + kBorder; ++v) {
    const bool inner_row = v >= 0 && v < h;
    TangentPlane* const row = image(level).row(v);
    const TangentPlane* const inner = image(level).row(std::clamp(v, 0, h - 1));
    for (int u = -kBorder; u < w + kBorder; u += inner_row && u == -1 ? w + 1 : 1) {
      row[u] = inner[std::clamp(u, 0, w - 1)];
    }
  }
}

/// Processes all rows that queries read, and those around them that this takes.
void DepthField::Impl::find_silhouettes(const Intrinsics& k, int level, const PixelWindow& window,
                                        ThreadPool& pool) {
  const FieldImage& of = image(level);
  const auto for_rows_beyond = [&](int beyond, const auto& row) {
    for_rows(pool, window.top - beyond, window.bottom + beyond, row);
  };
  constexpr int kReach = DepthFieldLevel::kSilhouetteReach;
  for_rows_beyond(kReach, [&](int v) { rows.find_edges(k, of, level, window, v, scratch); });
  for_rows_beyond(kReach, [&](int v) { rows.find_in_row(k, of, level, window, v, scratch); });
  for_rows_beyond(0, [&](int v) { rows.find_silhouettes(k, of, level, window, v, scratch); });
  for_rows_beyond(-1, [&](int v) { rows.mark_silhouettes(of, window, v, scratch); });
}

/// Level 0 is enough: wider pixels are means of its pixels.
void DepthField::Impl::find_tiles(const PixelWindow& window, ThreadPool& pool) {
  for_rows(pool, 0, view.tiles_high, [&](int v) {
    rows.find_tiles(image(0), window, v,
                    tiles.data() + static_cast<std::ptrdiff_t>(v) * view.tiles_wide);
  });
}

Result<DepthField> DepthField::create(int width, int height, const DepthFieldOptions& options,
                                      Isa isa) {
  const auto layout = pyramid_layout(width, height, options);
  if (!layout) return layout.error();
  auto impl = std::make_unique<Impl>();
  Impl& d = *impl;
  d.options = options;
  d.layout = *layout;
  d.planes.resize(layout->num_planes(), completed({}, options.unknown));
  d.shares.resize(layout->num_planes(), 1);
  d.silhouettes.resize(2 * layout->num_pixels());
  d.near_silhouette.resize(layout->num_bytes());
  d.rows = field_rows(isa);
  constexpr int kSegment = SilhouetteScratch::kSegment;
  d.scratch.num_segments = (layout->stride + kSegment - 1) / kSegment;
  const auto num_segments = static_cast<std::size_t>(d.scratch.num_segments) *
                            static_cast<std::size_t>(height + 2 * kBorder);
  d.edges_right.resize(num_segments);
  d.edges_down.resize(num_segments);
  d.any_found.resize(num_segments);
  d.has_any.resize(num_segments * kSegment);
  d.found.resize(6 * num_segments * kSegment);
  d.scratch.edges_right = d.edges_right.data();
  d.scratch.edges_down = d.edges_down.data();
  d.scratch.any_found = d.any_found.data();
  d.scratch.has_any = d.has_any.data();
  for (std::size_t i = 0; i < 6; ++i) {
    d.scratch.found[i] = d.found.data() + i * num_segments * kSegment;
  }
  for (int level = 0; level < layout->num_levels; ++level) {
    const std::ptrdiff_t origin = layout->origin(level);
    d.images[level] = {d.planes.data() + origin,
                       d.shares.data() + origin,
                       d.silhouettes.data() + 2 * origin,
                       d.near_silhouette.data() + origin,
                       layout->levels[level].width,
                       layout->levels[level].height,
                       layout->stride};
  }
  d.row_has_hole.resize(static_cast<std::size_t>(height));
  d.runs = HoleRuns(width, height);
  d.tiles.resize(layout->num_tiles());
  d.view = layout->view(d.planes.data(), d.silhouettes.data(), d.near_silhouette.data(),
                        d.tiles.data(), options);
  d.view.num_levels = 0;
  d.view.filled_behind = d.runs.filled();
  d.view.filled_stride = 2 * d.runs.words_in_row();
  return DepthField(std::move(impl));
}

DepthField::DepthField(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DepthField::DepthField(DepthField&&) noexcept = default;
DepthField& DepthField::operator=(DepthField&&) noexcept = default;
DepthField::~DepthField() = default;

template <class Take>
void DepthField::Impl::make(const Intrinsics& k, const PixelWindow& requested, ThreadPool& pool,
                            const Take& take) {
  view.num_levels = layout.num_levels;
  view.intrinsics = k;
  view.requested = requested.clipped(image(0).width, image(0).height);
  const FieldWindows windows = windows_for(requested);
  std::fill(row_has_hole.begin(), row_has_hole.end(), 0);
  runs.clear();
  for_rows(pool, windows.points.top, windows.points.bottom, [&](int v) {
    take(windows.points, v);
    row_has_hole[static_cast<std::size_t>(v)] =
        rows.find_holes(image(0), windows.points, v, runs.missing(v));
  });
  fill_holes(k, windows, pool);
  block_holes(windows.planes[0], pool);
  find_tiles(windows.planes[0], pool);
  for (int level = 0; level < view.num_levels; ++level) {
    if (level > 0) widen(level, Choice::majority, windows.planes[level], pool);
    extend_border(level, windows.planes[level]);
    find_silhouettes(k, level, windows.silhouettes[level], pool);
  }
  view.stamp = next_stamp();
}

void DepthField::update(const PointCloudView& cloud, ThreadPool& pool,
                        const PixelWindow& requested) {
  Impl& d = *impl_;
  PALPATE_ASSERT(cloud.pinhole && cloud.width == d.image(0).width &&
                 cloud.height == d.image(0).height);
  d.make(cloud.intrinsics, requested, pool, [&](const PixelWindow& window, int v) {
    d.rows.take_planes(cloud, d.image(0), window, v);
  });
  d.view.noise = cloud.noise;
}

void DepthField::update(const TangentPlane* planes, const Intrinsics& intrinsics, ThreadPool& pool,
                        const PixelWindow& requested) {
  Impl& d = *impl_;
  d.make(intrinsics, requested, pool, [&](const PixelWindow& window, int v) {
    const TangentPlane* const from = planes + std::ptrdiff_t{v} * d.image(0).width;
    std::copy(from + window.left, from + window.right, d.image(0).row(v) + window.left);
  });
}

PixelWindow DepthField::points_for(const PixelWindow& requested) const {
  return impl_->windows_for(requested).points;
}

const DepthFieldView& DepthField::view() const { return impl_->view; }

}}  // namespace palpate::v0
