// 3D Systems (Geomagic, SensAble) devices: OpenHaptics calls back from a thread of its own.

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include "palpate/devices/devices.h"
#include "src/core/internal/bounded_call.h"
#include "src/core/internal/guarded.h"
#include "src/devices/device_kinds.h"
#include "src/devices/open_haptics/open_haptics_api.h"
#include "src/devices/open_haptics/open_haptics_servo.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::string_view kKind = "openhaptics";
constexpr const char* kInstall =
    "install OpenHaptics and the Touch driver of 3D Systems, and set OH_SDK_BASE to its folder if "
    "libHD.so is not where the loader looks";
constexpr const char* kConnect =
    "connect it, give it its name with Touch_Setup, allow its use (a udev rule for its ttyACM or "
    "hidraw file) and try it with Touch_Diagnostic";
constexpr double kMetersPerMillimeter = 1e-3, kNewtonsPerMillinewton = 1e-3;
constexpr int kPatience = 500;  // ms
constexpr double kOpenPatience = 25, kStartPatience = 10, kStopPatience = 2,
                 kCutPatience = 0.25;  // s

/// There is one scheduler for all devices of a program.
std::atomic<int> g_num_running{0};

std::string text(const char* said) { return said == nullptr ? "" : said; }

std::string what_it_said(const OpenHapticsApi& api, const HdErrorInfo& error) {
  std::array<char, 40> codes{};
  std::snprintf(codes.data(), codes.size(), " (0x%04X, internal %d)", error.code,
                error.internal_code);
  return text(api.hdGetErrorString(error.code)) + codes.data();
}

/// One positive number, or `otherwise` when the driver does not know or names more than `most`,
/// which no device can do.
double requested(const OpenHapticsApi& api, HdEnum what, double unit, double otherwise,
                 double most) {
  double value = 0;
  api.hdGetDoublev(what, &value);
  value *= unit;
  return api.take_errors().code == 0 && value > 0 && value <= most ? value : otherwise;
}

int requested_integer(const OpenHapticsApi& api, HdEnum what) {
  int value = 0;
  api.hdGetIntegerv(what, &value);
  return api.take_errors().code == 0 ? value : 0;
}

/// Limits that the driver reports, and those of the weakest device for the others.
DeviceLimits driver_limits(const OpenHapticsApi& api) {
  DeviceLimits limits = find_device_model("touch").value_or(device_models().front()).limits;
  limits.max_force = requested(api, kHdMaxForce, 1, limits.max_force, 100);
  limits.max_stiffness =
      requested(api, kHdMaxStiffness, 1 / kMetersPerMillimeter, limits.max_stiffness, 1e5);
  limits.max_damping =
      requested(api, kHdMaxDamping, 1 / kMetersPerMillimeter, limits.max_damping, 1e3);
  if (requested_integer(api, kHdOutputDof) >= 6) {
    limits.max_torque = requested(api, kHdMaxTorque, kNewtonsPerMillinewton, 0, 10);
    limits.max_angular_stiffness =
        requested(api, kHdMaxTorqueStiffness, kNewtonsPerMillinewton, 0, 1e3);
  }
  limits.damping = assumed_damping(limits.max_stiffness);
  limits.angular_damping = assumed_damping(limits.max_angular_stiffness);
  double box[6] = {};  // least x, y, z; largest
  api.hdGetDoublev(kHdUsableWorkspace, box);
  const double diameter = std::min({box[3] - box[0], box[4] - box[1], box[5] - box[2]});
  const double radius = diameter / 2 * kMetersPerMillimeter;
  if (api.take_errors().code == 0 && radius > 0 && radius < 10) limits.workspace_radius = radius;
  return limits;
}

/// Errors: it needs a hand.
Status calibrate(const OpenHapticsApi& api, const std::string& name) {
  HdEnum answer = api.hdCheckCalibration();
  const int styles = requested_integer(api, kHdCalibrationStyle);
  if (answer == kHdCalibrationNeedsUpdate) {
    if (styles & kHdCalibrateInInkwell)
      api.hdUpdateCalibration(kHdCalibrateInInkwell);
    else if (styles & kHdCalibrateByMoving)
      api.hdUpdateCalibration(kHdCalibrateByMoving);
    answer = api.hdCheckCalibration();
  }
  api.take_errors();
  if (answer == kHdCalibrationOk) return Done{};
  return Error{Errc::unavailable,
               name + " is not calibrated: " +
                   (styles & kHdCalibrateInInkwell
                        ? "put its stylus into the inkwell, wait a moment and try again"
                        : "calibrate it with Touch_Setup or Touch_Diagnostic and try again")};
}

/// Opens, starts, stops and closes all devices.
LibraryThread& driver() {
  static LibraryThread& thread = *new LibraryThread;
  return thread;
}

/// Waits until `is_so`, but not for ever. Counts its own rounds: while the whole process stands
/// still, nobody hangs.
template <class Condition>
bool wait_for(Condition is_so) {
  for (int left = kPatience; !is_so(); --left) {
    if (left == 0) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

class OpenHapticsDevice final : public HapticDevice {
 public:
  /// Takes the device, which is the current one.
  OpenHapticsDevice(const OpenHapticsApi& api, HdHandle device, std::string_view name)
      : api_(api), device_(device) {
    info_.kind = kKind;
    info_.name = text(api_.hdGetString(kHdModelType)) + " " +
                 text(api_.hdGetString(kHdSerialNumber)) + ", " +
                 (name.empty() ? "the default device" : "'" + std::string(name) + "'");
    info_.limits = driver_limits(api_);
    info_.senses_orientation = requested_integer(api_, kHdInputDof) >= 6;
    info_.num_buttons = 2;
    api_.take_errors();
  }

  ~OpenHapticsDevice() override {
    stop();
    // A driver that hangs somewhere would make this hang, too.
    if (!is_stuck_)
      driver().returns_within(kStopPatience,
                              [api = api_, device = device_] { api.hdDisableDevice(device); });
  }

  const DeviceInfo& info() const override { return info_; }

  Status start(DeviceTick tick) override {
    stop();
    if (is_stuck_) return stuck();
    const auto servo = std::make_shared<OpenHapticsServo>(api_, device_, info_, std::move(tick));
    set_servo(servo);
    const auto error = std::make_shared<HdErrorInfo>();
    is_running_ = driver().returns_within(
        kStartPatience,
        [api = api_, device = device_, servo, error] { *error = schedule(api, device, servo); });
    if (!is_running_) {
      give_up();
      return stuck();
    }
    if (error->code != 0) {
      is_running_ = false;
      set_servo(nullptr);
      return Error{Errc::io_failure,
                   info_.name + " does not start: " + what_it_said(api_, *error) + "; " + kConnect};
    }
    if (wait_for([&] { return servo->last_time() > 0; })) return Done{};
    stop();
    return stuck();
  }

  void stop() noexcept override {
    if (!is_running_) return;
    const auto servo = this->servo();
    servo->request_end();
    bool is_off = false;
    if (wait_for([&] { return servo->has_ended(); })) {
      const auto end_here = [&] {
        is_off = driver().returns_within(kStopPatience, [api = api_, device = device_, servo] {
          if (--g_num_running == 0) api.hdStopScheduler();
          motors_off(api, device);
        });
      };
      guarded(end_here, [](const Error&) {});
    } else {
      --g_num_running;  // a scheduler that hangs is never stopped
    }
    is_running_ = false;
    if (!is_off) give_up();
  }

  Status status() const override {
    if (is_stuck_) return stuck();
    const auto servo = this->servo();
    if (servo == nullptr) return Done{};
    if (const HdEnum code = servo->failure(); code != 0) {
      return Error{
          Errc::io_failure,
          info_.name + (is_force_error(code)
                            ? " has stopped its force: " + what_it_said(api_, {code, 0, 0}) +
                                  "; let its motors cool down and start again"
                            : " has stopped: " + what_it_said(api_, {code, 0, 0}) +
                                  "; check its cable and power and start again")};
    }
    return Done{};
  }

 private:
  /// Schedules the servo. Returns the error; then, or if it was given up meanwhile, unschedules it.
  static HdErrorInfo schedule(const OpenHapticsApi& api, HdHandle device,
                              const std::shared_ptr<OpenHapticsServo>& servo) noexcept {
    api.hdMakeCurrentDevice(device);
    api.take_errors();
    for (const HdEnum capability :
         {kHdMaxForceClamping, kHdSoftwareForceLimit, kHdForceRamping, kHdForceOutput})
      api.hdEnable(capability);
    const HdScheduled scheduled =
        api.hdScheduleAsynchronous(&OpenHapticsServo::call_back, servo.get(), kHdMaxPriority);
    if (g_num_running++ == 0) api.hdStartScheduler();
    const HdErrorInfo error = api.take_errors();
    if (error.code == 0 && !servo->is_given_up()) return error;
    // Its last call sends no force.
    const bool is_idle = error.code != 0 || wait_for([&] { return servo->has_ended(); });
    if (--g_num_running == 0) api.hdStopScheduler();
    api.hdUnschedule(scheduled);
    motors_off(api, device);
    if (is_idle) servo->end();
    return error;
  }

  /// Gives up a driver that hangs. Should it return one day, it must still find the servo.
  void give_up() noexcept {
    is_stuck_ = true;
    const auto servo = this->servo();
    servo->give_up(servo);
    // Another thread tries, as it may hang, too.
    const auto cut = [this] {
      returns_within(kCutPatience, [api = api_, device = device_] { motors_off(api, device); });
    };
    guarded(cut, [](const Error&) {});
  }

  /// Returns the servo of the last start. Locked: the loop queries the status meanwhile.
  std::shared_ptr<OpenHapticsServo> servo() const {
    const std::lock_guard lock(mutex_);
    return servo_;
  }
  void set_servo(std::shared_ptr<OpenHapticsServo> servo) {
    const std::lock_guard lock(mutex_);
    servo_ = std::move(servo);
  }

  static void motors_off(const OpenHapticsApi& api, HdHandle device) noexcept {
    api.hdMakeCurrentDevice(device);
    api.hdDisable(kHdForceOutput);
    api.take_errors();
  }

  Error stuck() const {
    return Error{Errc::io_failure, info_.name +
                                       ": the driver does not call back; end this program, switch "
                                       "the device off and on, and start again"};
  }

  const OpenHapticsApi api_;
  const HdHandle device_;
  DeviceInfo info_;
  mutable std::mutex mutex_;
  std::shared_ptr<OpenHapticsServo> servo_;  // of the last start
  std::atomic<bool> is_running_ = false, is_stuck_ = false;
};

Result<std::unique_ptr<HapticDevice>> open_named(const std::string& name) {
  const Result<OpenHapticsApi> api = load_open_haptics();
  if (!api) return Error{api.error().code, api.error().message + "; " + kInstall};
  api->take_errors();
  const HdHandle handle = api->hdInitDevice(name.empty() ? nullptr : name.c_str());
  const HdErrorInfo error = api->take_errors();
  if (error.code != 0 || handle == kHdNoDevice) {
    const std::string which = name.empty() ? "the default device" : "the device '" + name + "'";
    if (error.code == kHdAlreadyInitiated) {
      return Error{Errc::io_failure,
                   "OpenHaptics says that " + which +
                       " is in use already: end the other program; if one crashed, unplug the "
                       "device and plug it in again"};
    }
    return Error{Errc::not_found, "OpenHaptics does not find " + which + ": " +
                                      what_it_said(*api, error) + "; " + kConnect};
  }
  api->hdMakeCurrentDevice(handle);
  auto device = std::make_unique<OpenHapticsDevice>(*api, handle, name);
  if (const Status calibrated = calibrate(*api, device->info().name); !calibrated)
    return calibrated.error();
  return std::unique_ptr<HapticDevice>(std::move(device));
}

}  // namespace

Result<std::unique_ptr<HapticDevice>> open_open_haptics_device(std::string_view address) {
  const auto opened = std::make_shared<std::optional<Result<std::unique_ptr<HapticDevice>>>>();
  if (driver().returns_within(
          kOpenPatience, [opened, name = std::string(address)] { *opened = open_named(name); })) {
    return *std::move(*opened);
  }
  return Error{Errc::unavailable,
               "the driver of OpenHaptics does not return while the device is opened; switch the "
               "device off and on, end other programs that use it, and try again"};
}

/// A device of OpenHaptics is claimed by opening it, so it is not opened here.
FoundDevice find_open_haptics_device() {
  FoundDevice found{std::string(kKind), std::string(kKind), false, "", ""};
  const Result<OpenHapticsApi> api = load_open_haptics();
  found.is_usable = api.has_value();
  if (found.is_usable) {
    found.what = "OpenHaptics in " + api->path +
                 "; whether its default device is connected shows "
                 "when it is opened";
  } else {
    found.what = api.error().message;
    found.hint = kInstall;
  }
  return found;
}

}}  // namespace palpate::v0
