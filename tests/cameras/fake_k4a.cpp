// A library with the symbols of libk4a, for want of a camera that the real one would show: one
// device whose every pixel is known.
#include <chrono>
#include <cstdint>
#include <thread>

#include "tests/cameras/fake_camera.h"

namespace {

palpate::test::FakeCamera control;

constexpr int kWidth = 640, kHeight = 576;
constexpr int kSucceeded = 0, kFailed = 1, kTimeout = 2;

struct Object {
  explicit Object(int frame = 0) : number(frame) { ++control.num_objects; }
  ~Object() { --control.num_objects; }
  int number;
};

/// k4a_calibration_camera_t.
struct Calibration {
  float rotation[9], translation[3];
  int model;
  unsigned num_parameters;
  float v[15];  // cx, cy, fx, fy, ...
  int width, height;
  float metric_radius;
};

int frame_number = 0;

}  // namespace

#pragma GCC visibility push(default)
extern "C" {

palpate::test::FakeCamera* palpate_fake_k4a() { return &control; }

std::uint32_t k4a_device_get_installed_count() { return control.is_plugged ? 1 : 0; }
int k4a_device_open(std::uint32_t index, Object** device) {
  if (index != 0 || !control.is_plugged) return kFailed;
  *device = new Object;
  return kSucceeded;
}
void k4a_device_close(Object* device) { delete device; }
int k4a_device_start_cameras(Object*, const void*) {
  return control.is_plugged ? kSucceeded : kFailed;
}
void k4a_device_stop_cameras(Object*) {}
int k4a_device_get_calibration(Object*, int, int, Calibration* calibration) {
  *calibration = {};
  calibration->num_parameters = 14;
  calibration->v[0] = 319.5f;
  calibration->v[1] = 287.5f;
  calibration->v[2] = calibration->v[3] = 504;
  calibration->width = kWidth;
  calibration->height = kHeight;
  return kSucceeded;
}
int k4a_device_get_capture(Object*, Object** capture, std::int32_t milliseconds) {
  if (!control.is_plugged) return kFailed;
  if (control.is_stalled) {
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
    return kTimeout;
  }
  std::this_thread::sleep_for(std::chrono::microseconds(control.microseconds));
  *capture = new Object(frame_number++);
  return kSucceeded;
}
Object* k4a_capture_get_depth_image(Object* capture) { return new Object(capture->number); }
void k4a_capture_release(Object* capture) { delete capture; }
std::uint16_t* k4a_image_get_buffer(Object* image) {
  return palpate::test::repeated_pattern(kWidth, kHeight, image->number);
}
int k4a_image_get_width_pixels(Object*) { return kWidth; }
int k4a_image_get_height_pixels(Object*) { return kHeight; }
int k4a_image_get_stride_bytes(Object*) { return 2 * kWidth; }
std::uint64_t k4a_image_get_device_timestamp_usec(Object* image) {
  return 1000000 + static_cast<std::uint64_t>(image->number) * 33333;
}
void k4a_image_release(Object* image) { delete image; }

}  // extern "C"
