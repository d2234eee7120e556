#include "palpate/field/depth_field.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/field/field_sample.h"
#include "palpate/math/sphere.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr int kWidth = 161, kHeight = 120;
const Intrinsics kCamera{150, 152, 79.3, 61.1};

/// A cloud whose pixel (u, v) has depth `depth(u, v)` and normal `normal(u, v)`; NaN leaves a hole.
template <class Depth, class Normal>
PointCloud make_cloud(const Depth& depth, const Normal& normal, int width = kWidth,
                      int height = kHeight) {
  PointCloud cloud(width, height, kCamera);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const double z = depth(u, v);
      const Vec3d p{(u - kCamera.cx) * z / kCamera.fx, (v - kCamera.cy) * z / kCamera.fy, z};
      cloud.set(static_cast<std::size_t>(v * width + u), to_float(p), to_float(normal(u, v)));
    }
  }
  return cloud;
}

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

/// A bumpy wall with a step, noise, and holes of all sizes.
PointCloud rough_cloud(std::uint64_t seed, int width = kWidth, int height = kHeight) {
  test::Random random(seed);
  return make_cloud(
      [&](int u, int v) -> double {
        if (random.uniform() < 0.02 || (u - 40) * (u - 40) + (v - 80) * (v - 80) < 200) return NAN;
        const double wall = u > 90 && v > 40 ? 0.6 : 0.85;
        return wall + 0.01 * std::sin(u * 0.1) + 0.002 * random.normal();
      },
      [&](int, int) {
        return Vec3d{0, 0, -1} + 0.2 * random.direction();
      },
      width, height);
}

DepthField make_field(const PointCloud& cloud, const DepthFieldOptions& options = {},
                      Isa isa = best_isa()) {
  ThreadPool pool(1);
  DepthField field =
      std::move(DepthField::create(cloud.width(), cloud.height(), options, isa)).value();
  field.update(cloud.view(), pool);
  return field;
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
                               static_cast<float>(level.is_step[i])});
      }
    }
  }
  for (int i = 0; i < view.tiles_wide * view.tiles_high; ++i) {
    all.insert(all.end(), {view.tiles[i].nearest, view.tiles[i].least_slope});
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
    // Large spheres ask wide pixels, which must not reach over the border of the image.
    const double radius = 0.0005 * std::pow(40.0, random.uniform());
    const Vec3d p =
        at_pixel(random.uniform(50, 110), random.uniform(45, 75), random.uniform(0.7, 0.9));
    const FieldSample<double> got = sample_field(field.view(), p, radius);
    EXPECT_NEAR(got.phi, dot(plane.normal, p) - plane.offset, 2e-6);
    EXPECT_NEAR(norm(got.gradient - plane.normal), 0, 2e-5);
  }
}

TEST(DepthField, GradientIsTheDerivativeOfTheValueEverywhere) {
  for (const DepthFieldOptions& options : {DepthFieldOptions{UnknownSpace::free, 2, kSolidBehind},
                                           DepthFieldOptions{UnknownSpace::solid, 2, kSolidBehind},
                                           DepthFieldOptions{UnknownSpace::free, 2, 0.03}}) {
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

// What counts is the force on a sphere, V_cap(phi) grad phi: where nothing is near, the field only
// says so.
TEST(DepthField, ForceIsContinuous) {
  const DepthField solid = make_field(rough_cloud(4), {UnknownSpace::free, 2, kSolidBehind});
  const DepthField thin = make_field(rough_cloud(4), {UnknownSpace::free, 2, 0.03});
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
  EXPECT_LT(large, 0.3 * small);
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
  EXPECT_GT(sample_field(make_field(with_hole(5), {UnknownSpace::free, 0, kSolidBehind}).view(),
                         behind, radius)
                .phi,
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
  const DepthField field = make_field(cloud, {UnknownSpace::solid, 4, kSolidBehind});
  for (double u = 20; u < 140; u += 3.7) {
    EXPECT_NEAR(sample_field(field.view(), at_pixel(u, 60, 0.81), 0.003).phi, -0.01, 1e-3) << u;
  }
}

TEST(DepthField, OutsideOfTheImageIsFreeUnlessUnknownSpaceIsSolid) {
  const PointCloud cloud = plane_cloud();
  const Vec3d left = at_pixel(-60, 60, 0.9);
  const double radius = 0.002;
  EXPECT_GT(sample_field(make_field(cloud).view(), left, radius).phi, radius);
  EXPECT_LT(
      sample_field(make_field(cloud, {UnknownSpace::solid, 4, kSolidBehind}).view(), left, radius)
          .phi,
      0);
}

TEST(DepthField, BesideASilhouetteOnlyTheNearSurfaceHasSpaceBehindIt) {
  const PointCloud cloud = make_cloud([](int u, int) { return u < 80 ? 0.5 : 1.5; },
                                      [](int, int) {
                                        return Vec3d{0, 0, -1};
                                      });
  const DepthField field = make_field(cloud);
  for (const double radius : {0.001, 0.004, 0.015}) {
    // More than the width of a sphere away from the edge.
    const double away = 3 + 3 * radius * kCamera.fx / 0.55;
    EXPECT_NEAR(sample_field(field.view(), at_pixel(80 - away, 60, 0.55), radius).phi, -0.05, 1e-5);
    EXPECT_GT(sample_field(field.view(), at_pixel(80 + away, 60, 0.55), radius).phi, radius);
    // In front of both nothing is near, wherever one looks.
    for (double u = 60; u < 100; u += 0.1) {
      EXPECT_GE(sample_field(field.view(), at_pixel(u, 60, 0.45), radius).phi, radius) << u;
    }
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
    for (const UnknownSpace unknown : {UnknownSpace::free, UnknownSpace::solid}) {
      for (const int fill_levels : {0, 4}) {
        const DepthFieldOptions options{unknown, fill_levels, kSolidBehind};
        const DepthField narrow = make_field(cloud, options, Isa::baseline);
        const DepthField wide = make_field(cloud, options, GetParam());
        EXPECT_TRUE(same_bits(numbers_of(narrow.view()), numbers_of(wide.view()))) << width;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, DepthFieldIsa, testing::Values(Isa::avx2, Isa::avx512),
                         [](const auto& isa) { return std::string(isa_name(isa.param)); });

/// One pixel of a level by the words of decision 11: the surface, or absence of one, that most of
/// the four pixels before show, the nearest if undecided, and the mean of its planes.
std::pair<float, float> merged(const DepthFieldLevel& fine, int level, int u, int v) {
  float offset[4], slope[4], w[4];
  for (int k = 0; k < 4; ++k) {
    const int at_u = std::min(2 * u + k % 2, fine.width - 1);
    const int at_v = std::min(2 * v + k / 2, fine.height - 1);
    const float* plane = fine.planes + 2 * (std::ptrdiff_t{at_v} * fine.stride + at_u);
    offset[k] = plane[0], slope[k] = plane[1], w[k] = plane[1] / plane[0];
  }
  const float tolerance = std::min(0.05f, 0.012f * static_cast<float>(1 << level));
  const auto is_same = [&](float a, float b) {
    if (a == 0 || b == 0) return a == b;
    return std::max(a, b) - std::min(a, b) <= tolerance * std::min(a, b);
  };
  std::pair<int, float> best{-1, 0};  // votes, then w
  for (const float a : w) {
    const int votes =
        static_cast<int>(std::count_if(w, w + 4, [&](float b) { return is_same(a, b); }));
    best = std::max(best, {votes, a});
  }
  if (best.second == 0) return {10.0f, 0.0f};
  float sum_offset = 0, sum_slope = 0, num = 0;
  for (int k = 0; k < 4; ++k) {
    if (!is_same(w[k], best.second)) continue;
    sum_offset += offset[k], sum_slope += slope[k], num += 1;
  }
  return {sum_offset / num, sum_slope / num};
}

TEST(DepthField, LevelsStepsAndTilesAreWhatTheyAreSaidToBe) {
  const DepthField field = make_field(rough_cloud(9), {UnknownSpace::free, 1, kSolidBehind});
  const DepthFieldView& view = field.view();
  int num_steps = 0, num_free = 0;
  for (int k = 0; k < view.num_levels; ++k) {
    const DepthFieldLevel& level = view.levels[k];
    const auto plane_at = [&](int u, int v) {
      return level.planes + 2 * (std::ptrdiff_t{v} * level.stride + u);
    };
    for (int v = 0; v < level.height; ++v) {
      for (int u = 0; u < level.width; ++u) {
        const float* plane = plane_at(u, v);
        num_free += plane[1] == 0;
        if (k > 0) {
          const auto [offset, slope] = merged(view.levels[k - 1], k, u, v);
          ASSERT_EQ(plane[0], offset) << k << ": " << u << ", " << v;
          ASSERT_EQ(plane[1], slope) << k << ": " << u << ", " << v;
        }
        const float depth = plane[0] / std::max(plane[1], 1e-6f);
        float miss = 0;
        for (int i = 0; i < 9; ++i) {
          const float* other = plane_at(u + i % 3 - 1, v + i / 3 - 1);
          miss = std::max(miss, std::abs(other[0] - depth * other[1]));
        }
        const bool is_step = miss > level.step_limit;
        ASSERT_EQ(level.is_step[std::ptrdiff_t{v} * level.stride + u], is_step) << u << ", " << v;
        num_steps += is_step;
      }
    }
  }
  EXPECT_GT(num_steps, 500);
  EXPECT_GT(num_free, 10);
  constexpr int kSize = DepthFieldView::kTileSize;
  const DepthFieldLevel& image = view.levels[0];
  for (int tile = 0; tile < view.tiles_wide * view.tiles_high; ++tile) {
    float nearest = 1e30f, least_slope = 1;
    const int u0 = tile % view.tiles_wide * kSize, v0 = tile / view.tiles_wide * kSize;
    for (int v = v0; v < std::min(v0 + kSize, image.height); ++v) {
      for (int u = u0; u < std::min(u0 + kSize, image.width); ++u) {
        const float* plane = image.planes + 2 * (std::ptrdiff_t{v} * image.stride + u);
        if (plane[1] == 0) continue;
        nearest = std::min(nearest, plane[0] / plane[1]);
        least_slope = std::min(least_slope, plane[1]);
      }
    }
    EXPECT_EQ(view.tiles[tile].nearest, nearest) << tile;
    EXPECT_EQ(view.tiles[tile].least_slope, least_slope) << tile;
  }
}

TEST(DepthField, RefusesBadSizesAndOptions) {
  for (const auto& [width, height] : {std::pair{7, 100}, {100, 7}, {5000, 100}, {-1, 10}}) {
    const auto field = DepthField::create(width, height);
    ASSERT_FALSE(field);
    EXPECT_NE(field.error().message.find("8 to 4096"), std::string::npos);
  }
  EXPECT_FALSE(DepthField::create(100, 100, {.fill_levels = -1}));
  EXPECT_FALSE(DepthField::create(100, 100, {.fill_levels = 99}));
  for (const double thickness : {0.0, -1.0, 1e9, double(NAN)}) {
    EXPECT_FALSE(DepthField::create(100, 100, {.thickness = thickness}));
  }
}

TEST(DepthField, TakesTheSmallestAndEmptyImages) {
  PointCloud cloud(8, 8, Intrinsics{10, 10, 4, 4});
  const DepthField empty = make_field(cloud);
  EXPECT_GT(sample_field(empty.view(), {0.0, 0.0, 1.0}, 0.01).phi, 0.01);
  cloud.set(27, {0, 0, 0.5f}, {0, 0, -1});
  const DepthField one = make_field(cloud, {UnknownSpace::solid, 4, kSolidBehind});
  EXPECT_TRUE(std::isfinite(sample_field(one.view(), {0.0, 0.0, 1.0}, 0.01).phi));
}

}  // namespace
}  // namespace palpate
