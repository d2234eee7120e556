// Estimates of depth over time (DepthAverage::kalman): how calm at rest, how prompt in motion.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>

#include <gtest/gtest.h>

#include "palpate/cloud/depth_source.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr int kWidth = 150, kHeight = 100, kSize = kWidth * kHeight;  // blocks are cut off
constexpr double kUnit = 1e-5, kNoise = 0.001;                        // m

DepthAverageOptions options_with(int rest_frames) {
  DepthAverageOptions options;
  options.kind = DepthAverage::kalman;
  options.rest_frames = rest_frames;
  options.noise = kNoise;
  options.noise_growth = 0;
  options.noise_patch = 1;
  return options;
}

/// Depth in meters at (u, v); 0: none.
using Depth = std::function<double(int u, int v)>;

/// Frames with noise.
class Camera {
 public:
  explicit Camera(double noise = kNoise) : noise_(noise) {}
  DepthFrame see(const Depth& depth) {
    DepthFrame frame{kWidth, kHeight, kUnit, {}, 0};
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const double z = depth(u, v), noisy = z + noise_ * random_.normal();
        frame.pixels.push_back(z > 0 ? static_cast<std::uint16_t>(std::lround(noisy / kUnit))
                                     : std::uint16_t{0});
      }
    }
    return frame;
  }

 private:
  double noise_;
  test::Random random_{7};
};

struct Estimator {
  ThreadPool pool{2};
  DepthAverager averager;

  explicit Estimator(const DepthAverageOptions& options)
      : averager(std::move(DepthAverager::create(kWidth, kHeight, options)).value()) {}
  std::span<const float> update(const DepthFrame& frame) { return averager.update(frame, pool); }
};

float measured(const DepthFrame& frame, int u, int v) {
  return static_cast<float>(frame.pixels[static_cast<std::size_t>(v * kWidth + u)] * kUnit);
}
float at(std::span<const float> depth, int u, int v) {
  return depth[static_cast<std::size_t>(v * kWidth + u)];
}

/// Mean square distance from `z`, in variances of a measurement.
double spread(std::span<const float> depth, double z) {
  double sum = 0;
  for (const float d : depth) sum += (d - z) * (d - z);
  return sum / (kSize * kNoise * kNoise);
}

TEST(DepthEstimate, IsTheMeanOfAllFramesAtFirst) {
  Estimator estimator(options_with(10000));
  Camera camera;
  constexpr int kFrames = 32;
  double mean = 0;
  for (int n = 1; n <= kFrames; ++n) {
    const double variance = spread(estimator.update(camera.see([](int, int) { return 0.5; })), 0.5);
    // One measurement in 400 is so far off that it counts for more.
    EXPECT_NEAR(variance * n, 1, 0.25) << n;
    mean += variance * n / kFrames;
  }
  EXPECT_NEAR(mean, 1, 0.1);
}

// A Kalman filter of what drifts by q variances a frame has the gain g with g^2 = q (1 - g) in the
// end. What does not drift it then estimates with a variance of g / (2 - g).
TEST(DepthEstimate, SettlesAtTheGainOfItsDrift) {
  constexpr int kRest = 12;
  Estimator estimator(options_with(kRest));
  Camera camera;
  double variance = 0;
  constexpr int kFrames = 120, kFrom = 80;
  for (int k = 0; k < kFrames; ++k) {
    const auto depth = estimator.update(camera.see([](int, int) { return 0.5; }));
    if (k >= kFrom) variance += spread(depth, 0.5) / (kFrames - kFrom);
  }
  const double q = 1.0 / (kRest * kRest), g = (std::sqrt(q * q + 4 * q) - q) / 2;
  EXPECT_NEAR(variance, g / (2 - g), 0.1 * g / (2 - g));
}

TEST(DepthEstimate, FollowsWhatMovesToTheBit) {
  Camera camera;
  for (const double speed : {0.00025, 0.001, 0.01}) {  // m a frame: from a quarter of the noise
    Estimator estimator(options_with(300));
    int num_other = 0;
    for (int k = 0; k < 60; ++k) {
      const double z = 0.3 + speed * std::max(0, k - 40);
      const DepthFrame frame = camera.see([z](int, int) { return z; });
      const auto depth = estimator.update(frame);
      if (k < 50) continue;
      for (int v = 0; v < kHeight; ++v) {
        for (int u = 0; u < kWidth; ++u) num_other += at(depth, u, v) != measured(frame, u, v);
      }
    }
    EXPECT_LT(num_other, 0.002 * 10 * kSize) << speed;
  }
}

TEST(DepthEstimate, TakesANewSurfaceAtOnce) {
  Estimator estimator(options_with(300));
  Camera camera;
  const auto is_hand = [](int u, int v) { return u > 30 && u < 60 && v > 20 && v < 70; };
  for (int k = 0; k < 90; ++k) {
    const bool is_there = k >= 40 && k < 80;
    const DepthFrame frame =
        camera.see([&](int u, int v) { return is_there && is_hand(u, v) ? 0.48 : 0.5; });
    const auto depth = estimator.update(frame);
    if (k != 40 && k != 80) continue;
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        if (!is_hand(u, v)) continue;
        ASSERT_EQ(at(depth, u, v), measured(frame, u, v)) << k;
      }
    }
  }
}

// No mean has a part of it, and what comes back is shown at once.
TEST(DepthEstimate, WhatIsFarIsFarAtOnce) {
  Estimator estimator(options_with(300));
  Camera camera;
  const auto is_hand = [](int u, int v) { return u > 30 && u < 60 && v > 20 && v < 70; };
  for (int k = 0; k < 90; ++k) {
    DepthFrame frame = camera.see([](int, int) { return 0.5; });
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const bool is_far = is_hand(u, v) ? k >= 40 && k < 60 : u > 100;
        if (is_far) frame.pixels[static_cast<std::size_t>(v * kWidth + u)] = kFarCount;
      }
    }
    const auto depth = estimator.update(frame);
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const std::uint16_t count = frame.pixels[static_cast<std::size_t>(v * kWidth + u)];
        ASSERT_EQ(at(depth, u, v) == INFINITY, count == kFarCount) << k;
        ASSERT_FALSE(std::isnan(at(depth, u, v))) << k;
        if (k == 60 && is_hand(u, v)) {
          ASSERT_EQ(at(depth, u, v), measured(frame, u, v));
        }
      }
    }
  }
}

// Two surfaces, 6 noises apart: pixels beside the edge are as calm as others, and stay on theirs
// while the other one moves.
TEST(DepthEstimate, DoesNotSmearEdges) {
  constexpr int kEdge = 75;
  Estimator estimator(options_with(300));
  Camera camera;
  for (int k = 0; k < 80; ++k) {
    const double near = 0.494 - 0.0005 * std::max(0, k - 60);
    const auto depth =
        estimator.update(camera.see([&](int u, int) { return u < kEdge ? near : 0.5; }));
    if (k < 59) continue;
    for (const int u : {kEdge - 1, kEdge}) {
      double mean = 0, most = 0;
      for (int v = 0; v < kHeight; ++v) {
        const double off = static_cast<double>(at(depth, u, v)) - (u < kEdge ? near : 0.5);
        mean += off / kHeight;
        most = std::max(most, std::abs(off));
      }
      EXPECT_LT(std::abs(mean), 0.5 * kNoise) << k << " " << u;
      if (k == 59) {
        EXPECT_LT(most, kNoise) << u;
      }
    }
  }
}

TEST(DepthEstimate, KeepsWhatIsMissedForAMomentAndForgetsWhatIsGone) {
  DepthAverageOptions options = options_with(300);
  options.keep_frames = 3;
  Estimator estimator(options);
  Camera camera;
  const auto is_lost = [](int u, int v) { return u % 10 == 5 && v % 10 == 5; };
  const auto is_gone = [](int u, int v) { return u >= 64 && u < 96 && v >= 32 && v < 64; };
  for (int k = 0; k < 40; ++k) {
    const auto depth = estimator.update(camera.see([&](int u, int v) {
      if (u < 4) return 0.0;  // never seen
      return k >= 30 && (is_lost(u, v) || is_gone(u, v)) ? 0.0 : 0.5;
    }));
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const bool is_shown = u >= 4 && (k < 30 || !(is_gone(u, v) || (is_lost(u, v) && k >= 33)));
        ASSERT_EQ(!std::isnan(at(depth, u, v)), is_shown) << k << " " << u << " " << v;
      }
    }
  }
}

// Noise larger than was said, and alike in many pixels.
TEST(DepthEstimate, LearnsTheNoise) {
  DepthAverageOptions options = options_with(300);
  options.noise_patch = 1000;
  Estimator estimator(options);
  Camera camera(2.5 * kNoise);
  test::Random random(3);
  double squares = 0, num = 0;
  for (int k = 0; k < 120; ++k) {
    double off[8][8];
    for (auto& row : off) {
      for (double& each : row) each = kNoise * random.normal();
    }
    const auto depth = estimator.update(
        camera.see([&](int u, int v) { return 0.5 + off[(v / 20) % 8][(u / 20) % 8]; }));
    if (k < 60) continue;
    squares += spread(depth, 0.5), ++num;
  }
  // The mean of 60 to 120 frames would have a 90th of 1 + 2.5^2.
  EXPECT_LT(squares / num, 7.25 / 40);
}

/// A surface with noise that squares of `side` pixels share, beside the camera's.
class SharedNoise {
 public:
  explicit SharedNoise(int side) : side_(side), columns_((kWidth + side - 1) / side) {}
  /// Returns a new frame's surface around `z`.
  Depth at(double z, double noise) {
    off_.assign(static_cast<std::size_t>(columns_ * ((kHeight + side_ - 1) / side_)), 0);
    for (double& each : off_) each = noise * random_.normal();
    return [this, z](int u, int v) {
      return z + off_[static_cast<std::size_t>(v / side_ * columns_ + u / side_)];
    };
  }

 private:
  int side_, columns_;
  std::vector<double> off_ = {};
  test::Random random_{3};
};

// No setting says that 16 or 256 pixels share their noise, or that it is 8 times as large. What was
// learned does not hide that the surface moves.
TEST(DepthEstimate, LearnsHowManyPixelsShareTheirNoise) {
  struct Case {
    int side;
    double noise;
  };
  for (const auto& [side, noise] : {Case{4, kNoise}, Case{16, kNoise}, Case{4, 8 * kNoise}}) {
    Estimator estimator(options_with(300));
    Camera camera(0.3 * kNoise);
    SharedNoise shared(side);
    double squares = 0, raw = 0;
    for (int k = 0; k < 60; ++k) {
      const DepthFrame frame = camera.see(shared.at(0.5, noise));
      const auto depth = estimator.update(frame);
      if (k < 40) continue;
      squares += spread(depth, 0.5);
      for (std::size_t i = 0; i < kSize; ++i) {
        const double off = frame.pixels[i] * kUnit - 0.5;
        raw += off * off / (kSize * kNoise * kNoise);
      }
    }
    EXPECT_LT(squares / raw, 1.0 / 12) << side << " " << noise;
    // It jumps: each pixel shows its measurement.
    const DepthFrame frame = camera.see(shared.at(0.4, noise));
    const auto depth = estimator.update(frame);
    int num_other = 0;
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) num_other += at(depth, u, v) != measured(frame, u, v);
    }
    EXPECT_LT(num_other, 0.002 * kSize) << side << " " << noise;
  }
}

// To and fro at a sixth of the frame rate is motion, not noise.
TEST(DepthEstimate, FollowsWhatSways) {
  Estimator estimator(options_with(300));
  Camera camera;
  double squares = 0;
  constexpr int kFrom = 30, kTo = 90;
  for (int k = 0; k < kTo; ++k) {
    const double z = 0.5 + 0.005 * std::sin(2 * kPi / 6 * std::max(0, k - kFrom));
    const auto depth = estimator.update(camera.see([z](int, int) { return z; }));
    if (k >= kFrom) squares += spread(depth, z) / (kTo - kFrom);
  }
  EXPECT_LT(squares, 1.1);
}

TEST(DepthEstimate, SameBitsForAnyThreadsAndInstructionSetAndNoAllocation) {
  std::vector<DepthFrame> frames;
  Camera camera(3 * kNoise);
  for (int k = 0; k < 30; ++k) {
    frames.push_back(camera.see([&](int u, int v) {
      if ((u * 7 + v * 3 + k) % 31 == 0) return 0.0;
      return u > 3 * k ? 0.5 + 0.0004 * k : 0.4;
    }));
  }
  DepthAverageOptions options = options_with(100);
  options.noise_patch = 20;
  std::vector<std::vector<float>> expected;
  for (const Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
    for (const int num_threads : {1, 3}) {
      ThreadPool pool(num_threads);
      auto averager = std::move(DepthAverager::create(kWidth, kHeight, options, isa)).value();
      for (std::size_t k = 0; k < frames.size(); ++k) {
        const test::AllocationCounter counter;
        const auto depth = averager.update(frames[k], pool);
        EXPECT_EQ(counter.count(), 0u);
        if (expected.size() == k) expected.emplace_back(depth.begin(), depth.end());
        ASSERT_EQ(std::memcmp(expected[k].data(), depth.data(), kSize * sizeof(float)), 0) << k;
      }
    }
  }
}

TEST(DepthEstimate, RefusesBadOptions) {
  const auto refuses = [](const std::function<void(DepthAverageOptions&)>& change) {
    DepthAverageOptions options = options_with(300);
    change(options);
    return !DepthAverager::create(kWidth, kHeight, options);
  };
  EXPECT_FALSE(refuses([](DepthAverageOptions&) {}));
  EXPECT_TRUE(refuses([](DepthAverageOptions& o) { o.rest_frames = 0; }));
  EXPECT_TRUE(refuses([](DepthAverageOptions& o) { o.noise = 0; }));
  EXPECT_TRUE(refuses([](DepthAverageOptions& o) { o.noise_growth = -1; }));
  EXPECT_TRUE(refuses([](DepthAverageOptions& o) { o.noise_patch = 0.5; }));
}

}  // namespace
}  // namespace palpate
