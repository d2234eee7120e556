// Donors that may be left out, against all corners of the box in double.
#include "src/contact/points/donors/assignment_rule.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

using test::Random;

// The difference of the squared distances to two donors is linear, so some center in the box is
// nearer to one of them if some corner is. From tools of millimeters to ones of many meters.
TEST(AssignmentRule, LeavesOutDonorsThatAreNearestToNoCornerAndNoOthers) {
  Random random(91);
  int num_left_out = 0, num_kept = 0;
  for (int n = 0; n < 100'000; ++n) {
    const float size = static_cast<float>(std::pow(10, random.uniform(-3, 2)));
    const auto point = [&] { return size * to_float(random.in_box(1)); };
    Cluster box;
    box.half_size =
        0.3f * size *
        Vec3f{static_cast<float>(random.uniform()), static_cast<float>(random.uniform()),
              static_cast<float>(random.uniform())};
    const Vec3f a = point(), b = point();
    const auto squared = [](const Vec3d& v) { return dot(v, v); };
    const double square_a = squared(to_double(a)), square_b = squared(to_double(b));
    if (square_a > square_b) continue;
    double most = -1e300;  // by how much b is nearer than a
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3d p{(corner & 1 ? 1 : -1) * double{box.half_size.x},
                    (corner & 2 ? 1 : -1) * double{box.half_size.y},
                    (corner & 4 ? 1 : -1) * double{box.half_size.z}};
      most = std::max(most, squared(to_double(a) - p) - squared(to_double(b) - p));
    }
    const bool is_kept =
        one_lane::may_be_nearest(b.x, b.y, b.z, static_cast<float>(square_b),
                                 {a.x, a.y, a.z, static_cast<float>(square_a)}, box);
    // Rounding may keep one more, never one fewer.
    if (most >= 0) {
      EXPECT_TRUE(is_kept) << size;
    } else if (most < -2e-5 * square_b) {
      EXPECT_FALSE(is_kept) << size;
    }
    ++(is_kept ? num_kept : num_left_out);
  }
  EXPECT_GT(num_kept, 5000);
  EXPECT_GT(num_left_out, 5000);
}

}  // namespace
}  // namespace palpate
