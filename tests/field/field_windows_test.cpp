// Results for a window of the image, stage by stage.
#include "src/field/pyramid/field_windows.h"

#include <cmath>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/cloud/surface_estimator.h"
#include "src/field/internal/needed_window.h"
#include "tests/test_util/random_frame.h"

namespace palpate {
namespace {

using test::Random;
using test::random_frame;

struct Options {
  SurfaceOptions surface;
  DepthFieldOptions field;
};

/// As many as there are ways through the code.
std::vector<Options> all_options() {
  std::vector<Options> all(6);
  all[1].field.unknown = UnknownSpace::solid;
  all[2].field.fill_levels = 0;
  all[3].field.fill_levels = 5;
  all[3].surface.filter.smoothing = Smoothing::bilateral;
  all[3].surface.filter.radius = 5;
  all[4].surface.normals.radius = 7;
  all[4].surface.filter.enabled = false;
  all[4].surface.flying_pixel_gap = 0.01;
  all[5].field.unknown = UnknownSpace::blocked;
  return all;
}

/// Calls f(u, v) for the pixels of a window.
template <class F>
void for_pixels(const PixelWindow& window, const F& f) {
  for (int v = window.top; v < window.bottom; ++v) {
    for (int u = window.left; u < window.right; ++u) f(u, v);
  }
}

template <class T>
bool has_same_bits(const T* a, const T* b, std::size_t num) {
  return std::memcmp(a, b, num * sizeof(T)) == 0;
}

// The pixels in which a ball is seen: all of them, and none that is farther than a pixel from one.
TEST(NeededWindow, IsWhereTheBallIsSeen) {
  constexpr int kWidth = 640, kHeight = 480;
  const Intrinsics k{525, 520, 300.5, 251.25};
  Random random(15);
  int num_inside = 0;
  for (int i = 0; i < 2000; ++i) {
    const double reach = 0.3 * std::pow(random.uniform(), 2), z = 0.03 + reach + random.uniform();
    const Vec3d p{z * random.uniform(-0.7, 0.7), z * random.uniform(-0.6, 0.6), z};
    const PixelWindow window = needed_window(k, kWidth, kHeight, p, reach);
    // Along each axis the ball is seen as wide as a circle: the angles of its two tangents.
    const auto expect_tight = [&](double x, double focal, double center, int size, int first,
                                  int last) {
      const double middle = std::atan2(x, z), half = std::asin(reach / std::hypot(x, z));
      const double low = focal * std::tan(middle - half) + center;
      const double high = focal * std::tan(middle + half) + center;
      if (low < 0 || low > size - 1 || high < 1 || high > size) return;  // the image ends there
      EXPECT_LE(first, low + 1e-6);
      EXPECT_GE(last, high - 1e-6);
      EXPECT_GE(first, low - 1 - 1e-6);
      EXPECT_LE(last, high + 1 + 1e-6);
      ++num_inside;
    };
    expect_tight(p.x, k.fx, k.cx, kWidth, window.left, window.right);
    expect_tight(p.y, k.fy, k.cy, kHeight, window.top, window.bottom);
  }
  EXPECT_GT(num_inside, 1000);
  const PixelWindow all{0, 0, kWidth, kHeight};
  EXPECT_EQ(needed_window(k, kWidth, kHeight, {0, 0, 0.3}, 0.29), all) << "up to the eye";
  EXPECT_EQ(needed_window(k, kWidth, kHeight, {1e200, 0, 1e200}, 0.1), all) << "numbers overflow";
}

// To the last pixel of every stage, in memory where another frame was before.
TEST(FieldWindows, HaveTheBitsOfTheWholeImage) {
  constexpr int kWidth = 800, kHeight = 600;
  const Intrinsics k{700, 710, 390, 310};
  Random random(14);
  ThreadPool pool(1);
  for (const Options& options : all_options()) {
    const auto make_surface = [&] {
      return SurfaceEstimator::create(kWidth, kHeight, k, options.surface).value();
    };
    const auto make_field = [&] {
      return DepthField::create(kWidth, kHeight, options.field).value();
    };
    SurfaceEstimator whole_surface = make_surface(), part_surface = make_surface();
    DepthField whole_field = make_field(), part_field = make_field();
    const PyramidLayout layout = pyramid_layout(kWidth, kHeight, options.field).value();
    for (int i = 0; i < 6; ++i) {
      part_surface.update(random_frame(kWidth, kHeight, random), pool);
      part_field.update(part_surface.cloud(), pool);
      const DepthFrame frame = random_frame(kWidth, kHeight, random);
      const int left = static_cast<int>(random.uniform(0, 700));
      const int top = static_cast<int>(random.uniform(0, 500));
      const PixelWindow requested{left, top, left + 1 + static_cast<int>(random.uniform(0, 99)),
                                  top + 1 + static_cast<int>(random.uniform(0, 99))};
      const FieldWindows windows = field_windows(layout, options.field, requested);
      EXPECT_EQ(windows.points, part_field.points_for(requested));
      whole_surface.update(frame, pool);
      whole_field.update(whole_surface.cloud(), pool);
      part_surface.update(frame, pool, {windows.points, false});
      part_field.update(part_surface.cloud(), pool, requested);

      const PointCloudView got = part_surface.cloud(), want = whole_surface.cloud();
      int num_wrong = 0;
      for_pixels(windows.points, [&](int u, int v) {
        const std::size_t p = static_cast<std::size_t>(v * kWidth + u);
        num_wrong += !has_same_bits(got.z + p, want.z + p, 1);
        num_wrong += !has_same_bits(got.nx + p, want.nx + p, 1);
      });
      EXPECT_EQ(num_wrong, 0);
      for (int number = 0; number < layout.num_levels; ++number) {
        const DepthFieldLevel& a = part_field.view().levels[number];
        const DepthFieldLevel& b = whole_field.view().levels[number];
        int num_other_planes = 0, num_other_marks = 0, num_other_rims = 0;
        for_pixels(windows.planes[number], [&](int u, int v) {
          const std::ptrdiff_t p = v * a.stride + u;
          num_other_planes += !has_same_bits(a.planes + 2 * p, b.planes + 2 * p, 2);
        });
        for_pixels(windows.silhouettes[number].grown(-1), [&](int u, int v) {
          const std::ptrdiff_t p = v * a.stride + u;
          num_other_marks += a.near_silhouette[p] != b.near_silhouette[p];
          for (std::ptrdiff_t q = b.near_silhouette[p] != 0 ? -1 : 2; q <= 1; ++q) {
            const std::ptrdiff_t row = 2 * (p + q * a.stride - 1);
            num_other_rims += !has_same_bits(a.silhouettes + row, b.silhouettes + row, 6);
          }
        });
        EXPECT_EQ(num_other_planes, 0) << number;
        EXPECT_EQ(num_other_marks, 0) << number;
        EXPECT_EQ(num_other_rims, 0) << number;
      }
      // No tile promises more than is so.
      const DepthFieldView &some = part_field.view(), &all = whole_field.view();
      int num_known = 0;
      for (int t = 0; t < all.tiles_wide * all.tiles_high; ++t) {
        if (some.tiles[t].nearest < 0) continue;
        ++num_known;
        EXPECT_TRUE(has_same_bits(some.tiles + t, all.tiles + t, 1));
      }
      EXPECT_GT(num_known, 0);
    }
  }
}

// Runs of missing pixels of any length, between surfaces that are not one; what lies beyond the
// points that an update reads is another image.
TEST(FieldWindows, HaveTheRunsOfTheWholeImage) {
  constexpr int kWidth = 800, kHeight = 600;
  const Intrinsics k{700, 710, 390, 310};
  Random random(16);
  ThreadPool pool(2);
  DepthField whole = DepthField::create(kWidth, kHeight).value();
  DepthField part = DepthField::create(kWidth, kHeight).value();
  const PyramidLayout layout = pyramid_layout(kWidth, kHeight, {}).value();
  const auto random_planes = [&] {
    // Stripes of a depth and of holes, by turns along rows and along columns.
    const bool is_column = random.uniform() < 0.5;
    std::vector<TangentPlane> line;
    while (line.size() < kWidth) {
      const auto depth = static_cast<float>(random.uniform(0.5, 2));
      const auto num = static_cast<std::size_t>(random.uniform(1, 40));
      line.insert(line.end(), num, {depth, 1});
      line.insert(line.end(), static_cast<std::size_t>(random.uniform(1, 67)), {});
    }
    std::vector<TangentPlane> planes;
    for (std::size_t v = 0; v < kHeight; ++v) {
      for (std::size_t u = 0; u < kWidth; ++u) planes.push_back(line[is_column ? v : u]);
    }
    return planes;
  };
  for (int i = 0; i < 60; ++i) {
    const std::vector<TangentPlane> planes = random_planes();
    const int left = static_cast<int>(random.uniform(0, 700));
    const int top = static_cast<int>(random.uniform(0, 500));
    const PixelWindow requested{left, top, left + 99, top + 99};
    std::vector<TangentPlane> others = random_planes();
    part.update(others.data(), k, pool);
    for_pixels(part.points_for(requested), [&](int u, int v) {
      const auto p = static_cast<std::size_t>(v * kWidth + u);
      others[p] = planes[p];
    });
    part.update(others.data(), k, pool, requested);
    whole.update(planes.data(), k, pool);
    const FieldWindows windows = field_windows(layout, {}, requested);
    for (int number = 0; number < layout.num_levels; ++number) {
      const DepthFieldLevel& a = part.view().levels[number];
      const DepthFieldLevel& b = whole.view().levels[number];
      int num_wrong = 0;
      for_pixels(windows.planes[number], [&](int u, int v) {
        const std::ptrdiff_t p = v * a.stride + u;
        num_wrong += !has_same_bits(a.planes + 2 * p, b.planes + 2 * p, 2);
      });
      EXPECT_EQ(num_wrong, 0) << i << ", level " << number;
    }
    int num_wrong = 0;
    for_pixels(windows.planes[0], [&](int u, int v) {
      const auto is_filled = [&](const DepthFieldView& view) {
        return view.filled_behind[v * view.filled_stride + u / 32] >> u % 32 & 1;
      };
      num_wrong += is_filled(part.view()) != is_filled(whole.view());
    });
    EXPECT_EQ(num_wrong, 0) << i;
  }
}

}  // namespace
}  // namespace palpate
