// A library with the symbols of libfreenect, for want of a Kinect: fakenect plays a recording once
// in a process and knows disparities alone. One device that gives millimeters, of which every pixel
// is known.
#include <sys/time.h>

#include <chrono>
#include <cstdint>
#include <thread>

#include "tests/cameras/fake_camera.h"

namespace {

palpate::test::FakeCamera control;

constexpr int kWidth = 640, kHeight = 480, kMillimeters = 5, kDisparity = 0, kMedium = 1;

struct Context {};
struct Device;
using Callback = void (*)(Device*, void*, std::uint32_t);
struct Device {
  void* user = nullptr;
  Callback callback = nullptr;
};
/// freenect_frame_mode.
struct Mode {
  std::uint32_t reserved;
  int resolution, format;
  std::int32_t bytes;
  std::int16_t width, height;
  std::int8_t bits, padding, rate, is_valid;
};

Device* open_device = nullptr;
int frame_number = 0, format = -1;

}  // namespace

#pragma GCC visibility push(default)
extern "C" {

palpate::test::FakeCamera* palpate_fake_freenect() { return &control; }

int freenect_init(Context** context, void*) {
  *context = new Context;
  ++control.num_objects;
  return 0;
}
int freenect_shutdown(Context* context) {
  delete context;
  --control.num_objects;
  return 0;
}
void freenect_set_log_level(Context*, int) {}
void freenect_select_subdevices(Context*, int) {}
int freenect_num_devices(Context*) { return control.is_plugged ? 1 : 0; }
int freenect_open_device(Context*, Device** device, int index) {
  if (index != 0 || !control.is_plugged) return -1;
  *device = open_device = new Device;
  ++control.num_objects;
  return 0;
}
int freenect_close_device(Device* device) {
  open_device = nullptr;
  delete device;
  --control.num_objects;
  return 0;
}
void freenect_set_user(Device* device, void* user) { device->user = user; }
void* freenect_get_user(Device* device) { return device->user; }
void freenect_set_depth_callback(Device* device, Callback callback) { device->callback = callback; }
int freenect_get_depth_mode_count() { return 2; }
Mode freenect_get_depth_mode(int index) {
  return {0,
          kMedium,
          index == 0 ? kDisparity : kMillimeters,
          2 * kWidth * kHeight,
          kWidth,
          kHeight,
          16,
          0,
          30,
          1};
}
int freenect_set_depth_mode(Device*, Mode mode) {
  format = mode.format;
  return 0;
}
int freenect_start_depth(Device*) { return format == kMillimeters ? 0 : -1; }
int freenect_stop_depth(Device*) { return 0; }
int freenect_process_events_timeout(Context*, timeval* timeout) {
  if (!control.is_plugged) return -1;
  if (control.is_stalled) {
    std::this_thread::sleep_for(std::chrono::microseconds(timeout->tv_usec));
    return 0;
  }
  std::this_thread::sleep_for(std::chrono::microseconds(control.microseconds));
  const int number = frame_number++;
  if (open_device != nullptr) {
    open_device->callback(open_device, palpate::test::repeated_pattern(kWidth, kHeight, number),
                          static_cast<std::uint32_t>(number) * 2000000U);
  }
  return 0;
}

}  // extern "C"
