// Force Dimension devices (omega, delta, sigma, lambda, Novint Falcon): polled by our own timer.

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "palpate/devices/devices.h"
#include "src/core/internal/bounded_call.h"
#include "src/devices/device_kinds.h"
#include "src/devices/device_pose.h"
#include "src/devices/force_dimension/force_dimension_api.h"
#include "src/devices/internal/polling_device.h"
#include "src/devices/motor_wrench.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::string_view kKind = "forcedimension";
constexpr const char* kInstall =
    "install the Force Dimension SDK 3.7 or newer and set FDSDK to its folder";
constexpr const char* kConnect =
    "connect it, switch it on and allow its use (a udev rule for USB vendor 1451, for a Falcon "
    "0403:cb48)";
constexpr int kMaxSilentTicks = 20;
constexpr int kStatusPeriod = 10;  // ticks
constexpr int kMaxForceOffs = 25;  // looks at the status: 0.25 s
constexpr int kMaxDeviceNumber = 126;
constexpr double kClosePatience = 2;  // s

/// The SDK has x towards the hand, y to the right and z up, with the origin in the middle, for a
/// Falcon, too. So H3D's HAPI reads dhdGetPosition(&z, &x, &y) and writes dhdSetForceAndTorque(z,
/// x, y) for x right, y up, z to the viewer, and CHAI3D, with x to the viewer and z up, takes the
/// numbers as they are.
constexpr MakerAxes kSdkAxes{2, 3, 1};

/// Model of a system type (dhdc.h); the weakest device for the ones that are not listed.
DeviceModel model_of(int system_type) {
  std::string_view key = "falcon";
  switch (system_type) {
    case 33: key = "omega.3"; break;
    case 34:
    case 36: key = "omega.6"; break;
    case 35:
    case 37: key = "omega.7"; break;
    case 63:
    case 64: key = "delta.3"; break;
    case 104:
    case 105:
    case 206: key = "sigma.7"; break;
    case 108:
    case 109:
    case 131:
    case 132: key = "lambda.7"; break;
    default: break;
  }
  return find_device_model(key).value_or(device_models().front());
}

const char* describe_force_off(int cause) {
  switch (cause) {
    case 1: return "its force button was pressed; start again when the hand is ready";
    case 2: return "the hand was faster than its velocity limit; move more slowly and start again";
    case 3: return "this computer left its watchdog waiting; end other programs and start again";
    case 4: return "a program switched it off; close other programs that use it and start again";
    case 5: return "the USB connection broke off; check the cable and start again";
    case 6: return "its dead-man switch was let go; hold the handle and start again";
    default: return "it does not say why; press its force button and start again";
  }
}

std::string text(const char* said) { return said == nullptr ? "" : said; }

class ForceDimensionDevice final : public PolledDevice {
 public:
  /// Takes the open device `id`.
  ForceDimensionDevice(ForceDimensionApi api, char id) : api_(std::move(api)), id_(id) {
    has_wrist_ = api_.dhdHasWrist(id_);
    info_.kind = kKind;
    info_.name =
        "Force Dimension " + text(api_.dhdGetSystemName(id_)) + ", number " + std::to_string(id_);
    info_.limits = model_of(api_.dhdGetSystemType(id_)).limits;
    if (!api_.dhdHasActiveWrist(id_)) {
      info_.limits.max_torque = info_.limits.max_angular_stiffness = 0;
    }
    info_.senses_orientation = has_wrist_;
    info_.num_buttons = 1;
  }
  ~ForceDimensionDevice() override {
    returns_within(kClosePatience, [api = api_, id = id_] { api.drdClose(id); });
  }

  Status begin() override {
    num_silent_ = num_force_offs_ = 0;
    num_ticks_ = 0;
    ramp_.restart();
    is_force_on_ = false;
    has_lost_force_ = false;
    const bool has_torque = info_.limits.max_torque > 0;
    const bool is_ready =
        (api_.dhdSetMaxForce == nullptr || api_.dhdSetMaxForce(info_.limits.max_force, id_) >= 0) &&
        (api_.dhdSetMaxTorque == nullptr || !has_torque ||
         api_.dhdSetMaxTorque(info_.limits.max_torque, id_) >= 0) &&
        send({}) && api_.dhdEnableForce(1, id_) >= 0;
    if (!is_ready) {
      remember_what_was_said();
      end();
      return Error{Errc::io_failure, info_.name + " does not take forces: " + said_.data() +
                                         "; switch it off and on and try again"};
    }
    api_.dhdSetGravityCompensation(1, id_);  // not every device has it
    return Done{};
  }

  bool read(DeviceState& state) noexcept override {
    is_answering_ = true;
    state.has_force = false;
    double matrix[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    Vec3d p, v, w;
    const bool has_answered =
        api_.dhdGetPositionAndOrientationFrame(&p.x, &p.y, &p.z, matrix, id_) >= 0 &&
        api_.dhdGetLinearVelocity(&v.x, &v.y, &v.z, id_) >= 0 &&
        (!has_wrist_ || api_.dhdGetAngularVelocityRad(&w.x, &w.y, &w.z, id_) >= 0);
    Pose X_BH{kSdkAxes.in_base(p), {}};
    Mat3d R = rotation_matrix({});
    if (has_wrist_) {
      std::memcpy(R.m, matrix, sizeof matrix);
      X_BH.rotation = kSdkAxes.in_base(quaternion_of(R));
    }
    state.is_valid =
        has_answered && is_possible(X_BH) && is_rotation(R) && std::isfinite(norm(v) + norm(w));
    if (!state.is_valid) {
      const bool is_there = is_still_there();
      state.has_force = has_force() && ramp_.is_full();
      return is_there;
    }
    state.X_BH = X_BH;
    state.V_BH = kSdkAxes.in_base(Twist{v, w});
    state.buttons = api_.dhdGetButtonMask(id_);
    if (num_ticks_++ % kStatusPeriod == 0 && !watch_force()) return false;
    state.has_force = has_force() && ramp_.is_full();
    return true;
  }

  bool write(const Wrench& F_H_B) noexcept override {
    const double share = ramp_.next(has_force());
    if (send(motor_wrench({share * F_H_B.force, share * F_H_B.torque}, info_.limits))) {
      if (is_answering_) num_silent_ = 0;
      return true;
    }
    return is_still_there();
  }

  void end() noexcept override {
    send({});
    api_.dhdEnableForce(0, id_);
  }

  void cut_force() noexcept override { api_.dhdEnableForce(0, id_); }

  Error trouble() const override {
    if (has_lost_force_) {
      return Error{Errc::unavailable,
                   info_.name + " has shut its force off: " + describe_force_off(force_off_cause_)};
    }
    return Error{Errc::io_failure, info_.name + " has stopped answering: " + said_.data() +
                                       "; check its cable and power and start again"};
  }

 private:
  /// False while the force is off or calls fail in a row; one failure leaves the last wrench on.
  bool has_force() const noexcept { return is_force_on_ && num_silent_ <= kPatientTicks; }

  bool send(const Wrench& F_H_B) noexcept {
    const auto [force, torque] = kSdkAxes.of_maker(F_H_B);
    return api_.dhdSetForceAndTorqueAndGripperForce(force.x, force.y, force.z, torque.x, torque.y,
                                                    torque.z, 0, id_) >= 0;
  }

  /// Counts failed ticks. Several in a row mean that the device is lost; then returns false.
  bool is_still_there() noexcept {
    const bool is_first = std::exchange(is_answering_, false);  // of this tick
    if (is_first && ++num_silent_ == 1) remember_what_was_said();
    return num_silent_ < kMaxSilentTicks;
  }

  /// The device shuts its force off by itself to protect the hand. While it does, nothing is sent,
  /// or it would come with a jump; when it stays off, so do we.
  bool watch_force() noexcept {
    std::array<int, kDhdStatusCapacity> status{};
    const bool has_answered = api_.dhdGetStatus(status.data(), id_) >= 0;
    if (has_answered) {
      is_force_on_ = status[kDhdStatusForce] != 0;
    } else {  // one time leaves it as it was
      remember_what_was_said();
      is_force_on_ = is_force_on_ && num_force_offs_ == 0;
    }
    num_force_offs_ = has_answered && is_force_on_ ? 0 : num_force_offs_ + 1;
    if (num_force_offs_ <= kMaxForceOffs) return true;
    has_lost_force_ = has_answered;
    force_off_cause_ = status[kDhdStatusForceOffCause];
    return false;
  }

  void remember_what_was_said() noexcept {
    const char* said = api_.dhdErrorGetLastStr();
    std::strncpy(said_.data(), said == nullptr ? "" : said, said_.size() - 1);
  }

  ForceDimensionApi api_;
  char id_;
  bool has_wrist_ = false;
  std::array<char, 160> said_{};
  MotorRamp ramp_;
  int num_silent_ = 0, num_force_offs_ = 0, force_off_cause_ = 0;
  unsigned num_ticks_ = 0;
  bool is_answering_ = true;  // at this tick so far
  bool is_force_on_ = false, has_lost_force_ = false;
};

/// The number after the colon; -1 if it is left open.
Result<int> device_number(std::string_view address) {
  if (address.empty()) return -1;
  int number = 0;
  const char* end = address.data() + address.size();
  const auto [rest, error] = std::from_chars(address.data(), end, number);
  if (error != std::errc{} || rest != end || number < 0 || number > kMaxDeviceNumber) {
    return Error{Errc::invalid_argument,
                 "'" + std::string(address) +
                     "' is not the number of a Force Dimension device; write "
                     "forcedimension:0 for the first one"};
  }
  return number;
}

std::string number_of_devices(int count) {
  return std::to_string(count) + (count == 1 ? " device" : " devices");
}

}  // namespace

Result<std::unique_ptr<HapticDevice>> open_force_dimension_device(std::string_view address) {
  const Result<int> desired = device_number(address);
  if (!desired) return desired.error();
  const Result<ForceDimensionApi> api = load_force_dimension();
  if (!api) return Error{api.error().code, api.error().message + "; " + kInstall};
  const int count = std::clamp(api->dhdGetDeviceCount(), 0, kMaxDeviceNumber + 1);
  if (count == 0 || *desired >= count) {
    return Error{Errc::not_found, "no Force Dimension device " +
                                      (*desired < 0 ? "is there" : std::to_string(*desired)) +
                                      ": the SDK " + api->version + " sees " +
                                      number_of_devices(count) + "; " + kConnect};
  }
  int id = -1;
  if (*desired >= 0) {
    id = api->drdOpenID(static_cast<char>(*desired));
  } else {
    for (int i = 0; i < count && id < 0; ++i) id = api->drdOpenID(static_cast<char>(i));
  }
  if (id < 0) {
    return Error{Errc::io_failure,
                 "the Force Dimension device cannot be opened: " + text(api->dhdErrorGetLastStr()) +
                     "; end other programs that use it, or " + kConnect};
  }
  auto device = std::make_unique<ForceDimensionDevice>(*api, static_cast<char>(id));
  if (!api->drdIsInitialized(static_cast<char>(id))) {
    return Error{Errc::unavailable,
                 device->info().name +
                     " does not know yet where its handle is, and Palpate does not move a device "
                     "by itself: rest the handle in its calibration pit until the light stops "
                     "blinking, or run HapticInit of the SDK, which moves the device, and try "
                     "again"};
  }
  return std::unique_ptr<HapticDevice>(std::make_unique<PollingDevice>(std::move(device)));
}

FoundDevice find_force_dimension_device() {
  FoundDevice found{std::string(kKind), std::string(kKind), false, "", ""};
  const Result<ForceDimensionApi> api = load_force_dimension();
  if (!api) {
    found.what = api.error().message;
    found.hint = std::string(kInstall) + "; then " + kConnect;
    return found;
  }
  const int count = std::max(api->dhdGetDeviceCount(), 0);
  const int num_free = std::clamp(api->dhdGetAvailableCount(), 0, count);
  found.is_usable = num_free > 0;
  found.what = number_of_devices(count) + ", " + std::to_string(num_free) + " free, by SDK " +
               api->version + " in " + api->path;
  if (count == 0)
    found.hint = kConnect;
  else if (num_free == 0)
    found.hint = "end the program that uses it";
  return found;
}

}}  // namespace palpate::v0
