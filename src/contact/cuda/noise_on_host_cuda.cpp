#include "src/contact/cuda/noise_on_host.h"

#include <vector>

namespace palpate { inline namespace v0 {

SurfaceView NoiseOnHost::on_host(SurfaceView surface, std::size_t camera, gpu::Stream& stream) {
  std::size_t number = 4 * camera;
  while (fields_.size() < number + 4) fields_.emplace_back(gpu_);
  for (DepthFieldView* const field :
       {&surface.field, &surface.seen_free, &surface.in_front, &surface.remembered}) {
    *field = fields_[number++].on_host(*field, stream);
  }
  return surface;
}

std::optional<MeasureNoise> NoiseOnHost::of_one(const SurfaceView& from, const SurfaceView& to,
                                                double alpha, const Pose& X_CT,
                                                gpu::Stream& stream) {
  const SurfaceView after = on_host(to, 0, stream);
  const SurfaceView before = alpha < 1 ? on_host(from, 0, stream) : after;
  if (!stream.wait()) return std::nullopt;
  return query_.measure_one(before, after, alpha, X_CT, {.noise = true}).noise;
}

std::optional<MeasureNoise> NoiseOnHost::of_hull(std::span<const SurfaceBlend> cameras,
                                                 const Pose& X_WT, gpu::Stream& stream) {
  std::vector<SurfaceBlend> here(cameras.begin(), cameras.end());
  for (std::size_t k = 0; k < here.size(); ++k) {
    here[k].to = on_host(here[k].to, k, stream);
    here[k].from = here[k].progress < 1 ? on_host(here[k].from, k, stream) : here[k].to;
  }
  if (!stream.wait()) return std::nullopt;
  return query_.measure(here, X_WT, {.noise = true}).noise;
}

}}  // namespace palpate::v0
