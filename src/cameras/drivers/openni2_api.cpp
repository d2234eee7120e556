#include "src/cameras/drivers/openni2_api.h"

#include <vector>

#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 { namespace openni2 {
namespace {

Result<Api> load() {
  std::vector<std::string> candidates;
  for (const char* variable : {"OPENNI2_REDIST64", "OPENNI2_REDIST"}) {
    if (const std::string folder = environment(variable); !folder.empty()) {
      candidates.push_back(folder + "/libOpenNI2.so.0");
      candidates.push_back(folder + "/libOpenNI2.so");
    }
  }
  candidates.insert(candidates.end(), {"libOpenNI2.so.0", "libOpenNI2.so"});
  auto library = SharedLibrary::open(candidates);
  if (!library) {
    return Error{Errc::unavailable,
                 "OpenNI2 is not there: " + library.error().message +
                     "; install libopenni2-0, or name its folder in OPENNI2_REDIST"};
  }
  Api api{};
  library->require("oniInitialize", api.initialize);
  library->require("oniGetExtendedError", api.last_error);
  library->require("oniGetVersion", api.version);
  library->require("oniGetDeviceList", api.device_list);
  library->require("oniReleaseDeviceList", api.release_list);
  library->require("oniDeviceOpen", api.open);
  library->require("oniDeviceClose", api.close);
  library->require("oniDeviceGetSensorInfo", api.sensor_info);
  library->require("oniDeviceSetProperty", api.set_device);
  library->require("oniDeviceCreateStream", api.create_stream);
  library->require("oniStreamDestroy", api.destroy_stream);
  library->require("oniStreamStart", api.start);
  library->require("oniStreamStop", api.stop);
  library->require("oniWaitForAnyStream", api.wait);
  library->require("oniStreamReadFrame", api.read);
  library->require("oniFrameRelease", api.release);
  library->require("oniStreamSetProperty", api.set);
  library->require("oniStreamGetProperty", api.get);
  if (const Status status = library->check("; install OpenNI 2.2 or newer"); !status)
    return status.error();
  api.path = library->path();
  if (api.initialize(kApiVersion) != kOk) {
    return Error{Errc::unavailable, api.path + " does not start: " + api.last_error()};
  }
  return api;
}

}  // namespace

LibraryThread& caller() {
  static LibraryThread& thread = *new LibraryThread;
  return thread;
}

const Result<Api>& api() {
  static const Result<Api> loaded = caller().call([] { return load(); });
  return loaded;
}

}}}  // namespace palpate::v0::openni2
