// The functions of OpenNI2 that Palpate calls, with declarations of our own (OniCAPI.h,
// version 2.2).
#pragma once

#include <cstdint>
#include <string>

#include "palpate/core/core.h"
#include "src/core/internal/bounded_call.h"

namespace palpate { inline namespace v0 { namespace openni2 {

struct Device;  // OniDeviceHandle points at it
struct Stream;

struct Version {
  int major, minor, maintenance, build;
};
struct VideoMode {
  int format, width, height, rate;
};
struct SensorInfo {
  int sensor, num_modes;
  VideoMode* modes;
};
struct DeviceInfo {
  char uri[256], vendor[256], name[256];
  std::uint16_t usb_vendor, usb_product;
};
struct Frame {
  int num_bytes;
  void* data;
  int sensor;
  std::uint64_t microseconds;
  int number, width, height;
  VideoMode mode;
  int is_cropped, crop_x, crop_y, stride;
};

inline constexpr int kApiVersion = 2002;  // major * 1000 + minor
inline constexpr int kOk = 0, kTimeOut = 102;
inline constexpr int kDepth = 3;                                                   // sensor
inline constexpr int kMillimeters = 100, kTenths = 101;                            // formats
inline constexpr int kRegistration = 5, kSpeed = 100, kRepeat = 101, kSerial = 3;  // of a device
inline constexpr int kHorizontalFov = 1, kVerticalFov = 2, kVideoMode = 3, kMirroring = 7,
                     kNumFrames = 8;  // of a stream

struct Api {
  int (*initialize)(int version);
  const char* (*last_error)();
  Version (*version)();
  int (*device_list)(DeviceInfo** devices, int* num);
  int (*release_list)(DeviceInfo* devices);
  int (*open)(const char* uri, Device** device);
  int (*close)(Device* device);
  const SensorInfo* (*sensor_info)(Device* device, int sensor);
  int (*set_device)(Device* device, int property, const void* data, int num_bytes);
  int (*create_stream)(Device* device, int sensor, Stream** stream);
  void (*destroy_stream)(Stream* stream);
  int (*start)(Stream* stream);
  void (*stop)(Stream* stream);
  int (*wait)(Stream** streams, int num, int* index, int milliseconds);
  int (*read)(Stream* stream, Frame** frame);
  void (*release)(Frame* frame);
  int (*set)(Stream* stream, int property, const void* data, int num_bytes);
  int (*get)(Stream* stream, int property, void* data, int* num_bytes);

  std::string path;  ///< of the library
};

/// Returns the thread that makes all calls: the library remembers every thread that has called it
/// and asks the system later on whether that still exists, which is fatal if it does not.
LibraryThread& caller();

/// Loads and initializes it, once. On the thread of `caller`. Errors: every place that was tried;
/// the library's own error.
const Result<Api>& api();

}}}  // namespace palpate::v0::openni2
