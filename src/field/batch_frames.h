// How the fields of many images of one camera model are made at once.
#pragma once

#include <memory>
#include <optional>

#include "palpate/field/sensor.h"
#include "palpate/gpu/devices.h"
#include "src/field/frame_slots.h"

namespace palpate::inline v0 {

/// Keeps the fields of one batch of images.
class BatchFrames {
 public:
  virtual ~BatchFrames() = default;

  /// Memory for so many images. Errors: there is too little.
  virtual Status reserve(int num_images) = 0;
  /// The fields of `num` images, one after the other in the memory that `first` is in.
  virtual Result<SurfaceBatch> update(const DepthImageView& first, int num,
                                      std::optional<CallerStream> stream, ThreadPool& pool) = 0;
};

Result<std::unique_ptr<BatchFrames>> make_batch_frames_cpu(const SlotSettings& settings);
/// So many pixels at once are enough for any GPU.
Result<std::unique_ptr<BatchFrames>> make_batch_frames_cuda(const SlotSettings& settings, int gpu,
                                                            int pixels_at_once = 1 << 23);

}  // namespace palpate::inline v0
