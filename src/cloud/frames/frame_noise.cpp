#include "src/cloud/internal/frame_noise.h"

#include <cmath>

namespace palpate { inline namespace v0 {

FrameNoise frame_noise(const MeasurementNoise& noise) {
  const MeasurementNoise known = noise.at_zero > 0 || noise.growth > 0 ? noise : MeasurementNoise{};
  FrameNoise result;
  const auto mean = [&](int level) {
    return known.patch() / (known.patch() + std::ldexp(1, 2 * level) - 1);
  };
  for (int level = 0; level < kNumNoiseLevels; ++level) {
    constexpr double of_white = 0.75;  // what a mean of four loses
    const double sd = std::sqrt(kDetailShare / of_white * (mean(level) - mean(level + 1)));
    result.base[level] = static_cast<float>(sd * known.at_zero);
    result.growth[level] = static_cast<float>(sd * known.growth);
  }
  return result;
}

}}  // namespace palpate::v0
