// Takes links out of depth images on a GPU: what LinkImage does, with the same bits.
#pragma once

#include <memory>
#include <span>

#include "palpate/cameras/cameras.h"

namespace palpate { inline namespace v0 {

/// Keeps the meshes and all buffers for one image size on a GPU.
class LinksOnGpu {
 public:
  virtual ~LinksOnGpu() = default;
  /// Sets what the links cover, or hide, to no measurement, and waits for it; allocates nothing.
  /// False: the frame is as it was, because it has another size, or a link is so near that its
  /// padding does not fit into the buffers. Error: the GPU is lost.
  virtual Result<bool> remove_from(DepthFrame& frame, std::span<const Pose> X_CL) = 0;
};

/// Errors: no such GPU, not enough memory on it.
Result<std::unique_ptr<LinksOnGpu>> make_links_on_gpu(std::span<const RobotLink> links,
                                                      const Intrinsics& intrinsics, int width,
                                                      int height, double padding, int gpu);

}}  // namespace palpate::v0
