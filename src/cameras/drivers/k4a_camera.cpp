// Azure Kinect, Femto and their recordings (.mkv) by libk4a and libk4arecord, with declarations of
// our own (k4atypes.h, version 1.4).
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/drivers/python_packages.h"
#include "src/cameras/stream/raw_frames.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kSucceeded = 0;       // of every call
constexpr int kNone = 2;            // of a wait: time is over; of a recording: its end
constexpr int kNarrowUnbinned = 2;  // depth mode: 640 x 576

struct Handle;  // of a device, recording, capture or image

struct Intrinsic {
  int type;
  unsigned num_parameters;
  /// cx, cy, fx, fy, k1 to k6, codx, cody, p2, p1, metric radius.
  float v[15];
};
struct CameraCalibration {
  float rotation[9], translation[3];
  Intrinsic intrinsic;
  int width, height;
  float metric_radius;
};
/// The depth camera comes first; the rest is not looked at.
struct Calibration {
  CameraCalibration depth;
  char rest[4096];
};
struct DeviceConfiguration {
  int color_format, color_resolution, depth_mode, rate;
  bool only_synchronized;
  std::int32_t delay;
  int sync_mode;
  std::uint32_t subordinate_delay;
  bool no_light;
};

struct Api {
  std::uint32_t (*device_count)();
  int (*open_device)(std::uint32_t index, Handle** device);
  void (*close_device)(Handle* device);
  int (*start)(Handle* device, const DeviceConfiguration* configuration);
  void (*stop)(Handle* device);
  int (*device_calibration)(Handle* device, int depth_mode, int color, Calibration* calibration);
  int (*device_capture)(Handle* device, Handle** capture, std::int32_t milliseconds);
  Handle* (*depth_image)(Handle* capture);
  void (*release_capture)(Handle* capture);
  std::uint8_t* (*buffer)(Handle* image);
  int (*width)(Handle* image);
  int (*height)(Handle* image);
  int (*stride)(Handle* image);
  std::uint64_t (*microseconds)(Handle* image);
  void (*release_image)(Handle* image);
  // Functions of libk4arecord, which may be missing.
  int (*open_file)(const char* path, Handle** playback);
  void (*close_file)(Handle* playback);
  int (*file_calibration)(Handle* playback, Calibration* calibration);
  int (*file_capture)(Handle* playback, Handle** capture);

  std::string path;
  std::string no_record;  ///< why recordings cannot be played; else empty
};

std::vector<std::string> places(const char* variable, const char* stem) {
  std::vector<std::string> candidates = given_by(variable);
  for (const char* version : {".so", ".so.1.4", ".so.1.3"}) {
    candidates.push_back(std::string(stem) + version);
  }
  for (const char* mark : {"-", ".so"}) {
    for (std::string& file :
         files_of_python_package("pyk4a_bundle.libs", std::string(stem) + mark)) {
      if (std::filesystem::exists(file)) candidates.push_back(std::move(file));
    }
  }
  return candidates;
}

void load_record(Api& api) {
  auto library = SharedLibrary::open(places("K4ARECORD_LIBRARY", "libk4arecord"));
  if (!library) {
    api.no_record = "libk4arecord is not there: " + library.error().message;
    return;
  }
  library->require("k4a_playback_open", api.open_file);
  library->require("k4a_playback_close", api.close_file);
  library->require("k4a_playback_get_calibration", api.file_calibration);
  library->require("k4a_playback_get_next_capture", api.file_capture);
  if (const Status status = library->check(""); !status) api.no_record = status.error().message;
}

Result<Api> load() {
  // libk4arecord finds the library that has been loaded by its name.
  auto library = SharedLibrary::open(places("K4A_LIBRARY", "libk4a"));
  if (!library) {
    return Error{Errc::unavailable,
                 "libk4a is not there: " + library.error().message +
                     "; install it, or pip install pyk4a-bundle (also from a virtual environment "
                     "that is active), or name it in K4A_LIBRARY"};
  }
  Api api{};
  library->require("k4a_device_get_installed_count", api.device_count);
  library->require("k4a_device_open", api.open_device);
  library->require("k4a_device_close", api.close_device);
  library->require("k4a_device_start_cameras", api.start);
  library->require("k4a_device_stop_cameras", api.stop);
  library->require("k4a_device_get_calibration", api.device_calibration);
  library->require("k4a_device_get_capture", api.device_capture);
  library->require("k4a_capture_get_depth_image", api.depth_image);
  library->require("k4a_capture_release", api.release_capture);
  library->require("k4a_image_get_buffer", api.buffer);
  library->require("k4a_image_get_width_pixels", api.width);
  library->require("k4a_image_get_height_pixels", api.height);
  library->require("k4a_image_get_stride_bytes", api.stride);
  library->require("k4a_image_get_device_timestamp_usec", api.microseconds);
  library->require("k4a_image_release", api.release_image);
  if (const Status status = library->check("; install libk4a 1.3 or newer"); !status)
    return status.error();
  api.path = library->path();
  load_record(api);
  return api;
}

const Result<Api>& api() {
  static const Result<Api> loaded = load();
  return loaded;
}

class K4aSource final : public MakersSource {
 public:
  K4aSource(const Api& api, Handle* handle, bool is_file)
      : api_(api), handle_(handle), is_file_(is_file) {}
  ~K4aSource() override {
    if (held_ != nullptr) api_.release_image(held_);
    if (is_started_) api_.stop(handle_);
    is_file_ ? api_.close_file(handle_) : api_.close_device(handle_);
  }

  Status open(const CameraUri& uri) {
    info_.name = uri.target.empty() ? "k4a" : "k4a:" + uri.target;
    info_.rate = uri.rate.value_or(30);
    info_.is_live = !is_file_;
    info_.sensor = SensorKind::tof;
    Calibration calibration{};
    if (!is_file_) {
      const DeviceConfiguration configuration{0, 0, kNarrowUnbinned, 2, false, 0, 0, 0, false};
      if (api_.start(handle_, &configuration) != kSucceeded) {
        return Error{Errc::unavailable, info_.name +
                                            " does not start; is its power supply plugged "
                                            "in, and libdepthengine there?"};
      }
      is_started_ = true;
    }
    const int status = is_file_
                           ? api_.file_calibration(handle_, &calibration)
                           : api_.device_calibration(handle_, kNarrowUnbinned, 0, &calibration);
    // The size comes with the first image, which is kept for next().
    const auto got = take();
    if (!got) return got.error();
    if (!*got) return Error{Errc::bad_input, info_.name + " has no depth"};
    info_.width = api_.width(held_);
    info_.height = api_.height(held_);
    if (status == kSucceeded) set_camera(calibration.depth);
    return Done{};
  }

  Result<bool> next(DepthFrame& frame) override {
    if (held_ == nullptr) {
      const auto got = take();
      if (!got || !*got) return got;
    }
    copy(frame);
    api_.release_image(std::exchange(held_, nullptr));
    return true;
  }

 private:
  void set_camera(const CameraCalibration& camera) {
    const auto v = [&](int i) { return static_cast<double>(camera.intrinsic.v[i]); };
    info_.intrinsics = {v(2), v(3), v(0), v(1)};
    info_.distortion = {v(4), v(5), v(13), v(12), v(6), v(7), v(8), v(9)};
    scale_camera({camera.width, camera.height}, info_);
  }

  /// The next depth image into `held_`; false at the end, or when cancelled.
  Result<bool> take() {
    const double begin = monotonic_now();
    while (!is_cancelled_) {
      Handle* capture = nullptr;
      const int got = is_file_ ? api_.file_capture(handle_, &capture)
                               : api_.device_capture(handle_, &capture, kWaitMilliseconds);
      if (got == kSucceeded && capture != nullptr) {
        held_ = api_.depth_image(capture);
        api_.release_capture(capture);
        if (held_ != nullptr) return true;
      } else if (got == kNone && is_file_) {
        return false;
      } else if (got != kNone) {
        return Error{is_file_ ? Errc::bad_input : Errc::unavailable,
                     info_.name + (is_file_ ? " is damaged" : " has been lost")};
      }
      if (const Status status = check_silence(begin); !is_file_ && !status) return status.error();
    }
    return false;
  }

  void copy(DepthFrame& frame) {
    frame.unit = info_.unit;
    frame.timestamp = 1e-6 * static_cast<double>(api_.microseconds(held_));
    copy_rows(api_.buffer(held_), api_.stride(held_), api_.width(held_), api_.height(held_), frame);
  }

  const Api& api_;
  Handle* const handle_;
  Handle* held_ = nullptr;  // an image
  const bool is_file_;
  bool is_started_ = false;
};

}  // namespace

Result<RawStream> open_k4a_camera(const CameraUri& uri, const CameraOpening&) {
  if (const Status status = uri.check_extras(); !status) return status.error();
  const bool is_file = uri.target.ends_with(".mkv");
  std::error_code ignored;
  if (is_file && !std::filesystem::is_regular_file(uri.target, ignored)) {
    return Error{Errc::not_found, "no such file: " + uri.target + "; check its name"};
  }
  const auto index = camera_number(uri.target);
  if (!is_file && !index) {
    return Error{Errc::invalid_argument,
                 "camera " + uri.text + ": give k4a, k4a:NUMBER or k4a:FILE.mkv"};
  }
  const Result<Api>& loaded = api();
  if (!loaded) return loaded.error();
  Handle* handle = nullptr;
  if (is_file) {
    if (!loaded->no_record.empty()) return Error{Errc::unavailable, loaded->no_record};
    if (loaded->open_file(uri.target.c_str(), &handle) != kSucceeded) {
      return Error{Errc::bad_input,
                   uri.target + " cannot be played: it is not a recording of libk4a"};
    }
  } else if (const auto at = static_cast<std::uint32_t>(*index);
             loaded->device_count() <= at || loaded->open_device(at, &handle) != kSucceeded) {
    return Error{Errc::not_found, loaded->path + " sees no camera of the number " +
                                      std::to_string(*index) +
                                      "; plug it in, and see that you may use it (udev rules of "
                                      "libk4a)"};
  }
  auto source = std::make_unique<K4aSource>(*loaded, handle, is_file);
  if (const Status status = source->open(uri); !status) return status.error();
  return RawStream{std::move(source)};
}

FoundCameras find_k4a_cameras() {
  const Result<Api>& loaded = api();
  FoundCameras found = found_by(loaded);
  if (!loaded) return found;
  found.version = version_of_file(loaded->path);  // the library reports none
  const std::uint32_t num = loaded->device_count();
  for (std::uint32_t i = 0; i < num; ++i) found.devices.push_back("k4a:" + std::to_string(i));
  found.reason = num > 0 ? "Azure Kinect and Femto; recordings"
                         : "no camera is plugged in; recordings can be played";
  if (!loaded->no_record.empty()) found.reason += "; no recordings: " + loaded->no_record;
  return found;
}

}}  // namespace palpate::v0
