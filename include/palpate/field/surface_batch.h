// Many surfaces at once.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "palpate/field/surface_timeline.h"

namespace palpate {

/// Surfaces that poses are measured against (contact/contact_batch.h), not owning: views in host
/// memory, which may show arrays anywhere, or depth fields of one camera model whose arrays lie at
/// equal distances in memory, as Sensor::update_batch makes them.
class SurfaceBatch {
 public:
  SurfaceBatch() = default;
  /// `one` must outlive it; so must views.
  SurfaceBatch(const SurfaceView& one) : SurfaceBatch(std::span(&one, 1)) {}
  SurfaceBatch(std::span<const SurfaceView> views)
      : views_(views.data()), size_(static_cast<int>(views.size())) {}
  SurfaceBatch(const std::vector<SurfaceView>& views) : SurfaceBatch(std::span(views)) {}
  /// `num` fields without clouds. Distances from one to the next: in pixels of planes, silhouettes
  /// and near_silhouette, and in tiles.
  SurfaceBatch(const DepthFieldView& first, int num, std::ptrdiff_t pixels_apart,
               std::ptrdiff_t tiles_apart)
      : size_(num), pixels_apart_(pixels_apart), tiles_apart_(tiles_apart) {
    first_.field = first;
  }

  int size() const { return size_; }
  bool is_even() const { return views_ == nullptr && size_ > 0; }
  std::ptrdiff_t pixels_apart() const { return pixels_apart_; }
  std::ptrdiff_t tiles_apart() const { return tiles_apart_; }

  SurfaceView operator[](int number) const {
    if (views_ != nullptr) return views_[number];
    SurfaceView surface = first_;
    const std::ptrdiff_t pixels = number * pixels_apart_;
    for (int k = 0; k < surface.field.num_levels; ++k) {
      DepthFieldLevel& level = surface.field.levels[k];
      level.planes += 2 * pixels;
      level.silhouettes += 2 * pixels;
      level.near_silhouette += pixels;
    }
    surface.field.tiles += number * tiles_apart_;
    return surface;
  }

 private:
  const SurfaceView* views_ = nullptr;
  SurfaceView first_;
  int size_ = 0;
  std::ptrdiff_t pixels_apart_ = 0, tiles_apart_ = 0;
};

}  // namespace palpate
