// The noise of each scale from the counts of its details: a quantile for each depth, then a curve
// for each level. Shared code for CPU and GPU.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "src/cloud/surface/adaptive/scale_noise.h"

namespace palpate { inline namespace v0 {

/// Steps of 2^-bits of an octave above a power of two, by the bits of the numbers.
PALPATE_HOSTDEV inline int steps_above(float first, float value, int bits) {
  std::uint32_t from, to;
  std::memcpy(&from, &first, sizeof from);
  std::memcpy(&to, &value, sizeof to);
  return static_cast<int>(to >> (23 - bits)) - static_cast<int>(from >> (23 - bits));
}
/// Returns the number at the lower end of a step.
PALPATE_HOSTDEV inline double lower_end(float first, int step, int bits) {
  const int octave = step >> bits;
  const double within = static_cast<double>(step & ((1 << bits) - 1)) / (1 << bits);
  return std::ldexp(static_cast<double>(first) * (1 + within), octave);
}

/// Place of a detail among the counts.
struct DetailPlace {
  int depth, size;
};
/// Finds the place of a detail of a cell at an inverse depth.
PALPATE_HOSTDEV inline DetailPlace place_of(float inverse_depth, float detail) {
  constexpr float nearest = DetailCounts::kNearest, smallest = DetailCounts::kSmallest;
  const float z = 1.0f / inverse_depth, size = std::fabs(detail) * z * z;
  const int depth_step = steps_above(nearest, z < nearest ? nearest : z, 2);
  const int size_step = steps_above(smallest, size < smallest ? smallest : size, 3);
  return {depth_step < DetailCounts::kDepths ? depth_step : DetailCounts::kDepths - 1,
          size_step < DetailCounts::kSizes ? size_step : DetailCounts::kSizes - 1};
}

/// Noise of the details of one depth.
struct DetailNoise {
  double z = 0;    ///< m
  double sd = -1;  ///< m; -1: too few details to tell
  double num = 0;  ///< details
};
/// Finds the noise of the details of a depth by a quantile of their sizes. `number`: of the depth.
PALPATE_HOSTDEV inline DetailNoise detail_noise(const std::uint32_t (&counts)[DetailCounts::kSizes],
                                                int number) {
  constexpr int min_num = 20;  // from which noise is known
  constexpr double quantile = 0.7;
  constexpr double normal_quantile = 1.0364;  // of the size of a normal variable of unit variance
  const auto size_at = [](int step) { return lower_end(DetailCounts::kSmallest, step, 3); };
  DetailNoise noise;
  noise.z = (lower_end(DetailCounts::kNearest, number, 2) +
             lower_end(DetailCounts::kNearest, number + 1, 2)) /
            2;
  for (const std::uint32_t num : counts) noise.num += num;
  if (noise.num < min_num) return noise;
  noise.sd = size_at(DetailCounts::kSizes);
  double before = 0;
  for (int i = 0; i < DetailCounts::kSizes; ++i) {
    const double num = counts[i];
    if (before + num >= quantile * noise.num) {
      const double low = i == 0 ? 0 : size_at(i), high = size_at(i + 1);
      const double share = (quantile * noise.num - before) / num;
      noise.sd = (low + share * (high - low)) * kTails / normal_quantile;
      break;
    }
    before += num;
  }
  return noise;
}

/// Fits base + growth z^2 to noise by depth, weighted by counts over the squared noise; neither is
/// negative.
class NoiseCurve {
 public:
  PALPATE_HOSTDEV void add(double z, double sd, double num) {
    const double square = z * z, at_least = sd < 1e-7 ? 1e-7 : sd;
    const double weight = num / (at_least * at_least);
    w_ += weight;
    q_ += weight * square;
    qq_ += weight * square * square;
    y_ += weight * sd;
    qy_ += weight * square * sd;
  }
  PALPATE_HOSTDEV bool is_empty() const { return w_ <= 0; }
  PALPATE_HOSTDEV ScaleNoise fitted() const {
    const double determinant = w_ * qq_ - q_ * q_;
    double base = 0, growth = qy_ / qq_;
    if (determinant > 1e-9 * w_ * qq_) {
      base = (y_ * qq_ - qy_ * q_) / determinant;
      growth = (w_ * qy_ - q_ * y_) / determinant;
      if (base < 0) base = 0, growth = qy_ / qq_;
      if (growth < 0) growth = 0, base = y_ / w_;
    }
    return {static_cast<float>(base), static_cast<float>(growth)};
  }

 private:
  double w_ = 0, q_ = 0, qq_ = 0, y_ = 0, qy_ = 0;
};

using NoiseByDepth = DetailNoise[DetailCounts::kDepths];

/// Finds the noise of all levels, `result`. A level's noise is at most a few times that of the
/// finer ones: more is shape.
PALPATE_HOSTDEV inline void fit_noise(const NoiseByDepth (&by_depth)[kNumScales],
                                      ScaleNoise* result) {
  // Growth of the noise from the finer levels to the next one. White noise falls by half; noise
  // that is smooth over a few pixels grows up to their number.
  constexpr double max_growth[kNumScales] = {0, 3, 2, 1.25, 1};
  double most[DetailCounts::kDepths] = {};  // of the finer levels
  for (int level = 0; level < kNumScales; ++level) {
    NoiseCurve curve;
    for (int i = 0; i < DetailCounts::kDepths; ++i) {
      const DetailNoise& at = by_depth[level][i];
      if (at.sd < 0) continue;
      double sd = at.sd;
      if (level > 0) {
        const double before = result[level - 1].at(at.z);
        const double limit = max_growth[level] * (most[i] < before ? before : most[i]);
        if (limit < sd) sd = limit;
      }
      if (most[i] < sd) most[i] = sd;
      curve.add(at.z, sd, at.num);
    }
    result[level] = !curve.is_empty() ? curve.fitted()
                    : level > 0       ? result[level - 1]
                                      : ScaleNoise{};
  }
}

}}  // namespace palpate::v0
