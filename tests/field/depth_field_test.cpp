#include "palpate/field/depth_field.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/math/geometry.h"
#include "src/field/internal/field_point.h"
#include "tests/field/field_clouds.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using namespace test::field_clouds;  // NOLINT: all of it

Plane<double> tilted_plane() {
  const Vec3d n = normalized(Vec3d{0.3, -0.4, -0.9});
  return {n, dot(n, {0, 0, 0.8})};
}

double depth_of(const Plane<double>& plane, int u, int v) {
  return plane.offset /
         dot(plane.normal, {(u - kCamera.cx) / kCamera.fx, (v - kCamera.cy) / kCamera.fy, 1});
}

PointCloud plane_cloud() {
  const Plane<double> plane = tilted_plane();
  return make_cloud([&](int u, int v) { return depth_of(plane, u, v); },
                    [&](int, int) { return plane.normal; });
}

/// All numbers of a field, with the borders of its levels.
std::vector<float> numbers_of(const DepthFieldView& view) {
  std::vector<float> all;
  constexpr int kBorder = DepthFieldLevel::kBorder;
  for (int k = 0; k < view.num_levels; ++k) {
    const DepthFieldLevel& level = view.levels[k];
    for (int v = -kBorder; v < level.height + kBorder; ++v) {
      for (int u = -kBorder; u < level.width + kBorder; ++u) {
        const std::ptrdiff_t i = std::ptrdiff_t{v} * level.stride + u;
        all.insert(all.end(), {level.planes[2 * i], level.planes[2 * i + 1],
                               static_cast<float>(level.near_silhouette[i])});
        if (level.near_silhouette[i] == 0) continue;
        for (int around = 0; around < 9; ++around) {  // elsewhere what is written there may be old
          const std::ptrdiff_t at = i + (around / 3 - 1) * level.stride + around % 3 - 1;
          for (const Silhouette& one : {level.silhouettes[2 * at], level.silhouettes[2 * at + 1]}) {
            all.insert(all.end(), {one.side, one.offset, one.slope});
          }
        }
      }
    }
  }
  for (int i = 0; i < view.tiles_wide * view.tiles_high; ++i) {
    all.insert(all.end(), {view.tiles[i].nearest, view.tiles[i].min_slope});
  }
  return all;
}

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

Vec3d at_pixel(double u, double v, double z) {
  return {(u - kCamera.cx) * z / kCamera.fx, (v - kCamera.cy) * z / kCamera.fy, z};
}

TEST(DepthField, IsTheDistanceToAPlaneForSpheresOfAllSizes) {
  const Plane<double> plane = tilted_plane();
  const DepthField field = make_field(plane_cloud());
  test::Random random(1);
  for (int i = 0; i < 3000; ++i) {
    // Large spheres sample wide pixels, which must not reach over the border of the image.
    const double radius = 0.0005 * std::pow(40.0, random.uniform());
    const Vec3d p =
        at_pixel(random.uniform(50, 110), random.uniform(45, 75), random.uniform(0.7, 0.9));
    const FieldSample<double> got = sample_field(field.view(), p, radius);
    const double distance = dot(plane.normal, p) - plane.offset;
    if (distance < -0.03) continue;  // there the border of the image is near for the widest pixels
    // The rounding of the maximum over wider pixels makes the field deeper.
    const double bias = distance < -1.3 * radius ? -0.35 * distance : 0;
    EXPECT_NEAR(got.phi, distance, 2e-6 + bias) << radius;
    EXPECT_NEAR(norm(cross(got.gradient, plane.normal)), 0, 2e-5);
    EXPECT_NEAR(dot(got.gradient, plane.normal), 1, 2e-5 + (bias > 0 ? 0.051 : 0));
  }
}

TEST(DepthField, GradientIsTheDerivativeOfTheValueEverywhere) {
  for (const DepthFieldOptions& options :
       {DepthFieldOptions{UnknownSpace::free, 2}, DepthFieldOptions{UnknownSpace::solid, 2},
        DepthFieldOptions{UnknownSpace::free, 2, UnseenSpace::free, 0.03}}) {
    const DepthField field = make_field(rough_cloud(2), options);
    test::Random random(3);
    for (int i = 0; i < 4000; ++i) {
      const double radius = 0.001 * std::pow(50.0, random.uniform());
      // Also outside of the image, and behind both surfaces.
      const Vec3d p =
          at_pixel(random.uniform(-15, 175), random.uniform(-15, 135), random.uniform(0.4, 1.1));
      const FieldSample<double> at = sample_field(field.view(), p, radius);
      for (int axis = 0; axis < 3; ++axis) {
        constexpr double kStep = 1e-7;
        Vec3d low = p, high = p;
        low[axis] -= kStep;
        high[axis] += kStep;
        const double slope = (sample_field(field.view(), high, radius).phi -
                              sample_field(field.view(), low, radius).phi) /
                             (2 * kStep);
        EXPECT_NEAR(at.gradient[axis], slope, 2e-3 * (1 + norm(at.gradient))) << i << " " << axis;
      }
    }
  }
}

// The force on a sphere, V_cap(phi) grad phi, must be continuous: where nothing is near, the field
// only says so.
TEST(DepthField, ForceIsContinuous) {
  const DepthField solid = make_field(rough_cloud(4), {UnknownSpace::free, 2});
  const DepthField thin =
      make_field(rough_cloud(4), {UnknownSpace::free, 2, UnseenSpace::free, 0.03});
  test::Random random(5);
  for (int line = 0; line < 80; ++line) {
    const DepthField& field = line % 2 == 0 ? solid : thin;
    const double radius = 0.001 * std::pow(50.0, random.uniform());
    const Vec3d from =
        at_pixel(random.uniform(0, 160), random.uniform(0, 120), random.uniform(0.5, 1));
    const Vec3d to =
        at_pixel(random.uniform(0, 160), random.uniform(0, 120), random.uniform(0.5, 1));
    // The largest change over a step halves with the step; a jump would stay.
    const auto force = [&](double share) {
      const FieldSample<double> at =
          sample_field(field.view(), from * (1 - share) + to * share, radius);
      return cap_volume(radius, at.phi) / sphere_volume(radius) * at.gradient;
    };
    const auto largest_change = [&](int steps) {
      double largest = 0;
      Vec3d last = force(0);
      for (int k = 1; k <= steps; ++k) {
        const Vec3d next = force(static_cast<double>(k) / steps);
        largest = std::max(largest, norm(next - last));
        last = next;
      }
      return largest;
    };
    EXPECT_LT(largest_change(160000), 0.3 * largest_change(20000) + 1e-3) << line;
  }
}

TEST(DepthField, OneNoisyPixelHardlyMovesALargeSphere) {
  test::Random random(6);
  const PointCloud noisy = make_cloud([&](int, int) { return 0.8 + 0.003 * random.normal(); },
                                      [](int, int) {
                                        return Vec3d{0, 0, -1};
                                      });
  const DepthField field = make_field(noisy);
  const auto deviation = [&](double radius) {
    double sum = 0;
    for (int i = 0; i < 500; ++i) {
      const Vec3d p = at_pixel(random.uniform(60, 100), random.uniform(40, 80), 0.8);
      const double phi = sample_field(field.view(), p, radius).phi;
      sum += phi * phi / 500;
    }
    return std::sqrt(sum);
  };
  const double small = deviation(0.002), large = deviation(0.03);
  EXPECT_GT(small, 0.001);
  EXPECT_LT(large, 0.35 * small);
}

TEST(DepthField, SmallHolesAreClosedAndLargeOnesFree) {
  const Plane<double> plane = tilted_plane();
  const auto with_hole = [&](int half) {
    return make_cloud(
        [&](int u, int v) -> double {
          const bool is_hole = std::abs(u - 80) <= half && std::abs(v - 60) <= half;
          return is_hole ? NAN : depth_of(plane, u, v);
        },
        [&](int, int) { return plane.normal; });
  };
  const Vec3d behind = at_pixel(80, 60, depth_of(plane, 80, 60) + 0.01);
  const double exact = dot(plane.normal, behind) - plane.offset;
  const double radius = 0.003;
  EXPECT_NEAR(sample_field(make_field(with_hole(0)).view(), behind, radius).phi, exact, 3e-4);
  EXPECT_NEAR(sample_field(make_field(with_hole(5)).view(), behind, radius).phi, exact, 4e-3);
  EXPECT_GT(
      sample_field(make_field(with_hole(5), {UnknownSpace::free, 0}).view(), behind, radius).phi,
      radius);
  EXPECT_GT(sample_field(make_field(with_hole(40)).view(), behind, radius).phi, radius);
}

// A wide hole is closed by what is around it, as a flat piece.
TEST(DepthField, SolidUnknownSpaceClosesEveryHole) {
  const PointCloud cloud = make_cloud(
      [](int u, int v) -> double { return std::abs(u - 80) + std::abs(v - 60) < 50 ? NAN : 0.8; },
      [](int, int) {
        return Vec3d{0, 0, -1};
      });
  const DepthField field = make_field(cloud, {UnknownSpace::solid, 4});
  for (double u = 20; u < 140; u += 3.7) {
    EXPECT_NEAR(sample_field(field.view(), at_pixel(u, 60, 0.81), 0.003).phi, -0.01, 1e-3) << u;
  }
}

TEST(DepthField, OutsideOfTheImageIsFreeUnlessUnknownSpaceIsSolid) {
  const PointCloud cloud = plane_cloud();
  const Vec3d left = at_pixel(-60, 60, 0.9);
  const double radius = 0.002;
  EXPECT_GT(sample_field(make_field(cloud).view(), left, radius).phi, radius);
  EXPECT_LT(sample_field(make_field(cloud, {UnknownSpace::solid, 4}).view(), left, radius).phi, 0);
}

/// Two frontal walls, the near one at the left of column `first_far`.
PointCloud step_cloud(double near, double far, int first_far = 80) {
  return make_cloud([=](int u, int) { return u < first_far ? near : far; },
                    [](int, int) {
                      return Vec3d{0, 0, -1};
                    });
}

// Behind the near wall the way out is to its front or sideways, out of its shadow, whichever is
// shorter; beside the shadow only the far wall and the shadow's side are there.
TEST(DepthField, IsTheDistanceToFreeSpaceAtAStep) {
  const double near = 0.5, far = 1.5;
  const DepthField field = make_field(step_cloud(near, far));
  test::Random random(40);
  // Its side wall holds the eye, and column 79.5.
  const Vec3d out = normalized(Vec3d{1, 0, -(79.5 - kCamera.cx) / kCamera.fx});
  int num_sideways = 0, num_forward = 0, num_astray = 0, num_steep = 0;
  for (int i = 0; i < 20000; ++i) {
    const double radius = 0.001 * std::pow(12.0, random.uniform());
    const double z = random.uniform(0.45, 0.9);
    const Vec3d p = at_pixel(80 + random.uniform(-10, 8), random.uniform(50, 70), z);
    const double side = dot(out, p), front = near - z;
    const FieldSample<double> at = sample_field(field.view(), p, radius);
    const double pixel = z / kCamera.fx, width = std::max(radius, pixel);
    num_steep += at.phi < radius && norm(at.gradient) > 1.2;
    if (front < 0 && side < 0) {
      const double exact = std::max(side, front);
      EXPECT_NEAR(at.phi, exact, 0.25 * -exact + 0.75 * width) << radius << " " << side;
      // The gradient points along one way out if that is much shorter than the other.
      if (std::abs(side - front) < 0.5 * -exact + 3 * width || -exact < width) continue;
      const Vec3d way = side > front ? out : Vec3d{0, 0, -1};
      ++(side > front ? num_sideways : num_forward);
      // Between two levels, whose walls may be apart, the field may be flat.
      const bool points_out =
          dot(way, at.gradient) > std::cos(15 * kPi / 180) * norm(at.gradient) + 1e-9;
      num_astray += !points_out;
    } else if (side > radius + pixel || front > radius) {
      EXPECT_GE(at.phi, radius * (1 - 1e-6)) << side << " " << front;
    }
  }
  EXPECT_GT(num_sideways, 300);
  EXPECT_GT(num_forward, 20);
  EXPECT_LT(num_astray, 0.03 * (num_sideways + num_forward));
  EXPECT_LT(num_steep, 1000);
}

// Wherever an edge lies in the wide pixels of large spheres, half of each is behind it where its
// middle is: a pixel that shows two surfaces tells how much of it each covers. The remainder is an
// eighth of a wide pixel, where the edge goes through its middle.
TEST(DepthField, WideSpheresEndWhereTheSurfaceEnds) {
  for (int first_far = 72; first_far < 88; ++first_far) {
    const DepthField field = make_field(step_cloud(0.5, 1.5, first_far));
    for (const double pixels : {1, 2, 4, 8}) {
      const double z = 0.5 + 0.04 * pixels,
                   radius = pixels * z / kCamera.fx / static_cast<double>(kFootprint);
      const FieldSample<double> at =
          sample_field(field.view(), at_pixel(first_far - 0.5, 60, z), radius);
      EXPECT_NEAR(at.phi, 0, 0.13 * pixels * z / kCamera.fx) << first_far << ", " << pixels;
    }
  }
}

// However deep behind the near wall, and whatever lies how far behind it. In places, where the
// walls of two levels are apart, it is steeper; there forces are bounded.
TEST(DepthField, IsHardlySteeperDeepInAShadow) {
  for (const double far : {0.52, 0.6, 1.5, 9.0}) {
    const DepthField field = make_field(step_cloud(0.5, far));
    test::Random random(41);
    int num = 0, num_steep = 0, num_steepest = 0;
    for (int i = 0; i < 20000; ++i) {
      const double radius = 0.001 * std::pow(12.0, random.uniform());
      const double z = 0.5 + 0.8 * random.uniform() * random.uniform();
      const Vec3d p = at_pixel(80 + random.uniform(-40, 6), random.uniform(50, 70), z);
      const FieldSample<double> at = sample_field(field.view(), p, radius);
      if (at.phi >= radius) continue;
      ++num;
      num_steep += norm(at.gradient) > 1.1;
      num_steepest += norm(at.gradient) > 1.2;
    }
    EXPECT_GT(num, 10000);
    EXPECT_LT(num_steep, 0.12 * num) << far;
    EXPECT_LT(num_steepest, 0.1 * num) << far;
  }
}

TEST(DepthField, AnyNumberOfThreadsGivesTheSameBits) {
  const PointCloud cloud = rough_cloud(7);
  std::vector<float> first;
  for (const int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    DepthField field = std::move(DepthField::create(kWidth, kHeight)).value();
    field.update(plane_cloud().view(), pool);  // what was there before does not matter
    field.update(cloud.view(), pool);
    const std::vector<float> numbers = numbers_of(field.view());
    if (first.empty()) first = numbers;
    EXPECT_TRUE(same_bits(numbers, first)) << threads;
  }
}

class DepthFieldIsa : public testing::TestWithParam<Isa> {};

TEST_P(DepthFieldIsa, SameBitsAsBaseline) {
  if (GetParam() > best_isa()) {
    GTEST_SKIP() << "SKIPPED: this processor lacks " << isa_name(GetParam());
  }
  for (const int width : {8, 9, 31, 64, 161, 203}) {
    const PointCloud cloud = rough_cloud(8, width, 45);
    for (const UnknownSpace unknown :
         {UnknownSpace::free, UnknownSpace::solid, UnknownSpace::blocked}) {
      for (const int fill_levels : {0, 4}) {
        const DepthFieldOptions options{unknown, fill_levels};
        const DepthField narrow = make_field(cloud, options, Isa::baseline);
        const DepthField wide = make_field(cloud, options, GetParam());
        EXPECT_TRUE(same_bits(numbers_of(narrow.view()), numbers_of(wide.view()))) << width;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, DepthFieldIsa, testing::Values(Isa::avx2, Isa::avx512),
                         [](const auto& isa) { return std::string(isa_name(isa.param)); });

TEST(DepthField, RefusesBadSizesAndOptions) {
  for (const auto& [width, height] : {std::pair{7, 100}, {100, 7}, {5000, 100}, {-1, 10}}) {
    const auto field = DepthField::create(width, height);
    ASSERT_FALSE(field);
    EXPECT_NE(field.error().message.find("8 to 4096"), std::string::npos);
  }
  EXPECT_FALSE(DepthField::create(100, 100, {.fill_levels = -1}));
  EXPECT_FALSE(DepthField::create(100, 100, {.fill_levels = 99}));
  for (const double thickness : {0.0, -1.0, 1e9, double(NAN)}) {
    EXPECT_FALSE(
        DepthField::create(100, 100, {.unseen = UnseenSpace::free, .thickness = thickness}));
  }
  // A thickness of what is solid.
  EXPECT_FALSE(DepthField::create(100, 100, {.thickness = 0.03}));
}

TEST(DepthField, TakesTheSmallestAndEmptyImages) {
  PointCloud cloud(8, 8, Intrinsics{10, 10, 4, 4});
  const DepthField empty = make_field(cloud);
  EXPECT_GT(sample_field(empty.view(), {0.0, 0.0, 1.0}, 0.01).phi, 0.01);
  cloud.set(27, {0, 0, 0.5f}, {0, 0, -1});
  const DepthField one = make_field(cloud, {UnknownSpace::solid, 4});
  EXPECT_TRUE(std::isfinite(sample_field(one.view(), {0.0, 0.0, 1.0}, 0.01).phi));
}

}  // namespace
}  // namespace palpate
