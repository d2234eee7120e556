// Smaller depth images, against planes and by hand.
#include "palpate/cloud/depth_source.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "palpate/math/geometry.h"

namespace palpate {
namespace {

constexpr Intrinsics kIntrinsics{120, 118, 31.3, 23.8};
constexpr int kWidth = 66, kHeight = 50;  // 66 and 50 are not whole multiples of 4

DepthStreamInfo stream() {
  DepthStreamInfo info;
  info.width = kWidth;
  info.height = kHeight;
  info.intrinsics = kIntrinsics;
  return info;
}

Vec3d ray(const Intrinsics& k, double u, double v) {
  return {(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1};
}

DepthFrame frame_of(const std::function<double(int u, int v)>& depth, double unit) {
  DepthFrame frame{kWidth, kHeight, unit, {}, 3.5};
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(depth(u, v) / unit)));
    }
  }
  return frame;
}

TEST(DepthBinning, TheRayOfASquareIsTheMeanOfItsRays) {
  for (const int binning : {1, 2, 3, 4, 8}) {
    const DepthStreamInfo small = binned(stream(), binning);
    EXPECT_EQ(small.width, kWidth / binning);
    EXPECT_EQ(small.height, kHeight / binning);
    Vec3d mean;
    for (int v = 0; v < binning; ++v) {
      for (int u = 0; u < binning; ++u) mean += ray(kIntrinsics, 2 * binning + u, binning + v);
    }
    mean = mean / (binning * binning);
    EXPECT_LT(norm(ray(small.intrinsics, 2, 1) - mean), 1e-14) << binning;
  }
}

// n . p = d for the points of a plane; rounding and the curvature of 1/z within a square remain.
TEST(DepthBinning, PlanesStayWhereTheyAre) {
  const Vec3d n = normalized(Vec3d{0.3, -0.2, -1});
  const double d = n.z * 0.6, unit = 2e-5;
  const DepthFrame frame =
      frame_of([&](int u, int v) { return d / dot(n, ray(kIntrinsics, u, v)); }, unit);
  for (const int binning : {2, 4}) {
    const DepthStreamInfo small = binned(stream(), binning);
    DepthFrame out;
    bin_depth(frame, binning, out);
    ASSERT_EQ(out.pixels.size(), static_cast<std::size_t>(small.width * small.height));
    EXPECT_EQ(out.unit, unit);
    for (int v = 0; v < small.height; ++v) {
      for (int u = 0; u < small.width; ++u) {
        const double z = unit * out.pixels[static_cast<std::size_t>(v * small.width + u)];
        EXPECT_NEAR(dot(n, ray(small.intrinsics, u, v) * z), d, 4e-5) << u << " " << v;
      }
    }
  }
}

TEST(DepthBinning, NoPixelFloatsBetweenTwoSurfacesAndHolesStayHoles) {
  // Foreground left of column 31, which is inside of a square; a hole of odd shape.
  const auto depth = [](int u, int v) {
    const bool is_hole = u >= 8 && u < 12 && v >= 8 && v < 12;
    return is_hole && !(u == 8 && v == 8) ? 0.0 : u < 31 ? 0.5 : 1.5;
  };
  DepthFrame frame = frame_of(depth, 0.001);
  frame.pixels[0] = 65535;
  for (const int binning : {2, 4, 8}) {
    DepthFrame out;
    bin_depth(frame, binning, out);
    for (std::size_t i = 0; i < out.pixels.size(); ++i) {
      const std::uint16_t count = out.pixels[i];
      EXPECT_TRUE(count == 0 || count == 500 || count == 1500) << count;
    }
    const auto at = [&](int u, int v) {
      return out.pixels[static_cast<std::size_t>((v / binning) * out.width + u / binning)];
    };
    EXPECT_EQ(at(0, 0), 500);
    EXPECT_EQ(at(8, 8), 500);  // one measurement is one
    EXPECT_EQ(at(60, 30), 1500);
    if (binning == 2) {
      EXPECT_EQ(at(10, 10), 0);
    }
    // Three of four columns of that square are the foreground.
    if (binning == 4) {
      EXPECT_EQ(at(31, 20), 500);
    }
  }
}

TEST(DepthBinning, TheMeanIsOfWhatAgreesWithTheLowerMedian) {
  DepthFrame frame{2, 2, 0.001, {1000, 1010, 1031, 1100}, 0}, out;
  bin_depth(frame, 2, out);
  // The lower median of 1000, 1010, 1031, 1100 is 1010; 1/32 of it is 31: 1100 is another surface.
  EXPECT_EQ(out.pixels, std::vector<std::uint16_t>{1014});  // 3041 / 3 = 1013.67
  frame.pixels = {0, 0, 65535, 700};
  bin_depth(frame, 2, out);
  EXPECT_EQ(out.pixels, std::vector<std::uint16_t>{700});
  frame.pixels = {65534, 65534, 65534, 65534};
  bin_depth(frame, 2, out);
  EXPECT_EQ(out.pixels, std::vector<std::uint16_t>{65534});
}

TEST(DepthBinning, MostOfWhatWasMeasuredSaysWhetherItIsFar) {
  DepthFrame frame{2, 2, 0.001, {}, 0}, out;
  const auto binned = [&](std::vector<std::uint16_t> pixels) {
    frame.pixels = std::move(pixels);
    bin_depth(frame, 2, out);
    return out.pixels.at(0);
  };
  EXPECT_EQ(binned({65535, 65535, 65535, 65535}), 65535);
  EXPECT_EQ(binned({65535, 0, 0, 65535}), 65535);
  EXPECT_EQ(binned({65535, 65535, 64000, 65535}), 65535);
  EXPECT_EQ(binned({65535, 65535, 700, 700}), 700);
}

}  // namespace
}  // namespace palpate
