#include "src/devices/open_haptics/open_haptics_api.h"

#include <vector>

#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 {
namespace {

std::vector<std::string> candidates() {
  std::vector<std::string> all;
  if (const std::string sdk = environment("OH_SDK_BASE"); !sdk.empty()) {
    for (const char* folder : {"/lib", "/usr/lib"}) {
      for (std::string& file : library_files(sdk + folder, "libHD.so"))
        all.push_back(std::move(file));
    }
  }
  all.insert(all.end(), {"libHD.so", "/usr/lib/libHD.so", "/usr/lib64/libHD.so"});
  return all;
}

}  // namespace

HdErrorInfo OpenHapticsApi::take_errors() const noexcept {
  constexpr int kMany = 64;  // a driver that never runs out of errors must not keep us
  HdErrorInfo oldest{};
  for (int i = 0; i < kMany; ++i) {
    const HdErrorInfo error = hdGetError();
    if (error.code == 0) break;
    oldest = error;
  }
  return oldest;
}

Result<OpenHapticsApi> load_open_haptics() {
  Result<SharedLibrary> found = SharedLibrary::open(candidates());
  if (!found) return Error{Errc::not_found, "no OpenHaptics: " + found.error().message};
  SharedLibrary& library = *found;
  OpenHapticsApi api{};
  api.path = library.path();
#define PALPATE_REQUIRE(name) library.require(#name, api.name)
  PALPATE_REQUIRE(hdInitDevice);
  PALPATE_REQUIRE(hdDisableDevice);
  PALPATE_REQUIRE(hdMakeCurrentDevice);
  PALPATE_REQUIRE(hdBeginFrame);
  PALPATE_REQUIRE(hdEndFrame);
  PALPATE_REQUIRE(hdEnable);
  PALPATE_REQUIRE(hdDisable);
  PALPATE_REQUIRE(hdGetDoublev);
  PALPATE_REQUIRE(hdGetIntegerv);
  PALPATE_REQUIRE(hdGetString);
  PALPATE_REQUIRE(hdSetDoublev);
  PALPATE_REQUIRE(hdGetError);
  PALPATE_REQUIRE(hdGetErrorString);
  PALPATE_REQUIRE(hdCheckCalibration);
  PALPATE_REQUIRE(hdUpdateCalibration);
  PALPATE_REQUIRE(hdScheduleAsynchronous);
  PALPATE_REQUIRE(hdUnschedule);
  PALPATE_REQUIRE(hdStartScheduler);
  PALPATE_REQUIRE(hdStopScheduler);
#undef PALPATE_REQUIRE
  if (const Status status = library.check(": it is not OpenHaptics' libHD"); !status)
    return status.error();
  return api;
}

}}  // namespace palpate::v0
