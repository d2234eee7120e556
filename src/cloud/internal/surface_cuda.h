// Surface estimation on a GPU: what SurfaceEstimator does, by the same formulas and with the same
// bits, on device memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "palpate/cloud/surface_estimator.h"
#include "src/cloud/internal/tangent_plane.h"

namespace palpate { inline namespace v0 {

namespace gpu {
class Stream;
}

/// Rows [begin, end) of an image.
struct ImageRows {
  int begin = 0, end = 0;
};

/// Owns all buffers for one image size, and for as many images as a batch makes at once. Nothing
/// waits or allocates after `create`, and all work may be recorded in a gpu::Graph: what changes
/// from frame to frame is read from page-locked memory.
class SurfaceCuda {
 public:
  /// Errors: those of SurfaceEstimator::create, no such GPU, not enough memory on it.
  /// Distorted images are undistorted as by SurfaceEstimator; then frames are done in one part.
  static Result<SurfaceCuda> create(int width, int height, const Intrinsics& intrinsics,
                                    const SurfaceOptions& options, int gpu, int num_images = 0,
                                    const Distortion& distortion = {});
  SurfaceCuda(SurfaceCuda&&) noexcept;
  SurfaceCuda& operator=(SurfaceCuda&&) noexcept;
  ~SurfaceCuda();

  /// Page-locked memory where the host puts the next raw frame and its unit (meters per count). Do
  /// not write while work that was submitted before has still to read it.
  std::span<std::uint16_t> input();
  void set_unit(double unit);

  /// Submits read, filter, normals and depth change of the frame in `input`. A frame may be done
  /// in parts, spread over the time between frames so that queries never wait for long (thesis
  /// section 4.2): all parts 0 ... num_parts - 1, in order. The bits do not depend on the number.
  /// Adaptive smoothing needs the whole image: the last part does it, and all normals.
  void enqueue(gpu::Stream& stream, int part = 0, int num_parts = 1);
  /// The same of a whole frame whose counts are on this GPU; the unit is the one that was set.
  void enqueue_counts(gpu::Stream& stream, const std::uint16_t* counts);
  /// The same from depth in meters (NaN or 0: no measurement), width * height values on this GPU.
  void enqueue_depth(gpu::Stream& stream, const float* depth, int part = 0, int num_parts = 1);
  /// The same of `num` images, one after the other in the memory of this GPU: of counts, or of
  /// depth if they are null. Makes only the planes of their points; no depth change. `noises`:
  /// where the noise of each goes on the GPU, if it is learned; or null.
  void enqueue_images(gpu::Stream& stream, const std::uint16_t* counts, const float* depth, int num,
                      FrameNoise* noises = nullptr);
  /// True if each image tells its noise; else it is that of `cloud`.
  bool learns_noise() const;
  /// The rows of its input that a part is the first to read.
  ImageRows input_rows(int part, int num_parts) const;

  /// Arrays on the GPU, always the same ones, and the frame's noise in memory of the host, null in
  /// a batch that learns it; they hold a frame when its last part is done.
  PointCloudView cloud() const;
  /// Planes of the points of all images of a batch, on the GPU.
  const TangentPlane* planes() const;
  /// Distance from one image's points to those of the next.
  std::ptrdiff_t points_apart() const;
  /// Statistics of the last frame that is done.
  SurfaceStats stats() const;

 private:
  struct Impl;
  explicit SurfaceCuda(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}}  // namespace palpate::v0
