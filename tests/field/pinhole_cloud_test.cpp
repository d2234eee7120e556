#include "src/field/internal/pinhole_cloud.h"

#include <gtest/gtest.h>

#include "palpate/field/depth_field.h"
#include "src/field/internal/field_point.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

const Intrinsics kCamera{150, 152, 79.3, 61.1};

PointCloud wall(double noise) {
  test::Random random(1);
  PointCloud cloud(160, 120);
  for (int v = 0; v < 120; ++v) {
    for (int u = 0; u < 160; ++u) {
      if (random.uniform() < 0.1) continue;
      const double z = 0.7 + 0.001 * v;
      const double x = (u + noise * random.normal() - kCamera.cx) * z / kCamera.fx;
      cloud.set(static_cast<std::size_t>(v * 160 + u),
                to_float({x, (v - kCamera.cy) * z / kCamera.fy, z}), {0, 0, -1});
    }
  }
  return cloud;
}

TEST(PinholeCloud, FindsTheCameraOfAnOrganizedCloud) {
  const auto found = make_pinhole_cloud(wall(0).view());
  ASSERT_TRUE(found);
  ASSERT_TRUE(found->view().pinhole);
  EXPECT_EQ(found->width(), 160);
  const Intrinsics k = found->view().intrinsics;
  EXPECT_NEAR(k.fx, kCamera.fx, 1e-2);
  EXPECT_NEAR(k.fy, kCamera.fy, 1e-2);
  EXPECT_NEAR(k.cx, kCamera.cx, 1e-2);
  EXPECT_NEAR(k.cy, kCamera.cy, 1e-2);
}

// Points that lie on no grid: an image is made for them.
TEST(PinholeCloud, PutsLoosePointsIntoAnImage) {
  PointCloud loose(20000, 1);
  test::Random random(2);
  for (std::size_t i = 0; i < loose.size(); ++i) {
    loose.set(i, to_float({random.uniform(-0.3, 0.3), random.uniform(-0.2, 0.2), 0.9}), {0, 0, -1});
  }
  for (const PointCloud& cloud : {loose, wall(2)}) {
    const auto image = make_pinhole_cloud(cloud.view());
    ASSERT_TRUE(image);
    ASSERT_TRUE(image->view().pinhole);
    EXPECT_GT(image->width(), 50);
    EXPECT_LT(image->size(), 2 * cloud.size());
    int num = 0;
    for (std::size_t i = 0; i < image->size(); ++i) {
      const PointCloudView seen = image->view();
      if (!(seen.z[i] > 0)) continue;
      const auto width = static_cast<std::size_t>(seen.width);
      const Intrinsics& k = seen.intrinsics;
      EXPECT_NEAR(k.fx * seen.x[i] / seen.z[i] + k.cx, static_cast<double>(i % width), 0.501);
      EXPECT_NEAR(k.fy * seen.y[i] / seen.z[i] + k.cy, static_cast<double>(i / width), 0.501);
      ++num;
    }
    EXPECT_GT(num, static_cast<int>(cloud.size() / 3));
    ThreadPool pool(1);
    DepthField field = std::move(DepthField::create(image->width(), image->height())).value();
    field.update(image->view(), pool);
    const double depth = cloud.height() == 1 ? 0.9 : 0.7 + 0.001 * kCamera.cy;
    EXPECT_NEAR(sample_field(field.view(), {0.0, 0.0, depth + 0.02}, 0.01).phi, -0.02, 2e-3);
    EXPECT_NEAR(sample_field(field.view(), {0.03, 0.02, depth - 0.005}, 0.01).phi, 0.005, 2e-2);
  }
}

TEST(PinholeCloud, RefusesACloudBehindTheCamera) {
  PointCloud cloud(3, 1);
  cloud.set(0, {0, 0, -1}, {0, 0, 1});
  const auto image = make_pinhole_cloud(cloud.view());
  ASSERT_FALSE(image);
  EXPECT_NE(image.error().message.find("in front of the camera"), std::string::npos);
}

}  // namespace
}  // namespace palpate
