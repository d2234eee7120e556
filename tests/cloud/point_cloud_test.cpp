#include "palpate/cloud/point_cloud.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

namespace palpate {
namespace {

bool is_invalid(const PointCloud& cloud, std::size_t i) {
  for (int channel = 0; channel < 6; ++channel) {
    if (!std::isnan(cloud.channel(channel)[i])) return false;
  }
  return true;
}

TEST(PointCloud, StartsInvalidUpToTheLastPaddingPoint) {
  const PointCloud cloud(13, 7);
  const std::size_t padded = 128;
  for (std::size_t i = 0; i < padded; ++i) EXPECT_TRUE(is_invalid(cloud, i)) << i;
  EXPECT_EQ(cloud.view().size(), 91u);
  EXPECT_FALSE(cloud.view().pinhole);
  EXPECT_EQ(static_cast<std::size_t>(cloud.view().y - cloud.view().x), padded);
}

TEST(PointCloud, SetNormalizesAndTheViewSeesIt) {
  const Intrinsics k{500, 501, 6, 3};
  PointCloud cloud(13, 7, k);
  cloud.set(90, {1, 2, 3}, {0, 3e-30f, -4e-30f});
  const PointCloudView view = cloud.view();
  EXPECT_EQ(view.x[90], 1.0f);
  EXPECT_EQ(view.y[90], 2.0f);
  EXPECT_EQ(view.z[90], 3.0f);
  EXPECT_EQ(view.nx[90], 0.0f);
  EXPECT_FLOAT_EQ(view.ny[90], 0.6f);
  EXPECT_FLOAT_EQ(view.nz[90], -0.8f);
  EXPECT_EQ(cloud.point(90), (Vec3f{1, 2, 3}));
  EXPECT_TRUE(view.pinhole);
  EXPECT_EQ(view.intrinsics, k);
  cloud.set(3, {1, 1, 1}, {3e38f, 3e38f, 0});
  EXPECT_FLOAT_EQ(cloud.normal(3).x, std::sqrt(0.5f));
}

TEST(PointCloud, AnythingNotFiniteMakesThePointInvalid) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  PointCloud cloud(8, 1);
  const Vec3f p{1, 2, 3}, n{0, 0, -1};
  for (float bad : {nan, infinity, -infinity}) {
    for (int axis = 0; axis < 3; ++axis) {
      Vec3f bad_p = p, bad_n = n;
      bad_p[axis] = bad_n[axis] = bad;
      cloud.set(5, p, n);
      ASSERT_FALSE(is_invalid(cloud, 5));
      cloud.set(5, bad_p, n);
      EXPECT_TRUE(is_invalid(cloud, 5));
      cloud.set(5, p, n);
      cloud.set(5, p, bad_n);
      EXPECT_TRUE(is_invalid(cloud, 5));
    }
  }
  cloud.set(5, p, n);
  cloud.set(5, p, {0, 0, 0});
  EXPECT_TRUE(is_invalid(cloud, 5));
}

}  // namespace
}  // namespace palpate
