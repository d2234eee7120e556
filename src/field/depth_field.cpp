#include "palpate/field/depth_field.h"

#include <algorithm>
#include <vector>

#include "palpate/core/stamp.h"
#include "src/field/field_pyramid.h"

namespace palpate {
namespace {

constexpr int kBorder = DepthFieldLevel::kBorder;

/// One level.
class Image {
 public:
  /// Of arrays for all levels.
  Image(const PyramidLayout& layout, int level, TangentPlane* planes, std::uint8_t* is_step)
      : width_(layout.levels[level].width),
        height_(layout.levels[level].height),
        stride_(layout.stride),
        planes_(planes + layout.origin(level)),
        is_step_(is_step + layout.origin(level)) {}

  int width() const { return width_; }
  int height() const { return height_; }
  const TangentPlane& at(int u, int v) const { return planes_[index(u, v)]; }
  TangentPlane& at(int u, int v) { return planes_[index(u, v)]; }
  std::uint8_t& is_step(int u, int v) { return is_step_[index(u, v)]; }

 private:
  std::ptrdiff_t index(int u, int v) const { return static_cast<std::ptrdiff_t>(v) * stride_ + u; }

  int width_, height_, stride_;
  TangentPlane* planes_;
  std::uint8_t* is_step_;
};

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
  std::vector<TangentPlane> planes;  // of all levels
  std::vector<std::uint8_t> steps;   // likewise
  std::vector<Image> images;
  std::vector<char> row_has_hole;  // of level 0
  std::vector<DepthTile> tiles;
  DepthFieldView view;

  void take_planes(const PointCloudView& cloud, ThreadPool& pool);
  void widen(int level, Choice choice, ThreadPool& pool);
  void fill_holes(ThreadPool& pool);
  void fill_level(int level, ThreadPool& pool);
  void extend_border(Image& image) const;
  void find_steps(int level, ThreadPool& pool);
  void find_tiles(ThreadPool& pool);
};

/// Level 0: the tangent plane of every point.
void DepthField::Impl::take_planes(const PointCloudView& cloud, ThreadPool& pool) {
  Image& image = images[0];
  for_rows(pool, image.height(), [&](int v) {
    char has_hole = 0;
    for (int u = 0; u < image.width(); ++u) {
      const std::size_t i = static_cast<std::size_t>(v) * static_cast<std::size_t>(cloud.width) +
                            static_cast<std::size_t>(u);
      if (!(cloud.z[i] > 0)) {
        image.at(u, v) = {};
        has_hole = 1;
        continue;
      }
      image.at(u, v) =
          tangent_plane(cloud.x[i], cloud.y[i], cloud.z[i], cloud.nx[i], cloud.ny[i], cloud.nz[i]);
    }
    row_has_hole[static_cast<std::size_t>(v)] = has_hole;
  });
}

/// Makes a level from the one before: one pixel of two by two.
void DepthField::Impl::widen(int level, Choice choice, ThreadPool& pool) {
  const Image& fine = images[static_cast<std::size_t>(level - 1)];
  Image& coarse = images[static_cast<std::size_t>(level)];
  for_rows(pool, coarse.height(), [&](int v) {
    const int v0 = 2 * v, v1 = std::min(2 * v + 1, fine.height() - 1);
    for (int u = 0; u < coarse.width(); ++u) {
      const int u0 = 2 * u, u1 = std::min(2 * u + 1, fine.width() - 1);
      const TangentPlane four[4] = {fine.at(u0, v0), fine.at(u1, v0), fine.at(u0, v1),
                                    fine.at(u1, v1)};
      coarse.at(u, v) = widened(four, level, choice);
    }
  });
}

/// Gives the pixels without surface what the next wider level knows there.
void DepthField::Impl::fill_level(int level, ThreadPool& pool) {
  Image& fine = images[static_cast<std::size_t>(level)];
  const Image& coarse = images[static_cast<std::size_t>(level + 1)];
  for_rows(pool, fine.height(), [&](int v) {
    if (level == 0 && !row_has_hole[static_cast<std::size_t>(v)]) return;
    const int v0 = v / 2, v1 = second_nearest(v, coarse.height());
    for (int u = 0; u < fine.width(); ++u) {
      if (fine.at(u, v).is_surface()) continue;
      const int u0 = u / 2, u1 = second_nearest(u, coarse.width());
      const TangentPlane four[4] = {coarse.at(u0, v0), coarse.at(u1, v0), coarse.at(u0, v1),
                                    coarse.at(u1, v1)};
      fine.at(u, v) = interpolated(four, level + 1);
    }
  });
}

/// Closes holes from the outside in: the widest level that has to be asked is made first.
void DepthField::Impl::fill_holes(ThreadPool& pool) {
  if (std::find(row_has_hole.begin(), row_has_hole.end(), 1) == row_has_hole.end()) return;
  const int levels = layout.num_filled(options);
  for (int level = 1; level <= levels; ++level) widen(level, Choice::nearest, pool);
  for (int level = levels - 1; level >= 0; --level) fill_level(level, pool);
}

/// Around the image: nothing, or the surface of the outermost pixels going on.
void DepthField::Impl::extend_border(Image& image) const {
  const int w = image.width(), h = image.height();
  for (int v = -kBorder; v < h + kBorder; ++v) {
    const bool inner_row = v >= 0 && v < h;
    for (int u = -kBorder; u < w + kBorder; u += inner_row && u == -1 ? w + 1 : 1) {
      image.at(u, v) = options.unknown == UnknownSpace::solid
                           ? image.at(std::clamp(u, 0, w - 1), std::clamp(v, 0, h - 1))
                           : TangentPlane{};
    }
  }
}

/// Where the nine planes around a pixel do not belong to one smooth surface.
void DepthField::Impl::find_steps(int level, ThreadPool& pool) {
  Image& image = images[static_cast<std::size_t>(level)];
  const float limit = step_limit_of(level);
  for_rows(pool, image.height() + 2 * kStepBorder, [&](int row) {
    const int v = row - kStepBorder;
    const TangentPlane* rows[3] = {&image.at(0, v - 1), &image.at(0, v), &image.at(0, v + 1)};
    std::uint8_t* const is_step = &image.is_step(0, v);
    for (int u = -kStepBorder; u < image.width() + kStepBorder; ++u) {
      const TangentPlane* around[3] = {rows[0] + u - 1, rows[1] + u - 1, rows[2] + u - 1};
      is_step[u] = has_step(around, limit);
    }
  });
}

/// What is nearest in each tile of level 0. Wider pixels are means of these.
void DepthField::Impl::find_tiles(ThreadPool& pool) {
  constexpr int kSize = DepthFieldView::kTileSize;
  const Image& image = images[0];
  pool.parallel_for(view.tiles_high, [&](int row) {
    const int end_v = std::min((row + 1) * kSize, image.height());
    for (int column = 0; column < view.tiles_wide; ++column) {
      const int end_u = std::min((column + 1) * kSize, image.width());
      DepthTile tile = empty_tile();
      for (int v = row * kSize; v < end_v; ++v) {
        for (int u = column * kSize; u < end_u; ++u) tile = join(tile, tile_of(image.at(u, v)));
      }
      tiles[static_cast<std::size_t>(row * view.tiles_wide + column)] = tile;
    }
  });
}

Result<DepthField> DepthField::create(int width, int height, const DepthFieldOptions& options) {
  const auto layout = pyramid_layout(width, height, options);
  if (!layout) return layout.error();
  auto impl = std::make_unique<Impl>();
  Impl& d = *impl;
  d.options = options;
  d.layout = *layout;
  d.planes.resize(layout->num_planes());
  d.steps.assign(layout->num_steps(), 1);
  for (int level = 0; level < layout->num_levels; ++level) {
    d.images.emplace_back(*layout, level, d.planes.data(), d.steps.data());
  }
  d.row_has_hole.resize(static_cast<std::size_t>(height));
  d.tiles.resize(layout->num_tiles());
  d.view = layout->view(d.planes.data(), d.steps.data(), d.tiles.data(), options);
  d.view.num_levels = 0;
  return DepthField(std::move(impl));
}

DepthField::DepthField(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DepthField::DepthField(DepthField&&) noexcept = default;
DepthField& DepthField::operator=(DepthField&&) noexcept = default;
DepthField::~DepthField() = default;

void DepthField::update(const PointCloudView& cloud, ThreadPool& pool) {
  Impl& d = *impl_;
  PALPATE_ASSERT(cloud.pinhole && cloud.width == d.images[0].width() &&
                 cloud.height == d.images[0].height());
  d.take_planes(cloud, pool);
  d.fill_holes(pool);
  d.view.num_levels = d.layout.num_levels;
  d.view.intrinsics = cloud.intrinsics;
  d.find_tiles(pool);
  for (int level = 0; level < d.view.num_levels; ++level) {
    Image& image = d.images[static_cast<std::size_t>(level)];
    if (level > 0) d.widen(level, Choice::majority, pool);
    d.extend_border(image);
    d.find_steps(level, pool);
  }
  d.view.stamp = next_stamp();
}

const DepthFieldView& DepthField::view() const { return impl_->view; }

}  // namespace palpate
