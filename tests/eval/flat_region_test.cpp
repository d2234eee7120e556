// The largest flat region of images made up with a plane in them.
#include "eval/studies/flat_region.h"

#include <gtest/gtest.h>

#include "tests/eval/noisy_picture.h"

namespace palpate::eval {
namespace {

/// A plane left of column `border`, a ball beside it.
DepthFrame picture(const DepthStreamInfo& stream, const Plane<double>& plane, int border) {
  return noisy_picture(stream, [&](int u, int v, const Vec3d& ray) {
    const double flat = plane.offset / dot(plane.normal, ray);
    const double round = 0.8 + 3e-6 * ((u - 280) * (u - 280) + (v - 120) * (v - 120));
    return u < border ? flat : round;
  });
}

DepthStreamInfo camera() { return made_up_camera(320, 240, 300); }

TEST(FlatRegion, IsThePlaneAndEndsWhereItEnds) {
  const DepthStreamInfo stream = camera();
  const Vec3d n = normalized(Vec3d{0.3, -0.2, -1});
  const Plane<double> plane{n, dot(n, Vec3d{0, 0, 1})};
  const DepthFrame frame = picture(stream, plane, 200);
  const auto region = largest_flat_region(stream, frame);
  ASSERT_TRUE(region);
  EXPECT_LT(norm(region->plane_C.normal - n), 2e-3);
  EXPECT_NEAR(region->plane_C.offset, plane.offset, 1e-3);
  EXPECT_NEAR(static_cast<double>(region->pixels.size()), 200 * 240, 0.03 * 200 * 240);
  for (const std::size_t pixel : region->pixels) EXPECT_LT(pixel % 320, 208u);
  // The cell farthest from what is outside lies as far from the border as from the image's edge.
  EXPECT_NEAR(region->max_within(), 200 / FlatRegion::kCell / 2, 1);
  for (const Vec3d& p : region->places(stream, 1)) {
    EXPECT_NEAR(dot(p, region->plane_C.normal), region->plane_C.offset, 1e-12);
  }
}

TEST(FlatRegion, IsNoneWhereNothingIsFlatOrSeen) {
  const DepthStreamInfo stream = camera();
  DepthFrame frame = picture(stream, {{0, 0, -1}, -1}, 320);
  Random random(1);
  for (auto& pixel : frame.pixels) {
    pixel = static_cast<std::uint16_t>(pixel * random.uniform(0.7, 1.3));
  }
  EXPECT_FALSE(largest_flat_region(stream, frame));
  std::fill(frame.pixels.begin(), frame.pixels.end(), std::uint16_t{0});
  EXPECT_FALSE(largest_flat_region(stream, frame));
}

}  // namespace
}  // namespace palpate::eval
