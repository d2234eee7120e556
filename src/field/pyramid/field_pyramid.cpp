#include "src/field/pyramid/field_pyramid.h"

#include <algorithm>
#include <string>

#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

Result<PyramidLayout> pyramid_layout(int width, int height, const DepthFieldOptions& options) {
  constexpr int kMinSide = 8;
  if (width < kMinSide || width > kMaxImageWidth || height < kMinSide || height > kMaxImageHeight) {
    return Error{Errc::invalid_argument, "a depth field of " + std::to_string(width) + " x " +
                                             std::to_string(height) +
                                             " pixels is not possible; use 8 to 4096 a side"};
  }
  if (const Status status = check_settings(options); !status) return status.error();
  if (options.unknown == UnknownSpace::blocked && options.unseen != UnseenSpace::solid) {
    return Error{
        Errc::invalid_argument,
        "unknown blocked makes all space solid that was not seen to be free, but unseen free "
        "or fade makes space behind surfaces free: leave one of them out"};
  }
  if (options.unseen == UnseenSpace::solid && options.thickness != DepthFieldOptions{}.thickness) {
    return Error{
        Errc::invalid_argument,
        "thickness has no effect while unseen is solid: use unseen free or unseen fade, or "
        "leave out thickness"};
  }
  PyramidLayout layout;
  layout.stride = width + 2 * DepthFieldLevel::kBorder;
  while (layout.num_levels < DepthFieldView::kMaxLevels && std::min(width, height) >= 4) {
    layout.levels[layout.num_levels++] = {width, height, layout.num_rows};
    layout.num_rows += height + 2 * DepthFieldLevel::kBorder;
    width = (width + 1) / 2;
    height = (height + 1) / 2;
  }
  return layout;
}

DepthFieldView PyramidLayout::view(const TangentPlane* planes, const Silhouette* silhouettes,
                                   const std::uint8_t* near_silhouette, const DepthTile* tiles,
                                   const DepthFieldOptions& options) const {
  DepthFieldView view;
  view.num_levels = num_levels;
  for (int number = 0; number < num_levels; ++number) {
    const float scale = 1.0f / static_cast<float>(1 << number);
    DepthFieldLevel& level = view.levels[number];
    level.planes = &planes[origin(number)].offset;
    level.silhouettes = &silhouettes[2 * origin(number)];
    level.near_silhouette = &near_silhouette[origin(number)];
    level.width = levels[number].width;
    level.height = levels[number].height;
    level.stride = stride;
    level.scale = scale;
    level.last_u = static_cast<float>(levels[0].width) * scale - DepthFieldLevel::kFirst;
    level.last_v = static_cast<float>(levels[0].height) * scale - DepthFieldLevel::kFirst;
  }
  view.tiles = tiles;
  view.tiles_wide = tiles_wide();
  view.tiles_high = tiles_high();
  switch (options.unseen) {
    case UnseenSpace::solid: view.thickness = static_cast<float>(kSolidBehind); break;
    case UnseenSpace::free: view.thickness = static_cast<float>(options.thickness); break;
    case UnseenSpace::fade: view.thickness = static_cast<float>(-options.thickness); break;
  }
  return view;
}

int PyramidLayout::num_filled(const DepthFieldOptions& options) const {
  const int top = num_levels - 1;
  return options.unknown == UnknownSpace::solid ? top : std::min(options.fill_levels, top);
}

}}  // namespace palpate::v0
