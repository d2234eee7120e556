#include "src/cloud/internal/frame_noise.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {

FrameNoise frame_noise(const DepthNoise& noise) {
  const DepthNoise known = noise.at_zero > 0 || noise.growth > 0 ? noise : DepthNoise{};
  FrameNoise result;
  for (int level = 0; level < kNumNoiseLevels; ++level) {
    const double num_pixels = std::ldexp(1, 2 * level);
    const double sd = std::sqrt(kDetailShare * std::min(1.0, known.patch() / num_pixels));
    result.base[level] = static_cast<float>(sd * known.at_zero);
    result.growth[level] = static_cast<float>(sd * known.growth);
  }
  return result;
}

}}  // namespace palpate::v0
