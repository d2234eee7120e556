// Kinect v1 by libfreenect, with declarations of our own (libfreenect.h, version 0.5).
#include <sys/time.h>

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/stream/raw_frames.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 {
namespace {

struct Context;
struct Device;

constexpr int kMillimeters = 5, kDisparity = 0;  // depth formats: DEPTH_MM, DEPTH_11BIT
constexpr int kMedium = 1;                       // 640 x 480
constexpr int kCameraOnly = 2, kErrorsOnly = 1, kMirrorDepth = 1 << 16;

struct FrameMode {
  std::uint32_t reserved;
  int resolution, format;
  std::int32_t bytes;
  std::int16_t width, height;
  std::int8_t bits, padding, rate, is_valid;
};

struct Api {
  int (*init)(Context** context, void* usb);
  int (*shutdown)(Context* context);
  void (*set_log_level)(Context* context, int level);
  void (*select)(Context* context, int subdevices);
  int (*num_devices)(Context* context);
  int (*open)(Context* context, Device** device, int index);
  int (*close)(Device* device);
  void (*set_user)(Device* device, void* user);
  void* (*get_user)(Device* device);
  void (*set_callback)(Device* device, void (*callback)(Device*, void*, std::uint32_t));
  int (*num_modes)();
  FrameMode (*mode)(int index);
  int (*set_mode)(Device* device, FrameMode mode);
  int (*start)(Device* device);
  int (*stop)(Device* device);
  int (*process)(Context* context, timeval* timeout);
  int (*set_flag)(Device* device, int flag, int value);  // may be missing

  std::string path;
};

Result<Api> load() {
  std::vector<std::string> candidates = given_by("FREENECT_LIBRARY");
  candidates.insert(candidates.end(), {"libfreenect.so.0.5", "libfreenect.so.0", "libfreenect.so"});
  auto library = SharedLibrary::open(candidates);
  if (!library) {
    return Error{Errc::unavailable, "libfreenect is not there: " + library.error().message +
                                        "; install libfreenect0.5, or name it in FREENECT_LIBRARY"};
  }
  Api api{};
  library->require("freenect_init", api.init);
  library->require("freenect_shutdown", api.shutdown);
  library->require("freenect_set_log_level", api.set_log_level);
  library->require("freenect_select_subdevices", api.select);
  library->require("freenect_num_devices", api.num_devices);
  library->require("freenect_open_device", api.open);
  library->require("freenect_close_device", api.close);
  library->require("freenect_set_user", api.set_user);
  library->require("freenect_get_user", api.get_user);
  library->require("freenect_set_depth_callback", api.set_callback);
  library->require("freenect_get_depth_mode_count", api.num_modes);
  library->require("freenect_get_depth_mode", api.mode);
  library->require("freenect_set_depth_mode", api.set_mode);
  library->require("freenect_start_depth", api.start);
  library->require("freenect_stop_depth", api.stop);
  library->require("freenect_process_events_timeout", api.process);
  library->find("freenect_set_flag", api.set_flag);
  if (const Status status = library->check("; install libfreenect 0.2 or newer"); !status)
    return status.error();
  api.path = library->path();
  return api;
}

const Result<Api>& api() {
  static const Result<Api> loaded = load();
  return loaded;
}

/// A connection to the library; each has its own.
class Connection {
 public:
  explicit Connection(const Api& api) : api_(api) {
    is_open_ = api_.init(&context_, nullptr) >= 0;
    if (!is_open_) return;
    api_.set_log_level(context_, kErrorsOnly);
    api_.select(context_, kCameraOnly);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  ~Connection() {
    if (is_open_) api_.shutdown(context_);
  }
  Context* context() const { return context_; }
  /// Below 0: USB cannot be used.
  int num_devices() const { return is_open_ ? api_.num_devices(context_) : -1; }

 private:
  const Api& api_;
  Context* context_ = nullptr;
  bool is_open_ = false;
};

// A Kinect of the usual calibration: its reference plane, how far aside its projector is, and how
// wide half a pixel of depth is at the reference plane. cm; of the shift, quarters of half a pixel.
constexpr double kReference = 120, kBase = 7.5, kHalfPixel = 0.1042, kZeroShift = 200.375;

/// The library makes millimeters of a camera's disparities by the calibration in it. The one that
/// plays recordings (fakenect) gives disparities: these are taken to be of the usual calibration.
std::vector<std::uint16_t> millimeters_of_disparity() {
  std::vector<std::uint16_t> table(2048);
  for (std::size_t i = 0; i + 1 < table.size(); ++i) {
    const double shift = kHalfPixel * (static_cast<double>(i) / 4 - kZeroShift);
    const double depth = 10 * (kReference * shift / (kBase - shift) + kReference);
    const bool is_seen = shift < kBase && depth < 10000;
    table[i] = is_seen ? static_cast<std::uint16_t>(depth + 0.5) : std::uint16_t{0};
  }
  return table;
}

class FreenectSource final : public MakersSource {
 public:
  explicit FreenectSource(const Api& api) : api_(api), connection_(api) {}
  ~FreenectSource() override {
    if (is_started_) api_.stop(device_);
    if (device_ != nullptr) api_.close(device_);
  }

  Status open(const CameraUri& uri, int index) {
    info_.name = "freenect:" + std::to_string(index);
    const int num = connection_.num_devices();
    if (num <= index) {
      return Error{Errc::not_found,
                   api_.path +
                       (num < 0 ? " cannot use USB"
                                : " sees no camera of the number " + std::to_string(index)) +
                       "; plug the Kinect and its power supply in, and see that you may use it "
                       "(udev rules of libfreenect)"};
    }
    if (api_.open(connection_.context(), &device_, index) < 0) {
      device_ = nullptr;
      return Error{Errc::unavailable, info_.name +
                                          " cannot be opened; does another program use "
                                          "it, or the module gspca_kinect of the kernel?"};
    }
    const auto mode = choose_mode();
    if (!mode || (uri.size && !(*uri.size == ImageSize{mode->width, mode->height}))) {
      return Error{Errc::invalid_argument,
                   info_.name + " has no such depth mode; it has 640x480 at 30 Hz"};
    }
    if (mode->format == kDisparity) millimeters_ = millimeters_of_disparity();
    info_.width = mode->width;
    info_.height = mode->height;
    info_.rate = uri.rate.value_or(mode->rate > 0 ? mode->rate : 30);
    info_.is_live = true;
    info_.sensor = SensorKind::structured_light;
    // The library turns pixels into directions by this; it reports no intrinsics of the camera.
    constexpr double kFocal = kReference / (2 * kHalfPixel);
    info_.intrinsics = {kFocal, kFocal, 319.5, 239.5};
    api_.set_user(device_, this);
    api_.set_callback(device_, [](Device* device, void* pixels, std::uint32_t stamp) {
      static_cast<FreenectSource*>(api()->get_user(device))->take(pixels, stamp);
    });
    if (api_.set_flag != nullptr) api_.set_flag(device_, kMirrorDepth, 0);
    if (api_.set_mode(device_, *mode) < 0 || api_.start(device_) < 0) {
      return Error{Errc::unavailable, info_.name + " does not start"};
    }
    is_started_ = true;
    return Done{};
  }

  Result<bool> next(DepthFrame& frame) override {
    desired_ = &frame;
    const double begin = monotonic_now();
    while (desired_ != nullptr && !is_cancelled_) {
      timeval wait{0, 1000L * kWaitMilliseconds};
      if (api_.process(connection_.context(), &wait) < 0) {
        return Error{Errc::unavailable, info_.name + " has been lost"};
      }
      if (const Status status = check_silence(begin); desired_ != nullptr && !status)
        return status.error();
    }
    return desired_ == nullptr;
  }

 private:
  /// Prefers millimeters to disparities.
  std::optional<FrameMode> choose_mode() const {
    for (const int format : {kMillimeters, kDisparity}) {
      for (int i = 0; i < api_.num_modes(); ++i) {
        const FrameMode mode = api_.mode(i);
        if (mode.is_valid != 0 && mode.resolution == kMedium && mode.format == format) return mode;
      }
    }
    return {};
  }

  /// Called while events are processed.
  void take(const void* pixels, std::uint32_t stamp) {
    constexpr double kTicksPerSecond = 60e6;  // wrapped every 72 s
    if (has_stamp_) ticks_ += static_cast<std::int32_t>(stamp - last_stamp_);
    last_stamp_ = stamp;
    has_stamp_ = true;
    if (desired_ == nullptr) return;  // of several at once the first one
    copy_rows(pixels, 2 * info_.width, info_.width, info_.height, *desired_);
    if (!millimeters_.empty()) {
      for (std::uint16_t& pixel : desired_->pixels) pixel = millimeters_[pixel & 2047U];
    }
    desired_->unit = info_.unit;
    desired_->timestamp = static_cast<double>(ticks_) / kTicksPerSecond;
    desired_ = nullptr;
  }

  const Api& api_;
  const Connection connection_;
  Device* device_ = nullptr;
  std::vector<std::uint16_t> millimeters_;  // of each disparity, if the camera sends disparities
  DepthFrame* desired_ = nullptr;           // the frame to fill
  std::int64_t ticks_ = 0;                  // since the first frame
  std::uint32_t last_stamp_ = 0;
  bool has_stamp_ = false, is_started_ = false;
};

}  // namespace

Result<RawStream> open_freenect_camera(const CameraUri& uri, const CameraOpening&) {
  if (const Status status = uri.check_extras(); !status) return status.error();
  const auto index = camera_number(uri.target);
  if (!index) {
    return Error{Errc::invalid_argument,
                 "camera " + uri.text + ": give freenect or freenect:NUMBER"};
  }
  const Result<Api>& loaded = api();
  if (!loaded) return loaded.error();
  auto source = std::make_unique<FreenectSource>(*loaded);
  if (const Status status = source->open(uri, *index); !status) return status.error();
  return RawStream{std::move(source)};
}

FoundCameras find_freenect_cameras() {
  const Result<Api>& loaded = api();
  FoundCameras found = found_by(loaded);
  if (!loaded) return found;
  found.version = version_of_file(loaded->path);
  const int num = Connection(*loaded).num_devices();
  found.is_usable = num >= 0;
  for (int i = 0; i < num; ++i) found.devices.push_back("freenect:" + std::to_string(i));
  found.reason = num > 0    ? "Kinect v1"
                 : num == 0 ? "no Kinect is plugged in"
                            : "USB cannot be used here: see that you may, and that there is any";
  return found;
}

}}  // namespace palpate::v0
