// The functions of librealsense2 that Palpate calls, with declarations of our own (rs.h,
// version 2.x).
#pragma once

#include <memory>
#include <string>

#include "palpate/cameras/cameras.h"
#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 { namespace realsense {

// Objects of the library.
struct Failure;
struct Context;
struct DeviceList;
struct Device;
struct SensorList;
struct Sensor;
struct ProfileList;
struct Profile;
struct Queue;
struct Frame;

struct CameraIntrinsics {
  int width, height;
  float ppx, ppy, fx, fy;
  int model;
  float coefficients[5];
};

inline constexpr int kDepthStream = 1, kZ16 = 1;
inline constexpr int kName = 0, kSerial = 1;                // camera info
inline constexpr int kPreset = 12, kEmitter = 18;           // options
inline constexpr int kNoDistortion = 0, kBrownConrady = 4;  // models
inline constexpr int kStopped = 3;                          // status of a playback

struct Api {
  int (*version)(Failure** error);
  const char* (*message)(const Failure* error);
  void (*free_error)(Failure* error);
  Context* (*create_context)(int version, Failure** error);
  DeviceList* (*query_devices)(const Context* context, Failure** error);
  int (*device_count)(const DeviceList* list, Failure** error);
  Device* (*create_device)(const DeviceList* list, int index, Failure** error);
  void (*delete_list)(DeviceList* list);
  void (*delete_device)(Device* device);
  const char* (*device_info)(const Device* device, int info, Failure** error);
  Device* (*add_file)(Context* context, const char* file, Failure** error);
  void (*remove_file)(Context* context, const char* file, Failure** error);
  void (*set_real_time)(const Device* device, int real_time, Failure** error);
  int (*playback_status)(const Device* device, Failure** error);
  SensorList* (*query_sensors)(const Device* device, Failure** error);
  int (*sensor_count)(const SensorList* list, Failure** error);
  Sensor* (*create_sensor)(const SensorList* list, int index, Failure** error);
  void (*delete_sensors)(SensorList* list);
  void (*delete_sensor)(Sensor* sensor);
  int (*supports_option)(const Sensor* sensor, int option, Failure** error);
  void (*set_option)(const Sensor* sensor, int option, float value, Failure** error);
  ProfileList* (*profiles)(Sensor* sensor, Failure** error);
  int (*profile_count)(const ProfileList* list, Failure** error);
  const Profile* (*profile)(const ProfileList* list, int index, Failure** error);
  void (*delete_profiles)(ProfileList* list);
  void (*profile_data)(const Profile* profile, int* stream, int* format, int* index, int* id,
                       int* rate, Failure** error);
  void (*intrinsics)(const Profile* profile, CameraIntrinsics* intrinsics, Failure** error);
  void (*open)(Sensor* sensor, const Profile* profile, Failure** error);
  void (*close)(const Sensor* sensor, Failure** error);
  void (*start)(const Sensor* sensor, Queue* queue, Failure** error);
  void (*stop)(const Sensor* sensor, Failure** error);
  Queue* (*create_queue)(int capacity, Failure** error);
  void (*delete_queue)(Queue* queue);
  int (*wait)(Queue* queue, unsigned milliseconds, Frame** frame, Failure** error);
  void (*release)(Frame* frame);
  const void* (*data)(const Frame* frame, Failure** error);
  int (*width)(const Frame* frame, Failure** error);
  int (*height)(const Frame* frame, Failure** error);
  int (*stride)(const Frame* frame, Failure** error);
  double (*milliseconds)(const Frame* frame, Failure** error);
  float (*unit)(const Frame* frame, Failure** error);
  const Profile* (*frame_profile)(const Frame* frame, Failure** error);

  std::string path;  ///< of the library
  Context* context = nullptr;
  int version_number = 0;  ///< 25901: 2.59.1
};

/// Loads it, once: librealsense2.so, or the one in the Python package pyrealsense2. Errors: every
/// place that was tried.
const Result<Api>& api();

/// The depth of a device, which it takes over. `file`: of a recording; empty: a camera.
Result<std::unique_ptr<DepthSource>> open_device(Device* device, const CameraUri& uri,
                                                 const std::string& file);

}}}  // namespace palpate::v0::realsense
