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

namespace {

DetailNoise detail_noise(const std::uint32_t (&counts)[DetailCounts::kSizes], int number) {
  double num = 0, before = 0;
  for (const std::uint32_t in_step : counts) num += in_step;
  if (num < kMinDetails) return {};
  int step = 0;
  for (; before + counts[step] < kQuantile * num; ++step) before += counts[step];
  return quantile_noise(number, num, step, before, counts[step]);
}

}  // namespace

std::array<ScaleNoise, kNumScales> noise_of(const std::array<DetailCounts, kNumScales>& counts) {
  std::array<ScaleNoise, kNumScales> result;
  double most[DetailCounts::kDepths] = {};  // of the finer levels
  for (int level = 0; level < kNumScales; ++level) {
    const auto at = static_cast<std::size_t>(level);
    const ScaleNoise before = level > 0 ? result[at - 1] : ScaleNoise{};
    NoiseCurve curve;
    for (int z = 0; z < DetailCounts::kDepths; ++z) {
      const DetailNoise noise = detail_noise(counts[at].counts[z], z);
      if (noise.sd < 0) continue;
      const double sd = limited_noise(noise, level, result.data(), most[z]);
      if (most[z] < sd) most[z] = sd;
      curve.add(NoiseCurve::of(noise.z, sd, noise.num));
    }
    double quotients[NoiseCurve::kNumQuotients];
    for (int k = 0; k < NoiseCurve::kNumQuotients; ++k) quotients[k] = curve.quotient(k);
    result[at] = curve.is_empty() ? before : curve.fitted(quotients);
  }
  return result;
}

}}  // namespace palpate::v0
