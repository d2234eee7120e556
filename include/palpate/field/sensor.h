// Depth images become surfaces that tools are measured against.
#pragma once

#include <memory>

#include "palpate/field/surface_batch.h"
#include "palpate/field/surface_timeline.h"
#include "palpate/gpu/caller_stream.h"

namespace palpate {

/// A depth camera. World W is its frame C: x right, y down, z forward.
struct Camera {
  int width = 0, height = 0;  ///< pixels
  Intrinsics intrinsics;
  Distortion distortion = {};  ///< of its lens: images are straightened, at any place
};

struct SensorOptions {
  SurfaceOptions surface;
  DepthFieldOptions field;
  int num_surfaces = 1;  ///< so many of the newest ones stay valid
  int num_threads = 0;   ///< on a CPU; 0: one per core
};

/// Makes a surface of each image: a cloud with normals for the methods of points, and a depth field
/// for FieldMethod. Images are looked at one by one; for what lies between two of them see
/// ContactQuery::measure and SurfaceTimeline. One thread at a time.
class Sensor {
 public:
  /// Allocates all memory. Errors: see SurfaceEstimator and DepthField; fewer than one surface or
  /// more than 64; the place is not in this build or on this machine, or has too little memory.
  static Result<Sensor> create(const Camera& camera, const Place& place = Place::cpu(),
                               const SensorOptions& options = {});
  Sensor(Sensor&&) noexcept;
  Sensor& operator=(Sensor&&) noexcept;
  ~Sensor();

  /// The surface of an image, valid for the next num_surfaces - 1 updates; on a GPU its arrays are
  /// there. An image that cannot be taken (see status) gives a surface that is none: whoever is
  /// measured against it gets StepStatus::no_surface. O(pixels): about 5 ms of one core or 0.2 ms
  /// of a GPU for 640 x 480. No allocation; the same bits for any number of threads, at every
  /// place.
  SurfaceView update(const DepthImageView& image);

  /// The fields of `num` images of this camera's model, one after the other in memory, of which
  /// `first` shows the first; without clouds, valid until the next batch. On a CPU each image is
  /// made by one thread. On a GPU a few launches make all; if the images are there and a stream is
  /// given, the call only asks for the work, and after one with as many images it may be captured
  /// in a CUDA graph. Takes memory when it meets more images than before: about 95 bytes for each
  /// pixel of a large image, 190 for each of 64 x 64. The values are those of `update`, to the bit.
  /// A batch that cannot be taken (see status) is empty.
  SurfaceBatch update_batch(const DepthImageView& first, int num,
                            std::optional<CallerStream> stream = {});
  /// So that the first batch need not. Errors: there is too little memory; it says what fits.
  Status reserve_batch(int num_images);

  /// An error if the last image or batch was not taken: another size than the camera's, no values,
  /// in the memory of another place; or the GPU has failed, which lasts.
  const Status& status() const;
  const Place& place() const;

 private:
  struct Impl;
  explicit Sensor(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
