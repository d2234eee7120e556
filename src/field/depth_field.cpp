#include "palpate/field/depth_field.h"

#include <algorithm>
#include <vector>

#include "palpate/core/assert.h"
#include "palpate/core/stamp.h"
#include "src/field/field_rows.h"

namespace palpate {
namespace {

constexpr int kBorder = DepthFieldLevel::kBorder;

/// Calls `row(v)` for all rows of an image, in parallel.
template <class Row>
void for_rows(ThreadPool& pool, int height, const Row& row) {
  constexpr int kRowsPerTask = 16;
  pool.parallel_for((height + kRowsPerTask - 1) / kRowsPerTask, [&](int task) {
    const int end = std::min(height, (task + 1) * kRowsPerTask);
    for (int v = task * kRowsPerTask; v < end; ++v) row(v);
  });
}

}  // namespace

struct DepthField::Impl {
  DepthFieldOptions options;
  PyramidLayout layout;
  std::vector<TangentPlane> planes;           // of all levels
  std::vector<Silhouette> silhouettes;        // two a pixel, likewise
  std::vector<std::uint8_t> near_silhouette;  // likewise
  std::vector<float> found;                   // of `scratch`
  std::vector<std::uint8_t> has_any, has_edge, any_found;
  SilhouetteScratch scratch;
  FieldImage images[DepthFieldView::kMaxLevels];
  FieldRows rows;
  std::vector<char> row_has_hole;  // of level 0
  std::vector<DepthTile> tiles;
  DepthFieldView view;

  const FieldImage& image(int level) const { return images[level]; }
  void take_planes(const PointCloudView& cloud, ThreadPool& pool);
  void widen(int level, Choice choice, ThreadPool& pool);
  void fill_holes(ThreadPool& pool);
  void extend_border(int level) const;
  void find_silhouettes(const Intrinsics& k, int level, ThreadPool& pool);
  void find_tiles(ThreadPool& pool);
};

void DepthField::Impl::take_planes(const PointCloudView& cloud, ThreadPool& pool) {
  for_rows(pool, image(0).height, [&](int v) {
    row_has_hole[static_cast<std::size_t>(v)] = rows.take_planes(cloud, image(0), v);
  });
}

void DepthField::Impl::widen(int level, Choice choice, ThreadPool& pool) {
  const FieldImage &fine = image(level - 1), &coarse = image(level);
  for_rows(pool, coarse.height, [&](int v) { rows.widen(fine, level, choice, coarse, v); });
}

/// Closes holes from the outside in: the widest level that has to be asked is made first.
void DepthField::Impl::fill_holes(ThreadPool& pool) {
  if (std::find(row_has_hole.begin(), row_has_hole.end(), 1) == row_has_hole.end()) return;
  const int num_filled = layout.num_filled(options);
  for (int level = 1; level <= num_filled; ++level) widen(level, Choice::nearest, pool);
  for (int level = num_filled - 1; level >= 0; --level) {
    for_rows(pool, image(level).height, [&](int v) {
      if (level == 0 && !row_has_hole[static_cast<std::size_t>(v)]) return;
      rows.fill(image(level + 1), level + 1, image(level), v);
    });
  }
}

/// Around the image: nothing, or the surface of the outermost pixels going on.
void DepthField::Impl::extend_border(int level) const {
  const int w = image(level).width, h = image(level).height;
  for (int v = -kBorder; v < h + kBorder; ++v) {
    const bool inner_row = v >= 0 && v < h;
    TangentPlane* const row = image(level).row(v);
    const TangentPlane* const inner = image(level).row(std::clamp(v, 0, h - 1));
    for (int u = -kBorder; u < w + kBorder; u += inner_row && u == -1 ? w + 1 : 1) {
      row[u] =
          options.unknown == UnknownSpace::solid ? inner[std::clamp(u, 0, w - 1)] : TangentPlane{};
    }
  }
}

/// In all rows that queries look at, and as far beyond as that takes.
void DepthField::Impl::find_silhouettes(const Intrinsics& k, int level, ThreadPool& pool) {
  const FieldImage& of = image(level);
  const auto for_rows_beyond = [&](int beyond, const auto& row) {
    for_rows(pool, of.height + 2 * beyond + 1, [&](int v) { row(v - beyond); });
  };
  constexpr int kReach = DepthFieldLevel::kSilhouetteReach;
  for_rows_beyond(kSilhouetteBorder + kReach,
                  [&](int v) { rows.find_edges(k, of, level, v, scratch); });
  for_rows_beyond(kSilhouetteBorder + kReach,
                  [&](int v) { rows.find_in_row(k, of, level, v, scratch); });
  for_rows_beyond(kSilhouetteBorder,
                  [&](int v) { rows.find_silhouettes(k, of, level, v, scratch); });
  for_rows_beyond(kSilhouetteBorder - 1, [&](int v) { rows.mark_silhouettes(of, v, scratch); });
}

/// Wider pixels are means of those of level 0.
void DepthField::Impl::find_tiles(ThreadPool& pool) {
  pool.parallel_for(view.tiles_high, [&](int v) {
    rows.find_tiles(image(0), v, tiles.data() + static_cast<std::ptrdiff_t>(v) * view.tiles_wide);
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
  d.planes.resize(layout->num_planes());
  d.silhouettes.resize(2 * layout->num_pixels());
  d.near_silhouette.resize(layout->num_bytes());
  d.rows = field_rows(isa);
  constexpr int kSegment = SilhouetteScratch::kSegment;
  d.scratch.num_segments = (layout->stride + kSegment - 1) / kSegment;
  const auto num_segments = static_cast<std::size_t>(d.scratch.num_segments) *
                            static_cast<std::size_t>(height + 2 * kBorder);
  d.has_edge.resize(num_segments);
  d.any_found.resize(num_segments);
  d.has_any.resize(num_segments * kSegment);
  d.found.resize(6 * num_segments * kSegment);
  d.scratch.has_edge = d.has_edge.data();
  d.scratch.any_found = d.any_found.data();
  d.scratch.has_any = d.has_any.data();
  for (std::size_t i = 0; i < 6; ++i) {
    d.scratch.found[i] = d.found.data() + i * num_segments * kSegment;
  }
  for (int level = 0; level < layout->num_levels; ++level) {
    const std::ptrdiff_t origin = layout->origin(level);
    d.images[level] = {d.planes.data() + origin,          d.silhouettes.data() + 2 * origin,
                       d.near_silhouette.data() + origin, layout->levels[level].width,
                       layout->levels[level].height,      layout->stride};
  }
  d.row_has_hole.resize(static_cast<std::size_t>(height));
  d.tiles.resize(layout->num_tiles());
  d.view = layout->view(d.planes.data(), d.silhouettes.data(), d.near_silhouette.data(),
                        d.tiles.data(), options);
  d.view.num_levels = 0;
  return DepthField(std::move(impl));
}

DepthField::DepthField(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DepthField::DepthField(DepthField&&) noexcept = default;
DepthField& DepthField::operator=(DepthField&&) noexcept = default;
DepthField::~DepthField() = default;

void DepthField::update(const PointCloudView& cloud, ThreadPool& pool) {
  Impl& d = *impl_;
  PALPATE_ASSERT(cloud.pinhole && cloud.width == d.image(0).width &&
                 cloud.height == d.image(0).height);
  d.take_planes(cloud, pool);
  d.fill_holes(pool);
  d.view.num_levels = d.layout.num_levels;
  d.view.intrinsics = cloud.intrinsics;
  d.find_tiles(pool);
  for (int level = 0; level < d.view.num_levels; ++level) {
    if (level > 0) d.widen(level, Choice::majority, pool);
    d.extend_border(level);
    d.find_silhouettes(cloud.intrinsics, level, pool);
  }
  d.view.stamp = next_stamp();
}

const DepthFieldView& DepthField::view() const { return impl_->view; }

}  // namespace palpate
