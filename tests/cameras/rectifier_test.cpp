// Undistorted images against OpenCV's formulas, pixel by pixel.
#include "src/cameras/stream/rectifier.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "palpate/cloud/surface_estimator.h"
#include "tests/cameras/camera_fakes.h"

namespace palpate {
namespace {

constexpr int kWidth = 160, kHeight = 120;
const Intrinsics kCamera{140, 142, 79.3, 60.1};

/// As the documentation of OpenCV's calib3d writes it, term by term.
void project(const Distortion& d, const Intrinsics& camera, double x, double y, double& u,
             double& v) {
  const double r2 = x * x + y * y, r4 = r2 * r2, r6 = r2 * r2 * r2;
  const double radial =
      (1 + d.k1 * r2 + d.k2 * r4 + d.k3 * r6) / (1 + d.k4 * r2 + d.k5 * r4 + d.k6 * r6);
  u = camera.fx * (x * radial + 2 * d.p1 * x * y + d.p2 * (r2 + 2 * x * x)) + camera.cx;
  v = camera.fy * (y * radial + d.p1 * (r2 + 2 * y * y) + 2 * d.p2 * x * y) + camera.cy;
}

/// Every pixel that comes out is the raw one nearest to where its ray is seen.
void expect_nearest(const Distortion& distortion, const CameraModel& raw) {
  Rectifier rectifier({kWidth, kHeight, kCamera, {}});
  DepthFrame frame;
  frame.width = raw.width;
  frame.height = raw.height;
  for (int i = 0; i < raw.width * raw.height; ++i) {
    frame.pixels.push_back(static_cast<std::uint16_t>(i + 1));
  }
  CameraModel model = raw;
  model.distortion = distortion;
  rectifier.apply(model, frame);
  ASSERT_EQ(frame.width, kWidth);
  ASSERT_EQ(frame.pixels.size(), std::size_t{kWidth * kHeight});
  int num_seen = 0;
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      double u_raw, v_raw;
      project(distortion, raw.intrinsics, (u - kCamera.cx) / kCamera.fx,
              (v - kCamera.cy) / kCamera.fy, u_raw, v_raw);
      const bool is_inside =
          u_raw > -0.5 && v_raw > -0.5 && u_raw < raw.width - 0.5 && v_raw < raw.height - 0.5;
      const int got = frame.pixels[static_cast<std::size_t>(v * kWidth + u)];
      if (!is_inside) {
        EXPECT_EQ(got, 0) << u << " " << v;
        continue;
      }
      ASSERT_GT(got, 0) << u << " " << v;
      EXPECT_NEAR((got - 1) % raw.width, u_raw, 0.5 + 1e-6);
      EXPECT_NEAR((got - 1) / raw.width, v_raw, 0.5 + 1e-6);
      ++num_seen;
    }
  }
  EXPECT_GT(num_seen, kWidth * kHeight / 2);
}

TEST(Rectifier, BrownConrady) {
  expect_nearest({-0.28, 0.09, 0.001, -0.002, -0.01, 0, 0, 0}, {kWidth, kHeight, kCamera, {}});
  expect_nearest({0.12, -0.03, -0.003, 0.001, 0, 0, 0, 0}, {kWidth, kHeight, kCamera, {}});
}

TEST(Rectifier, Rational) {
  // The wide-angle numbers of an Azure Kinect's depth camera.
  expect_nearest({5.9, 3.4, 1e-5, 3e-5, 0.17, 6.2, 5.1, 0.9}, {kWidth, kHeight, kCamera, {}});
}

/// Else no pixel would be seen, without a word.
TEST(Rectifier, ALensThatCannotBeIsRefused) {
  for (const double k2 : {std::numeric_limits<double>::quiet_NaN(), 1e30}) {
    DepthStreamInfo info;
    info.width = kWidth;
    info.height = kHeight;
    info.intrinsics = kCamera;
    info.distortion.k2 = k2;
    const std::string words = "distortion coefficient k2 must be a number from";
    const auto pushed = PushedSource::create(info);
    ASSERT_FALSE(pushed);
    EXPECT_NE(pushed.error().message.find(words), std::string::npos) << pushed.error().message;
    const auto estimator =
        SurfaceEstimator::create(kWidth, kHeight, kCamera, {}, best_isa(), info.distortion);
    ASSERT_FALSE(estimator);
    EXPECT_NE(estimator.error().message.find(words), std::string::npos);
  }
}

TEST(Rectifier, AnotherSizeIsTheSameView) {
  expect_nearest({}, {80, 60, {70, 71, 39.4, 29.8}, {}});
  expect_nearest({-0.1, 0, 0, 0, 0, 0, 0, 0}, {200, 150, {175, 177.5, 99.25, 75.25}, {}});
}

TEST(Rectifier, GivesTheSameInWhateverOrderSizesCome) {
  Rectifier one({kWidth, kHeight, kCamera, {}});
  const auto model = [](int k) {
    return CameraModel{40 + k, 30 + k, {35, 35, 19.5 + k, 14.5}, {0.01 * k, 0, 0, 0, 0, 0, 0, 0}};
  };
  for (const int k : {0, 1, 0, 1, 2, 3, 4, 5, 0, 5, 4, 3, 1, 1, 2}) {
    Rectifier fresh({kWidth, kHeight, kCamera, {}});
    DepthFrame frame = test::pattern_frame(40 + k, 30 + k, k, 0), same = frame;
    one.apply(model(k), frame);
    fresh.apply(model(k), same);
    EXPECT_EQ(frame.pixels, same.pixels) << k;
  }
}

TEST(Rectifier, APinholeIsLeftAlone) {
  Rectifier rectifier({kWidth, kHeight, kCamera, {}});
  DepthFrame frame = test::pattern_frame(kWidth, kHeight, 3, 0);
  const auto* const memory = frame.pixels.data();
  rectifier.apply({kWidth, kHeight, kCamera, {}}, frame);
  EXPECT_EQ(frame.pixels, test::pattern(kWidth, kHeight, 3));
  EXPECT_EQ(frame.pixels.data(), memory);
}

TEST(Rectifier, NothingIsSeenTwiceWhereThePolynomialTurnsBack) {
  // r (1 - r^2) grows up to r = 1 / sqrt(3) and then turns back.
  const Distortion back{-1, 0, 0, 0, 0, 0, 0, 0};
  EXPECT_NEAR(largest_radius(back, 2), 1 / std::sqrt(3.0), 1e-3);
  EXPECT_EQ(largest_radius({0.1, 0, 0, 0, 0, 0, 0, 0}, 2), 2);
  const Intrinsics wide{40, 40, 79.5, 59.5};
  Rectifier rectifier({kWidth, kHeight, wide, {}});
  DepthFrame frame = test::pattern_frame(kWidth, kHeight, 0, 0);
  rectifier.apply({kWidth, kHeight, wide, back}, frame);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const double r = std::hypot((u - 79.5) / 40, (v - 59.5) / 40);
      const bool is_seen = frame.pixels[static_cast<std::size_t>(v * kWidth + u)] != 0;
      EXPECT_TRUE(is_seen || r > 0.57);
      EXPECT_TRUE(!is_seen || r < 0.585);
    }
  }
}

/// Computes the area by brute force: all rectangles, by sums of pixels that the lens does not see.
int largest_valid_area(const CameraModel& pinhole, const CameraModel& raw) {
  const auto table = lens_table(pinhole, raw);
  const int w = pinhole.width, h = pinhole.height;
  std::vector<int> sums(static_cast<std::size_t>((w + 1) * (h + 1)), 0);
  const auto at = [&](int u, int v) -> int& {
    return sums[static_cast<std::size_t>(v * (w + 1) + u)];
  };
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      const bool is_out = table[static_cast<std::size_t>(v * w + u)] ==
                          static_cast<std::uint32_t>(raw.width * raw.height);
      at(u + 1, v + 1) = at(u, v + 1) + at(u + 1, v) - at(u, v) + (is_out ? 1 : 0);
    }
  }
  int most = 0;
  for (int v0 = 0; v0 < h; ++v0) {
    for (int v1 = v0 + 1; v1 <= h; ++v1) {
      for (int u0 = 0; u0 < w; ++u0) {
        for (int u1 = u0 + 1; u1 <= w; ++u1) {
          if (at(u1, v1) - at(u0, v1) - at(u1, v0) + at(u0, v0) > 0) break;
          most = std::max(most, (u1 - u0) * (v1 - v0));
        }
      }
    }
  }
  return most;
}

TEST(ValidPart, IsTheLargestRectangleThatTheLensSeesAndTheSameRays) {
  const CameraModel pinhole{60, 44, {40, 41, 28.2, 23.1}, {}};
  for (const Distortion& lens :
       {Distortion{0.12, -0.03, -0.003, 0.001, 0, 0, 0, 0},
        Distortion{0.3, 0, 0.02, -0.03, 0, 0, 0, 0}, Distortion{-1, 0, 0, 0, 0, 0, 0, 0}}) {
    CameraModel raw = pinhole;
    raw.distortion = lens;
    const CameraModel part = valid_part(pinhole, raw);
    EXPECT_LT(part.width * part.height, 60 * 44);
    EXPECT_EQ(part.width * part.height, largest_valid_area(pinhole, raw));
    const int left = static_cast<int>(std::lround(28.2 - part.intrinsics.cx));
    const int top = static_cast<int>(std::lround(23.1 - part.intrinsics.cy));
    const auto whole = lens_table(pinhole, raw), cut = lens_table(part, raw);
    for (int v = 0; v < part.height; ++v) {
      for (int u = 0; u < part.width; ++u) {
        const auto got = cut[static_cast<std::size_t>(v * part.width + u)];
        EXPECT_LT(got, 60u * 44u);
        EXPECT_EQ(got, whole[static_cast<std::size_t>((v + top) * 60 + u + left)]);
      }
    }
  }
  EXPECT_EQ(valid_part(pinhole, pinhole), pinhole);
  // A lens that sees next to nothing is left as it is.
  CameraModel elsewhere = pinhole;
  elsewhere.intrinsics.cx += 57;
  EXPECT_EQ(valid_part(pinhole, elsewhere), pinhole);
}

TEST(Rectifier, LeavesNoFlowOfOtherPixels) {
  const CameraModel pinhole{kWidth, kHeight, kCamera, {}};
  DepthFrame frame{kWidth, kHeight, 0.001, {}};
  frame.pixels.assign(kWidth * kHeight, 500);
  frame.flow.assign(2 * kWidth * kHeight, 1);
  Rectifier rectifier(pinhole);
  rectifier.apply(pinhole, frame);
  EXPECT_EQ(frame.flow.size(), 2u * kWidth * kHeight);
  CameraModel raw = pinhole;
  raw.distortion.k1 = 0.1;
  rectifier.apply(raw, frame);
  EXPECT_TRUE(frame.flow.empty());
  // A stream that announces both flow and distortion is refused at its creation.
  DepthStreamInfo info = test::stream_info(kWidth, kHeight);
  info.has_flow = true;
  EXPECT_TRUE(PushedSource::create(info));
  info.distortion.k1 = 0.1;
  const auto refused = PushedSource::create(info);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("optical flow"), std::string::npos);
}

TEST(CameraTruth, WinsOverTheStreamAndFollowsItsSize) {
  DepthStreamInfo stream = test::stream_info(320, 240);
  stream.distortion.k1 = 0.5;
  const CameraTruth truth{Intrinsics{300, 300, 159.5, 119.5}, Distortion{}, {}, {320, 240}};
  const CameraModel same = truth.model_of(stream, 320, 240);
  EXPECT_EQ(same.intrinsics, *truth.intrinsics);
  EXPECT_EQ(same.distortion, Distortion{});
  const CameraModel half = truth.model_of(stream, 160, 120);
  EXPECT_EQ(half.intrinsics, (Intrinsics{150, 150, 79.5, 59.5}));
  EXPECT_EQ((CameraTruth{{}, {}, {}, {320, 240}}.model_of(stream, 320, 240).distortion.k1), 0.5);
}

}  // namespace
}  // namespace palpate
