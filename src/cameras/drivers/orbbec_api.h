// The functions of the Orbbec SDK that Palpate calls, with declarations of our own
// (libobsensor/h/*.h, version 2.x).
#pragma once

#include <cstdint>
#include <string>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 { namespace orbbec {

// Objects of the library.
struct Failure;
struct Context;
struct DeviceList;
struct Device;
struct Pipeline;
struct Config;
struct ProfileList;
struct Profile;
struct Frame;

#pragma pack(push, 1)
struct CameraIntrinsic {
  float fx, fy, cx, cy;
  std::int16_t width, height;
};
struct CameraDistortion {
  float k1, k2, k3, k4, k5, k6, p1, p2;
  int model;
};
#pragma pack(pop)

inline constexpr int kDepthSensor = 3;
inline constexpr int kY16 = 8, kZ16 = 28;  // formats
// Models of distortion.
inline constexpr int kNoDistortion = 0, kBrownConrady = 3, kBrownConrady6 = 4;
inline constexpr int kLogOff = 5;

struct Api {
  int (*version)();
  const char* (*message)(const Failure* error);
  void (*delete_error)(Failure* error);
  void (*set_log_level)(int severity, Failure** error);
  void (*set_extensions)(const char* folder, Failure** error);  // may be missing
  Context* (*create_context)(Failure** error);
  DeviceList* (*query_devices)(Context* context, Failure** error);
  std::uint32_t (*device_count)(const DeviceList* list, Failure** error);
  Device* (*device)(const DeviceList* list, std::uint32_t index, Failure** error);
  const char* (*name)(const DeviceList* list, std::uint32_t index, Failure** error);
  const char* (*serial_number)(const DeviceList* list, std::uint32_t index, Failure** error);
  void (*delete_list)(DeviceList* list, Failure** error);
  void (*delete_device)(Device* device, Failure** error);
  Pipeline* (*create_pipeline)(const Device* device, Failure** error);
  void (*delete_pipeline)(Pipeline* pipeline, Failure** error);
  ProfileList* (*profiles)(const Pipeline* pipeline, int sensor, Failure** error);
  std::uint32_t (*profile_count)(const ProfileList* list, Failure** error);
  Profile* (*profile)(const ProfileList* list, int index, Failure** error);
  void (*delete_profiles)(ProfileList* list, Failure** error);
  void (*delete_profile)(const Profile* profile, Failure** error);
  int (*format)(const Profile* profile, Failure** error);
  std::uint32_t (*profile_width)(const Profile* profile, Failure** error);
  std::uint32_t (*profile_height)(const Profile* profile, Failure** error);
  std::uint32_t (*rate)(const Profile* profile, Failure** error);
  CameraIntrinsic (*intrinsic)(const Profile* profile, Failure** error);
  CameraDistortion (*distortion)(const Profile* profile, Failure** error);
  Config* (*create_config)(Failure** error);
  void (*delete_config)(Config* config, Failure** error);
  void (*enable)(Config* config, const Profile* profile, Failure** error);
  void (*start)(Pipeline* pipeline, const Config* config, Failure** error);
  void (*stop)(Pipeline* pipeline, Failure** error);
  Frame* (*wait)(Pipeline* pipeline, std::uint32_t milliseconds, Failure** error);
  Frame* (*depth_of)(const Frame* frames, Failure** error);
  Profile* (*profile_of)(const Frame* frame, Failure** error);
  void (*delete_frame)(const Frame* frame, Failure** error);
  std::uint32_t (*width)(const Frame* frame, Failure** error);
  std::uint32_t (*height)(const Frame* frame, Failure** error);
  std::uint8_t* (*data)(const Frame* frame, Failure** error);
  std::uint32_t (*num_bytes)(const Frame* frame, Failure** error);
  std::uint64_t (*microseconds)(const Frame* frame, Failure** error);
  float (*millimeters)(const Frame* frame, Failure** error);  // per count

  std::string path;  ///< of the library
  Context* context = nullptr;
  int version_number = 0;  ///< 20903: 2.9.3
};

/// Loads it, once: libOrbbecSDK.so, or the one in the Python package pyorbbecsdk2. Errors: every
/// place that was tried.
const Result<Api>& api();

}}}  // namespace palpate::v0::orbbec
