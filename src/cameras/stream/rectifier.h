// Depth images of any camera as those of one pinhole camera without distortion.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "palpate/cloud/depth_source.h"
#include "src/cloud/internal/lens_table.h"

namespace palpate { inline namespace v0 {

/// Parameters that the user declares of a camera; they override those that it reports. Intrinsics
/// are those of the first image size and are scaled for others.
struct CameraTruth {
  std::optional<Intrinsics> intrinsics;
  std::optional<Distortion> distortion;
  std::optional<double> unit;
  ImageSize size;  ///< of the first image

  CameraModel model_of(const DepthStreamInfo& stream, int width, int height) const;
};

/// True if its pixels have rays: focal lengths are positive, and all of it is finite.
bool has_rays(const CameraModel& model);

/// The part of a pinhole image whose every pixel a camera of that model sees: the largest rectangle
/// of such pixels, of several the uppermost and then leftmost. The whole image if that is smaller
/// than a surface may be (8 x 8). O(pixels).
CameraModel valid_part(const CameraModel& pinhole, const CameraModel& raw);

/// Error for optical flow of an image with distortion: no vectors of flow are undistorted.
Error flow_of_lens(const std::string& name);

/// Applies lens tables to frames in host memory. A table is made when the model changes to one that
/// is not among the last four. Not for several threads at once.
class Rectifier {
 public:
  /// `pinhole`: of all images that come out. Its distortion is none.
  explicit Rectifier(const CameraModel& pinhole);

  const CameraModel& pinhole() const { return pinhole_; }
  /// Turns an image of `model` into one of the pinhole; 0 where the camera sees nothing.
  /// Its optical flow is dropped unless both are the same.
  void apply(const CameraModel& model, DepthFrame& frame);

 private:
  struct Table {
    CameraModel model;
    std::vector<std::uint32_t> raw_pixels;
  };
  CameraModel pinhole_;
  std::vector<Table> tables_;  // that of the newest image first
  std::vector<std::uint16_t> spare_;
};

}}  // namespace palpate::v0
