// Blends two clouds on a GPU: blend_clouds, with the same bits.
#pragma once

#include <memory>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

namespace gpu {
class Stream;
}

/// Owns the blended cloud. Nothing waits or allocates after `create`, and all work may be recorded
/// in a gpu::Graph.
class CloudBlendCuda {
 public:
  /// Clouds have this size and camera. Errors: no such GPU, not enough memory on it.
  static Result<CloudBlendCuda> create(int width, int height, const Intrinsics& intrinsics,
                                       int gpu);
  CloudBlendCuda(CloudBlendCuda&&) noexcept;
  CloudBlendCuda& operator=(CloudBlendCuda&&) noexcept;
  ~CloudBlendCuda();

  /// Sets the position between the old cloud (0) and the new one (1), or beyond it. Kept in
  /// page-locked memory: do not change it while submitted work has still to read it.
  void set_progress(double t);
  /// Both clouds are on this GPU, and neither is the blended one.
  void enqueue(gpu::Stream& stream, const PointCloudView& old_cloud,
               const PointCloudView& new_cloud, double max_jump);

  /// Points and normals on the GPU, always in the same arrays; no depth-change vectors.
  PointCloudView cloud() const;

 private:
  struct Impl;
  explicit CloudBlendCuda(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}}  // namespace palpate::v0
