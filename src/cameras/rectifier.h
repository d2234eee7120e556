// Depth images of any camera as those of one pinhole camera without distortion.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "palpate/cameras/camera_uri.h"
#include "palpate/cloud/depth_source.h"

namespace palpate {

/// How one image was taken.
struct CameraModel {
  int width = 0, height = 0;
  Intrinsics intrinsics;
  Distortion distortion;

  friend bool operator==(const CameraModel&, const CameraModel&) = default;
};

/// What people say of a camera, which wins over what it says of itself. Intrinsics are those of the
/// first image size and are scaled for others.
struct CameraTruth {
  std::optional<Intrinsics> intrinsics;
  std::optional<Distortion> distortion;
  std::optional<double> unit;
  ImageSize size;  ///< of the first image

  CameraModel model_of(const DepthStreamInfo& stream, int width, int height) const;
};

/// Which raw pixel belongs to each pixel of the pinhole image: the nearest one, never a mixture of
/// two depths. The table is made when the model changes. Not for several threads at once.
class Rectifier {
 public:
  /// `pinhole`: of all images that come out. Its distortion is none.
  explicit Rectifier(const CameraModel& pinhole);

  const CameraModel& pinhole() const { return pinhole_; }
  /// Turns an image of `model` into one of the pinhole; 0 where the camera sees nothing.
  void apply(const CameraModel& model, DepthFrame& frame);
  /// For each pixel of the pinhole image the number of the raw one, past the end where the camera
  /// sees nothing. Valid until the next call.
  const std::vector<std::uint32_t>& raw_pixels(const CameraModel& model);

 private:
  void make_table(const CameraModel& model);

  CameraModel pinhole_, table_model_;
  std::vector<std::uint32_t> raw_pixels_;  // per pixel of the pinhole; past the end: none
  std::vector<std::uint16_t> spare_;
};

/// How far from the optical axis a lens still maps different rays to different pixels: the largest
/// r (X / Z) up to `limit` below which the radial distortion grows with r.
double largest_radius(const Distortion& distortion, double limit);

}  // namespace palpate
