// A library with the symbols of the Orbbec SDK, for want of a camera that the real one would show:
// one device whose every pixel is known.
#include <chrono>
#include <cstdint>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "src/cameras/drivers/orbbec_api.h"
#include "tests/cameras/camera_fakes.h"
#include "tests/cameras/fake_orbbec.h"

using palpate::orbbec::CameraDistortion;
using palpate::orbbec::CameraIntrinsic;
using palpate::test::FakeOrbbec;

namespace {

FakeOrbbec control;

struct Object {
  Object() { ++control.num_objects; }
  Object(const Object& other) : number(other.number), width(other.width), height(other.height) {
    ++control.num_objects;
  }
  ~Object() { --control.num_objects; }
  int number = 0, width = 0, height = 0, format = 28;
  std::vector<std::uint16_t> pixels;
};
struct Failure {
  std::string message;
};
using Error = Failure**;

void fail(Error error, const char* message) {
  if (error != nullptr) *error = new Failure{message};
}
/// Returns false, with an error, once the camera is unplugged.
bool is_there(Error error) {
  if (!control.is_plugged) fail(error, "Device is deactivated/disconnected!");
  return control.is_plugged;
}

int frame_number = 0;
constexpr int kSizes[][2] = {{320, 240}, {64, 48}, {640, 576}, {1024, 1024}};

}  // namespace

#pragma GCC visibility push(default)
extern "C" {

FakeOrbbec* palpate_fake_orbbec() { return &control; }

int ob_get_version() { return 20903; }
const char* ob_error_get_message(const Failure* error) { return error->message.c_str(); }
void ob_delete_error(Failure* error) { delete error; }
void ob_set_logger_severity(int, Error) {}
void* ob_create_context(Error) { return &control; }

Object* ob_query_device_list(void*, Error) { return new Object; }
std::uint32_t ob_device_list_get_count(const Object*, Error) { return control.is_plugged ? 1 : 0; }
Object* ob_device_list_get_device(const Object*, std::uint32_t index, Error error) {
  if (index != 0) return fail(error, "Invalid index value"), nullptr;
  if (control.is_busy) return fail(error, "Device is in use"), nullptr;
  return is_there(error) ? new Object : nullptr;
}
const char* ob_device_list_get_device_name(const Object*, std::uint32_t, Error) {
  return "Orbbec Femto Bolt";
}
const char* ob_device_list_get_device_serial_number(const Object*, std::uint32_t, Error) {
  return "AY123";
}
void ob_delete_device_list(Object* list, Error) { delete list; }
void ob_delete_device(Object* device, Error) { delete device; }

Object* ob_create_pipeline_with_device(const Object*, Error error) {
  return is_there(error) ? new Object : nullptr;
}
void ob_delete_pipeline(Object* pipeline, Error) { delete pipeline; }
Object* ob_pipeline_get_stream_profile_list(const Object*, int sensor, Error error) {
  if (sensor != 3) return fail(error, "no such sensor"), nullptr;
  return is_there(error) ? new Object : nullptr;
}
// One more profile, of a compressed format.
std::uint32_t ob_stream_profile_list_get_count(const Object*, Error) { return 5; }
Object* ob_stream_profile_list_get_profile(const Object*, int index, Error) {
  auto* const profile = new Object;
  profile->width = kSizes[index % 4][0];
  profile->height = kSizes[index % 4][1];
  profile->format = index == 4 ? 27 : index % 2 == 0 ? 8 : 28;
  return profile;
}
void ob_delete_stream_profile_list(Object* list, Error) { delete list; }
void ob_delete_stream_profile(const Object* profile, Error) { delete profile; }
int ob_stream_profile_get_format(const Object* profile, Error) { return profile->format; }
std::uint32_t ob_video_stream_profile_get_width(const Object* profile, Error) {
  return static_cast<std::uint32_t>(profile->width);
}
std::uint32_t ob_video_stream_profile_get_height(const Object* profile, Error) {
  return static_cast<std::uint32_t>(profile->height);
}
std::uint32_t ob_video_stream_profile_get_fps(const Object*, Error) { return 30; }
CameraIntrinsic ob_video_stream_profile_get_intrinsic(const Object* profile, Error) {
  const auto width = static_cast<float>(profile->width),
             height = static_cast<float>(profile->height);
  return {width,
          width,
          0.5f * (width - 1),
          0.5f * (height - 1),
          static_cast<std::int16_t>(profile->width),
          static_cast<std::int16_t>(profile->height)};
}
CameraDistortion ob_video_stream_profile_get_distortion(const Object*, Error) {
  return {control.k1, 0, 0, 0, 0, 0, 0, 0, control.lens};
}

Object* ob_create_config(Error) { return new Object; }
void ob_delete_config(Object* config, Error) { delete config; }
void ob_config_enable_stream_with_stream_profile(Object*, const Object* profile, Error) {
  control.width = profile->width;
  control.height = profile->height;
}
void ob_pipeline_start_with_config(Object*, const Object*, Error error) { is_there(error); }
void ob_pipeline_stop(Object*, Error error) { is_there(error); }
Object* ob_pipeline_wait_for_frameset(Object*, std::uint32_t milliseconds, Error) {
  // The real SDK reports no error for a lost camera: no more frames come.
  if (!control.is_plugged || control.is_stalled) {
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
    return nullptr;
  }
  std::this_thread::sleep_for(std::chrono::microseconds(control.microseconds));
  auto* const frames = new Object;
  frames->number = frame_number++;
  frames->width = control.width;
  frames->height = control.height;
  return frames;
}
Object* ob_frameset_get_depth_frame(const Object* frames, Error) {
  auto* const depth = new Object(*frames);
  depth->pixels = palpate::test::pattern(depth->width, depth->height, depth->number);
  return depth;
}
Object* ob_frame_get_stream_profile(const Object* frame, Error) { return new Object(*frame); }
void ob_delete_frame(const Object* frame, Error) { delete frame; }
std::uint32_t ob_video_frame_get_width(const Object* frame, Error) {
  return static_cast<std::uint32_t>(frame->width);
}
std::uint32_t ob_video_frame_get_height(const Object* frame, Error) {
  return static_cast<std::uint32_t>(frame->height);
}
const std::uint16_t* ob_frame_get_data(const Object* frame, Error) { return frame->pixels.data(); }
std::uint32_t ob_frame_get_data_size(const Object* frame, Error) {
  return static_cast<std::uint32_t>(2 * frame->pixels.size());
}
std::uint64_t ob_frame_get_timestamp_us(const Object* frame, Error) {
  return 1000000 + static_cast<std::uint64_t>(frame->number) * 33333;
}
float ob_depth_frame_get_value_scale(const Object*, Error) { return control.millimeters; }

}  // extern "C"
#pragma GCC visibility pop
