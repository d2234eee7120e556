#include "src/cloud/surface/adaptive/scale_noise.h"

#include "src/cloud/surface/adaptive/noise_fit.h"

namespace palpate { inline namespace v0 {

void DetailCounts::add(const DetailCounts& other) {
  for (int z = 0; z < kDepths; ++z) {
    for (int i = 0; i < kSizes; ++i) counts[z][i] += other.counts[z][i];
  }
}

void DetailCounts::add(float inverse_depth, float detail) {
  const DetailPlace place = place_of(inverse_depth, detail);
  ++counts[place.depth][place.size];
}

std::array<ScaleNoise, kNumScales> noise_of(const std::array<DetailCounts, kNumScales>& counts) {
  NoiseByDepth by_depth[kNumScales];
  for (int level = 0; level < kNumScales; ++level) {
    const DetailCounts& of_level = counts[static_cast<std::size_t>(level)];
    for (int z = 0; z < DetailCounts::kDepths; ++z) {
      by_depth[level][z] = detail_noise(of_level.counts[z], z);
    }
  }
  std::array<ScaleNoise, kNumScales> result;
  fit_noise(by_depth, result.data());
  return result;
}

}}  // namespace palpate::v0
