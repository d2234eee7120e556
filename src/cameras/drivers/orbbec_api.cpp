#include "src/cameras/drivers/orbbec_api.h"

#include <filesystem>
#include <vector>

#include "src/cameras/drivers/python_packages.h"
#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 { namespace orbbec {
namespace {

std::vector<std::string> places() {
  std::vector<std::string> candidates = given_by("ORBBEC_LIBRARY");
  for (const char* name : {"libOrbbecSDK.so.2", "libOrbbecSDK.so"}) candidates.emplace_back(name);
  for (std::string& file : files_of_python_package("pyorbbecsdk", "libOrbbecSDK.so")) {
    candidates.push_back(std::move(file));
  }
  return candidates;
}

void find_functions(SharedLibrary& library, Api& api) {
  library.require("ob_get_version", api.version);
  library.require("ob_error_get_message", api.message);
  library.require("ob_delete_error", api.delete_error);
  library.require("ob_set_logger_severity", api.set_log_level);
  library.find("ob_set_extensions_directory", api.set_extensions);
  library.require("ob_create_context", api.create_context);
  library.require("ob_query_device_list", api.query_devices);
  library.require("ob_device_list_get_count", api.device_count);
  library.require("ob_device_list_get_device", api.device);
  library.require("ob_device_list_get_device_name", api.name);
  library.require("ob_device_list_get_device_serial_number", api.serial_number);
  library.require("ob_delete_device_list", api.delete_list);
  library.require("ob_delete_device", api.delete_device);
  library.require("ob_create_pipeline_with_device", api.create_pipeline);
  library.require("ob_delete_pipeline", api.delete_pipeline);
  library.require("ob_pipeline_get_stream_profile_list", api.profiles);
  library.require("ob_stream_profile_list_get_count", api.profile_count);
  library.require("ob_stream_profile_list_get_profile", api.profile);
  library.require("ob_delete_stream_profile_list", api.delete_profiles);
  library.require("ob_delete_stream_profile", api.delete_profile);
  library.require("ob_stream_profile_get_format", api.format);
  library.require("ob_video_stream_profile_get_width", api.profile_width);
  library.require("ob_video_stream_profile_get_height", api.profile_height);
  library.require("ob_video_stream_profile_get_fps", api.rate);
  library.require("ob_video_stream_profile_get_intrinsic", api.intrinsic);
  library.require("ob_video_stream_profile_get_distortion", api.distortion);
  library.require("ob_create_config", api.create_config);
  library.require("ob_delete_config", api.delete_config);
  library.require("ob_config_enable_stream_with_stream_profile", api.enable);
  library.require("ob_pipeline_start_with_config", api.start);
  library.require("ob_pipeline_stop", api.stop);
  library.require("ob_pipeline_wait_for_frameset", api.wait);
  library.require("ob_frameset_get_depth_frame", api.depth_of);
  library.require("ob_frame_get_stream_profile", api.profile_of);
  library.require("ob_delete_frame", api.delete_frame);
  library.require("ob_video_frame_get_width", api.width);
  library.require("ob_video_frame_get_height", api.height);
  library.require("ob_frame_get_data", api.data);
  library.require("ob_frame_get_data_size", api.num_bytes);
  library.require("ob_frame_get_timestamp_us", api.microseconds);
  library.require("ob_depth_frame_get_value_scale", api.millimeters);
}

Result<Api> load() {
  auto library = SharedLibrary::open(places());
  if (!library) {
    return Error{Errc::unavailable,
                 "the Orbbec SDK is not there: " + library.error().message +
                     "; install it, or pip install pyorbbecsdk2 (also from a virtual environment "
                     "that is active), or name its libOrbbecSDK.so in ORBBEC_LIBRARY"};
  }
  Api api{};
  find_functions(*library, api);
  if (const Status status = library->check("; install version 2 of the Orbbec SDK"); !status)
    return status.error();
  api.path = library->path();
  api.version_number = api.version();
  Failure* error = nullptr;
  api.set_log_level(kLogOff, &error);  // it writes into the folder where the program runs
  // Filters and depth engines lie beside the library.
  const auto extensions = std::filesystem::path(api.path).parent_path() / "extensions";
  std::error_code ignored;
  if (api.set_extensions != nullptr && std::filesystem::is_directory(extensions, ignored)) {
    api.set_extensions(extensions.c_str(), &error);
  }
  error = nullptr;
  api.context = api.create_context(&error);
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

}}}  // namespace palpate::v0::orbbec
