#include "src/cameras/rectifier.h"

#include <utility>

namespace palpate {
namespace {

/// The same view with another number of pixels; pixel centres are at whole numbers.
Intrinsics scaled(const Intrinsics& camera, double x, double y) {
  return {camera.fx * x, camera.fy * y, (camera.cx + 0.5) * x - 0.5, (camera.cy + 0.5) * y - 0.5};
}

}  // namespace

CameraModel CameraTruth::model_of(const DepthStreamInfo& stream, int width, int height) const {
  CameraModel model{width, height, stream.intrinsics, stream.distortion};
  if (intrinsics) {
    model.intrinsics = *intrinsics;
    if (size.width > 0 && !(size == ImageSize{width, height})) {
      model.intrinsics =
          scaled(*intrinsics, double(width) / size.width, double(height) / size.height);
    }
  }
  if (distortion) model.distortion = *distortion;
  return model;
}

Rectifier::Rectifier(const CameraModel& pinhole) : pinhole_(pinhole), table_model_(pinhole) {
  pinhole_.distortion = {};
  table_model_.width = 0;  // there is no table yet
}

void Rectifier::apply(const CameraModel& model, DepthFrame& frame) {
  if (model == pinhole_) return;
  if (!(model == table_model_)) raw_pixels_ = lens_table(pinhole_, table_model_ = model);
  frame.pixels.push_back(0);  // what is seen where the camera sees nothing
  spare_.resize(raw_pixels_.size());
  const std::uint16_t* const raw = frame.pixels.data();
  for (std::size_t i = 0; i < raw_pixels_.size(); ++i) spare_[i] = raw[raw_pixels_[i]];
  std::swap(frame.pixels, spare_);
  frame.width = pinhole_.width;
  frame.height = pinhole_.height;
}

}  // namespace palpate
