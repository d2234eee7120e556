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
/// Details from which on the noise of a depth is known.
inline constexpr int kMinDetails = 20;
/// Share of the details whose sizes tell the noise.
inline constexpr double kQuantile = 0.7;

/// Returns the noise of depth `number` from the quantile of `num` details. It is in a step of sizes
/// that has `in_step` of them, after `before` smaller ones.
PALPATE_HOSTDEV inline DetailNoise quantile_noise(int number, double num, int step, double before,
                                                  double in_step) {
  constexpr double normal_quantile = 1.0364;  // of the size of a normal variable of unit variance
  const auto size_at = [](int at) { return lower_end(DetailCounts::kSmallest, at, 3); };
  DetailNoise noise;
  noise.z = (lower_end(DetailCounts::kNearest, number, 2) +
             lower_end(DetailCounts::kNearest, number + 1, 2)) /
            2;
  noise.num = num;
  const double low = step == 0 ? 0 : size_at(step), high = size_at(step + 1);
  const double share = (kQuantile * num - before) / in_step;
  noise.sd = (low + share * (high - low)) * kTails / normal_quantile;
  return noise;
}

/// Sums over the noise by depth of a level, for base + growth z^2: weights w, counts over the
/// squared noise, and with q = z^2 and the noise y also w q, w q^2, w y and w q y.
struct NoiseCurve {
  static constexpr int kNumSums = 5;
  double sums[kNumSums] = {};

  /// Returns the terms of one depth.
  PALPATE_HOSTDEV static NoiseCurve of(double z, double sd, double num) {
    const double square = z * z, at_least = sd < 1e-7 ? 1e-7 : sd;
    const double weight = num / (at_least * at_least);
    return {{weight, weight * square, weight * square * square, weight * sd, weight * square * sd}};
  }
  PALPATE_HOSTDEV void add(const NoiseCurve& other) {
    for (int k = 0; k < kNumSums; ++k) sums[k] += other.sums[k];
  }
  PALPATE_HOSTDEV bool is_empty() const { return sums[0] <= 0; }
  /// Returns one of four quotients: the growth without a base, base and growth, the base without a
  /// growth. The lanes of a GPU share them.
  static constexpr int kNumQuotients = 4;
  PALPATE_HOSTDEV double quotient(int which) const {
    const double w = sums[0], q = sums[1], qq = sums[2], y = sums[3], qy = sums[4];
    const double above = which == 0   ? qy
                         : which == 1 ? y * qq - qy * q
                         : which == 2 ? w * qy - q * y
                                      : y;
    return above / (which == 0 ? qq : which == 3 ? w : determinant());
  }
  /// Returns the curve of least squares; neither number is negative.
  PALPATE_HOSTDEV ScaleNoise fitted(const double (&quotients)[kNumQuotients]) const {
    double base = 0, growth = quotients[0];
    if (determinant() > 1e-9 * sums[0] * sums[2]) {
      base = quotients[1];
      growth = quotients[2];
      if (base < 0) base = 0, growth = quotients[0];
      if (growth < 0) growth = 0, base = quotients[3];
    }
    return {static_cast<float>(base), static_cast<float>(growth)};
  }

 private:
  PALPATE_HOSTDEV double determinant() const { return sums[0] * sums[2] - sums[1] * sums[1]; }
};

/// Returns the noise of a depth at a level: limited by that of the finer `levels` and by `most`,
/// the most of all of them. More is shape.
PALPATE_HOSTDEV inline double limited_noise(const DetailNoise& at, int level,
                                            const ScaleNoise* levels, double most) {
  // Growth of the noise from the finer levels to the next one. White noise falls by half; noise
  // that is smooth over a few pixels grows up to their number, from level to level ever less.
  constexpr double max_growth[kNumScales] = {0, 3, 2, 1.25, 1};
  if (level == 0) return at.sd;
  const double known = levels[level - 1].at(at.z);
  double growth = max_growth[level];
  if (level > 1) {
    const double finer = levels[level - 2].at(at.z);
    if (known < growth * finer) growth = finer < known ? known / finer : 1;
  }
  // Noise that has fallen may rise again, as that of a Kinect does, but not to all of `most`.
  const double limit = growth * (most < known ? known : std::sqrt(known * most));
  return limit < at.sd ? limit : at.sd;
}

/// Returns the noise of a frame's surface by that of its details.
PALPATE_HOSTDEV inline FrameNoise frame_noise_of(const ScaleNoise* levels) {
  FrameNoise noise;
  for (int level = 0; level < kNumScales; ++level) {
    noise.base[level] = static_cast<float>(static_cast<double>(levels[level].base) / kTails);
    noise.growth[level] = static_cast<float>(static_cast<double>(levels[level].growth) / kTails);
  }
  return noise;
}

}}  // namespace palpate::v0
