#include <gtest/gtest.h>

#include <limits>

#include "scenes/body_shapes.h"
#include "scenes/noise_model.h"
#include "scenes/scene.h"

namespace palpate {
inline namespace v0 {
namespace scenes {
namespace {

Scene wall_at(double depth) {
  Scene scene;
  scene.environment = Environment::wall(depth);
  return scene;
}

std::vector<DepthFrame> frames_of(const Scene& scene, const SimulatedCameraOptions& options) {
  auto source = open_simulated_camera(scene, options).value();
  std::vector<DepthFrame> frames;
  DepthFrame frame;
  while (source->next(frame).value()) frames.push_back(frame);
  EXPECT_FALSE(source->next(frame).value()) << "the end is the end";
  return frames;
}

struct Statistics {
  double mean = 0, deviation = 0;
  int count = 0, missing = 0;
};

/// Computes statistics of the measured depth, without the left tenth of the image.
Statistics statistics(const DepthFrame& frame) {
  Statistics s;
  double sum = 0, squares = 0;
  for (int v = 0; v < frame.height; ++v) {
    for (int u = frame.width / 10; u < frame.width; ++u) {
      const std::uint16_t count = frame.pixels[static_cast<std::size_t>(v * frame.width + u)];
      if (count == 0) {
        ++s.missing;
        continue;
      }
      ++s.count;
      const double z = count * frame.unit;
      sum += z;
      squares += z * z;
    }
  }
  s.mean = sum / s.count;
  s.deviation = std::sqrt(squares / s.count - s.mean * s.mean);
  return s;
}

TEST(SimulatedCamera, AxialNoiseFollowsNguyen) {
  for (const double z : {0.5, 0.803, 1.0, 1.511, 2.0, 3.0}) {
    SimulatedCameraOptions options;
    options.unit = 0.0001;
    options.duration = 1 / 30.0;
    const double sigma = 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4);
    const Statistics smooth = [&] {
      SimulatedCameraOptions o = options;
      o.noise.disparity_steps = 0;
      return statistics(frames_of(wall_at(z), o).at(0));
    }();
    EXPECT_NEAR(smooth.mean, z, 0.02 * sigma) << z;
    EXPECT_NEAR(smooth.deviation, sigma, 0.02 * sigma) << z;
    const Statistics quantised = statistics(frames_of(wall_at(z), options).at(0));
    EXPECT_NEAR(quantised.mean, z, 0.1 * sigma) << z;
    EXPECT_NEAR(quantised.deviation, sigma, 0.05 * sigma) << z;
  }
}

TEST(SimulatedCamera, NoiseIsNearlyNormalAndIndependent) {
  SimulatedCameraOptions options;
  options.unit = 0.00005;
  options.noise.disparity_steps = 0;
  options.noise.missing = 0;
  options.duration = 2 / 30.0;
  const auto frames = frames_of(wall_at(1), options);
  const double sigma = 0.0012 + 0.0019 * 0.36;
  double n = 0, third = 0, fourth = 0, beyond2 = 0, neighbor = 0, in_time = 0;
  for (std::size_t i = 0; i + 1 < frames[0].pixels.size(); ++i) {
    const double x = (frames[0].pixels[i] * options.unit - 1) / sigma;
    const double next = (frames[0].pixels[i + 1] * options.unit - 1) / sigma;
    const double later = (frames[1].pixels[i] * options.unit - 1) / sigma;
    n += 1;
    third += x * x * x;
    fourth += x * x * x * x;
    beyond2 += std::abs(x) > 2;
    neighbor += x * next;
    in_time += x * later;
  }
  EXPECT_NEAR(third / n, 0, 0.03);
  EXPECT_NEAR(fourth / n, 3, 0.08);
  EXPECT_NEAR(beyond2 / n, 0.0455, 0.002);
  EXPECT_NEAR(neighbor / n, 0, 0.01);
  EXPECT_NEAR(in_time / n, 0, 0.01);
}

TEST(SimulatedCamera, DepthsAreWholeDisparitySteps) {
  SimulatedCameraOptions options;
  options.unit = 0.00001;
  options.duration = 1 / 30.0;
  const auto frames = frames_of(wall_at(0.6), options);
  const double steps = 575.8157 * 0.075 * 8;
  int measured = 0;
  for (const std::uint16_t count : frames[0].pixels) {
    if (count == 0) continue;
    const double step = steps / (count * options.unit);
    EXPECT_NEAR(step, std::round(step), 0.01);
    ++measured;
  }
  EXPECT_GT(measured, 250000);
}

TEST(SimulatedCamera, TheStatedShareIsMissing) {
  SimulatedCameraOptions options;
  options.noise.missing = 0.05;
  options.duration = 1 / 30.0;
  const Statistics s = statistics(frames_of(wall_at(1), options).at(0));
  EXPECT_NEAR(s.missing / static_cast<double>(s.missing + s.count), 0.05, 0.003);
}

TEST(SimulatedCamera, SameSeedSameBitsInAnyOrder) {
  const Scene scene = make_scene("hand").value();
  SimulatedCameraOptions options;
  options.duration = 3 / 30.0;
  const auto once = frames_of(scene, options), twice = frames_of(scene, options);
  ASSERT_EQ(once.size(), 3u);
  for (std::size_t i = 0; i < once.size(); ++i) EXPECT_EQ(once[i].pixels, twice[i].pixels);
  EXPECT_NE(once[0].pixels, once[1].pixels);
  options.seed = 2;
  EXPECT_NE(frames_of(scene, options)[0].pixels, once[0].pixels);
  // Frame 2 measured first.
  const std::vector<float> depth = render_depth(scene, once[2].timestamp);
  DepthSensor sensor({}, scene.intrinsics, scene.width, scene.height, 0.001, 1);
  std::vector<std::uint16_t> counts(depth.size());
  sensor.measure(depth, 2, counts);
  EXPECT_EQ(counts, once[2].pixels);
}

// A plate at 0.8 m in front of a wall at 1.6 m: the shadow is f b (1/0.8 - 1/1.6) = 27 pixels wide
// and left of the plate, for the projector is on the right.
TEST(SimulatedCamera, ShadowsFallOnTheLeft) {
  Scene scene = wall_at(1.6);
  scene.bodies.push_back({"plate", block({-0.1, -0.1, 0.8}, {0.1, 0.1, 0.82}), nullptr, {}});
  SimulatedCameraOptions options;
  options.noise.missing = 0;
  options.noise.lateral = 0;
  options.duration = 1 / 30.0;
  const auto missing_in_row = [&](int v) {
    std::vector<int> columns;
    const DepthFrame frame = frames_of(scene, options).at(0);
    for (int u = 0; u < 640; ++u) {
      if (frame.pixels[static_cast<std::size_t>(v * 640 + u)] == 0) columns.push_back(u);
    }
    return columns;
  };
  const std::vector<int> columns = missing_in_row(240);
  EXPECT_NEAR(static_cast<double>(columns.size()), 575.8157 * 0.075 * (1 / 0.8 - 1 / 1.6), 1.1);
  ASSERT_FALSE(columns.empty());
  const double left_edge = 319.5 - 0.1 / 0.8 * 575.8157;
  EXPECT_LT(columns.back(), left_edge);
  EXPECT_GT(columns.front(), left_edge - 30);
  EXPECT_TRUE(missing_in_row(20).empty());
  options.noise.baseline = 0;
  EXPECT_TRUE(missing_in_row(240).empty());
}

TEST(SimulatedCamera, LateralNoiseMovesEdgesOnly) {
  Scene scene = wall_at(1.6);
  scene.bodies.push_back({"plate", block({-0.1, -0.1, 0.8}, {0.1, 0.1, 0.82}), nullptr, {}});
  SimulatedCameraOptions options;
  options.noise.axial_base = options.noise.axial_growth = 0;
  options.noise.baseline = options.noise.missing = 0;
  options.duration = 1 / 30.0;
  const DepthFrame jittered = frames_of(scene, options).at(0);
  options.noise.enabled = false;
  const DepthFrame clean = frames_of(scene, options).at(0);
  int moved = 0;
  for (int v = 0; v < 480; ++v) {
    for (int u = 0; u < 640; ++u) {
      const auto i = static_cast<std::size_t>(v * 640 + u);
      if (jittered.pixels[i] == clean.pixels[i]) continue;
      ++moved;
      const double x = std::abs(u - 319.5) - 0.1 / 0.8 * 575.8157;
      const double y = std::abs(v - 239.5) - 0.1 / 0.8 * 575.8157;
      EXPECT_LT(std::min(std::abs(x), std::abs(y)), 4);
    }
  }
  EXPECT_GT(moved, 100);
}

TEST(SimulatedCamera, WithoutNoiseCountsAreRoundedDepth) {
  const Scene scene = make_scene("ridge-90").value();
  SimulatedCameraOptions options;
  options.noise.enabled = false;
  options.unit = 0.0001;
  options.duration = 1 / 30.0;
  const DepthFrame frame = frames_of(scene, options).at(0);
  const std::vector<float> depth = render_depth(scene, 0);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    ASSERT_NEAR(frame.pixels[i] * 0.0001, static_cast<double>(depth[i]), 0.500001e-4);
  }
}

TEST(SimulatedCamera, DepthThatDoesNotFitIsMissing) {
  SimulatedCameraOptions options;
  options.noise.enabled = false;
  options.duration = 1 / 30.0;
  for (const double z : {65.535, 70.0, 0.0004}) {
    EXPECT_EQ(frames_of(wall_at(z), options).at(0).pixels[0], 0) << z;
  }
  EXPECT_EQ(frames_of(wall_at(65.534), options).at(0).pixels[0], 65534);
  Scene empty;
  EXPECT_EQ(frames_of(empty, options).at(0).pixels[1000], 0);
}

TEST(SimulatedCamera, StreamsUntilTheDuration) {
  SimulatedCameraOptions options;
  options.duration = 0.5;
  const Scene scene = make_scene("wall").value();
  const auto source = open_simulated_camera(scene, options).value();
  EXPECT_EQ(source->info().num_frames, 15);
  EXPECT_EQ(source->info().width, 640);
  EXPECT_EQ(source->info().name, "wall");
  const auto frames = frames_of(scene, options);
  ASSERT_EQ(frames.size(), 15u);
  for (std::size_t k = 0; k < frames.size(); ++k) {
    EXPECT_DOUBLE_EQ(frames[k].timestamp, static_cast<double>(k) / 30);
    EXPECT_EQ(frames[k].pixels.size(), 640u * 480u);
  }
  EXPECT_EQ(open_simulated_camera(scene, {}).value()->info().num_frames, 120);
}

TEST(SimulatedCamera, RefusesNonsense) {
  const Scene scene = make_scene("wall").value();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](const Scene& s, const SimulatedCameraOptions& options) {
    const auto source = open_simulated_camera(s, options);
    return !source && source.error().code == Errc::invalid_argument &&
           source.error().message.find("give a number") != std::string::npos;
  };
  for (const double bad : {0.0, -1.0, nan}) {
    SimulatedCameraOptions options;
    options.unit = bad;
    EXPECT_TRUE(refused(scene, options));
    options = {};
    options.duration = bad;
    EXPECT_TRUE(refused(scene, options));
  }
  for (double NoiseModel::*field :
       {&NoiseModel::axial_base, &NoiseModel::axial_growth, &NoiseModel::disparity_steps,
        &NoiseModel::baseline, &NoiseModel::missing, &NoiseModel::lateral}) {
    SimulatedCameraOptions options;
    options.noise.*field = -1;
    EXPECT_TRUE(refused(scene, options));
    options.noise.*field = nan;
    EXPECT_TRUE(refused(scene, options));
  }
  Scene tiny = scene;
  tiny.width = 2;
  EXPECT_TRUE(refused(tiny, {}));
  Scene blind = scene;
  blind.intrinsics.fx = 0;
  EXPECT_TRUE(refused(blind, {}));
}

}  // namespace
}  // namespace scenes
}  // namespace v0
}  // namespace palpate
