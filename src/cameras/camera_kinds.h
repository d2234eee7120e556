// The kinds of cameras, each in a file of its own.
#pragma once

#include "src/cameras/stream/camera_source.h"

namespace palpate { inline namespace v0 {

/// Cameras of a library that was loaded when the program runs; without it, why there are none.
template <class Api>
FoundCameras found_by(const Result<Api>& loaded) {
  FoundCameras found;
  found.is_live = true;
  found.is_usable = loaded.has_value();
  if (loaded) {
    found.library = loaded->path;
  } else {
    found.reason = loaded.error().message;
  }
  return found;
}
/// Cameras that need nothing.
inline FoundCameras always_there(std::string what) {
  FoundCameras found;
  found.is_usable = true;
  found.reason = std::move(what);
  return found;
}

/// Opens the raw stream that a URI of its kind names.
using OpenKind = Result<RawStream>(const CameraUri& uri, const CameraOpening& opening);
/// Finds the cameras of a kind that can be used here. Leaves `kind` and `usage` empty.
using FindKind = FoundCameras();

OpenKind open_folder_camera, open_scene_camera, open_pipe_camera, open_bag_camera,
    open_openni2_camera, open_realsense_camera, open_k4a_camera, open_freenect_camera,
    open_orbbec_camera, open_v4l2_camera, open_ros2_camera;
FindKind find_folder_cameras, find_scene_cameras, find_pipe_cameras, find_bag_cameras,
    find_openni2_cameras, find_realsense_cameras, find_k4a_cameras, find_freenect_cameras,
    find_orbbec_cameras, find_v4l2_cameras, find_ros2_cameras;

}}  // namespace palpate::v0
