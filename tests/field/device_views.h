// Compares what is on a GPU with what the CPU made.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/field/depth_field.h"
#include "src/gpu/internal/runtime.h"

namespace palpate::test {

/// All that a view shows, in host memory.
struct ShownField {
  std::vector<float> planes;
  std::vector<std::uint8_t> near_silhouette;
  std::vector<float> silhouettes;  ///< of the nine pixels around those that are near any
  std::vector<DepthTile> tiles;
  std::vector<std::uint8_t> filled_behind;  ///< of level 0, if it is known
};

inline ShownField shown_by(const DepthFieldView& view, gpu::Stream& stream) {
  constexpr int kBorder = DepthFieldLevel::kBorder;
  ShownField shown;
  // The copies are not page-locked: fine for a test.
  for (int k = 0; k < view.num_levels; ++k) {
    const DepthFieldLevel& level = view.levels[k];
    const std::ptrdiff_t first = -kBorder * (level.stride + 1);
    const auto rows = static_cast<std::size_t>(level.height + 2 * kBorder);
    const auto stride = static_cast<std::size_t>(level.stride);
    const std::size_t size = rows * stride;
    std::vector<float> planes(2 * size);
    std::vector<std::uint8_t> near_silhouette(size);
    std::vector<Silhouette> silhouettes(2 * size);
    stream.copy(planes.data(), level.planes + 2 * first, planes.size() * sizeof(float));
    stream.copy(near_silhouette.data(), level.near_silhouette + first, size);
    stream.copy(silhouettes.data(), level.silhouettes + 2 * first,
                silhouettes.size() * sizeof(Silhouette));
    EXPECT_TRUE(stream.wait()) << stream.status().error().message;
    // Beside a narrower level's border nothing is shown.
    for (std::size_t row = 0; row < rows; ++row) {
      const std::size_t begin = row * stride;
      const auto end = begin + static_cast<std::size_t>(level.width + 2 * kBorder);
      for (std::size_t i = begin; i < end; ++i) {
        shown.planes.insert(shown.planes.end(), {planes[2 * i], planes[2 * i + 1]});
        shown.near_silhouette.push_back(near_silhouette[i]);
        if (near_silhouette[i] == 0) continue;
        for (std::size_t around = 0; around < 9;
             ++around) {  // elsewhere what is written there may be old
          const std::size_t at = i + around % 3 - 1 + around / 3 * stride - stride;
          for (const Silhouette& one : {silhouettes[2 * at], silhouettes[2 * at + 1]}) {
            shown.silhouettes.insert(shown.silhouettes.end(), {one.side, one.offset, one.slope});
          }
        }
      }
    }
  }
  shown.tiles.resize(static_cast<std::size_t>(view.tiles_wide * view.tiles_high));
  stream.copy(shown.tiles.data(), view.tiles, shown.tiles.size() * sizeof(DepthTile));
  if (view.filled_behind != nullptr && view.num_levels > 0) {
    const DepthFieldLevel& finest = view.levels[0];
    const auto stride = static_cast<std::size_t>(view.filled_stride);
    std::vector<std::uint32_t> words(stride * static_cast<std::size_t>(finest.height));
    stream.copy(words.data(), view.filled_behind, words.size() * sizeof(std::uint32_t));
    EXPECT_TRUE(stream.wait()) << stream.status().error().message;
    for (std::size_t v = 0; v < static_cast<std::size_t>(finest.height); ++v) {
      for (std::size_t u = 0; u < static_cast<std::size_t>(finest.width); ++u) {
        shown.filled_behind.push_back(words[v * stride + u / 32] >> u % 32 & 1);
      }
    }
  }
  EXPECT_TRUE(stream.wait()) << stream.status().error().message;
  return shown;
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

inline void expect_same_field(const DepthFieldView& got, const DepthFieldView& want,
                              gpu::Stream& stream) {
  ASSERT_EQ(got.num_levels, want.num_levels);
  for (int k = 0; k < want.num_levels; ++k) {
    const DepthFieldLevel &a = got.levels[k], &b = want.levels[k];
    EXPECT_EQ(a.width, b.width);
    EXPECT_EQ(a.height, b.height);
    EXPECT_EQ(a.scale, b.scale);
    EXPECT_EQ(a.last_u, b.last_u);
    EXPECT_EQ(a.last_v, b.last_v);
  }
  EXPECT_EQ(got.tiles_wide, want.tiles_wide);
  EXPECT_EQ(got.tiles_high, want.tiles_high);
  EXPECT_EQ(got.thickness, want.thickness);
  EXPECT_EQ(got.intrinsics.fx, want.intrinsics.fx);
  const ShownField a = shown_by(got, stream), b = shown_by(want, stream);
  EXPECT_TRUE(same_bits(a.planes, b.planes));
  EXPECT_TRUE(same_bits(a.near_silhouette, b.near_silhouette));
  EXPECT_TRUE(same_bits(a.silhouettes, b.silhouettes));
  EXPECT_TRUE(same_bits(a.tiles, b.tiles));
  if (got.filled_behind != nullptr) {
    EXPECT_EQ(a.filled_behind, b.filled_behind);
  }
}

/// Points, normals and depth-change vectors.
inline void expect_same_cloud(const PointCloudView& got, const PointCloudView& want,
                              gpu::Stream& stream) {
  ASSERT_EQ(got.width, want.width);
  ASSERT_EQ(got.height, want.height);
  EXPECT_EQ(got.pinhole, want.pinhole);
  EXPECT_EQ(got.intrinsics.cy, want.intrinsics.cy);
  const auto channels = [](const PointCloudView& view) {
    return std::vector{view.x,  view.y,      view.z,      view.nx,    view.ny,
                       view.nz, view.edge_x, view.edge_y, view.edge_z};
  };
  const auto a = channels(got), b = channels(want);
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_NE(a[i], nullptr);
    std::vector<float> values(want.size());
    stream.copy(values.data(), a[i], values.size() * sizeof(float));
    ASSERT_TRUE(stream.wait()) << stream.status().error().message;
    // One NaN is as good as another.
    for (std::size_t k = 0; k < values.size(); ++k) {
      if (std::isnan(values[k]) && std::isnan(b[i][k])) continue;
      ASSERT_EQ(values[k], b[i][k]) << "channel " << i << ", point " << k;
    }
  }
}

}  // namespace palpate::test
