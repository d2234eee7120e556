// Depth fields of many images of one camera model at once.
#pragma once

#include <memory>
#include <optional>

#include "palpate/field/sensor.h"
#include "palpate/gpu/devices.h"
#include "src/field/timeline/frame_slots.h"

namespace palpate { inline namespace v0 {

/// Keeps the fields of one batch of images.
class BatchFrames {
 public:
  virtual ~BatchFrames() = default;

  /// Allocates memory for `num_images`. Errors: there is too little.
  virtual Status reserve(int num_images) = 0;
  /// Computes the fields of `num` images, which follow each other in the memory of `first`.
  virtual Result<SurfaceBatch> update(const DepthImageView& first, int num,
                                      std::optional<CallerStream> stream, ThreadPool& pool) = 0;
};

Result<std::unique_ptr<BatchFrames>> make_batch_frames_cpu(const SlotSettings& settings);
/// `pixels_at_once`: the default is enough to fill any GPU.
Result<std::unique_ptr<BatchFrames>> make_batch_frames_cuda(const SlotSettings& settings, int gpu,
                                                            int pixels_at_once = 1 << 23);

}}  // namespace palpate::v0
