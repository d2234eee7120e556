// A ball cut by two planes: the closed form against quadrature, limits and finite differences.
#include "src/math/internal/two_plane_cut.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

struct Case {
  double radius, a, b, cosine;
};

Case random_case(test::Random& random) {
  const double radius = random.uniform(0.1, 2);
  // Some planes miss the ball; some are nearly parallel.
  const double angle = random.uniform() < 0.2
                           ? random.uniform(-1, 1) * 1e-3 + (random.uniform() < 0.5 ? 0 : kPi)
                           : random.uniform(0, kPi);
  return {radius, radius * random.uniform(-1.2, 1.2), radius * random.uniform(-1.2, 1.2),
          std::cos(angle)};
}

TwoPlaneCut<double> cut(const Case& c) { return two_plane_cut(c.radius, c.a, c.b, c.cosine); }

// Computes the area of the part of a disc where y <= t.
double disc_part(double radius, double t) {
  if (t >= radius) return kPi * radius * radius;
  if (t <= -radius) return 0;
  return radius * radius * (kPi - std::acos(t / radius)) + t * std::sqrt(radius * radius - t * t);
}

// Slices across plane a: discs of which plane b leaves a part.
double volume_by_slices(const Case& c, int num = 20000) {
  const double sine = std::sqrt(std::max(0.0, 1 - c.cosine * c.cosine));
  const double high = std::min(-c.a, c.radius);
  if (high <= -c.radius) return 0;
  // x = high - (high + R) s^2 (3 - 2 s): dense at both ends, where the slices change fastest.
  double sum = 0;
  for (int i = 0; i < num; ++i) {
    const double s = (i + 0.5) / num;
    const double x = -c.radius + (high + c.radius) * s * s * (3 - 2 * s);
    const double weight = (high + c.radius) * 6 * s * (1 - s) / num;
    const double radius = std::sqrt(std::max(0.0, c.radius * c.radius - x * x));
    const double t = -c.b - c.cosine * x;
    sum += weight * (sine > 0 ? disc_part(radius, t / sine) : (t >= 0 ? kPi * radius * radius : 0));
  }
  return sum;
}

// Chords along the line in which the planes meet, over a grid.
double volume_by_chords(const Case& c, int num = 1000) {
  const double sine = std::sqrt(1 - c.cosine * c.cosine), cell = 2 * c.radius / num;
  double sum = 0;
  for (int i = 0; i < num; ++i) {
    const double x = -c.radius + (i + 0.5) * cell;
    for (int j = 0; j < num; ++j) {
      const double y = -c.radius + (j + 0.5) * cell;
      const double squared = c.radius * c.radius - x * x - y * y;
      if (squared > 0 && x <= -c.a && c.cosine * x + sine * y <= -c.b) {
        sum += 2 * std::sqrt(squared) * cell * cell;
      }
    }
  }
  return sum;
}

TEST(TwoPlaneCut, EqualsQuadratureOfSlices) {
  test::Random random(1);
  for (int i = 0; i < 1200; ++i) {
    const Case c = random_case(random);
    // Nearly parallel planes cut the slices off all at once: a coarse sum.
    const double tolerance = std::abs(c.cosine) > 0.999999 ? 1e-4 : 1e-6;
    ASSERT_NEAR(cut(c).volume, volume_by_slices(c), tolerance * sphere_volume(c.radius)) << i;
  }
}

TEST(TwoPlaneCut, EqualsQuadratureOfChords) {
  test::Random random(2);
  for (int i = 0; i < 20; ++i) {
    const Case c = random_case(random);
    ASSERT_NEAR(cut(c).volume, volume_by_chords(c), 2e-3 * sphere_volume(c.radius)) << i;
  }
}

TEST(TwoPlaneCut, AreasAreItsGradient) {
  test::Random random(3);
  for (int i = 0; i < 1000; ++i) {
    const Case c = random_case(random);
    const double h = 1e-5 * c.radius, disc = kPi * c.radius * c.radius;
    const auto moved = [&](double a, double b) {
      return two_plane_cut(c.radius, c.a + a, c.b + b, c.cosine).volume;
    };
    const TwoPlaneCut<double> result = cut(c);
    // Nearly parallel planes turn a small step into a large one along their common line.
    const double tolerance = std::abs(c.cosine) > 0.999 ? 3e-2 : 3e-4;
    ASSERT_NEAR(result.area_a, (moved(-h, 0) - moved(h, 0)) / (2 * h), tolerance * disc) << i;
    ASSERT_NEAR(result.area_b, (moved(0, -h) - moved(0, h)) / (2 * h), tolerance * disc) << i;
  }
}

TEST(TwoPlaneCut, NeverMoreThanEitherCap) {
  test::Random random(4);
  for (int i = 0; i < 2000; ++i) {
    const Case c = random_case(random);
    const double a = cap_volume(c.radius, c.a), b = cap_volume(c.radius, c.b);
    const double ball = sphere_volume(c.radius), common = cut(c).volume;
    ASSERT_GE(common, std::max(0.0, a + b - ball) - 1e-12 * ball);
    ASSERT_LE(common, std::min(a, b) + 1e-12 * ball);
    const double swapped = two_plane_cut(c.radius, c.b, c.a, c.cosine).volume;
    ASSERT_NEAR(common, swapped, 1e-12 * ball);
    // The part behind neither is in front of both planes.
    const double front = two_plane_cut(c.radius, -c.a, -c.b, c.cosine).volume;
    ASSERT_NEAR(a + b - common, ball - front, 1e-7 * ball);
  }
}

TEST(TwoPlaneCut, Limits) {
  const double ball = sphere_volume(1.0);
  EXPECT_NEAR(two_plane_cut(1.0, 0.0, 0.0, 0.0).volume, kPi / 3, 1e-15);  // a quarter
  EXPECT_NEAR(two_plane_cut(1.0, 0.0, 0.0, -0.5).volume, ball / 6, 1e-15);
  // Parallel: the plane farther back decides; opposed: a slab, or nothing.
  EXPECT_EQ(two_plane_cut(1.0, 0.2, -0.1, 1.0).volume, cap_volume(1.0, 0.2));
  EXPECT_DOUBLE_EQ(two_plane_cut(1.0, -0.3, -0.2, -1.0).volume,
                   cap_volume(1.0, -0.3) + cap_volume(1.0, -0.2) - ball);
  EXPECT_EQ(two_plane_cut(1.0, 0.3, -0.2, -1.0).volume, 0);
  // A plane that misses the ball: all or nothing.
  EXPECT_EQ(two_plane_cut(1.0, 0.4, -1.0, 0.3).volume, cap_volume(1.0, 0.4));
  EXPECT_EQ(two_plane_cut(1.0, -2.0, 0.4, 0.3).volume, cap_volume(1.0, 0.4));
  EXPECT_DOUBLE_EQ(two_plane_cut(1.0, -2.0, -1.0, 0.3).volume, ball);
  EXPECT_EQ(two_plane_cut(1.0, 0.4, 1.0, 0.3).volume, 0);
  EXPECT_EQ(two_plane_cut(1.0, 1.5, -3.0, 0.3).volume, 0);
}

TEST(TwoPlaneCut, ContinuousWhereItsCasesMeet) {
  test::Random random(5);
  for (int i = 0; i < 500; ++i) {
    const Case from = random_case(random), to = random_case(random);
    double last = 0;
    const int num = 400;
    for (int k = 0; k <= num; ++k) {
      const double s = static_cast<double>(k) / num;
      const double a = (1 - s) * from.a / from.radius + s * to.a / to.radius;
      const double b = (1 - s) * from.b / from.radius + s * to.b / to.radius;
      const double angle = (1 - s) * std::acos(from.cosine) + s * std::acos(to.cosine);
      const double volume = two_plane_cut(1.0, a, b, std::cos(angle)).volume;
      if (k > 0) {
        ASSERT_LT(std::abs(volume - last), 20.0 / num) << i << ", " << k;
      }
      last = volume;
    }
  }
}

TEST(TwoPlaneCut, SinglePrecisionIsClose) {
  test::Random random(6);
  for (int i = 0; i < 1000; ++i) {
    const Case c = random_case(random);
    const TwoPlaneCut<float> single =
        two_plane_cut(static_cast<float>(c.radius), static_cast<float>(c.a),
                      static_cast<float>(c.b), static_cast<float>(c.cosine));
    ASSERT_NEAR(static_cast<double>(single.volume), cut(c).volume, 2e-3 * sphere_volume(c.radius))
        << i;
  }
}

}  // namespace
}  // namespace palpate
