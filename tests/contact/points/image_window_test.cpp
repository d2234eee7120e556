#include "src/contact/points/scan/image_window.h"

#include <gtest/gtest.h>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

PointCloudView pinhole_view() {
  PointCloudView view;
  view.width = 640;
  view.height = 480;
  view.pinhole = true;
  view.intrinsics = {525, 520, 300.5, 251.25};
  return view;
}

TEST(ImageWindow, HoldsEveryPixelOfTheBox) {
  const PointCloudView view = pinhole_view();
  const Bounds box{{-0.1, -0.05, -0.02}, {0.08, 0.06, 0.12}};
  test::Random random(2);
  for (int i = 0; i < 500; ++i) {
    const Pose X_WT{{random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(0.05, 2)},
                    random.rotation(3)};
    const ImageWindow window = image_window(view, box, X_WT);
    EXPECT_LE(window.row_end, view.height);
    EXPECT_LE(window.column_end, view.width);
    for (int k = 0; k < 200; ++k) {
      const Vec3d p_W =
          X_WT * Vec3d{random.uniform(box.low.x, box.high.x), random.uniform(box.low.y, box.high.y),
                       random.uniform(box.low.z, box.high.z)};
      if (p_W.z <= 0) continue;
      const double u = std::round(view.intrinsics.fx * p_W.x / p_W.z + view.intrinsics.cx);
      const double v = std::round(view.intrinsics.fy * p_W.y / p_W.z + view.intrinsics.cy);
      if (u < 0 || v < 0 || u >= view.width || v >= view.height) continue;
      EXPECT_TRUE(u >= window.column_begin && u < window.column_end);
      EXPECT_TRUE(v >= window.row_begin && v < window.row_end);
    }
  }
}

TEST(ImageWindow, IsSmallWhenItCanBeAndEverythingWhenItMust) {
  const PointCloudView view = pinhole_view();
  const Bounds box{{-0.1, -0.1, -0.1}, {0.1, 0.1, 0.1}};
  const ImageWindow ahead = image_window(view, box, {{0, 0, 1}, {}});
  EXPECT_LT(ahead.row_end - ahead.row_begin, 125);
  EXPECT_LT(ahead.column_end - ahead.column_begin, 125);
  const ImageWindow around = image_window(view, box, {{0, 0, 0.05}, {}});
  EXPECT_EQ(around.column_end - around.column_begin, view.width);
  const ImageWindow beside = image_window(view, box, {{9, 0, 1}, {}});
  EXPECT_EQ(beside.column_begin, beside.column_end);
  PointCloudView unorganized = view;
  unorganized.pinhole = false;
  EXPECT_EQ(image_window(unorganized, box, {{9, 0, 1}, {}}).row_end, view.height);
}

}  // namespace
}  // namespace palpate
