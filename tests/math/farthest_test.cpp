// The farthest point of points and spheres against distances that are known.
#include "src/math/internal/farthest.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

TEST(Farthest, IsTheCornerOfABox) {
  std::vector<Vec3d> corners;
  for (int i = 0; i < 8; ++i) corners.push_back({2.0 * (i & 1), 3.0 * (i / 2 & 1), 6.0 * (i / 4)});
  EXPECT_EQ(farthest(corners, {}), 7);
  EXPECT_EQ(farthest(corners, {1, 1.5, 3}), 3.5);
  EXPECT_EQ(farthest(std::vector<Vec3d>{}, {1, 2, 3}), 0);
}

TEST(Farthest, IsTheFarSideOfASphere) {
  const std::vector<Sphere> spheres = {{{0, 0, 0}, 4}, {{3, 4, 0}, 0.5f}};
  EXPECT_EQ(farthest(spheres, {}), 5.5);
  EXPECT_EQ(farthest(spheres, {}, 2), 8);
  EXPECT_EQ(farthest(std::vector<Sphere>{}, {1, 2, 3}), 0);
}

TEST(Farthest, NoPointOfASphereIsFartherAndOneIsAsFar) {
  test::Random random(1);
  for (int n = 0; n < 100; ++n) {
    const std::vector<Sphere> spheres = {{to_float(random.in_box(1)), 0.3f},
                                         {to_float(random.in_box(1)), 0.5f}};
    const Vec3d center = random.in_box(1);
    const double distance = farthest(spheres, center);
    double largest = 0;
    for (const Sphere& s : spheres) {
      for (int i = 0; i < 3000; ++i) {
        const Vec3d p = to_double(s.center) + double{s.radius} * random.direction();
        largest = std::max(largest, norm(p - center));
      }
    }
    EXPECT_LE(largest, distance + 1e-12);
    EXPECT_GT(largest, distance - 0.01);
  }
}

}  // namespace
}  // namespace palpate
