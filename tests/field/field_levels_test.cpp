// Levels, silhouettes and tiles of a depth field, against their definitions.
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/field/depth_field.h"
#include "tests/field/field_clouds.h"

namespace palpate {
namespace {

using namespace test::field_clouds;  // NOLINT: all of it

/// Shares of one level, pixel by pixel: how much of its area shows the surface of its plane.
struct Shares {
  std::vector<float> values;
  int width = 0, height = 0;

  explicit Shares(const DepthFieldLevel& level)
      : values(static_cast<std::size_t>(level.width * level.height), 1.0f),
        width(level.width),
        height(level.height) {}
  float& at(int u, int v) { return values[static_cast<std::size_t>(v * width + u)]; }
  /// Beyond the image a pixel shows one surface.
  double around(int u, int v) const {
    if (u < 0 || v < 0 || u >= width || v >= height) return 1;
    return static_cast<double>(values[static_cast<std::size_t>(v * width + u)]);
  }
};

struct WidePixel {
  float offset = 0, slope = 0, share = 0;
};

/// One pixel of a level by the words of decisions 11 and 13: the surface, or absence of one, that
/// most of the area of the four pixels before shows, the nearest if undecided, and the mean of its
/// planes. What is not of a pixel's own surface is of the other one.
WidePixel merged(const DepthFieldLevel& fine, Shares& shares, int level, int u, int v) {
  float offset[4], slope[4], w[4], share[4];
  for (int k = 0; k < 4; ++k) {
    const int at_u = std::min(2 * u + k % 2, fine.width - 1);
    const int at_v = std::min(2 * v + k / 2, fine.height - 1);
    const float* plane = fine.planes + 2 * (std::ptrdiff_t{at_v} * fine.stride + at_u);
    offset[k] = plane[0], slope[k] = plane[1], w[k] = plane[1] / plane[0];
    share[k] = shares.at(at_u, at_v);
  }
  const float tolerance = std::min(0.05f, 0.012f * static_cast<float>(1 << level));
  const auto is_same = [&](float a, float b) {
    if (a == 0 || b == 0) return a == b;
    return std::max(a, b) - std::min(a, b) <= tolerance * std::min(a, b);
  };
  std::pair<float, float> best{-1.0f, 0.0f};  // pixels, then w
  for (const float a : w) {
    float num = 0;
    for (int k = 0; k < 4; ++k) num += is_same(a, w[k]) ? share[k] : 1 - share[k];
    best = std::max(best, {num, a});
  }
  if (best.second == 0) return {10.0f, 0.0f, best.first / 4};
  float sum_offset = 0, sum_slope = 0, num = 0;
  for (int k = 0; k < 4; ++k) {
    if (!is_same(w[k], best.second)) continue;
    sum_offset += offset[k], sum_slope += slope[k], num += 1;
  }
  return {sum_offset / num, sum_slope / num, best.first / 4};
}

/// Returns the shares of all levels.
std::vector<Shares> shares_of(const DepthFieldView& view) {
  std::vector<Shares> all;
  for (int k = 0; k < view.num_levels; ++k) {
    all.emplace_back(view.levels[k]);
    for (int v = 0; k > 0 && v < view.levels[k].height; ++v) {
      for (int u = 0; u < view.levels[k].width; ++u) {
        all.back().at(u, v) = merged(view.levels[k - 1], all[all.size() - 2], k, u, v).share;
      }
    }
  }
  return all;
}

/// The nearest silhouettes of a pixel by their definition: over all places between two pixels side
/// by side, in double.
struct TrueSilhouettes {
  double exit = 1e9, occluder = 1e9;  ///< pixels
};
TrueSilhouettes true_silhouettes(const DepthFieldLevel& level, const Shares& shares, int u, int v) {
  struct Pixel {
    double offset, slope;
    double depth() const { return slope > 0 ? offset / slope : 1e9; }
    double at(double z) const { return offset - z * slope; }
  };
  const auto pixel = [&](int x, int y) {
    const float* plane = level.planes + 2 * (std::ptrdiff_t{y} * level.stride + x);
    return Pixel{plane[0], plane[1]};
  };
  // A plane looks as if its depth grew by the sine of its slant from pixel to pixel, in pixels.
  const auto is_apart = [](const Pixel& near, const Pixel& far, double gap, double span,
                           double reach) {
    const double cosine = far.slope > 0 ? std::min(near.slope, far.slope) : near.slope;
    return gap > span * (1 + reach * std::sqrt(std::max(0.0, 1 - cosine * cosine)));
  };
  const Pixel own = pixel(u, v);
  TrueSilhouettes found;
  for (int y = v - 3; y <= v + 3; ++y) {
    for (int x = u - 3; x <= u + 3; ++x) {
      for (const bool is_right : {true, false}) {
        const Pixel a = pixel(x, y), b = is_right ? pixel(x + 1, y) : pixel(x, y + 1);
        const Pixel near = a.depth() < b.depth() ? a : b, far = a.depth() < b.depth() ? b : a;
        const double f = is_right ? kCamera.fx : kCamera.fy;
        const double width = 1 / (static_cast<double>(level.scale) * f);
        // Both show two surfaces: the edge lies where their areas meet.
        const double next = is_right ? shares.around(x + 1, y) : shares.around(x, y + 1);
        const double shift = std::clamp(shares.around(x, y) - next, -0.375, 0.375);
        const double du = x - u + (is_right ? 0.5 + shift : 0);
        const double dv = y - v + (is_right ? 0 : 0.5 + shift);
        const double distance = std::hypot(du, dv);
        if (near.slope <= 0 || std::max(std::abs(du), std::abs(dv)) > 3) continue;
        const double z = near.depth();
        if (!is_apart(near, far, far.at(z), width * z, 1)) continue;
        if (own.slope > 0) {
          const double behind = own.depth() * (1 + 3 * width / std::max(own.slope, 0.02));
          if (far.at(behind) > (1.0 - 3) * width * own.depth()) {
            found.exit = std::min(found.exit, distance);
          }
        }
        if (own.depth() <= z) continue;
        const double requested = std::min(own.depth(), z + 0.5);
        const double reach = std::sqrt(2 * distance * distance + 0.5);
        if (is_apart(near, own, own.at(requested) - near.at(requested), width * z, reach)) {
          found.occluder = std::min(found.occluder, distance);
        }
      }
    }
  }
  return found;
}

// The search along rows first and columns then finds the nearest silhouette or one hardly farther.
TEST(DepthField, SilhouettesAreTheNearestOnes) {
  const DepthField field = make_field(rough_cloud(42));
  const std::vector<Shares> shares = shares_of(field.view());
  int num_exits = 0, num_occluders = 0, num_missed = 0, num_farther = 0;
  for (int k = 0; k < 3; ++k) {
    const DepthFieldLevel& level = field.view().levels[k];
    for (int v = 4; v < level.height - 4; ++v) {
      for (int u = 4; u < level.width - 4; ++u) {
        const std::ptrdiff_t i = std::ptrdiff_t{v} * level.stride + u;
        const TrueSilhouettes want =
            true_silhouettes(level, shares[static_cast<std::size_t>(k)], u, v);
        if (level.near_silhouette[i] == 0) {
          num_missed += (want.exit < 1e8) + (want.occluder < 1e8);
          EXPECT_GT(std::min(want.exit, want.occluder), 1.5) << u << " " << v;
          continue;
        }
        const double width = 1 / (static_cast<double>(level.scale) * kCamera.fx);
        const auto check = [&](float side, double distance, int& num) {
          if (distance > 1e8) {
            EXPECT_EQ(side, 0) << u << " " << v;
            return;
          }
          ++num;
          num_missed += side == 0;
          // Sides are measured at a right angle to the wall through the eye: up to 1 / 1.25
          // shorter.
          const double found = std::abs(static_cast<double>(side)) / width;
          EXPECT_GT(found, side == 0 ? -1 : 0.75 * distance) << u << " " << v;
          num_farther += found > 1.05 * distance;
        };
        check(level.silhouettes[2 * i].side, want.exit, num_exits);
        check(level.silhouettes[2 * i + 1].side, want.occluder, num_occluders);
      }
    }
  }
  EXPECT_GT(num_exits, 1000);
  EXPECT_GT(num_occluders, 1000);
  EXPECT_LT(num_missed, 0.35 * (num_exits + num_occluders));
  EXPECT_LT(num_farther, 0.15 * (num_exits + num_occluders));
}

TEST(DepthField, LevelsAndTilesAreWhatTheyAreSaidToBe) {
  const DepthField field = make_field(rough_cloud(9), {UnknownSpace::free, 1});
  const DepthFieldView& view = field.view();
  std::vector<Shares> shares = shares_of(view);
  int num_free = 0;
  for (int k = 0; k < view.num_levels; ++k) {
    const DepthFieldLevel& level = view.levels[k];
    const auto plane_at = [&](int u, int v) {
      return level.planes + 2 * (std::ptrdiff_t{v} * level.stride + u);
    };
    for (int v = 0; v < level.height; ++v) {
      for (int u = 0; u < level.width; ++u) {
        const float* plane = plane_at(u, v);
        num_free += plane[1] == 0;
        if (k > 0) {
          const WidePixel want =
              merged(view.levels[k - 1], shares[static_cast<std::size_t>(k - 1)], k, u, v);
          ASSERT_EQ(plane[0], want.offset) << k << ": " << u << ", " << v;
          ASSERT_EQ(plane[1], want.slope) << k << ": " << u << ", " << v;
        }
      }
    }
  }
  EXPECT_GT(num_free, 10);
  // Tiles at the border also stand for the pixels of any level where its surface goes on.
  constexpr int kSize = DepthFieldView::kTileSize, kGoesOn = DepthFieldLevel::kGoesOn;
  const int last_u = view.tiles_wide - 1, last_v = view.tiles_high - 1;
  for (int tile = 0; tile < view.tiles_wide * view.tiles_high; ++tile) {
    float nearest = 1e30f, min_slope = 1;
    const int tile_u = tile % view.tiles_wide, tile_v = tile / view.tiles_wide;
    for (int k = 0; k < view.num_levels; ++k) {
      const DepthFieldLevel& level = view.levels[k];
      const int u0 = tile_u == 0 ? -kGoesOn : tile_u * kSize >> k;
      const int v0 = tile_v == 0 ? -kGoesOn : tile_v * kSize >> k;
      const int u1 =
          tile_u == last_u ? level.width + kGoesOn : (((tile_u + 1) * kSize - 1) >> k) + 1;
      const int v1 =
          tile_v == last_v ? level.height + kGoesOn : (((tile_v + 1) * kSize - 1) >> k) + 1;
      for (int v = v0; v < v1; ++v) {
        for (int u = u0; u < u1; ++u) {
          const bool is_inside = u >= 0 && u < level.width && v >= 0 && v < level.height;
          const float* plane = level.planes + 2 * (std::ptrdiff_t{v} * level.stride + u);
          if (plane[1] == 0 || (is_inside && k > 0)) continue;
          nearest = std::min(nearest, plane[0] / plane[1]);
          min_slope = std::min(min_slope, plane[1]);
        }
      }
    }
    EXPECT_NEAR(view.tiles[tile].nearest, nearest, 1e-6) << tile;
    EXPECT_NEAR(view.tiles[tile].min_slope, min_slope, 1e-6) << tile;
  }
}

}  // namespace
}  // namespace palpate
