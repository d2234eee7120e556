// A ball in parts has its volume and its moments, and behind any plane as much as the ball.
#include "src/contact/internal/ball_parts.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

/// Returns the share of a ball's volume behind a plane at `distance` from its center.
double cap_share(double radius, double distance) {
  const double h = std::clamp(radius - distance, 0.0, 2 * radius);
  return h * h * (3 * radius - h) / (4 * radius * radius * radius);
}

struct PlaneError {
  double rms = 0, most = 0;
};
PlaneError behind_planes(const std::vector<BallPart>& parts) {
  test::Random random(3);
  PlaneError error;
  const int num = 4000;
  for (int i = 0; i < num; ++i) {
    const Vec3d n = rotate(random.rotation(kPi), Vec3d{0, 0, 1});
    const double distance = random.uniform(-1.0, 1.0);
    double sum = 0;
    for (const BallPart& part : parts) {
      sum += part.share * cap_share(part.radius, distance - dot(part.center, n));
    }
    const double off = sum - cap_share(1, distance);
    error.rms += off * off / num;
    error.most = std::max(error.most, std::abs(off));
  }
  error.rms = std::sqrt(error.rms);
  return error;
}

TEST(BallParts, HaveTheMomentsOfTheBall) {
  for (const double radius : {0.0, 0.4, 0.25, 0.1}) {
    double volume = 0, second = 0;
    Vec3d first;
    for (const BallPart& part : radius > 0 ? even_parts(radius) : thirty_parts()) {
      volume += part.share;
      first += part.share * part.center;
      second += part.share * (dot(part.center, part.center) + 0.6 * part.radius * part.radius);
    }
    EXPECT_NEAR(volume, 1, 1e-12) << radius;
    EXPECT_LT(norm(first), 1e-12) << radius;
    EXPECT_NEAR(second, 0.6, radius > 0.2 ? 0.018 : 0.01)
        << radius << ": flat cells count as balls";
  }
}

TEST(BallParts, AreCutAsTheBallIs) {
  for (const double radius : {0.15, 0.08}) {
    const PlaneError even = behind_planes(even_parts(radius));
    EXPECT_LT(even.rms, 0.0012) << radius;
    EXPECT_LT(even.most, 0.004) << radius;
  }
}

// Gaps between the parts, or a part that reaches out of the ball, would falsify contacts.
TEST(BallParts, FillTheBallEvenlyAndKeepToIt) {
  for (const double radius : {0.15, 0.08}) {
    const std::vector<BallPart> parts = even_parts(radius);
    const double whole = radius * radius * radius;
    EXPECT_NEAR(static_cast<double>(parts.size()) * whole, 1.3, 0.3);
    double farthest = 0;
    for (const BallPart& part : parts) {
      EXPECT_LT(part.radius, 1.02 * radius);
      farthest = std::max(farthest, norm(part.center) + part.radius);
    }
    EXPECT_LT(farthest, 1 + 0.6 * radius);
    // Balls that lie within, as wide as four parts.
    test::Random random(4);
    const double wide = 4 * radius;
    for (int i = 0; i < 200; ++i) {
      const Vec3d at =
          (1 - wide) * random.uniform(0.0, 1.0) * rotate(random.rotation(kPi), Vec3d{0, 0, 1});
      double sum = 0;
      for (const BallPart& part : parts) {
        sum += part.share * lens_volume(part.radius, wide, norm(part.center - at)) /
               sphere_volume(part.radius);
      }
      const double share = wide * wide * wide;
      EXPECT_NEAR(sum, share, 0.03 * share);
    }
  }
}

}  // namespace
}  // namespace palpate
