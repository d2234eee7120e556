// The loops over the rows of a depth field, compiled once per instruction set.
#include <algorithm>

#include "src/core/internal/simd_rows.h"
#include "src/field/pyramid/field_rows.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

/// The planes of kLanes pixels side by side.
struct Planes {
  VecF offset, slope;
};
struct Tiles {
  VecF nearest, min_slope;
};

inline Mask is_hole(const Planes& planes) { return ~(planes.slope > 0.0f); }
inline Planes load(const TangentPlane* from) {
  const Pairs pairs = load_pairs(&from->offset);
  return {pairs.first, pairs.second};
}
inline void store(TangentPlane* to, const Planes& planes) {
  store_pairs(&to->offset, {planes.offset, planes.slope});
}

}  // namespace

void take_planes(const PointCloudView& cloud, const FieldImage& image, const PixelWindow& window,
                 int v) {
  TangentPlane* const out = image.row(v);
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(v) * cloud.width;
  const float* const in[6] = {cloud.x + first,  cloud.y + first,  cloud.z + first,
                              cloud.nx + first, cloud.ny + first, cloud.nz + first};
  const float* const depth = cloud.depth == nullptr ? in[2] : cloud.depth + first;
  int u = window.left;
  for (; u + kLanes <= window.right; u += kLanes) {
    store(out + u,
          plane_or_far(tangent_plane<Planes>(load(in[0] + u), load(in[1] + u), load(in[2] + u),
                                             load(in[3] + u), load(in[4] + u), load(in[5] + u)),
                       load(depth + u), cloud.max_depth));
  }
  for (; u < window.right; ++u) out[u] = plane_of(cloud, first + u);
}

bool find_holes(const FieldImage& image, const PixelWindow& window, int v, std::uint64_t* holes) {
  const TangentPlane* const row = image.row(v);
  std::uint64_t any = 0;
  const auto set = [&](int u, std::uint64_t bits) {
    any |= bits;
    holes[u / 64] |= bits << u % 64;
  };
  int u = window.left;  // a multiple of kLanes
  for (; u + kLanes <= window.right; u += kLanes) set(u, mask_bits(is_hole(load(row + u))));
  for (; u < window.right; ++u) set(u, row[u].is_surface() ? 0 : 1);
  return any != 0;
}

void widen(const FieldImage& fine, int level, Choice choice, const FieldImage& coarse,
           const PixelWindow& window, int v) {
  const int low = 2 * v, high = 2 * v + 1 < fine.height ? 2 * v + 1 : fine.height - 1;
  const TangentPlane* const rows[2] = {fine.row(low), fine.row(high)};
  const float* const shares[2] = {fine.share_row(low), fine.share_row(high)};
  TangentPlane* const out = coarse.row(v);
  float* const out_shares = coarse.share_row(v);
  int u = window.left;
  for (; u + kLanes <= window.right && 2 * (u + kLanes) <= fine.width; u += kLanes) {
    SharedPixel<Planes> four[4];
    for (int k = 0; k < 2; ++k) {
      const Planes left = load(rows[k] + 2 * u), right = load(rows[k] + 2 * u + kLanes);
      const Pairs offsets = split_pairs(left.offset, right.offset);
      const Pairs slopes = split_pairs(left.slope, right.slope);
      const Pairs share = split_pairs(load(shares[k] + 2 * u), load(shares[k] + 2 * u + kLanes));
      four[2 * k] = {{offsets.first, slopes.first}, share.first};
      four[2 * k + 1] = {{offsets.second, slopes.second}, share.second};
    }
    const SharedPixel<Planes> wide = widened(four, level, choice);
    store(out + u, wide.plane);
    if (choice == Choice::majority) store(out_shares + u, wide.share);
  }
  for (; u < window.right; ++u) {
    const int u0 = 2 * u, u1 = 2 * u + 1 < fine.width ? 2 * u + 1 : fine.width - 1;
    const SharedPixel<TangentPlane> four[4] = {{rows[0][u0], shares[0][u0]},
                                               {rows[0][u1], shares[0][u1]},
                                               {rows[1][u0], shares[1][u0]},
                                               {rows[1][u1], shares[1][u1]}};
    const SharedPixel<TangentPlane> wide = widened(four, level, choice);
    out[u] = wide.plane;
    if (choice == Choice::majority) out_shares[u] = wide.share;
  }
}

void fill(const FieldImage& coarse, int level, const FieldImage& fine, const PixelWindow& window,
          int v) {
  const TangentPlane* const rows[2] = {coarse.row(v / 2),
                                       coarse.row(second_nearest(v, coarse.height))};
  TangentPlane* const out = fine.row(v);
  int u = window.left;
  for (; u + kLanes <= window.right; u += kLanes) {
    const Planes known = load(out + u);
    const Mask holes = is_hole(known);
    if (mask_bits(holes) == 0) continue;
    const VecI column = lane_ids() + u, nearest = column >> 1;
    const VecI second = second_nearest(column, coarse.width);
    Planes four[4];
    for (int k = 0; k < 4; ++k) {
      const float* const row = &rows[k / 2]->offset;
      const VecI at = 2 * (k % 2 == 0 ? nearest : second);
      four[k] = {gather(row, at), gather(row, at + 1)};
    }
    const Planes guess = interpolated(four, level);
    store(out + u,
          {select(holes, guess.offset, known.offset), select(holes, guess.slope, known.slope)});
  }
  for (; u < window.right; ++u) {
    if (out[u].is_surface()) continue;
    const int u0 = u / 2, u1 = second_nearest(u, coarse.width);
    const TangentPlane four[4] = {rows[0][u0], rows[0][u1], rows[1][u0], rows[1][u1]};
    out[u] = interpolated(four, level);
  }
}

void find_tiles(const FieldImage& image, const PixelWindow& window, int v, DepthTile* tiles) {
  constexpr int kSize = DepthFieldView::kTileSize;
  static_assert(kSize % kLanes == 0);
  const int end_v = std::min((v + 1) * kSize, image.height);
  for (int u = 0; u < image.width; u += kSize, ++tiles) {
    const PixelWindow square{u, v * kSize, std::min(u + kSize, image.width), end_v};
    if (!window.contains(square)) {
      *tiles = unknown_tile<DepthTile>();
      continue;
    }
    Tiles lanes = empty_tile<Tiles>();
    DepthTile tile = empty_tile<DepthTile>();
    const bool is_whole = u + kSize <= image.width;
    for (int row = v * kSize; row < end_v; ++row) {
      const TangentPlane* const planes = image.row(row) + u;
      if (is_whole) {
        for (int k = 0; k < kSize; k += kLanes) {
          lanes = join(lanes, tile_of<Tiles>(load(planes + k)));
        }
      } else {
        for (int k = 0; k < image.width - u; ++k) {
          tile = join(tile, tile_of<DepthTile>(planes[k]));
        }
      }
    }
    for (int i = 0; i < kLanes; ++i) {
      tile = join(tile, DepthTile{lanes.nearest[i], lanes.min_slope[i]});
    }
    *tiles = tile;
  }
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
