#include "palpate/field/depth_field.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "palpate/cloud/depth_source.h"

namespace palpate {
namespace {

constexpr int kBorder = DepthFieldLevel::kBorder;
// Where there is no surface: so far in front that no sphere is near.
constexpr float kFreeOffset = 10.0f;
// A surface seen so aslant that its plane passes the eye closer than this share of its depth counts
// as steep as that.
constexpr float kLeastOffset = 0.02f;
// Pixels of level k belong to one surface if their depths differ by less than this share times 2^k,
// up to a limit: a wider pixel reaches farther along a slanted surface.
constexpr float kSameSurface = 0.012f, kSameSurfaceLimit = 0.05f;
// There is a step where the plane of a neighbour misses the surface point of a pixel by more,
// metres times 2^k.
constexpr float kStepLimit = 0.006f, kStepLimitLimit = 0.025f;

/// A pixel's tangent plane; no surface if the slope is 0.
struct TangentPlane {
  float offset = kFreeOffset, slope = 0;

  bool is_surface() const { return slope > 0; }
  float inverse_depth() const { return slope / offset; }
};

static_assert(sizeof(TangentPlane) == 2 * sizeof(float));  // read as pairs of numbers

float tolerance_of(int level) {
  return std::min(kSameSurface * static_cast<float>(1 << level), kSameSurfaceLimit);
}

float step_limit_of(int level) {
  return std::min(kStepLimit * static_cast<float>(1 << level), kStepLimitLimit);
}

/// The pixels of all levels.
struct Pixels {
  std::vector<TangentPlane> planes;
  std::vector<std::uint8_t> is_step;
};

/// One level, whose pixels are rows of a larger memory from `first_row` on.
class Image {
 public:
  static int num_rows(int height) { return height + 2 * kBorder; }

  Image(Pixels& pixels, int first_row, int width, int height, int stride)
      : width_(width),
        height_(height),
        stride_(stride),
        planes_(&pixels.planes[static_cast<std::size_t>(first_row * stride)]),
        is_step_(&pixels.is_step[static_cast<std::size_t>(first_row * stride)]) {}

  int width() const { return width_; }
  int height() const { return height_; }
  const TangentPlane& at(int u, int v) const { return planes_[index(u, v)]; }
  TangentPlane& at(int u, int v) { return planes_[index(u, v)]; }
  std::uint8_t& is_step(int u, int v) { return is_step_[index(u, v)]; }
  /// As level `number` of `finest`.
  DepthFieldLevel level(int number, const Image& finest) const {
    const float scale = 1.0f / static_cast<float>(1 << number);
    return {&planes_[index(0, 0)].offset,
            &is_step_[index(0, 0)],
            width_,
            height_,
            stride_,
            scale,
            static_cast<float>(finest.width()) * scale + 2,
            static_cast<float>(finest.height()) * scale + 2,
            step_limit_of(number)};
  }

 private:
  std::size_t index(int u, int v) const {
    return static_cast<std::size_t>(v + kBorder) * static_cast<std::size_t>(stride_) +
           static_cast<std::size_t>(u + kBorder);
  }

  int width_, height_, stride_;
  TangentPlane* planes_;
  std::uint8_t* is_step_;
};

/// Which of a few pixels a wider one stands for.
enum class Choice {
  majority,  ///< the surface, or absence of one, that most of them show; the nearest if undecided
  nearest,   ///< any surface, the nearest one
  farthest,  ///< any surface, the farthest one: what goes on behind an edge
};

/// Mean of the planes of one surface among four pixels with weights.
TangentPlane merge(const TangentPlane (&pixels)[4], const float (&weights)[4], float tolerance,
                   Choice choice) {
  float w[4];
  for (int i = 0; i < 4; ++i) w[i] = pixels[i].inverse_depth();
  const auto is_same = [&](int i, int j) {
    return std::abs(w[i] - w[j]) <= tolerance * std::max(w[i], w[j]) && (w[i] > 0) == (w[j] > 0);
  };
  int best = -1, best_votes = 0;
  for (int i = 0; i < 4; ++i) {
    if (weights[i] <= 0 || (choice != Choice::majority && w[i] <= 0)) continue;
    int votes = 0;
    for (int j = 0; j < 4; ++j) votes += choice == Choice::majority && is_same(i, j);
    const bool is_better =
        choice == Choice::farthest ? best >= 0 && w[i] < w[best] : best >= 0 && w[i] > w[best];
    if (best < 0 || votes > best_votes || (votes == best_votes && is_better)) {
      best = i;
      best_votes = votes;
    }
  }
  if (best < 0 || w[best] <= 0) return {};
  TangentPlane mean{0, 0};
  float total = 0;
  for (int i = 0; i < 4; ++i) {
    if (weights[i] <= 0 || !is_same(i, best)) continue;
    mean.offset += weights[i] * pixels[i].offset;
    mean.slope += weights[i] * pixels[i].slope;
    total += weights[i];
  }
  return {mean.offset / total, mean.slope / total};
}

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
  Pixels pixels;
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
      const float z = cloud.z[i];
      if (!(z > 0)) {
        image.at(u, v) = {};
        has_hole = 1;
        continue;
      }
      const float d = -(cloud.x[i] * cloud.nx[i] + cloud.y[i] * cloud.ny[i] + z * cloud.nz[i]);
      const float offset = std::max(d, kLeastOffset * z);
      image.at(u, v) = {offset, offset / z};
    }
    row_has_hole[static_cast<std::size_t>(v)] = has_hole;
  });
}

/// Makes a level from the one before: one pixel of two by two.
void DepthField::Impl::widen(int level, Choice choice, ThreadPool& pool) {
  const Image& fine = images[static_cast<std::size_t>(level - 1)];
  Image& coarse = images[static_cast<std::size_t>(level)];
  const float tolerance = tolerance_of(level);
  for_rows(pool, coarse.height(), [&](int v) {
    const int v0 = 2 * v, v1 = std::min(2 * v + 1, fine.height() - 1);
    for (int u = 0; u < coarse.width(); ++u) {
      const int u0 = 2 * u, u1 = std::min(2 * u + 1, fine.width() - 1);
      const TangentPlane four[4] = {fine.at(u0, v0), fine.at(u1, v0), fine.at(u0, v1),
                                    fine.at(u1, v1)};
      constexpr float kEqual[4] = {1, 1, 1, 1};
      coarse.at(u, v) = merge(four, kEqual, tolerance, choice);
    }
  });
}

/// Gives the pixels without surface what the next wider level knows there.
void DepthField::Impl::fill_level(int level, ThreadPool& pool) {
  Image& fine = images[static_cast<std::size_t>(level)];
  const Image& coarse = images[static_cast<std::size_t>(level + 1)];
  const float tolerance = tolerance_of(level + 1);
  for_rows(pool, fine.height(), [&](int v) {
    if (level == 0 && !row_has_hole[static_cast<std::size_t>(v)]) return;
    // Between which two rows of the wider level, the nearer one first.
    const int v0 = v / 2, v1 = std::clamp(v0 + (v % 2 ? 1 : -1), 0, coarse.height() - 1);
    for (int u = 0; u < fine.width(); ++u) {
      if (fine.at(u, v).is_surface()) continue;
      const int u0 = u / 2, u1 = std::clamp(u0 + (u % 2 ? 1 : -1), 0, coarse.width() - 1);
      const TangentPlane four[4] = {coarse.at(u0, v0), coarse.at(u1, v0), coarse.at(u0, v1),
                                    coarse.at(u1, v1)};
      constexpr float kBilinear[4] = {9, 3, 3, 1};
      fine.at(u, v) = merge(four, kBilinear, tolerance, Choice::farthest);
    }
  });
}

/// Closes holes from the outside in: the widest level that has to be asked is made first.
void DepthField::Impl::fill_holes(ThreadPool& pool) {
  if (std::find(row_has_hole.begin(), row_has_hole.end(), 1) == row_has_hole.end()) return;
  const int top = static_cast<int>(images.size()) - 1;
  const int levels =
      options.unknown == UnknownSpace::solid ? top : std::min(options.fill_levels, top);
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
  constexpr int kOuter = kBorder - 2;  // farther out no place is looked at
  for_rows(pool, image.height() + 2 * kOuter, [&](int row) {
    const int v = row - kOuter;
    const TangentPlane* rows[3] = {&image.at(0, v - 1), &image.at(0, v), &image.at(0, v + 1)};
    std::uint8_t* const is_step = &image.is_step(0, v);
    for (int u = -kOuter; u < image.width() + kOuter; ++u) {
      const float depth = rows[1][u].offset / std::max(rows[1][u].slope, 1e-6f);
      float worst = 0;
      for (const TangentPlane* r : rows) {
        for (int k = u - 1; k <= u + 1; ++k) {
          worst = std::max(worst, std::abs(r[k].offset - depth * r[k].slope));
        }
      }
      is_step[u] = worst > limit;
    }
  });
}

/// What is nearest in each tile of level 0. Wider pixels are means of these.
void DepthField::Impl::find_tiles(ThreadPool& pool) {
  constexpr int kSize = DepthFieldView::kTileSize;
  const Image& image = images[0];
  pool.parallel_for(view.tiles_high, [&](int row) {
    DepthTile* const tiles_of_row = &tiles[static_cast<std::size_t>(row * view.tiles_wide)];
    std::fill(tiles_of_row, tiles_of_row + view.tiles_wide, DepthTile{1e30f, 1.0f});
    for (int v = row * kSize; v < std::min((row + 1) * kSize, image.height()); ++v) {
      for (int u = 0; u < image.width(); ++u) {
        const TangentPlane& plane = image.at(u, v);
        if (!plane.is_surface()) continue;
        DepthTile& tile = tiles_of_row[u / kSize];
        tile.nearest = std::min(tile.nearest, plane.offset / plane.slope);
        tile.least_slope = std::min(tile.least_slope, plane.slope);
      }
    }
  });
}

Result<DepthField> DepthField::create(int width, int height, const DepthFieldOptions& options) {
  constexpr int kLeast = 8;
  if (width < kLeast || width > kMaxImageWidth || height < kLeast || height > kMaxImageHeight) {
    return Error{Errc::invalid_argument, "a depth field of " + std::to_string(width) + " x " +
                                             std::to_string(height) +
                                             " pixels is not possible; use 8 to 4096 a side"};
  }
  if (options.fill_levels < 0 || options.fill_levels >= DepthFieldView::kMaxLevels) {
    return Error{Errc::invalid_argument, "holes can be filled over 0 to " +
                                             std::to_string(DepthFieldView::kMaxLevels - 1) +
                                             " levels, not " + std::to_string(options.fill_levels)};
  }
  if (!(options.thickness >= 1e-3 && options.thickness <= kSolidBehind)) {
    return Error{Errc::invalid_argument,
                 "what is behind a surface can be felt over 0.001 m and more, not over " +
                     std::to_string(options.thickness) + " m"};
  }
  auto impl = std::make_unique<Impl>();
  impl->options = options;
  const int stride = width + 2 * kBorder;
  struct Size {
    int width, height;
  };
  std::vector<Size> sizes;
  int num_rows = 0;
  while (static_cast<int>(sizes.size()) < DepthFieldView::kMaxLevels &&
         std::min(width, height) >= 4) {
    sizes.push_back({width, height});
    num_rows += Image::num_rows(height);
    width = (width + 1) / 2;
    height = (height + 1) / 2;
  }
  const auto num_pixels = static_cast<std::size_t>(num_rows) * static_cast<std::size_t>(stride);
  impl->pixels.planes.resize(num_pixels + 1);      // four pixels are read where three are needed
  impl->pixels.is_step.assign(num_pixels + 3, 1);  // vectors of bytes are read four at a time
  int first_row = 0;
  for (const Size& size : sizes) {
    impl->images.emplace_back(impl->pixels, first_row, size.width, size.height, stride);
    first_row += Image::num_rows(size.height);
  }
  const Image& finest = impl->images[0];
  impl->row_has_hole.resize(static_cast<std::size_t>(finest.height()));
  constexpr int kTile = DepthFieldView::kTileSize;
  DepthFieldView& view = impl->view;
  view.tiles_wide = (finest.width() + kTile - 1) / kTile;
  view.tiles_high = (finest.height() + kTile - 1) / kTile;
  impl->tiles.resize(static_cast<std::size_t>(view.tiles_wide * view.tiles_high));
  view.tiles = impl->tiles.data();
  view.thickness = static_cast<float>(options.thickness);
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
  d.view.num_levels = static_cast<int>(d.images.size());
  d.view.intrinsics = cloud.intrinsics;
  d.find_tiles(pool);
  for (int level = 0; level < d.view.num_levels; ++level) {
    Image& image = d.images[static_cast<std::size_t>(level)];
    if (level > 0) d.widen(level, Choice::majority, pool);
    d.extend_border(image);
    d.find_steps(level, pool);
    d.view.levels[level] = image.level(level, d.images[0]);
  }
}

const DepthFieldView& DepthField::view() const { return impl_->view; }

}  // namespace palpate
