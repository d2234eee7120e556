#include "src/devices/force_dimension/force_dimension_api.h"

#include <vector>

#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kOldestMajor = 3, kOldestMinor = 7;

#if defined(__aarch64__)
constexpr const char* kSdkFolder = "/lib/release/lin-aarch64-gcc";
#else
constexpr const char* kSdkFolder = "/lib/release/lin-x86_64-gcc";
#endif

/// libdrd holds the functions of libdhd, too. It alone reports whether a device is
/// initialized.
std::vector<std::string> candidates() {
  std::vector<std::string> folders;
  for (const char* variable : {"FDSDK", "FORCEDIM_SDK"}) {
    if (const std::string sdk = environment(variable); !sdk.empty())
      folders.push_back(sdk + kSdkFolder);
  }
  if (const std::string home = environment("HOME"); !home.empty())
    folders.push_back(home + "/.local/lib");
  folders.push_back("/usr/local/lib");

  std::vector<std::string> all;
  for (const std::string& folder : folders) {
    for (std::string& file : library_files(folder, "libdrd.so")) all.push_back(std::move(file));
  }
  all.insert(all.end(), {"libdrd.so.3", "libdrd.so"});
  return all;
}

}  // namespace

Result<ForceDimensionApi> load_force_dimension() {
  Result<SharedLibrary> found = SharedLibrary::open(candidates());
  if (!found) {
    return Error{Errc::not_found, "no Force Dimension SDK: " + found.error().message};
  }
  SharedLibrary& library = *found;
  ForceDimensionApi api{};
  api.path = library.path();
#define PALPATE_REQUIRE(name) library.require(#name, api.name)
  PALPATE_REQUIRE(dhdGetSDKVersion);
  PALPATE_REQUIRE(dhdErrorGetLastStr);
  PALPATE_REQUIRE(dhdGetDeviceCount);
  PALPATE_REQUIRE(dhdGetAvailableCount);
  PALPATE_REQUIRE(drdOpenID);
  PALPATE_REQUIRE(drdClose);
  PALPATE_REQUIRE(drdIsInitialized);
  PALPATE_REQUIRE(dhdGetSystemType);
  PALPATE_REQUIRE(dhdGetSystemName);
  PALPATE_REQUIRE(dhdHasWrist);
  PALPATE_REQUIRE(dhdHasActiveWrist);
  PALPATE_REQUIRE(dhdGetPositionAndOrientationFrame);
  PALPATE_REQUIRE(dhdGetLinearVelocity);
  PALPATE_REQUIRE(dhdGetAngularVelocityRad);
  PALPATE_REQUIRE(dhdGetButtonMask);
  PALPATE_REQUIRE(dhdSetForceAndTorqueAndGripperForce);
  PALPATE_REQUIRE(dhdEnableForce);
  PALPATE_REQUIRE(dhdSetGravityCompensation);
  PALPATE_REQUIRE(dhdGetStatus);
#undef PALPATE_REQUIRE
  library.find("dhdSetMaxForce", api.dhdSetMaxForce);
  library.find("dhdSetMaxTorque", api.dhdSetMaxTorque);

  int major = 0, minor = 0, release = 0, revision = 0;
  if (api.dhdGetSDKVersion != nullptr) {
    api.dhdGetSDKVersion(&major, &minor, &release, &revision);
    api.version = std::to_string(major) + "." + std::to_string(minor) + "." +
                  std::to_string(release) + "." + std::to_string(revision);
    if (major < kOldestMajor || (major == kOldestMajor && minor < kOldestMinor)) {
      return Error{Errc::unavailable, "the Force Dimension SDK in " + api.path + " is release " +
                                          api.version + ", which is too old"};
    }
  }
  if (const Status status = library.check(": it is not a whole Force Dimension SDK"); !status)
    return status.error();
  return api;
}

}}  // namespace palpate::v0
