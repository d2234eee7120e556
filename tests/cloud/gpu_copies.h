// Results on a GPU as the host sees them.
#pragma once

#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/cloud/point_cloud.h"
#include "src/gpu/internal/runtime.h"

namespace palpate::test {

inline std::vector<float> copy_to_host(gpu::Stream& stream, const float* on_gpu, std::size_t num) {
  std::vector<float> values(num);
  stream.copy(values.data(), on_gpu, num * sizeof(float));
  EXPECT_TRUE(stream.wait()) << stream.status().error().message;
  return values;
}

/// Bit for bit, any NaN being like any other.
inline void expect_same_bits(const std::vector<float>& got, const float* expected,
                             const char* what) {
  for (std::size_t i = 0; i < got.size(); ++i) {
    if (std::isnan(got[i]) && std::isnan(expected[i])) continue;
    ASSERT_EQ(std::memcmp(&got[i], &expected[i], sizeof(float)), 0)
        << what << " " << i << ": " << got[i] << ", not " << expected[i];
  }
}

/// The six arrays of a cloud on a GPU, padding included, against one in host memory; and the
/// depth-change vectors if both have them.
inline void expect_same_cloud(gpu::Stream& stream, const PointCloudView& got,
                              const PointCloudView& expected) {
  ASSERT_EQ(got.width, expected.width);
  ASSERT_EQ(got.height, expected.height);
  EXPECT_EQ(got.gpu, 0);
  EXPECT_EQ(got.pinhole, expected.pinhole);
  EXPECT_EQ(got.intrinsics, expected.intrinsics);
  constexpr std::size_t kPadding = PointCloudView::kPadding;
  const std::size_t padded = (got.size() + kPadding - 1) / kPadding * kPadding;
  const float* const from[6] = {got.x, got.y, got.z, got.nx, got.ny, got.nz};
  const float* const to[6] = {expected.x,  expected.y,  expected.z,
                              expected.nx, expected.ny, expected.nz};
  constexpr const char* kNames[6] = {"x", "y", "z", "nx", "ny", "nz"};
  for (int k = 0; k < 6; ++k)
    expect_same_bits(copy_to_host(stream, from[k], padded), to[k], kNames[k]);
  if (got.edge_x == nullptr || expected.edge_x == nullptr) return;
  expect_same_bits(copy_to_host(stream, got.edge_x, got.size()), expected.edge_x, "edge_x");
  expect_same_bits(copy_to_host(stream, got.edge_y, got.size()), expected.edge_y, "edge_y");
  expect_same_bits(copy_to_host(stream, got.edge_z, got.size()), expected.edge_z, "edge_z");
}

}  // namespace palpate::test
