#include "apps/touch/sources.h"

#include <vector>

#include "palpate/cameras/cameras.h"
#include "palpate/devices/devices.h"

namespace palpate::apps {
namespace {

std::string joined(const std::vector<std::string>& names, const char* between) {
  std::string all;
  for (const std::string& name : names) all += (all.empty() ? "" : between) + name;
  return all;
}

}  // namespace

Result<CameraUri> connected_camera() {
  // Without their intrinsics the kernel's cameras cannot be opened, and most are those of a
  // library.
  std::vector<std::string> cameras, of_kernel, without_library;
  for (const FoundCameras& found : find_cameras()) {
    auto& devices = found.is_live ? cameras : of_kernel;
    if (found.is_live && !found.is_usable) without_library.push_back(found.kind);
    if (!found.is_live && found.kind != "v4l2") continue;
    devices.insert(devices.end(), found.devices.begin(), found.devices.end());
  }
  if (cameras.size() == 1) return parse_camera_uri(cameras.front());
  if (!cameras.empty()) {
    return Error{Errc::invalid_argument,
                 "there are several cameras: give one --camera of " + joined(cameras, ", ")};
  }
  std::string text = "no depth source is given, and no camera is plugged in";
  if (!without_library.empty()) {
    text += " (the libraries for " + joined(without_library, ", ") + " are not installed)";
  }
  if (!of_kernel.empty()) {
    text += "; give --camera '" + of_kernel.front() + "?intrinsics=fx,fy,cx,cy'";
  }
  return Error{
      Errc::not_found,
      text +
          "; give --camera URI, --depth-sequence DIR or --scene NAME; palpate cameras -v lists "
          "what was tried"};
}

Result<std::string> connected_device() {
  std::vector<std::string> devices;
  for (const FoundDevice& found : find_devices()) {
    // Nothing is plugged in: these are only used when requested.
    const bool is_named = found.kind == "sim" || found.kind == "replay" || found.kind == "ros2" ||
                          found.kind == "page";
    if (found.is_usable && !is_named) devices.push_back(found.uri);
  }
  if (devices.size() == 1) return devices.front();
  if (!devices.empty()) {
    return Error{Errc::invalid_argument,
                 "there are several haptic devices: give one --device of " + joined(devices, ", ")};
  }
  return Error{
      Errc::not_found,
      "no haptic device is there; palpate devices -v says what was tried; without one give "
      "--device page for a mouse, or --device sim"};
}

}  // namespace palpate::apps
