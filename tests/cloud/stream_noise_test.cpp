// The noise that a stream teaches: of known variance at every scale, at rest and in motion.
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "src/cloud/internal/stream_noise.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using test::Random;

constexpr int kWide = 320, kHigh = 256;
constexpr double kUnit = 1e-5;  // m per count: no rounding to speak of

double normal(Random& random) {
  double sum = -6;
  for (int i = 0; i < 12; ++i) sum += random.uniform(0, 1);
  return sum;
}

/// Normal variables, of which a frame takes a run from anywhere.
class Normals {
 public:
  Normals() {
    Random random(5);
    for (double& each : table_) each = normal(random);
  }
  const double* run(Random& random) const {
    const double begin = random.uniform(0, static_cast<double>(table_.size() - kWide * kHigh));
    return &table_[static_cast<std::size_t>(begin)];
  }

 private:
  std::vector<double> table_ = std::vector<double>(4 * kWide * kHigh);
};

/// A wall at z (m) with white noise of its own, and one that all pixels share (m). A share of its
/// pixels has no measurement.
DepthFrame wall(Random& random, double z, double own, double shared, double holes) {
  DepthFrame frame;
  frame.width = kWide;
  frame.height = kHigh;
  frame.unit = kUnit;
  static const Normals normals;
  const double* const run = normals.run(random);
  const double all = z + shared * normal(random);
  for (int i = 0; i < kWide * kHigh; ++i) {
    const bool is_hole = holes > 0 && random.uniform(0, 1) < holes;
    frame.pixels.push_back(is_hole ? 0 : static_cast<std::uint16_t>((all + own * run[i]) / kUnit));
  }
  return frame;
}

/// Returns the integral of a quadratic B-spline of nodes 1 apart, up to t from its own.
double spline_up_to(double t) {
  if (t < 0) return 1 - spline_up_to(-t);
  if (t < 0.5) return 0.5 + 0.75 * t - t * t * t / 3;
  return t < 1.5 ? 1 - std::pow(1.5 - t, 3) / 6 : 1;
}

/// Variance of the mean over a square anywhere, by B-splines of unit variance at each node.
double square_variance(double side, double apart) {
  constexpr int num_places = 64;
  double sum = 0;
  for (int place = 0; place < num_places; ++place) {
    const double left = apart * place / num_places;
    for (double node = -2 * apart; node < left + side + 2 * apart; node += apart) {
      const double share =
          apart / side *
          (spline_up_to((left + side - node) / apart) - spline_up_to((left - node) / apart));
      sum += share * share / num_places;
    }
  }
  return sum * sum;  // both ways
}

/// Variance of the mean over a square of 2^level pixels at depth z, as queries place the noise:
/// half of a scale's cells as B-splines over nodes as far apart, half over nodes half as far with
/// four times the variance; pixels are independent.
double variance_of(const FrameNoise& noise, int level, double z) {
  double sum = 0, before = 0;
  for (int k = 0; k < kNumNoiseLevels; ++k) {
    const double sd =
        static_cast<double>(noise.base[k]) + static_cast<double>(noise.growth[k]) * z * z;
    const double detail = sd * sd / kDetailShare, cells = detail - before / 4;
    const double side = 1 << level, apart = 1 << k;
    sum += k == 0 ? cells / (side * side)
                  : cells *
                        (0.5 * square_variance(side, apart) + 2 * square_variance(side, apart / 2));
    before = detail;
  }
  return sum;
}

FrameNoise learn(double step, double own, double shared, int num_frames, bool is_averaged = false,
                 double holes = 0, const MeasurementNoise& shown = {0.0005, 0.001, 0}) {
  Random random(7);
  StreamNoise stream(kWide, kHigh);
  const FrameNoise seen = frame_noise(shown);
  for (int i = 0; i < num_frames; ++i) {
    const DepthFrame frame = wall(random, 0.5 + step * i, own, shared, holes);
    stream.add(frame, seen);
  }
  return stream.of_frame(seen, is_averaged);
}

void expect_noise(const FrameNoise& noise, double own, double shared) {
  ASSERT_TRUE(noise.is_whole);
  for (int level = 0; level < kNumNoiseLevels; ++level) {
    const double want = own * own / (1 << 2 * level) + shared * shared;
    const double ratio = std::sqrt(variance_of(noise, level, 0.5) / want);
    // The widest cells share less than all pixels do.
    EXPECT_GT(ratio, level + 1 == kNumNoiseLevels ? 0.6 : 0.75) << level;
    EXPECT_LT(ratio, 1.25) << level;
  }
}

TEST(StreamNoise, IsThatOfTheFramesAtEveryScale) {
  constexpr double own = 0.002, shared = 0.0008;
  expect_noise(learn(0, own, shared, 200), own, shared);
}

// Few squares of 64 pixels of a real frame are measured all over.
TEST(StreamNoise, IsThatOfTheFramesBesideHoles) {
  constexpr double own = 0.002, shared = 0.0008, holes = 0.1;
  expect_noise(learn(0, own, shared, 200, false, holes), own, shared);
}

// Noise that neighbors share shows little in the details of one frame.
TEST(StreamNoise, MayBeFarAboveWhatOneFrameShows) {
  constexpr double own = 0.002, shared = 0.0008;
  expect_noise(learn(0, own, shared, 200, false, 0, {0.00002, 0.00004, 0}), own, shared);
}

// A camera that stops, as most do before they rest.
TEST(StreamNoise, IsHardlyChangedByAStop) {
  Random random(7);
  StreamNoise stopped(kWide, kHigh), resting(kWide, kHigh);
  const FrameNoise seen = frame_noise({0.0005, 0.001, 0});
  for (const double z : {0.52, 0.515, 0.51, 0.505}) {
    stopped.add(wall(random, z, 0.001, 0.0008, 0), seen);
  }
  for (int i = 0; i < 60; ++i) {
    const DepthFrame frame = wall(random, 0.5, 0.001, 0.0008, 0);
    stopped.add(frame, seen);
    resting.add(frame, seen);
  }
  const FrameNoise got = stopped.of_frame(seen, false), want = resting.of_frame(seen, false);
  ASSERT_TRUE(got.is_whole);
  for (int level = 0; level < kNumNoiseLevels; ++level) {
    const double ratio = variance_of(got, level, 0.5) / variance_of(want, level, 0.5);
    EXPECT_NEAR(std::sqrt(ratio), 1, 0.25) << level;
  }
}

TEST(StreamNoise, OfIndependentPixelsFallsWithTheirNumber) {
  constexpr double own = 0.002;
  const FrameNoise noise = learn(0, own, 0, 200);
  for (int level = 0; level < kNumNoiseLevels; ++level) {
    EXPECT_GE(noise.base[level], 0) << level;
    EXPECT_NEAR(std::sqrt(variance_of(noise, level, 0.5)) * (1 << level), own, 0.3 * own) << level;
  }
}

TEST(StreamNoise, OfAMovingWallIsNotItsMotion) {
  constexpr double own = 0.002;
  const double at_rest = variance_of(learn(0, own, 0, 100), 0, 0.5);
  const double moving = variance_of(learn(0.0005, own, 0, 100), 0, 0.5);
  EXPECT_GT(moving, 0.5 * at_rest);
  EXPECT_LT(moving, 1.3 * at_rest);
}

TEST(StreamNoise, OfAnAverageHasTheSizeOfItsSurface) {
  const FrameNoise seen = frame_noise({0.0005, 0.001, 0});
  const FrameNoise noise = learn(0, 0.002, 0, 100, true);
  for (int level = 0; level < 4; ++level) {
    EXPECT_NEAR(noise.base[level], seen.base[level], 0.25f * seen.base[level]) << level;
  }
}

TEST(StreamNoise, OfTheFirstFramesIsWhatTheyShow) {
  const FrameNoise seen = frame_noise({0.0005, 0.001, 0});
  const FrameNoise noise = learn(0, 0.002, 0, 3);
  EXPECT_FALSE(noise.is_whole);
  EXPECT_EQ(noise.base[2], seen.base[2]);
}

}  // namespace
}  // namespace palpate
