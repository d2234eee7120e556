// Noise of measures on a GPU, told by the host: FieldContact's own definition on the same fields,
// which come off the GPU once a frame.
#pragma once

#include <array>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "src/contact/cuda/gpu_field.h"
#include "src/contact/field/field_contact.h"

namespace palpate { inline namespace v0 {

class NoiseOnHost {
 public:
  NoiseOnHost(std::shared_ptr<const ToolIndex> index, const FieldMethod& method, int gpu)
      : gpu_(gpu), query_(std::move(index), method, {.reserves_noise = true}) {}

  /// Returns the noise of ContactQuery::measure_one. Waits for `stream`; the first fields of their
  /// size allocate. None: it is unknown, or the GPU has failed.
  std::optional<MeasureNoise> of_one(const SurfaceView& from, const SurfaceView& to, double alpha,
                                     const Pose& X_CT, gpu::Stream& stream);
  /// Returns that of ContactQuery::measure_hull.
  std::optional<MeasureNoise> of_hull(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                                      gpu::Stream& stream);

 private:
  SurfaceView on_host(SurfaceView surface, std::size_t camera, gpu::Stream& stream);

  int gpu_;
  FieldContact query_;
  std::deque<HostFields> fields_;  // four of each camera
  std::array<SurfaceBlend, kMaxCameras> here_;
};

}}  // namespace palpate::v0
