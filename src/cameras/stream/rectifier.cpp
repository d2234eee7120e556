#include "src/cameras/stream/rectifier.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

/// The same view with another number of pixels; pixel centers are at whole numbers.
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

bool has_rays(const CameraModel& model) {
  const auto& [fx, fy, cx, cy] = model.intrinsics;
  return fx > 0 && fy > 0 && std::isfinite(fx + fy + cx + cy) && check_distortion(model.distortion);
}

Error flow_of_lens(const std::string& name) {
  return {Errc::invalid_argument,
          name +
              ": an optical flow goes with undistorted images of the whole camera; undistort "
              "both, without 'distortion' and 'crop'"};
}

CameraModel valid_part(const CameraModel& pinhole, const CameraModel& raw) {
  constexpr int kMinSide = 8;
  const std::vector<std::uint32_t> table = lens_table(pinhole, raw);
  const auto outside = static_cast<std::uint32_t>(raw.width * raw.height);
  struct Column {
    int first = 0, height = 0;
  };
  // Heights of the columns of valid pixels that end in each row, and a stack of the columns that
  // still grow.
  std::vector<int> heights(static_cast<std::size_t>(pinhole.width) + 1, 0);
  std::vector<Column> growing;
  int left = 0, top = 0, width = 0, height = 0;
  for (int v = 0; v < pinhole.height; ++v) {
    growing.clear();
    for (int u = 0; u <= pinhole.width; ++u) {
      int& high = heights[static_cast<std::size_t>(u)];
      if (u < pinhole.width) {
        const auto pixel = static_cast<std::size_t>(v) * static_cast<std::size_t>(pinhole.width);
        high = table[pixel + static_cast<std::size_t>(u)] == outside ? 0 : high + 1;
      }
      int first = u;
      while (!growing.empty() && growing.back().height >= high) {
        const Column ended = growing.back();
        growing.pop_back();
        first = ended.first;
        if ((u - first) * ended.height <= width * height) continue;
        left = first;
        top = v + 1 - ended.height;
        width = u - first;
        height = ended.height;
      }
      growing.push_back({first, high});
    }
  }
  if (width < kMinSide || height < kMinSide) return pinhole;
  CameraModel part = pinhole;
  part.width = width;
  part.height = height;
  part.intrinsics.cx -= left;
  part.intrinsics.cy -= top;
  return part;
}

Rectifier::Rectifier(const CameraModel& pinhole) : pinhole_(pinhole) { pinhole_.distortion = {}; }

void Rectifier::apply(const CameraModel& model, DepthFrame& frame) {
  if (model == pinhole_) return;
  constexpr std::size_t kMaxTables = 4;
  auto table = std::ranges::find(tables_, model, &Table::model);
  if (table == tables_.end()) {
    if (tables_.size() == kMaxTables) tables_.pop_back();
    table = tables_.insert(tables_.end(), {model, lens_table(pinhole_, model)});
  }
  std::rotate(tables_.begin(), table, std::next(table));
  const std::vector<std::uint32_t>& raw_pixels = tables_.front().raw_pixels;
  frame.pixels.push_back(0);  // the measurement where the camera sees nothing
  spare_.resize(raw_pixels.size());
  const std::uint16_t* const raw = frame.pixels.data();
  for (std::size_t i = 0; i < raw_pixels.size(); ++i) spare_[i] = raw[raw_pixels[i]];
  std::swap(frame.pixels, spare_);
  frame.flow.clear();  // of the pixels before
  frame.width = pinhole_.width;
  frame.height = pinhole_.height;
}

}}  // namespace palpate::v0
