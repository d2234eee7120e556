// Measured noise against noise of known variance and length.
#include "src/cloud/internal/noise_measurement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "palpate/cloud/depth_noise.h"
#include "palpate/cloud/depth_source.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr int kWidth = 160, kHeight = 120;
constexpr double kUnit = 1e-5;  // m

/// Depth at (u, v) in frame k, m.
using Depth = std::function<double(int u, int v, int k)>;

/// Frames with noise whose correlation is exactly exp(-d / length) along rows and columns: each
/// pixel is a share of its neighbor's noise and new noise, first along rows, then along columns.
std::vector<DepthFrame> frames_of(const MeasurementNoise& noise, const Depth& depth, int num = 60) {
  test::Random random(5);
  const double share = noise.length > 0 ? std::exp(-1 / noise.length) : 0;
  const double rest = std::sqrt(1 - share * share);
  std::vector<DepthFrame> frames;
  for (int k = 0; k < num; ++k) {
    std::vector<double> field(kWidth * kHeight);
    for (double& each : field) each = random.normal();
    for (std::size_t i = 0; i < field.size(); ++i) {
      if (i % kWidth > 0) field[i] = share * field[i - 1] + rest * field[i];
    }
    for (std::size_t i = kWidth; i < field.size(); ++i) {
      field[i] = share * field[i - kWidth] + rest * field[i];
    }
    DepthFrame frame{kWidth, kHeight, kUnit, {}, 0};
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const double z = depth(u, v, k);
        const double noisy =
            z + noise.deviation(z) * field[static_cast<std::size_t>(v * kWidth + u)];
        frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(noisy / kUnit)));
      }
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

double ramp(int, int v, int) { return 0.25 + 0.3 * v / kHeight; }

TEST(NoiseMeasurement, FindsVarianceAndLength) {
  for (const double length : {0.0, 1.0, 3.0}) {
    const MeasurementNoise truth{0.0004, 0.002, length};
    NoiseMeasurement measurement;
    ASSERT_TRUE(measurement.add("ramp", frames_of(truth, ramp)));
    const auto got = measurement.result({});
    ASSERT_TRUE(got);
    for (const NoiseAtDepth& at : got->by_depth) {
      EXPECT_NEAR(at.deviation, truth.deviation(at.depth), 0.07 * at.deviation) << at.depth;
    }
    for (const double z : {0.25, 0.4, 0.55}) {
      EXPECT_NEAR(got->noise.deviation(z), truth.deviation(z), 0.05 * truth.deviation(z)) << z;
    }
    EXPECT_NEAR(got->noise.length, length, 0.1 * length) << length;
  }
}

TEST(NoiseMeasurement, SeveralScenesAddRange) {
  const MeasurementNoise truth{0.0002, 0.003, 0};
  NoiseMeasurement measurement;
  for (const double z : {0.2, 0.6}) {
    ASSERT_TRUE(measurement.add("wall", frames_of(truth, [z](int, int, int) { return z; })));
  }
  const auto got = measurement.result({});
  ASSERT_TRUE(got);
  EXPECT_NEAR(got->noise.at_zero, truth.at_zero, 0.15 * truth.at_zero);
  EXPECT_NEAR(got->noise.growth, truth.growth, 0.05 * truth.growth);
}

// One depth does not tell the growth: proportions are the usual ones.
TEST(NoiseMeasurement, KeepsTheUsualProportionsAtOneDepth) {
  const MeasurementNoise truth{0.001, 0.002, 0}, usual{0.0005, 0.001, 0};
  NoiseMeasurement measurement;
  ASSERT_TRUE(measurement.add("wall", frames_of(truth, [](int, int, int) { return 0.5; })));
  const auto got = measurement.result(usual);
  ASSERT_TRUE(got);
  EXPECT_NEAR(got->noise.growth, truth.growth, 0.05 * truth.growth);
}

TEST(NoiseMeasurement, RefusesWhatMovesAndWhatIsShort) {
  const MeasurementNoise noise{0.001, 0, 2};
  NoiseMeasurement measurement;
  const auto moves = [](int, int, int k) { return 0.5 + 0.05 * std::sin(0.4 * k); };
  const Status moving = measurement.add("hand", frames_of(noise, moves));
  ASSERT_FALSE(moving);
  EXPECT_EQ(moving.error().message,
            "hand: 100 % of the image moves; let camera and scene rest for three seconds");
  const Status brief = measurement.add("wall", frames_of(noise, ramp, 19));
  ASSERT_FALSE(brief);
  EXPECT_EQ(brief.error().message,
            "wall has 19 frames; noise needs at least 20 of a scene at rest");
  EXPECT_FALSE(measurement.result({}));
  // A small part that moves is left out.
  const auto waves = [&](int u, int v, int k) { return u < 32 && v < 32 ? moves(u, v, k) : 0.5; };
  ASSERT_TRUE(measurement.add("wave", frames_of(noise, waves)));
  const auto got = measurement.result({});
  ASSERT_TRUE(got);
  EXPECT_NEAR(got->noise.deviation(0.5), 0.001, 0.00005);
}

TEST(SensorNoise, GivesItsCameraItsEstimate) {
  SensorNoise sensor;
  sensor.kind = SensorKind::active_stereo;
  sensor.noise = {0.0003, 0.002, 7};
  const DepthAverageOptions options = depth_average_options_for(sensor);
  EXPECT_EQ(options.noise, 0.0003);
  EXPECT_EQ(options.noise_growth, 0.002);
  EXPECT_NEAR(options.noise_patch, 307.9, 0.1);  // the integral of exp(-r / 7) over the plane
  EXPECT_EQ(options.keep_frames, depth_average_options_for(sensor.kind).keep_frames);
  EXPECT_TRUE(check_settings(options));
}

}  // namespace
}  // namespace palpate
