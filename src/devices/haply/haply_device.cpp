// The service answers every message with one state and forgets a force when the next message does
// not repeat it. So each round reads the answer to the last round's message, requests the wrench,
// and sends it; nothing waits, and an answer that is late just has not come yet.

#include "src/devices/haply/haply_device.h"

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "palpate/devices/devices.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/devices/device_kinds.h"
#include "src/devices/device_pose.h"
#include "src/devices/haply/haply_messages.h"
#include "src/devices/haply/haply_service.h"
#include "src/devices/internal/polling_device.h"
#include "src/devices/motor_wrench.h"
#include "src/devices/transport/web_socket.h"

namespace palpate { inline namespace v0 {
namespace {

// A service that stands still for a moment goes on; the loop takes the force away much sooner.
constexpr double kMaxSilence = 1;  // s without a usable state: lost
constexpr int kMaxMessages = 64;   // of one tick: more must wait for the next
constexpr HaplyVersion kSaysVector{3, 5};

// The service returns a force that it has understood in its states. One that is above this size
// and has not come back for this many ticks was sent under the wrong key.
constexpr double kConfirmableForce = 0.05;  // N
constexpr int kPatience = 50;               // ticks

/// The service has x to the right, y away from the hand and z up, if no session asks for another
/// basis (docs.haply.co, inverseSDK/service/commons/basis), and we do not.
constexpr MakerAxes kServiceAxes{1, 3, -2};

/// The middle of the workspace from the device's base, which is the origin by default
/// (center_workspace in the examples of Haply's HardwareAPI), in the service's axes, m. The presets
/// "..._centered" have the origin in the middle themselves, and with those that turn or move the
/// device it is where the user has it (commons/mount-and-workspace).
constexpr Vec3d kMiddle{0.0186, -0.153, 0.151};
Vec3d middle_of(std::string_view preset) {
  const bool is_base = preset.empty() || preset == "defaults" || preset == "arm_front";
  return is_base ? kMiddle : Vec3d{};
}

bool is_usable(const Quaternion& q) {
  const double square = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
  return square > 0.25 && square < 4;
}

int num_buttons_of(HaplyKind grip) { return grip == HaplyKind::verse_grip ? 1 : 4; }

class HaplyDevice final : public PolledDevice {
 public:
  HaplyDevice(const HaplyAddress& address, HaplyInventory found)
      : address_(address), found_(std::move(found)) {
    const bool has_grip = !found_.grip_id.empty();
    info_.kind = "haply";
    info_.name = describe(found_, address_.service);
    info_.limits = find_device_model("inverse3")->limits;
    info_.limits.max_torque = info_.limits.max_angular_stiffness = 0;
    info_.senses_orientation = has_grip;
    info_.num_buttons = has_grip ? num_buttons_of(found_.grip_kind) : 0;
    request_.device_id = found_.device_id;
    request_.grip_kind = found_.grip_kind;
    request_.grip_id = found_.grip_id;
    text_.reserve(1024);
  }

  Status begin() override;
  bool read(DeviceState& state) noexcept override;
  bool write(const Wrench& F_H_B) noexcept override;
  void end() noexcept override;

 private:
  bool send(std::optional<Vec3d> force, double timeout) noexcept;
  bool take(std::string_view text, DeviceState& state) noexcept;
  bool take_grip(const HaplyMessage& message, DeviceState& state) noexcept;
  bool accepts_force(const HaplyEntry& arm) noexcept;
  bool is_well() noexcept;
  bool give_up(std::string_view why) noexcept;

  HaplyAddress address_;
  HaplyInventory found_;
  Vec3d middle_;  // of the workspace, in the service's frame
  HaplyRequest request_;
  std::optional<WebSocket> socket_, events_;
  HaplyMessage message_;
  std::string text_;

  bool is_waiting_ = false;                   // for the answer to our last message
  double last_answer_ = 0, last_usable_ = 0;  // s, when any and when a usable state came last
  bool is_calibrated_ = true, is_grip_connected_ = true;
  std::string_view unusable_;  // fault of the last state
  Quaternion orientation_;     // kept by states without the grip
  std::uint32_t buttons_ = 0;

  Vec3d sent_;
  bool is_force_confirmed_ = false, has_echo_ = false, uses_other_key_ = false,
       ignores_force_ = false;
  int num_unconfirmed_ = 0;
  MotorRamp ramp_;
};

Status HaplyDevice::begin() {
  end();
  Result<HaplyConnection> connected = connect_to_haply(address_.service, kHaplyAnswerTimeout);
  if (!connected) return connected.error();
  const HaplyEntry* arm = connected->inventory.find(HaplyKind::inverse3, found_.device_id);
  if (arm == nullptr) {
    return Error{Errc::not_found, "Inverse3 " + found_.device_id + " is no longer at " +
                                      haply_url(address_.service) +
                                      "; switch it on and open it again"};
  }
  middle_ = middle_of(arm->preset);
  socket_ = std::move(connected->socket);
  // Without the event socket the loop still notices that states end or forces are not taken.
  if (Result<WebSocket> events =
          WebSocket::connect({address_.service.host, address_.event_port}, kHaplyAnswerTimeout))
    events_ = std::move(*events);

  request_.force_key = found_.version.value_or(kSaysVector) < kSaysVector ? HaplyForceKey::values
                                                                          : HaplyForceKey::vector;
  request_.introduces_us = true;
  is_waiting_ = is_force_confirmed_ = has_echo_ = uses_other_key_ = ignores_force_ = false;
  is_calibrated_ = is_grip_connected_ = true;
  orientation_ = {};
  buttons_ = 0;
  sent_ = {};
  num_unconfirmed_ = 0;
  ramp_.restart();
  unusable_ = "it does not answer";

  // Requests without a force until there is a state to begin with.
  const double deadline = monotonic_now() + kHaplyAnswerTimeout;
  DeviceState state;
  std::string_view text;
  while (!state.is_valid && monotonic_now() < deadline) {
    if (!send(std::nullopt, kHaplyAnswerTimeout) ||
        socket_->receive(text, deadline - monotonic_now()) != WebSocket::Got::message)
      break;
    request_.introduces_us = false;
    is_waiting_ = false;
    state.is_valid = take(text, state);
  }
  if (!state.is_valid || !send(std::nullopt, kHaplyAnswerTimeout)) {
    const std::string message = info_.name + " reports no usable state: " + std::string(unusable_);
    end();
    return Error{Errc::unavailable, message};
  }
  last_answer_ = last_usable_ = monotonic_now();
  return Done{};
}

bool HaplyDevice::send(std::optional<Vec3d> force, double timeout) noexcept {
  request_.force = force;
  write_haply_request(request_, text_);
  is_waiting_ = true;
  return socket_->send(text_, timeout);
}

bool HaplyDevice::read(DeviceState& state) noexcept {
  state.is_valid = false;
  std::string_view text;
  for (int i = 0; i < kMaxMessages; ++i) {
    const WebSocket::Got got = socket_->receive(text, 0);
    if (got == WebSocket::Got::closed) return give_up("the service has closed the connection");
    if (got == WebSocket::Got::nothing) break;
    is_waiting_ = false;
    last_answer_ = state.time;
    state.is_valid = take(text, state);
    if (state.is_valid) last_usable_ = state.time;
  }
  state.has_force = ramp_.is_full();
  if (!is_well()) return false;
  if (state.time - last_usable_ <= kMaxSilence) return true;
  return give_up(state.time - last_answer_ > kMaxSilence ? "it has not answered for 1 s"
                                                         : unusable_);
}

/// True if the message holds a state that can be used.
bool HaplyDevice::take(std::string_view text, DeviceState& state) noexcept {
  const auto no = [this](std::string_view why) {
    unusable_ = why;
    return false;
  };
  if (!read_haply_message(text, message_)) return no("what it says cannot be read");
  const HaplyEntry* arm = message_.find(HaplyKind::inverse3, found_.device_id);
  if (arm == nullptr) return no("the Inverse3 is no longer connected to the service");
  is_calibrated_ = arm->is_calibrated.value_or(is_calibrated_);
  if (!is_calibrated_)
    return no(
        "the Inverse3 is not calibrated; put it into its calibration pose until its light "
        "says so");
  if (!take_grip(message_, state)) return no("the grip is not connected; wake it up or charge it");
  // A hand is never exactly at the origin: such a state has no position and is not used.
  const Vec3d p_BH = kServiceAxes.in_base(arm->position - middle_);
  if (!arm->has_state || !arm->has_position || !is_possible({p_BH, {}}) ||
      !is_finite(arm->velocity))
    return no("its states hold no position that a hand can have");
  state.X_BH.translation = p_BH;
  // The service measures no angular velocity.
  state.V_BH = {kServiceAxes.in_base(arm->velocity), {}};
  if (accepts_force(*arm)) return true;
  return no(
      "it does not take the forces sent; release the emergency brake, plug in the power "
      "supply, and update the service");
}

bool HaplyDevice::take_grip(const HaplyMessage& message, DeviceState& state) noexcept {
  if (found_.grip_id.empty()) return true;
  if (const HaplyEntry* grip = message.find(found_.grip_kind, found_.grip_id)) {
    is_grip_connected_ = grip->is_connected.value_or(is_grip_connected_);
    if (grip->has_state && is_usable(grip->orientation)) {
      orientation_ = kServiceAxes.in_base(normalized(grip->orientation));
      buttons_ = grip->buttons;
    }
  }
  state.X_BH.rotation = orientation_;
  state.buttons = buttons_;
  return is_grip_connected_;
}

bool HaplyDevice::accepts_force(const HaplyEntry& arm) noexcept {
  ramp_.next(true);
  has_echo_ = has_echo_ || arm.has_force;
  if (ignores_force_) return false;
  if (is_force_confirmed_ || norm(sent_) < kConfirmableForce) return true;
  is_force_confirmed_ = norm(arm.force) > 0.1 * norm(sent_);
  if (is_force_confirmed_ || ++num_unconfirmed_ <= kPatience) return true;
  if (uses_other_key_ && has_echo_) {
    ignores_force_ = true;
    return false;
  }
  // Changes to the other key; or back to the first one for good, with a service that never reports
  // the force. Until now the hand may have felt nothing, so the force is ramped up.
  request_.force_key =
      request_.force_key == HaplyForceKey::vector ? HaplyForceKey::values : HaplyForceKey::vector;
  is_force_confirmed_ = uses_other_key_;
  uses_other_key_ = true;
  num_unconfirmed_ = 0;
  ramp_.next(false);
  return true;
}

/// Reads the events that the service sends beside the states.
bool HaplyDevice::is_well() noexcept {
  if (!events_) return true;
  std::string_view text;
  for (int i = 0; i < kMaxMessages; ++i) {
    const WebSocket::Got got = events_->receive(text, 0);
    if (got == WebSocket::Got::closed) events_.reset();
    if (got != WebSocket::Got::message) return true;
    HaplyEvent event;
    if (!read_haply_event(text, event)) continue;
    if (!event.device_id.empty() && event.device_id != found_.device_id) continue;
    if (event.name == "device-safety-triggered") {
      if (event.safety_type == "ebrake_triggered")
        return give_up("the emergency brake has been triggered; release it and begin again");
      if (event.safety_type == "stall_detected")
        return give_up("a motor has stalled; free the handle and begin again");
    } else if (event.name == "device-disconnected") {
      return give_up("the Inverse3 has been disconnected");
    } else if (event.name == "device-calibration-failed") {
      return give_up("its calibration has failed; calibrate it and begin again");
    }
  }
  return true;
}

bool HaplyDevice::write(const Wrench& F_H_B) noexcept {
  // No answer yet: the service drops the last force by itself, and gets the newest one next time.
  if (is_waiting_) return true;
  sent_ = kServiceAxes.of_maker(motor_wrench(F_H_B, info_.limits).force) * ramp_.share();
  return send(sent_, 0) || give_up("the service no longer accepts messages");
}

void HaplyDevice::end() noexcept {
  if (socket_) {
    send(Vec3d{}, 0.1);
    socket_->close();
  }
  socket_.reset();
  events_.reset();
}

bool HaplyDevice::give_up(std::string_view why) noexcept {
  trouble_ = {Errc::unavailable, info_.name + " is lost: " + std::string(why)};
  return false;
}

Error with_advice(const Error& error, const NetAddress& address) {
  if (error.code == Errc::not_found && error.message.find("Inverse3") != std::string::npos)
    return error;
  return {error.code, error.message + " (tried " + haply_url(address) +
                          "); start Haply's Inverse Service, version 3.1 or newer"};
}

}  // namespace

Result<std::unique_ptr<HapticDevice>> open_haply_device_at(const HaplyAddress& address) {
  Result<HaplyInventory> found = inspect_haply(address.service, kHaplyAnswerTimeout);
  if (!found) return with_advice(found.error(), address.service);
  return std::unique_ptr<HapticDevice>(
      std::make_unique<PollingDevice>(std::make_unique<HaplyDevice>(address, std::move(*found))));
}

Result<std::unique_ptr<HapticDevice>> open_haply_device(std::string_view address) {
  HaplyAddress where;
  if (!address.empty()) {
    std::string_view text = address;
    if (text.starts_with("ws://")) text.remove_prefix(5);
    if (text.ends_with('/')) text.remove_suffix(1);
    const std::optional<NetAddress> parsed = parse_net_address(text, where.service.port);
    if (!parsed) {
      return Error{Errc::invalid_argument,
                   "haply:" + std::string(address) +
                       " is not an address of an Inverse Service; write haply:ws://HOST:PORT"};
    }
    where.service = *parsed;
  }
  return open_haply_device_at(where);
}

FoundDevice find_haply_device_at(const HaplyAddress& address) {
  FoundDevice device{"haply:" + haply_url(address.service), "haply", false, "", ""};
  const Result<HaplyInventory> found = inspect_haply(address.service, 0.09);
  if (found) {
    device.is_usable = true;
    device.what = describe(*found, address.service);
  } else {
    device.what = found.error().message;
    device.hint = "start Haply's Inverse Service (3.1 or newer) with an Inverse3 connected";
  }
  return device;
}

FoundDevice find_haply_device() { return find_haply_device_at({}); }

}}  // namespace palpate::v0
