// The noise of single measures on a GPU: warps keep the elements that touch, against one field as
// many as the tool has clusters, at most 1024, and against several cameras one of each block that
// runs; then one block sums up their noise.
#pragma once

#include <optional>

#include "src/contact/cuda/query_answer.h"
#include "src/contact/field/field_tool_cuda.h"
#include "src/contact/noise/noise_rows.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

class HullCameras;
struct NoiseEyes;  // the argument of a kernel

/// Owns the rows of a tool's elements. All memory is allocated at construction.
class MeasureNoiseCuda {
 public:
  MeasureNoiseCuda(const FieldTool& tool, int gpu);

  /// Returns the noise against one field on the GPU, in its frame. None: its noise is unknown, or
  /// the GPU has failed. To 1e-4 of the deviations of NoiseMemory, but at the border of two grids
  /// (noise_window); the same bits on every run.
  std::optional<MeasureNoise> of_field(const DepthFieldView& field, const FieldFrame& frame,
                                       gpu::Stream& stream) noexcept;
  /// The same against the cameras of a hull, in W.
  std::optional<MeasureNoise> of_cameras(const HullCameras& cameras, gpu::Stream& stream) noexcept;

  /// Returns the first failure.
  const Status& status() const { return memory_.status() ? answers_.status() : memory_.status(); }

 private:
  KeptRows kept_by(int num_parts) const;
  template <int kMaxViews>
  void keep(const HullCameras& cameras, gpu::Stream& stream) const noexcept;
  std::optional<MeasureNoise> sum(const NoiseEyes& eyes, int num_parts,
                                  gpu::Stream& stream) noexcept;

  ElementsView elements_;
  gpu::Memory memory_;
  int field_parts_, hull_parts_;  // of the rows
  NoiseRows rows_;
  AnswerBox answers_;
};

}}  // namespace palpate::v0
