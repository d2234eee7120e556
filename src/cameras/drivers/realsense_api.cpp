#include "src/cameras/drivers/realsense_api.h"

#include <dlfcn.h>

#include <vector>

#include "src/cameras/drivers/python_packages.h"
#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 { namespace realsense {
namespace {

std::vector<std::string> places() {
  std::vector<std::string> candidates = given_by("REALSENSE2_LIBRARY");
  for (const char* name : {"librealsense2.so", "librealsense2.so.2"}) candidates.emplace_back(name);
  // The Python module has all functions of the library.
  for (std::string& file : files_of_python_package("pyrealsense2", "pyrealsense2.cpython")) {
    candidates.push_back(std::move(file));
  }
  return candidates;
}

Result<Api> load() {
  std::vector<std::string> candidates = places();
  for (const std::string& candidate : candidates) {
    // A Python module leaves the symbols of Python to whoever loads it.
    if (const std::string python = python_library_of(candidate); !python.empty()) {
      dlopen(python.c_str(), RTLD_NOW | RTLD_GLOBAL);
    }
  }
  auto library = SharedLibrary::open(candidates, SharedLibrary::Symbols::their_own_first);
  if (!library) {
    return Error{Errc::unavailable,
                 "librealsense2 is not there: " + library.error().message +
                     "; install it, or pip install pyrealsense2 (also from a virtual environment "
                     "that is active), or name it in REALSENSE2_LIBRARY"};
  }
  Api api{};
  library->require("rs2_get_api_version", api.version);
  library->require("rs2_get_error_message", api.message);
  library->require("rs2_free_error", api.free_error);
  library->require("rs2_create_context", api.create_context);
  library->require("rs2_query_devices", api.query_devices);
  library->require("rs2_get_device_count", api.device_count);
  library->require("rs2_create_device", api.create_device);
  library->require("rs2_delete_device_list", api.delete_list);
  library->require("rs2_delete_device", api.delete_device);
  library->require("rs2_get_device_info", api.device_info);
  library->require("rs2_context_add_device", api.add_file);
  library->require("rs2_context_remove_device", api.remove_file);
  library->require("rs2_playback_device_set_real_time", api.set_real_time);
  library->require("rs2_playback_device_get_current_status", api.playback_status);
  library->require("rs2_query_sensors", api.query_sensors);
  library->require("rs2_get_sensors_count", api.sensor_count);
  library->require("rs2_create_sensor", api.create_sensor);
  library->require("rs2_delete_sensor_list", api.delete_sensors);
  library->require("rs2_delete_sensor", api.delete_sensor);
  library->require("rs2_supports_option", api.supports_option);
  library->require("rs2_set_option", api.set_option);
  library->require("rs2_get_stream_profiles", api.profiles);
  library->require("rs2_get_stream_profiles_count", api.profile_count);
  library->require("rs2_get_stream_profile", api.profile);
  library->require("rs2_delete_stream_profiles_list", api.delete_profiles);
  library->require("rs2_get_stream_profile_data", api.profile_data);
  library->require("rs2_get_video_stream_intrinsics", api.intrinsics);
  library->require("rs2_open", api.open);
  library->require("rs2_close", api.close);
  library->require("rs2_start_queue", api.start);
  library->require("rs2_stop", api.stop);
  library->require("rs2_create_frame_queue", api.create_queue);
  library->require("rs2_delete_frame_queue", api.delete_queue);
  library->require("rs2_try_wait_for_frame", api.wait);
  library->require("rs2_release_frame", api.release);
  library->require("rs2_get_frame_data", api.data);
  library->require("rs2_get_frame_width", api.width);
  library->require("rs2_get_frame_height", api.height);
  library->require("rs2_get_frame_stride_in_bytes", api.stride);
  library->require("rs2_get_frame_timestamp", api.milliseconds);
  library->require("rs2_depth_frame_get_units", api.unit);
  library->require("rs2_get_frame_stream_profile", api.frame_profile);
  if (const Status status = library->check("; install a newer librealsense2"); !status)
    return status.error();
  api.path = library->path();
  Failure* error = nullptr;
  api.version_number = api.version(&error);
  if (error == nullptr) api.context = api.create_context(api.version_number, &error);
  if (error != nullptr || api.context == nullptr) {
    return Error{Errc::unavailable, api.path + " does not start" + (error == nullptr ? "" : ": ") +
                                        (error == nullptr ? "" : api.message(error))};
  }
  return api;
}

}  // namespace

const Result<Api>& api() {
  static const Result<Api> loaded = load();
  return loaded;
}

}}}  // namespace palpate::v0::realsense
