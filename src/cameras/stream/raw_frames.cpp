#include "src/cameras/stream/raw_frames.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "src/cameras/stream/rectifier.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kLongestSilence = 2;  // s without a frame, then a camera is lost

}  // namespace

std::optional<std::size_t> choose_mode(std::span<const ImageMode> modes, const CameraUri& uri,
                                       ImageSize usual) {
  const auto merit = [&](const ImageMode& mode) {
    const bool is_usual = mode.width <= usual.width && mode.height <= usual.height;
    return std::array{is_usual ? mode.width * mode.height : -mode.width * mode.height,
                      -std::abs(mode.rate - static_cast<int>(uri.rate.value_or(30)))};
  };
  std::optional<std::size_t> best;
  for (std::size_t i = 0; i < modes.size(); ++i) {
    if (uri.size && !(*uri.size == ImageSize{modes[i].width, modes[i].height})) continue;
    if (!best || merit(modes[i]) > merit(modes[*best])) best = i;
  }
  return best;
}

std::string listed(std::span<const ImageMode> modes) {
  std::string all;
  for (const ImageMode& mode : modes) {
    all += (all.empty() ? "" : ", ") + std::to_string(mode.width) + "x" +
           std::to_string(mode.height) + " at " + std::to_string(mode.rate) + " Hz";
  }
  return all.empty() ? "none" : all;
}

void copy_rows(const void* data, std::ptrdiff_t stride, int width, int height, DepthFrame& frame) {
  frame.width = width;
  frame.height = height;
  frame.pixels.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int v = 0; v < height; ++v) {
    std::memcpy(frame.pixels.data() + static_cast<std::ptrdiff_t>(v) * width,
                static_cast<const char*>(data) + v * stride, 2 * static_cast<std::size_t>(width));
  }
}

void scale_camera(ImageSize of, DepthStreamInfo& info) {
  if (of.width < 1 || of.height < 1 || of.width == info.width) return;
  const CameraTruth truth{info.intrinsics, {}, {}, of};
  info.intrinsics = truth.model_of(info, info.width, info.height).intrinsics;
}

Status MakersSource::check_silence(double begin) const {
  if (monotonic_now() - begin <= kLongestSilence) return Done{};
  return Error{Errc::unavailable, info_.name + " sends no frames; check its cable"};
}

std::optional<int> camera_number(const std::string& target) {
  if (target.empty()) return 0;
  const auto number = parse_number<int>(target);
  return number && *number >= 0 && *number < 1000 ? number : std::nullopt;
}

SensorKind sensor_of_model(std::string_view name) {
  // The first one that fits.
  constexpr std::pair<std::string_view, SensorKind> kModels[] = {
      {"SR30", SensorKind::structured_light},
      {"F200", SensorKind::structured_light},
      {"L515", SensorKind::tof},
      {"RealSense", SensorKind::active_stereo},
      {"Femto", SensorKind::tof},
      {"Azure Kinect", SensorKind::tof},
      {"Gemini", SensorKind::active_stereo},
      {"Astra", SensorKind::structured_light},
  };
  for (const auto& [model, kind] : kModels) {
    if (name.find(model) != name.npos) return kind;
  }
  return SensorKind::none;
}

std::string listed_models(std::vector<std::string> models, std::string_view otherwise) {
  std::ranges::sort(models);
  const auto same = std::ranges::unique(models);
  models.erase(same.begin(), same.end());
  std::erase(models, "");
  std::string all;
  for (const std::string& model : models) all += (all.empty() ? "" : ", ") + model;
  return all.empty() ? std::string(otherwise) : all;
}

std::string dotted_version(int number) {
  return std::to_string(number / 10000) + "." + std::to_string(number / 100 % 100) + "." +
         std::to_string(number % 100);
}

}}  // namespace palpate::v0
