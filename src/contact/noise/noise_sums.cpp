#include "src/contact/noise/noise_sums.h"

#include "src/core/internal/select_isa.h"

namespace palpate { inline namespace v0 {
PALPATE_DECLARE_KERNELS(void add_measure_noise(const NoiseSums& sums, int camera,
                                               const NoiseCamera& view, const DepthFieldView& field,
                                               MeasureNoise& to);
                        constexpr AddMeasureNoise kMeasureNoise = add_measure_noise;)

namespace {

constexpr AddMeasureNoise kNoiseKernels[] = PALPATE_BY_ISA(kMeasureNoise);

}  // namespace

NoiseMemory::NoiseMemory(int num_groups, Isa isa)
    : num_(static_cast<std::size_t>(num_groups)), add_(select_isa(kNoiseKernels, isa)) {}

std::optional<MeasureNoise> NoiseMemory::of_field(const DepthFieldView& field,
                                                  const FieldFrame& frame) {
  if (field.noise == nullptr) return std::nullopt;
  MeasureNoise noise;
  add(0, {.fx = frame.fx, .fy = frame.fy, .cx = frame.cx, .cy = frame.cy}, field, noise);
  return noise;
}

}}  // namespace palpate::v0
