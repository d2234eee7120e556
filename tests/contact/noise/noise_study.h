// Scenes with noise of a known kind, and how often measurements are off by what they say: shared by
// the tests of a measure's noise.
#pragma once

#include <cmath>
#include <functional>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/field/sensor.h"
#include "tests/test_util/random.h"

namespace palpate::test {

inline constexpr int kWide = 320, kHigh = 240;
inline constexpr Intrinsics kEye{300, 300, 159.5, 119.5};

/// Noise of unit variance: white, or a box mean of `side` pixels each way of white noise.
inline std::vector<float> unit_noise(Random& random, int side) {
  const int wide = kWide + side, high = kHigh + side;
  std::vector<double> white(static_cast<std::size_t>(wide * high));
  for (double& each : white) {
    double sum = 0;
    for (int i = 0; i < 12; ++i) sum += random.uniform(0, 1);
    each = sum - 6;
  }
  std::vector<float> noise(static_cast<std::size_t>(kWide * kHigh));
  for (int v = 0; v < kHigh; ++v) {
    for (int u = 0; u < kWide; ++u) {
      double sum = 0;
      for (int q = 0; q < side; ++q) {
        for (int p = 0; p < side; ++p) {
          sum += white[static_cast<std::size_t>((v + q) * wide + u + p)];
        }
      }
      noise[static_cast<std::size_t>(v * kWide + u)] = static_cast<float>(sum / side);
    }
  }
  return noise;
}

/// Depth of a scene along the ray (x, y, 1).
using Shape = std::function<double(double x, double y)>;

/// The numbers of a measure: volume, force, torque.
inline std::array<double, 7> numbers_of(const Penetration& at) {
  const VolumeWrench& w = at.measure_W;
  return {at.volume, w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z};
}
inline std::array<double, 7> deviations_of(const MeasureNoise& noise) {
  const Vec3d f = noise.force_std(), t = noise.torque_std();
  return {noise.volume_std(), f.x, f.y, f.z, t.x, t.y, t.z};
}

/// Measurements of one tool at rest against many frames of one scene.
struct NoiseStudy {
  std::vector<std::array<double, 7>> measured, said;

  void add(const ContactResult& result) {
    measured.push_back(numbers_of(result.penetration));
    said.push_back(deviations_of(*result.noise));
  }
  /// Deviations from the mean, in what was said.
  std::vector<double> errors(int number) const {
    const auto k = static_cast<std::size_t>(number);
    double mean = 0;
    for (const auto& each : measured) mean += each[k];
    mean /= static_cast<double>(measured.size());
    // The mean of n takes away 1 / n of the variance.
    const auto num = static_cast<double>(measured.size());
    const double fair = std::sqrt(num / (num - 1));
    std::vector<double> result;
    for (std::size_t i = 0; i < measured.size(); ++i) {
      result.push_back(fair * (measured[i][k] - mean) / said[i][k]);
    }
    return result;
  }
};

inline double share_within(const std::vector<double>& errors, double limit) {
  double num = 0;
  for (const double error : errors) num += std::fabs(error) <= limit;
  return num / static_cast<double>(errors.size());
}
inline double rms(const std::vector<double>& errors) {
  double sum = 0;
  for (const double error : errors) sum += error * error;
  return std::sqrt(sum / static_cast<double>(errors.size()));
}

}  // namespace palpate::test
