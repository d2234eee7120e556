#include "src/cloud/surface/adaptive/scale_noise.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

constexpr int kMinCount = 20;  ///< details of a depth from which its noise is known
constexpr double kQuantile = 0.7;
/// Quantile of the size of a normal variable of unit variance, and the share by which the noise is
/// taken to be larger: real noise has longer tails.
constexpr double kNormalQuantile = 1.0364, kTails = 1.05;
/// Growth of the noise from the finer levels to the next one. White noise falls by half; noise
/// that is smooth over a few pixels grows up to their number.
constexpr double kMaxGrowth[kNumScales] = {0, 3, 2, 1.25, 1};

/// Steps of 2^-bits of an octave above a power of two, by the bits of the numbers.
int step_of(float value, float first, int bits) {
  const auto steps = [&](float x) {
    return static_cast<int>(std::bit_cast<std::uint32_t>(x) >> (23 - bits));
  };
  return steps(value) - steps(first);
}
/// Returns the number at the lower end of a step.
double lower_end(int step, float first, int bits) {
  const int octave = step >> bits;
  const double within = static_cast<double>(step & ((1 << bits) - 1)) / (1 << bits);
  return std::ldexp(static_cast<double>(first) * (1 + within), octave);
}

double depth_at(int number) {
  return (lower_end(number, DetailCounts::kNearest, 2) +
          lower_end(number + 1, DetailCounts::kNearest, 2)) /
         2;
}

/// Returns the noise of the details of one depth; 0: too few.
double noise_at(const std::array<std::uint32_t, DetailCounts::kSizes>& counts) {
  double total = 0;
  for (const std::uint32_t num : counts) total += num;
  if (total < kMinCount) return -1;
  double before = 0;
  for (int i = 0; i < DetailCounts::kSizes; ++i) {
    const double num = counts[static_cast<std::size_t>(i)];
    if (before + num >= kQuantile * total) {
      const double low = i == 0 ? 0 : lower_end(i, DetailCounts::kSmallest, 3);
      const double high = lower_end(i + 1, DetailCounts::kSmallest, 3);
      const double share = (kQuantile * total - before) / num;
      return (low + share * (high - low)) * kTails / kNormalQuantile;
    }
    before += num;
  }
  return lower_end(DetailCounts::kSizes, DetailCounts::kSmallest, 3);
}

/// Fits base + growth z^2 to noise by depth, weighted by counts over the squared noise; neither is
/// negative.
ScaleNoise fitted(const std::array<double, DetailCounts::kDepths>& noise,
                  const std::array<double, DetailCounts::kDepths>& num) {
  double w = 0, q = 0, qq = 0, y = 0, qy = 0;
  for (int i = 0; i < DetailCounts::kDepths; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (num[at] <= 0) continue;
    const double z = depth_at(i), square = z * z;
    const double sd = std::max(noise[at], 1e-7), weight = num[at] / (sd * sd);
    w += weight;
    q += weight * square;
    qq += weight * square * square;
    y += weight * noise[at];
    qy += weight * square * noise[at];
  }
  if (w <= 0) return {};
  const double determinant = w * qq - q * q;
  double base = 0, growth = qy / qq;
  if (determinant > 1e-9 * w * qq) {
    base = (y * qq - qy * q) / determinant;
    growth = (w * qy - q * y) / determinant;
    if (base < 0) base = 0, growth = qy / qq;
    if (growth < 0) growth = 0, base = y / w;
  }
  return {static_cast<float>(base), static_cast<float>(growth)};
}

}  // namespace

void DetailCounts::add(const DetailCounts& other) {
  for (std::size_t z = 0; z < counts.size(); ++z) {
    for (std::size_t i = 0; i < counts[z].size(); ++i) counts[z][i] += other.counts[z][i];
  }
}

void DetailCounts::add(float inverse_depth, float detail) {
  const float z = 1.0f / inverse_depth, size = std::abs(detail) * z * z;
  const int depth = std::clamp(step_of(std::max(z, kNearest), kNearest, 2), 0, kDepths - 1);
  const int step = std::clamp(step_of(std::max(size, kSmallest), kSmallest, 3), 0, kSizes - 1);
  ++counts[static_cast<std::size_t>(depth)][static_cast<std::size_t>(step)];
}

std::array<ScaleNoise, kNumScales> noise_of(const std::array<DetailCounts, kNumScales>& counts) {
  std::array<ScaleNoise, kNumScales> result;
  std::array<double, DetailCounts::kDepths> most{};  // of the finer levels
  for (std::size_t level = 0; level < kNumScales; ++level) {
    std::array<double, DetailCounts::kDepths> noise{}, num{};
    bool has_any = false;
    for (std::size_t z = 0; z < noise.size(); ++z) {
      noise[z] = noise_at(counts[level].counts[z]);
      if (noise[z] < 0) continue;
      for (const std::uint32_t n : counts[level].counts[z]) num[z] += n;
      if (level > 0) {
        const double finer = std::max(most[z], result[level - 1].at(depth_at(static_cast<int>(z))));
        noise[z] = std::min(noise[z], kMaxGrowth[level] * finer);
      }
      most[z] = std::max(most[z], noise[z]);
      has_any = true;
    }
    result[level] = has_any ? fitted(noise, num) : level > 0 ? result[level - 1] : ScaleNoise{};
  }
  return result;
}

}}  // namespace palpate::v0
