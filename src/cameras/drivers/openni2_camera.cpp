// Kinect v1, Xtion, Astra and .oni files by OpenNI2.
#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <thread>
#include <utility>
#include <vector>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/drivers/openni2_api.h"
#include "src/cameras/stream/raw_frames.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace {

using namespace openni2;
using namespace std::chrono_literals;

double unit_of(const VideoMode& mode) { return mode.format == kTenths ? 0.0001 : 0.001; }

/// The player of recordings walks through its streams once more when one of them has stopped,
/// without a lock: it must be asleep again before the stream goes.
constexpr auto kPlayerRest = 50ms;

/// Device and stream, closed in the right order.
class Openni2Source final : public MakersSource {
 public:
  Openni2Source(const Api& api, bool is_file) : api_(api), is_file_(is_file) {}
  ~Openni2Source() override {
    caller().call([&] {
      if (is_started_) api_.stop(stream_);
      if (is_started_ && is_file_) std::this_thread::sleep_for(kPlayerRest);
      if (stream_ != nullptr) api_.destroy_stream(stream_);
      return device_ == nullptr ? kOk : api_.close(device_);
    });
  }

  Status open(const CameraUri& uri, const std::string& device_uri) {
    info_.name = "openni2:" + (uri.target.empty() ? device_uri : uri.target);
    if (api_.open(device_uri.c_str(), &device_) != kOk) return failed("cannot be opened");
    if (api_.create_stream(device_, kDepth, &stream_) != kOk) return failed("has no depth");
    if (is_file_) {
      const float at_full_rate = -1;
      const int no = 0;
      api_.set_device(device_, kSpeed, &at_full_rate, sizeof at_full_rate);
      api_.set_device(device_, kRepeat, &no, sizeof no);
      int num = 0, bytes = sizeof num;
      if (api_.get(stream_, kNumFrames, &num, &bytes) == kOk && num > 0) info_.num_frames = num;
    } else if (const Status status = choose_mode(uri); !status) {
      return status;
    }
    const int off = 0;
    api_.set_device(device_, kRegistration, &off, sizeof off);
    api_.set(stream_, kMirroring, &off, sizeof off);
    int bytes = sizeof is_mirrored_;
    if (api_.get(stream_, kMirroring, &is_mirrored_, &bytes) != kOk) is_mirrored_ = 0;
    VideoMode mode{};
    bytes = sizeof mode;
    if (api_.get(stream_, kVideoMode, &mode, &bytes) != kOk) return failed("reports no image size");
    if (mode.format != kMillimeters && mode.format != kTenths) {
      return Error{Errc::bad_input, info_.name + " sends no millimeters but the format " +
                                        std::to_string(mode.format)};
    }
    set_image(mode, mode.width, mode.height, 0, 0);
    info_.rate = uri.rate.value_or(mode.rate > 0 ? mode.rate : 30);
    info_.is_live = !is_file_;
    info_.sensor = SensorKind::structured_light;
    if (api_.start(stream_) != kOk) return failed("does not start");
    is_started_ = true;
    return Done{};
  }

  Result<bool> next(DepthFrame& frame) override {
    if (info_.num_frames && num_read_ == *info_.num_frames) return false;
    if (const auto got = wait(); !got || !*got) return got;
    return caller().call([&] { return read(frame); });
  }

 private:
  Status failed(const char* what) const {
    std::string why = api_.last_error() == nullptr ? "" : api_.last_error();
    while (!why.empty() && std::isspace(static_cast<unsigned char>(why.back()))) why.pop_back();
    std::replace(why.begin(), why.end(), '\n', ' ');
    return Error{Errc::unavailable, info_.name + " " + what + (why.empty() ? "" : ": " + why)};
  }

  /// Chooses a mode, preferably in millimeters.
  Status choose_mode(const CameraUri& uri) {
    const SensorInfo* const sensor = api_.sensor_info(device_, kDepth);
    if (sensor == nullptr) return failed("reports no modes");
    std::vector<const VideoMode*> modes;
    std::vector<ImageMode> choices;
    for (const int format : {kMillimeters, kTenths}) {
      for (int i = 0; i < sensor->num_modes; ++i) {
        const VideoMode& mode = sensor->modes[i];
        if (mode.format != format) continue;
        modes.push_back(&mode);
        choices.push_back({mode.width, mode.height, mode.rate});
      }
    }
    const auto best = palpate::choose_mode(choices, uri, {640, 480});
    if (!best) {
      return Error{Errc::invalid_argument,
                   info_.name + " has no such mode; it has " + listed(choices)};
    }
    if (api_.set(stream_, kVideoMode, modes[*best], sizeof(VideoMode)) != kOk) {
      return failed("refuses its mode");
    }
    return Done{};
  }

  /// Sets size, unit and intrinsics by the mode and the part of its image that comes.
  void set_image(const VideoMode& mode, int width, int height, int crop_x, int crop_y) {
    info_.width = width;
    info_.height = height;
    info_.unit = unit_of(mode);
    float across = 0, down = 0;
    int bytes = sizeof across;
    if (api_.get(stream_, kHorizontalFov, &across, &bytes) != kOk || !(across > 0)) return;
    info_.intrinsics.fx = 0.5 * mode.width / std::tan(0.5 * static_cast<double>(across));
    bytes = sizeof down;
    const bool has_both = api_.get(stream_, kVerticalFov, &down, &bytes) == kOk && down > 0;
    info_.intrinsics.fy = has_both ? 0.5 * mode.height / std::tan(0.5 * static_cast<double>(down))
                                   : info_.intrinsics.fx;
    info_.intrinsics.cx = 0.5 * (mode.width - 1) - crop_x;
    info_.intrinsics.cy = 0.5 * (mode.height - 1) - crop_y;
    mode_ = mode;
    crop_ = {crop_x, crop_y};
  }

  Result<bool> read(DepthFrame& frame) {
    Frame* raw = nullptr;
    if (api_.read(stream_, &raw) != kOk || raw == nullptr) return failed("gives no frame").error();
    ++num_read_;
    copy(*raw, frame);
    api_.release(raw);
    return true;
  }

  /// False when cancelled.
  Result<bool> wait() {
    if (is_file_) return !is_cancelled_;
    const double begin = monotonic_now();
    while (!is_cancelled_) {
      int index = 0;
      const int got =
          caller().call([&] { return api_.wait(&stream_, 1, &index, kWaitMilliseconds); });
      if (got == kOk) return true;
      if (got != kTimeOut) {
        return caller().call([&] { return failed("has been lost"); }).error();
      }
      if (const Status status = check_silence(begin); !status) return status.error();
    }
    return false;
  }

  void copy(const Frame& raw, DepthFrame& frame) {
    const std::array crop = {raw.is_cropped != 0 ? raw.crop_x : 0,
                             raw.is_cropped != 0 ? raw.crop_y : 0};
    if (raw.width != info_.width || raw.height != info_.height || crop != crop_ ||
        std::memcmp(&raw.mode, &mode_, sizeof mode_) != 0) {
      set_image(raw.mode, raw.width, raw.height, crop[0], crop[1]);
    }
    frame.unit = unit_of(raw.mode);
    frame.timestamp = 1e-6 * static_cast<double>(raw.microseconds);
    copy_rows(raw.data, raw.stride, raw.width, raw.height, frame);
    for (auto row = frame.pixels.begin(); is_mirrored_ != 0 && row != frame.pixels.end();
         row += raw.width) {
      std::reverse(row, row + raw.width);
    }
  }

  const Api& api_;
  const bool is_file_;
  Device* device_ = nullptr;
  Stream* stream_ = nullptr;
  VideoMode mode_{};
  std::array<int, 2> crop_{};
  int is_mirrored_ = 0, num_read_ = 0;
  bool is_started_ = false;
};

/// Lists devices without files opened before: the library keeps them, even unplayable ones.
std::vector<DeviceInfo> list_devices(const Api& api) {
  DeviceInfo* devices = nullptr;
  int num = 0;
  if (api.device_list(&devices, &num) != kOk) return {};
  std::vector<DeviceInfo> all(devices, devices + num);
  api.release_list(devices);
  std::erase_if(
      all, [](const DeviceInfo& each) { return std::string_view(each.uri).ends_with(".oni"); });
  return all;
}

Result<RawStream> open_here(const Api& api, const CameraUri& uri) {
  std::error_code ignored;
  const bool is_file = uri.target.ends_with(".oni");
  std::string device = uri.target;
  if (is_file && !std::filesystem::is_regular_file(uri.target, ignored)) {
    return Error{Errc::not_found, "no such file: " + uri.target + "; check its name"};
  }
  if (!is_file) {
    const auto devices = list_devices(api);
    const auto found = std::find_if(devices.begin(), devices.end(), [&](const DeviceInfo& each) {
      return uri.target.empty() || std::string_view(each.uri).find(uri.target) != std::string::npos;
    });
    if (found == devices.end()) {
      return Error{Errc::not_found,
                   api.path + " sees no camera" +
                       (uri.target.empty() ? "" : " called " + uri.target) +
                       "; plug it in, and see that you may use it (udev rules of OpenNI2)"};
    }
    device = found->uri;
  }
  auto source = std::make_unique<Openni2Source>(api, is_file);
  if (const Status status = source->open(uri, device); !status) return status.error();
  return RawStream{std::move(source)};
}

}  // namespace

Result<RawStream> open_openni2_camera(const CameraUri& uri, const CameraOpening&) {
  if (const Status status = uri.check_extras(); !status) return status.error();
  const Result<Api>& loaded = api();
  if (!loaded) return loaded.error();
  return caller().call([&] { return open_here(*loaded, uri); });
}

FoundCameras find_openni2_cameras() {
  const Result<Api>& loaded = api();
  FoundCameras found = found_by(loaded);
  if (!loaded) return found;
  const Version version = caller().call([&] { return loaded->version(); });
  found.version = std::to_string(version.major) + "." + std::to_string(version.minor) + "." +
                  std::to_string(version.maintenance) + "." + std::to_string(version.build);
  for (const DeviceInfo& device : caller().call([&] { return list_devices(*loaded); })) {
    found.devices.push_back("openni2:" + std::string(device.uri));
  }
  found.reason = found.devices.empty() ? "no camera is plugged in; .oni files can be played"
                                       : "Kinect v1, Xtion, Astra and others; .oni files";
  return found;
}

}}  // namespace palpate::v0
