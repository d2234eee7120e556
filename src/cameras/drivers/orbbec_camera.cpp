// Orbbec cameras (Gemini, Femto, Astra 2) by version 2 of the Orbbec SDK.
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/drivers/orbbec_api.h"
#include "src/cameras/stream/raw_frames.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace {

using namespace orbbec;

/// The library reports errors through a last argument.
class Check {
 public:
  ~Check() { forget(); }
  operator Failure**() {
    forget();
    return &error_;
  }
  bool is_fine() const { return error_ == nullptr; }
  std::string message() const { return error_ == nullptr ? "" : api()->message(error_); }

 private:
  void forget() {
    if (error_ != nullptr) api()->delete_error(std::exchange(error_, nullptr));
  }
  Failure* error_ = nullptr;
};

/// Every object is deleted by a function of its own.
template <class Object>
using Owned = std::unique_ptr<Object, std::function<void(Object*)>>;
template <class Object, class Kind>
Owned<Object> own(Object* object, void (*remove)(Kind*, Failure**)) {
  return Owned<Object>(object, [remove](Object* old) { remove(old, Check()); });
}

class OrbbecSource final : public MakersSource {
 public:
  explicit OrbbecSource(const Api& api) : api_(api) {}
  ~OrbbecSource() override {
    if (is_started_) api_.stop(pipeline_.get(), Check());
  }

  Status open(const CameraUri& uri, Device* device, SensorKind sensor) {
    info_.name = uri.target.empty() ? "orbbec" : "orbbec:" + uri.target;
    info_.is_live = true;
    info_.sensor = sensor;
    device_ = own(device, api_.delete_device);
    Check check;
    pipeline_ = own(api_.create_pipeline(device, check), api_.delete_pipeline);
    if (!pipeline_) return failed("cannot be opened", check);
    const auto profiles =
        own(api_.profiles(pipeline_.get(), kDepthSensor, check), api_.delete_profiles);
    if (!profiles) return failed("has no depth", check);
    const auto config = own(api_.create_config(check), api_.delete_config);
    if (const Status status = choose_profile(uri, *profiles, config.get()); !status) return status;
    if (has_unknown_lens_ && !uri.distortion) notes_.add(kUnknownLens);
    api_.start(pipeline_.get(), config.get(), check);
    if (!check.is_fine()) return failed("does not start", check);
    is_started_ = true;
    return Done{};
  }

  Result<bool> next(DepthFrame& frame) override {
    const double begin = monotonic_now();
    while (!is_cancelled_) {
      Check check;
      const auto frames =
          own(api_.wait(pipeline_.get(), unsigned{kWaitMilliseconds}, check), api_.delete_frame);
      if (!check.is_fine()) return failed("has been lost", check).error();
      const auto depth =
          own(frames ? api_.depth_of(frames.get(), check) : nullptr, api_.delete_frame);
      if (depth) {
        const Status copied = copy(depth.get(), frame);
        if (!copied) return copied.error();
        return true;
      }
      if (const Status status = check_silence(begin); !status) return status.error();
    }
    return false;
  }

 private:
  Status failed(const char* what, const Check& check) const {
    const std::string why = check.message();
    return Error{Errc::unavailable, info_.name + " " + what + (why.empty() ? "" : ": " + why)};
  }

  Status choose_profile(const CameraUri& uri, const ProfileList& list, Config* config) {
    std::vector<Owned<Profile>> profiles;
    std::vector<ImageMode> modes;
    const int num = static_cast<int>(api_.profile_count(&list, Check()));
    for (int i = 0; i < num; ++i) {
      auto profile = own(api_.profile(&list, i, Check()), api_.delete_profile);
      if (!profile) continue;
      const int format = api_.format(profile.get(), Check());
      if (format != kY16 && format != kZ16) continue;
      modes.push_back({static_cast<int>(api_.profile_width(profile.get(), Check())),
                       static_cast<int>(api_.profile_height(profile.get(), Check())),
                       static_cast<int>(api_.rate(profile.get(), Check()))});
      profiles.push_back(std::move(profile));
    }
    const auto best = choose_mode(modes, uri, {848, 576});
    if (!best) {
      return Error{Errc::invalid_argument,
                   info_.name + " has no such depth mode; it has " + listed(modes)};
    }
    set_camera(*profiles[*best], modes[*best].width, modes[*best].height);
    info_.rate = uri.rate.value_or(modes[*best].rate > 0 ? modes[*best].rate : 30);
    Check check;
    api_.enable(config, profiles[*best].get(), check);
    return check.is_fine() ? Status(Done{}) : failed("refuses its mode", check);
  }

  void set_camera(const Profile& profile, int width, int height) {
    info_.width = width;
    info_.height = height;
    Check check;
    const CameraIntrinsic camera = api_.intrinsic(&profile, check);
    if (!check.is_fine() || !(camera.fx > 0)) return;  // the URI may have them
    const auto d = [](float value) { return static_cast<double>(value); };
    info_.intrinsics = {d(camera.fx), d(camera.fy), d(camera.cx), d(camera.cy)};
    scale_camera({camera.width, camera.height}, info_);
    const CameraDistortion bent = api_.distortion(&profile, check);
    info_.distortion = {};
    const bool is_known = bent.model == kBrownConrady || bent.model == kBrownConrady6;
    const bool is_bent = (bent.k1 != 0 || bent.k2 != 0 || bent.p1 != 0 || bent.p2 != 0);
    has_unknown_lens_ = check.is_fine() && is_bent && !is_known && bent.model != kNoDistortion;
    if (!check.is_fine() || !is_known) return;
    info_.distortion = {d(bent.k1), d(bent.k2), d(bent.p1), d(bent.p2),
                        d(bent.k3), d(bent.k4), d(bent.k5), d(bent.k6)};
  }

  Status copy(const Frame* raw, DepthFrame& frame) {
    Check check;
    const int width = static_cast<int>(api_.width(raw, check));
    const int height = static_cast<int>(api_.height(raw, check));
    const void* const data = api_.data(raw, check);
    const std::size_t num_bytes = api_.num_bytes(raw, check);
    if (data == nullptr || width < 1 || height < 1 || width > kMaxImageWidth ||
        height > kMaxImageHeight ||
        num_bytes < 2 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {
      return failed("gives a damaged frame", check);
    }
    if (width != info_.width || height != info_.height) {
      const auto profile = own(api_.profile_of(raw, check), api_.delete_profile);
      if (profile) set_camera(*profile, width, height);
    }
    // Reported in single precision: 0.1 is meant.
    const auto scale = static_cast<double>(api_.millimeters(raw, check));
    if (scale > 0) info_.unit = std::round(scale * 1e6) * 1e-9;
    frame.unit = info_.unit;
    frame.timestamp = 1e-6 * static_cast<double>(api_.microseconds(raw, check));
    copy_rows(data, 2 * static_cast<std::ptrdiff_t>(width), width, height, frame);
    return Done{};
  }

  const Api& api_;
  Owned<Device> device_;
  Owned<Pipeline> pipeline_;
  bool is_started_ = false, has_unknown_lens_ = false;
};

/// The cameras; `visit` is called with the list and the serial number and place of each.
template <class Visit>
void for_each_device(const Api& api, const Visit& visit) {
  Check check;
  const auto list = own(api.query_devices(api.context, check), api.delete_list);
  const std::uint32_t num = list ? api.device_count(list.get(), check) : 0;
  for (std::uint32_t i = 0; i < num; ++i) {
    const char* const serial = api.serial_number(list.get(), i, check);
    visit(*list, serial == nullptr ? "" : std::string(serial), i);
  }
}

}  // namespace

Result<RawStream> open_orbbec_camera(const CameraUri& uri, const CameraOpening&) {
  if (const Status status = uri.check_extras(); !status) return status.error();
  const Result<Api>& loaded = api();
  if (!loaded) return loaded.error();
  Device* device = nullptr;
  SensorKind sensor = SensorKind::none;
  std::string why;
  for_each_device(*loaded, [&](const DeviceList& list, const std::string& serial, std::uint32_t i) {
    if (device != nullptr || (!uri.target.empty() && serial != uri.target)) return;
    Check check;
    device = loaded->device(&list, i, check);
    why = check.message();
    const char* const name = loaded->name(&list, i, check);
    if (name != nullptr) sensor = sensor_of_model(name);
  });
  if (device == nullptr) {
    return Error{Errc::not_found,
                 loaded->path + " sees no camera" +
                     (uri.target.empty() ? "" : " with the serial number " + uri.target) +
                     (why.empty() ? "" : " that can be opened (" + why + ")") +
                     "; plug it in, and see that you may use it (udev rules of the Orbbec SDK)"};
  }
  auto source = std::make_unique<OrbbecSource>(*loaded);
  if (const Status status = source->open(uri, device, sensor); !status) return status.error();
  return RawStream{std::move(source)};
}

FoundCameras find_orbbec_cameras() {
  const Result<Api>& loaded = api();
  FoundCameras found = found_by(loaded);
  if (!loaded) return found;
  found.version = dotted_version(loaded->version_number);
  std::vector<std::string> models;
  for_each_device(*loaded, [&](const DeviceList& list, const std::string& serial, std::uint32_t i) {
    const char* const name = loaded->name(&list, i, Check());
    models.emplace_back(name == nullptr ? "" : name);
    found.devices.push_back("orbbec:" + serial);
  });
  found.reason = found.devices.empty()
                     ? "no camera is plugged in"
                     : listed_models(models, "Gemini, Femto, Astra 2 and others of Orbbec");
  return found;
}

}}  // namespace palpate::v0
