#include "src/contact/cuda/gpu_field.h"

#include <algorithm>

namespace palpate { inline namespace v0 {

bool GpuFields::grow(Copy& copy, std::size_t num_pixels, std::size_t num_tiles,
                     std::size_t num_words, gpu::Stream& stream) {
  if (num_pixels <= copy.num_pixels && num_tiles <= copy.num_tiles && num_words <= copy.num_words) {
    return true;
  }
  num_pixels = std::max(num_pixels, copy.num_pixels);
  num_tiles = std::max(num_tiles, copy.num_tiles);
  num_words = std::max(num_words, copy.num_words);
  stream.wait();  // the memory given up may still be in use
  copy = Copy{};
  copy.memory.emplace(gpu_);
  copy.planes = copy.memory->take<float>(2 * num_pixels);
  copy.silhouettes = copy.memory->take<Silhouette>(2 * num_pixels);
  copy.near_silhouette = copy.memory->take<std::uint8_t>(num_pixels);
  copy.tiles = copy.memory->take<DepthTile>(num_tiles);
  copy.filled_behind = copy.memory->take<std::uint32_t>(num_words);
  if (const Status& status = copy.memory->status(); !status) {
    stream.fail(status.error());
    return false;
  }
  copy.num_pixels = num_pixels;
  copy.num_tiles = num_tiles;
  copy.num_words = num_words;
  return true;
}

DepthFieldView GpuFields::on_gpu(const DepthFieldView& field, gpu::Stream& stream) noexcept {
  if (field.gpu == gpu_ || field.num_levels == 0) return field;
  const DepthFieldLevel& finest = field.levels[0];
  const CopySource source{field.stamp, finest.planes, field.gpu};
  const auto [slot, is_known] = slots_.choose(source);
  Copy& copy = copies_[slot];

  // All levels lie in one memory, one after the other, with kBorder pixels around each.
  constexpr std::ptrdiff_t kBorder = DepthFieldLevel::kBorder;
  const DepthFieldLevel& widest = field.levels[field.num_levels - 1];
  const std::ptrdiff_t stride = finest.stride, before = kBorder * stride + kBorder;
  const std::ptrdiff_t after = (widest.height + kBorder) * stride - kBorder;
  const std::ptrdiff_t num_pixels =
      before + (widest.near_silhouette - finest.near_silhouette) + after;
  const std::ptrdiff_t num_tiles = std::ptrdiff_t{field.tiles_wide} * field.tiles_high;
  const std::size_t num_words =
      field.filled_behind == nullptr ? 0 : std::size_t(field.filled_stride) * finest.height;
  if (!is_known) {
    if (!grow(copy, static_cast<std::size_t>(num_pixels), static_cast<std::size_t>(num_tiles),
              num_words, stream)) {
      return {};
    }
    stream.copy(copy.filled_behind, field.filled_behind, num_words * sizeof(std::uint32_t));
    stream.copy(copy.planes, finest.planes - 2 * before,
                2 * static_cast<std::size_t>(num_pixels) * sizeof(float));
    stream.copy(copy.silhouettes, finest.silhouettes - 2 * before,
                2 * static_cast<std::size_t>(num_pixels) * sizeof(Silhouette));
    stream.copy(copy.near_silhouette, finest.near_silhouette - before,
                static_cast<std::size_t>(num_pixels));
    stream.copy(copy.tiles, field.tiles, static_cast<std::size_t>(num_tiles) * sizeof(DepthTile));
    slots_.note(slot, source);
  }
  DepthFieldView view = field;
  view.filled_behind = num_words > 0 ? copy.filled_behind : nullptr;
  for (int k = 0; k < view.num_levels; ++k) {
    DepthFieldLevel& level = view.levels[k];
    level.planes = copy.planes + 2 * before + (level.planes - finest.planes);
    level.silhouettes = copy.silhouettes + 2 * before + (level.silhouettes - finest.silhouettes);
    level.near_silhouette =
        copy.near_silhouette + before + (level.near_silhouette - finest.near_silhouette);
  }
  view.tiles = copy.tiles;
  view.gpu = gpu_;
  return view;
}

}}  // namespace palpate::v0
