// Finding and opening depth cameras by the words of the command line.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cameras/camera_uri.h"
#include "palpate/cloud/depth_source.h"

namespace palpate {

/// One kind of camera, and what of it can be used here.
struct FoundCameras {
  std::string kind;
  std::string usage;  ///< "folder:DIR"
  bool is_usable = false;
  std::string library, version;      ///< of the vendor, if there is one and it was found
  std::vector<std::string> devices;  ///< what to give to open_camera
  std::string reason;                ///< what it is, or every place that was tried and what to do
  /// Its devices are cameras that are plugged in and can be opened by their names alone.
  bool is_live = false;
};
/// Asks every kind; takes a few seconds at most. Never fails, starts no camera.
std::vector<FoundCameras> find_cameras();

struct CameraOpening {
  /// The run goes by the clock of this computer: frames that nobody took in time are left out.
  /// Else every frame counts that does not come from a device.
  bool in_real_time = true;
  std::optional<double> duration = {};  ///< s, of simulated ones; none: the scene's
};

/// A stream as surfaces are made of it: a pinhole image without distortion, whose size and
/// intrinsics stay the same even if the camera changes its own. Live cameras are read by a thread
/// of their own and come back when they were unplugged. Kinds: see `find_cameras`. Errors: no such
/// kind or target; the library of the vendor is missing, with every place that was tried; nothing
/// says what the intrinsics are.
Result<std::unique_ptr<DepthSource>> open_camera(std::string_view uri,
                                                 const CameraOpening& opening = {});
Result<std::unique_ptr<DepthSource>> open_camera(const CameraUri& uri,
                                                 const CameraOpening& opening = {});

}  // namespace palpate
