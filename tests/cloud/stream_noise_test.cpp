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
    frame.pixels.push_back(
        is_hole ? 0 : static_cast<std::uint16_t>((all + own * run[i]) / kUnit));
  }
  return frame;
}

/// Variance of the mean over cells of a level, by its noise at depth z.
double variance_of(const FrameNoise& noise, int level, double z) {
  constexpr double of_white = 0.75;
  const auto sd = [&](int k) {
    return static_cast<double>(noise.base[k]) + static_cast<double>(noise.growth[k]) * z * z;
  };
  double sum = std::pow(sd(kNumNoiseLevels - 1), 2) / kDetailShare;
  for (int k = level; k < kNumNoiseLevels - 1; ++k) {
    sum += of_white * std::pow(sd(k), 2) / kDetailShare;
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
    EXPECT_NEAR(std::sqrt(variance_of(noise, level, 0.5) / want), 1, 0.25) << level;
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
TEST(StreamNoise, IsThatOfTheFramesAfterAStop) {
  constexpr double own = 0.001, shared = 0.0008;
  Random random(7);
  StreamNoise stream(kWide, kHigh);
  const FrameNoise seen = frame_noise({0.0005, 0.001, 0});
  for (const double z : {0.52, 0.515, 0.51, 0.505}) stream.add(wall(random, z, own, shared, 0), seen);
  for (int i = 0; i < 60; ++i) stream.add(wall(random, 0.5, own, shared, 0), seen);
  expect_noise(stream.of_frame(seen, false), own, shared);
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
