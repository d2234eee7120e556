// RealSense cameras and their recordings (.db3, .bag) by librealsense2.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>
#include <vector>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/drivers/realsense_api.h"
#include "src/cameras/stream/raw_frames.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace {

using namespace realsense;

constexpr int kQueueCapacity = 4;

/// The library reports errors through a last argument.
class Check {
 public:
  explicit Check(const Api& api) : api_(api) {}
  ~Check() {
    if (error_ != nullptr) api_.free_error(error_);
  }
  operator Failure**() { return &error_; }
  bool is_fine() const { return error_ == nullptr; }
  std::string message() const { return error_ == nullptr ? "" : api_.message(error_); }

 private:
  const Api& api_;
  Failure* error_ = nullptr;
};

std::string info_of(const Api& api, const Device* device, int what) {
  Check check(api);
  const char* const text = api.device_info(device, what, check);
  return check.is_fine() && text != nullptr ? text : "";
}

class RealsenseSource final : public MakersSource {
 public:
  /// Takes the device over.
  RealsenseSource(const Api& api, Device* device, std::string file)
      : api_(api), device_(device), file_(std::move(file)) {}
  ~RealsenseSource() override {
    if (is_started_) api_.stop(sensor_, Check(api_));
    if (is_open_) api_.close(sensor_, Check(api_));
    if (queue_ != nullptr) api_.delete_queue(queue_);
    if (profiles_ != nullptr) api_.delete_profiles(profiles_);
    if (sensor_ != nullptr) api_.delete_sensor(sensor_);
    if (device_ != nullptr) api_.delete_device(device_);
    if (!file_.empty()) api_.remove_file(api_.context, file_.c_str(), Check(api_));
  }

  Status open(const CameraUri& uri) {
    info_.name = uri.target.empty() ? "realsense" : "realsense:" + uri.target;
    info_.is_live = file_.empty();
    info_.sensor = sensor_of_model("RealSense " + info_of(api_, device_, kName));
    if (!file_.empty()) api_.set_real_time(device_, 0, Check(api_));
    ImageMode mode;
    const Profile* const profile = choose_profile(uri, mode);
    if (profile == nullptr) {
      return Error{Errc::invalid_argument,
                   info_.name + " has no such depth mode; it has " + listed(all_modes_)};
    }
    set_image(profile, mode.width, mode.height);
    if (has_unknown_lens_ && !uri.distortion) {
      notes_.add(info_.is_live ? kUnknownLens : info_.name + " " + kUnknownLens);
    }
    info_.rate = uri.rate.value_or(mode.rate > 0 ? mode.rate : 30);
    Check check(api_);
    if (api_.supports_option(sensor_, kEmitter, Check(api_)) != 0 && info_.is_live) {
      api_.set_option(sensor_, kEmitter, 1, Check(api_));
    }
    if (const Status status = set_preset(uri); !status) return status;
    queue_ = api_.create_queue(kQueueCapacity, check);
    if (check.is_fine()) api_.open(sensor_, profile, check);
    is_open_ = check.is_fine();
    if (check.is_fine()) api_.start(sensor_, queue_, check);
    is_started_ = check.is_fine();
    if (!check.is_fine()) {
      return Error{Errc::unavailable, info_.name + " does not start: " + check.message()};
    }
    return Done{};
  }

  Result<bool> next(DepthFrame& frame) override {
    const double begin = monotonic_now();
    while (!is_cancelled_) {
      Frame* raw = nullptr;
      const int got = api_.wait(queue_, unsigned{kWaitMilliseconds}, &raw, Check(api_));
      if (got != 0 && raw != nullptr) {
        const Status copied = copy(raw, frame);
        api_.release(raw);
        if (!copied) return copied.error();
        return true;
      }
      if (!file_.empty()) {
        if (api_.playback_status(device_, Check(api_)) == kStopped) return false;
        continue;
      }
      if (const Status status = check_silence(begin); !status) return status.error();
    }
    return false;
  }

 private:
  /// Chooses a mode of a depth sensor, which becomes `sensor_`. Null: there is no such mode.
  const Profile* choose_profile(const CameraUri& uri, ImageMode& chosen) {
    const Profile* best = nullptr;
    SensorList* const sensors = api_.query_sensors(device_, Check(api_));
    const int num = sensors == nullptr ? 0 : api_.sensor_count(sensors, Check(api_));
    for (int i = 0; i < num && best == nullptr; ++i) {
      Sensor* const sensor = api_.create_sensor(sensors, i, Check(api_));
      ProfileList* const profiles =
          sensor == nullptr ? nullptr : api_.profiles(sensor, Check(api_));
      std::vector<const Profile*> depth;
      std::vector<ImageMode> modes;
      const int count = profiles == nullptr ? 0 : api_.profile_count(profiles, Check(api_));
      for (int k = 0; k < count; ++k) {
        const Profile* const profile = api_.profile(profiles, k, Check(api_));
        ImageMode mode;
        int stream = 0, format = 0, index = 0, id = 0;
        api_.profile_data(profile, &stream, &format, &index, &id, &mode.rate, Check(api_));
        if (stream != kDepthStream || format != kZ16) continue;
        CameraIntrinsics camera{};
        api_.intrinsics(profile, &camera, Check(api_));
        mode.width = camera.width;
        mode.height = camera.height;
        depth.push_back(profile);
        modes.push_back(mode);
        all_modes_.push_back(mode);
      }
      if (const auto found = choose_mode(modes, uri, {848, 480})) {
        best = depth[*found];
        chosen = modes[*found];
        sensor_ = sensor;
        profiles_ = profiles;
        continue;
      }
      if (profiles != nullptr) api_.delete_profiles(profiles);
      if (sensor != nullptr) api_.delete_sensor(sensor);
    }
    if (sensors != nullptr) api_.delete_sensors(sensors);
    return best;
  }

  /// Selects a preset of the camera for its way to measure: 3 of a D400 is high accuracy.
  Status set_preset(const CameraUri& uri) {
    const auto given = uri.extras.find("preset");
    if (given == uri.extras.end()) return Done{};
    const auto number = camera_number(given->second);
    Check check(api_);
    if (number && !given->second.empty()) {
      api_.set_option(sensor_, kPreset, static_cast<float>(*number), check);
      if (check.is_fine()) return Done{};
    }
    return Error{Errc::invalid_argument,
                 info_.name + " has no preset '" + given->second.substr(0, 40) +
                     "'; give the number of one of its visual presets (D400: 1 default, 2 hand, 3 "
                     "high accuracy, 4 high density)" +
                     (check.is_fine() ? "" : ": " + check.message())};
  }

  void set_image(const Profile* profile, int width, int height) {
    CameraIntrinsics camera{};
    Check check(api_);
    api_.intrinsics(profile, &camera, check);
    info_.width = width;
    info_.height = height;
    if (!check.is_fine()) return;  // the URI may have them
    const auto d = [](float value) { return static_cast<double>(value); };
    info_.intrinsics = {d(camera.fx), d(camera.fy), d(camera.ppx), d(camera.ppy)};
    const float* const c = camera.coefficients;
    const bool is_bent = std::any_of(c, c + 5, [](float value) { return value != 0; });
    has_unknown_lens_ = is_bent && camera.model != kNoDistortion && camera.model != kBrownConrady;
    if (is_bent && camera.model == kBrownConrady) {
      info_.distortion = {d(c[0]), d(c[1]), d(c[2]), d(c[3]), d(c[4]), 0, 0, 0};
    }
  }

  Status copy(const Frame* raw, DepthFrame& frame) {
    Check check(api_);
    const int width = api_.width(raw, check);
    const int height = check.is_fine() ? api_.height(raw, check) : 0;
    const int stride = check.is_fine() ? api_.stride(raw, check) : 0;
    const void* const data = check.is_fine() ? api_.data(raw, check) : nullptr;
    if (!check.is_fine() || data == nullptr || width < 1 || height < 1 || stride < 2 * width) {
      return Error{Errc::unavailable, info_.name + " gives a damaged frame: " + check.message()};
    }
    if (width != info_.width || height != info_.height) {
      set_image(api_.frame_profile(raw, Check(api_)), width, height);
    }
    frame.timestamp = 1e-3 * api_.milliseconds(raw, Check(api_));
    Check has_unit(api_);
    const float unit = api_.unit(raw, has_unit);
    // Reported in single precision: 0.001 is meant.
    if (has_unit.is_fine() && unit > 0) {
      info_.unit = std::round(static_cast<double>(unit) * 1e9) * 1e-9;
    }
    frame.unit = info_.unit;
    copy_rows(data, stride, width, height, frame);
    return Done{};
  }

  const Api& api_;
  Device* const device_;
  const std::string file_;  // empty: a camera
  Sensor* sensor_ = nullptr;
  ProfileList* profiles_ = nullptr;
  std::vector<ImageMode> all_modes_;
  Queue* queue_ = nullptr;
  bool is_open_ = false, is_started_ = false, has_unknown_lens_ = false;
};

/// The cameras; `keep` is called with each and says whether it takes the device over.
template <class Keep>
void for_each_device(const Api& api, const Keep& keep) {
  DeviceList* const list = api.query_devices(api.context, Check(api));
  const int num = list == nullptr ? 0 : api.device_count(list, Check(api));
  for (int i = 0; i < num; ++i) {
    Device* const device = api.create_device(list, i, Check(api));
    if (device != nullptr && !keep(device)) api.delete_device(device);
  }
  if (list != nullptr) api.delete_list(list);
}

}  // namespace

Result<std::unique_ptr<DepthSource>> realsense::open_device(Device* device, const CameraUri& uri,
                                                            const std::string& file) {
  auto source = std::make_unique<RealsenseSource>(*api(), device, file);
  if (const Status status = source->open(uri); !status) return status.error();
  return std::unique_ptr<DepthSource>(std::move(source));
}

Result<RawStream> open_realsense_camera(const CameraUri& uri, const CameraOpening&) {
  if (const Status status = uri.check_extras({"preset"}); !status) return status.error();
  const bool is_file = uri.target.ends_with(".db3") || uri.target.ends_with(".bag");
  std::error_code ignored;
  if (is_file && !std::filesystem::is_regular_file(uri.target, ignored)) {
    return Error{Errc::not_found, "no such file: " + uri.target + "; check its name"};
  }
  const Result<Api>& loaded = api();
  if (!loaded) return loaded.error();
  Device* device = nullptr;
  if (is_file) {
    Check check(*loaded);
    device = loaded->add_file(loaded->context, uri.target.c_str(), check);
    if (!check.is_fine() || device == nullptr) {
      return Error{Errc::bad_input, uri.target + " cannot be played: " + check.message()};
    }
  } else {
    for_each_device(*loaded, [&](Device* each) {
      const bool is_requested =
          device == nullptr &&
          (uri.target.empty() || info_of(*loaded, each, kSerial) == uri.target);
      if (is_requested) device = each;
      return is_requested;
    });
    if (device == nullptr) {
      return Error{Errc::not_found,
                   loaded->path + " sees no camera" +
                       (uri.target.empty() ? "" : " with the serial number " + uri.target) +
                       "; plug it in, and see that you may use it (udev rules of librealsense2)"};
    }
  }
  auto source = realsense::open_device(device, uri, is_file ? uri.target : "");
  if (!source) return source.error();
  return RawStream{*std::move(source)};
}

FoundCameras find_realsense_cameras() {
  const Result<Api>& loaded = api();
  FoundCameras found = found_by(loaded);
  if (!loaded) return found;
  found.version = dotted_version(loaded->version_number);
  std::vector<std::string> models;
  for_each_device(*loaded, [&](const Device* device) {
    models.push_back(info_of(*loaded, device, kName));
    found.devices.push_back("realsense:" + info_of(*loaded, device, kSerial));
    return false;
  });
  found.reason = found.devices.empty()
                     ? "no camera is plugged in; recordings can be played"
                     : listed_models(models, "RealSense cameras") + "; recordings";
  return found;
}

}}  // namespace palpate::v0
