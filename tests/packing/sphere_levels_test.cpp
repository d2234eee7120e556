#include "src/packing/sphere_levels.h"

#include <algorithm>
#include <set>

#include <gtest/gtest.h>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

TEST(SphereLevels, AgreesWithBruteForce) {
  test::Random random(4);
  SphereLevels levels;
  std::vector<Sphere> spheres;
  for (int i = 0; i < 3000; ++i) {
    // Radii over three decades, in no order.
    spheres.push_back({to_float(random.in_box(1)),
                       static_cast<float>(0.1 * std::pow(10, random.uniform(-3, 0)))});
    levels.insert(spheres.back());
    if (i % 30 != 0) continue;
    const Vec3d p = random.in_box(1.2);
    for (double reach : {1e-4, 1e-2, 0.1, 1.0}) {
      double expected = reach;
      std::set<float> near;
      for (const Sphere& s : spheres) {
        const double gap = norm(p - to_double(s.center)) - static_cast<double>(s.radius);
        expected = std::min(expected, gap);
        if (gap <= reach) near.insert(s.center.x);
      }
      const double found = levels.clearance(p, reach);
      if (expected > 0) {
        EXPECT_DOUBLE_EQ(found, expected);
      } else {
        EXPECT_LE(found, 0);
      }
      std::vector<Sphere> gathered;
      ASSERT_TRUE(levels.gather(p, reach, 100000, gathered));
      std::set<float> seen;
      for (const Sphere& s : gathered) seen.insert(s.center.x);
      EXPECT_EQ(seen, near);
      gathered.clear();
      if (near.size() > 1) {
        EXPECT_FALSE(levels.gather(p, reach, near.size() - 1, gathered));
      }
    }
  }
}

TEST(SphereLevels, EmptyIsFree) { EXPECT_EQ(SphereLevels().clearance({1, 2, 3}, 0.5), 0.5); }

}  // namespace
}  // namespace palpate
