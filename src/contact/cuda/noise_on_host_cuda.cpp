#include "src/contact/cuda/noise_on_host.h"

#include <algorithm>

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
  const auto field_of = [&](SurfaceView surface) {
    surface.seen_free = surface.in_front = surface.remembered = {};
    return on_host(surface, 0, stream);
  };
  const SurfaceView after = field_of(to);
  const SurfaceView before = alpha < 1 ? field_of(from) : after;
  if (!stream.wait()) return std::nullopt;
  return query_.measure_one(before, after, alpha, X_CT, {.noise = true}).noise;
}

std::optional<MeasureNoise> NoiseOnHost::of_hull(std::span<const SurfaceBlend> cameras,
                                                 const Pose& X_WT, gpu::Stream& stream) {
  std::ranges::copy(cameras, here_.begin());
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    here_[k].to = on_host(here_[k].to, k, stream);
    here_[k].from = here_[k].progress < 1 ? on_host(here_[k].from, k, stream) : here_[k].to;
  }
  if (!stream.wait()) return std::nullopt;
  return query_.measure(std::span(here_).first(cameras.size()), X_WT, {.noise = true}).noise;
}

}}  // namespace palpate::v0
