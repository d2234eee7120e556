// VRPN has no message for "this force, now". A client sends a field of forces, F(x) = F0 + J (x -
// x0) within a radius of x0, and the server renders it until the next one comes. A tick gives a
// force and not how it changes nearby, so J is zero: the force stays as it is between two fields,
// which adds no stiffness of its own. The radius bounds where a force is felt if we end
// without a word. A Falcon's server grows it anew from a tenth with every field and lets x0 lag
// behind the hand by ten ticks, so much smaller it may not be.
//
// B is the frame of the server, whichever that is: VRPN does not say. A Falcon's has z towards the
// hand and the origin in the middle (vrpn_Tracker_NovintFalcon.C).

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "palpate/devices/devices.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/devices/device_kinds.h"
#include "src/devices/device_pose.h"
#include "src/devices/internal/polling_device.h"
#include "src/devices/internal/twist_between.h"
#include "src/devices/motor_wrench.h"
#include "src/devices/transport/tcp_socket.h"
#include "src/devices/vrpn/vrpn_connection.h"

namespace palpate { inline namespace v0 {
namespace {

/// TCP port of a server that is given without one.
constexpr int kVrpnPort = 3883;

constexpr double kRadius = 0.05;   // m
constexpr double kMaxAge = 0.005;  // s: a pose is taken for present until then
// A server that stands still for a moment goes on; the loop takes the force away much sooner.
constexpr double kMaxSilence = 1;          // s without a pose: lost
constexpr double kLongestStep = 0.1;       // s between poses that a velocity comes from
constexpr double kAnswerTimeout = 1.0;     // s for anything before the first tick
constexpr double kVelocityFilter = 0.005;  // s, of velocities from positions
constexpr double kMaxVelocityAge = 0.05;   // s: the server has said nothing since, so it is over
constexpr int kMaxMessages = 256;          // of one tick: more must wait for the next

// Servers smooth the field, a Falcon's by default with a time constant of 9.5 ms. A spring through
// such a lag tau is stable while K < b / tau + b^2 / m (Routh); b = 3 N s/m and m = 0.3 kg, which
// is a light hand, leave 340 N/m.
constexpr double kMaxStiffness = 300;  // N/m

struct VrpnAddress {
  std::string name;
  NetAddress server;
};

Result<VrpnAddress> parse_address(std::string_view text) {
  const std::size_t at = text.find('@');
  if (at != std::string_view::npos && at > 0) {
    std::string_view place = text.substr(at + 1);
    if (place.starts_with("tcp://")) place.remove_prefix(6);
    if (const auto server = parse_net_address(place, kVrpnPort))
      return VrpnAddress{std::string(text.substr(0, at)), *server};
  }
  return Error{Errc::invalid_argument, "vrpn:" + std::string(text) +
                                           " names no VRPN device; write vrpn:NAME@HOST[:PORT], "
                                           "e.g. vrpn:Phantom0@localhost"};
}

std::string describe(const VrpnAddress& address) {
  return address.name + '@' + describe(address.server);
}

std::string join(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) {
    if (text.size() > 200) return text + ", ...";
    text += (text.empty() ? "" : ", ") + name;
  }
  return text;
}

/// Returns the limits of the device that the name suggests; else those of the smallest one.
DeviceLimits guess_limits(std::string_view name) {
  std::string lower(name);
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  const auto model =
      find_device_model(lower.find("falcon") != std::string::npos ? "falcon" : "touch");
  DeviceLimits limits = model.value_or(device_models().front()).limits;
  limits.max_torque = limits.max_angular_stiffness = 0;  // a field has no torque
  limits.max_stiffness = std::min(limits.max_stiffness, kMaxStiffness);
  return limits;
}

/// Connects and waits for the first pose of the device.
Result<VrpnConnection> connect(const VrpnAddress& address) {
  Result<VrpnConnection> connection =
      VrpnConnection::connect(address.server, address.name, kAnswerTimeout);
  if (!connection) {
    return Error{connection.error().code,
                 connection.error().message +
                     "; start vrpn_server there, or name another place: vrpn:NAME@HOST[:PORT]"};
  }
  const double deadline = monotonic_now() + kAnswerTimeout;
  VrpnMessage message;
  VrpnKind kind = VrpnKind::other;
  for (;;) {
    const double left = deadline - monotonic_now();
    const auto got =
        left > 0 ? connection->receive(message, kind, left) : VrpnConnection::Got::nothing;
    if (got == VrpnConnection::Got::message && kind == VrpnKind::pose) return connection;
    if (got != VrpnConnection::Got::message) break;
  }
  if (connection->knows_device()) {
    return Error{Errc::unavailable, describe(address) +
                                        " says nothing of where it is; calibrate "
                                        "the device and look at the server's log"};
  }
  const std::string names = join(connection->senders());
  return Error{Errc::not_found, "the VRPN server at " + describe(address.server) +
                                    " has no device " + address.name +
                                    (names.empty() ? "; see its vrpn.cfg" : ", but: " + names)};
}

class VrpnDevice final : public PolledDevice {
 public:
  explicit VrpnDevice(VrpnAddress address) : address_(std::move(address)) {
    info_.kind = "vrpn";
    info_.name = describe(address_);
    info_.limits = guess_limits(address_.name);
    info_.num_buttons = 4;
  }

  Status begin() override;
  bool read(DeviceState& state) noexcept override;
  bool write(const Wrench& F_H_B) noexcept override;
  void end() noexcept override;

 private:
  bool take(const VrpnMessage& message, VrpnKind kind, double time) noexcept;
  void take_pose(const Pose& X_BH, double stamp, double time) noexcept;
  void take_velocity(const VrpnVelocity& velocity, double time) noexcept;
  bool give_up(std::string_view why) noexcept;

  VrpnAddress address_;
  std::optional<VrpnConnection> connection_;
  Pose X_BH_;
  Twist V_BH_;
  std::uint32_t buttons_ = 0;
  bool has_pose_ = false;
  double last_stamp_ = 0;     // stamp of the last pose by the server's clock, s
  double last_pose_ = 0;      // its arrival by ours, s
  double last_velocity_ = 0;  // arrival of the server's last velocity by ours, s
  Vec3d difference_;          // velocity from positions
  Vec3d reported_;            // velocity by the server
  double sum_difference_ = 0, sum_reported_ = 0;
};

Status VrpnDevice::begin() {
  end();
  Result<VrpnConnection> connection = connect(address_);
  if (!connection) return connection.error();
  connection_ = std::move(*connection);
  X_BH_ = {};
  V_BH_ = {};
  buttons_ = 0;
  has_pose_ = false;
  last_velocity_ = 0;
  difference_ = reported_ = {};
  sum_difference_ = sum_reported_ = 0;
  last_pose_ = monotonic_now();
  return Done{};
}

bool VrpnDevice::read(DeviceState& state) noexcept {
  VrpnMessage message;
  VrpnKind kind = VrpnKind::other;
  for (int i = 0; i < kMaxMessages; ++i) {
    const auto got = connection_->receive(message, kind, 0);
    if (got == VrpnConnection::Got::closed)
      return give_up("the server has ended the connection or sent what is not VRPN");
    if (got == VrpnConnection::Got::nothing) break;
    if (!take(message, kind, state.time)) return false;
  }
  state.X_BH = X_BH_;
  state.V_BH = V_BH_;
  state.buttons = buttons_;
  const double age = state.time - last_pose_;
  state.is_valid = has_pose_ && age <= kMaxAge;
  return age <= kMaxSilence || give_up("the server has sent no position for 1 s");
}

/// False: the device has refused to go on.
bool VrpnDevice::take(const VrpnMessage& message, VrpnKind kind, double time) noexcept {
  switch (kind) {
    case VrpnKind::pose: {
      VrpnPose pose;
      if (!read_vrpn_pose(message.payload, pose) || pose.sensor != 0 || !is_possible(pose.X_BH))
        return true;
      take_pose({pose.X_BH.translation, normalized(pose.X_BH.rotation)},
                message.seconds + 1e-6 * message.microseconds, time);
      last_pose_ = time;
      return true;
    }
    case VrpnKind::velocity: {
      VrpnVelocity velocity;
      if (read_vrpn_velocity(message.payload, velocity) && velocity.sensor == 0)
        take_velocity(velocity, time);
      return true;
    }
    case VrpnKind::button: {
      std::int32_t button = 0;
      bool is_down = false;
      if (read_vrpn_button(message.payload, button, is_down))
        buttons_ = (buttons_ & ~(1u << button)) | (is_down ? 1u << button : 0u);
      return true;
    }
    case VrpnKind::buttons: read_vrpn_buttons(message.payload, buttons_); return true;
    case VrpnKind::force_error: {
      constexpr std::array<std::string_view, 4> kErrors = {
          "it says that a parameter of the force is out of range",
          "it says that its servo loop takes too long",
          "it says that the force was too large, a motor is too hot or an amplifier off",
          "it reports an error of the force device"};
      std::int32_t code = 4;  // no error
      if (!read_vrpn_force_error(message.payload, code) || code == 4) return true;
      return give_up(kErrors[static_cast<std::size_t>(std::clamp(code, 0, 3))]);
    }
    case VrpnKind::other: break;
  }
  return true;
}

void VrpnDevice::take_pose(const Pose& X_BH, double stamp, double time) noexcept {
  // Stamps of some servers stand still or go back: then the arrival of poses counts.
  const bool is_stamped = stamp > last_stamp_;
  const double interval = is_stamped ? stamp - last_stamp_ : time - last_pose_;
  if (has_pose_ && interval > 0 && interval < kLongestStep) {
    const Vec3d raw = (X_BH.translation - X_BH_.translation) / interval;
    difference_ += (raw - difference_) * (interval / (interval + kVelocityFilter));
    sum_difference_ += norm(difference_);
  }
  // A Falcon's server reports meters per microsecond. Velocities of the server are used if they
  // are, on average, as large as the positions say.
  const bool is_plausible =
      sum_reported_ > 0.5 * sum_difference_ && sum_reported_ < 2 * sum_difference_;
  const bool is_fresh = time - last_velocity_ <= kMaxVelocityAge;
  V_BH_.linear = is_plausible && is_fresh ? reported_ : difference_;
  if (!is_fresh) V_BH_.angular = {};
  X_BH_ = X_BH;
  last_stamp_ = stamp;
  has_pose_ = true;
}

void VrpnDevice::take_velocity(const VrpnVelocity& velocity, double time) noexcept {
  const Quaternion& q = velocity.turn;
  const double size = norm(velocity.linear);
  if (!std::isfinite(size)) return;
  reported_ = velocity.linear;
  last_velocity_ = time;
  sum_reported_ += size;
  // Some servers send a zero quaternion instead of none.
  const double square = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
  if (!(std::abs(square - 1) < 0.01) || !(velocity.interval > 1e-4)) return;
  V_BH_.angular = rotation_vector(q) / velocity.interval;
}

bool VrpnDevice::write(const Wrench& F_H_B) noexcept {
  VrpnForceField field;
  field.origin = X_BH_.translation;
  field.radius = kRadius;
  field.force = motor_wrench(F_H_B, info_.limits).force;
  return connection_->send(field) || give_up("the server no longer accepts messages");
}

void VrpnDevice::end() noexcept {
  if (!connection_) return;
  connection_->send({});
  connection_->close();
  connection_.reset();
}

bool VrpnDevice::give_up(std::string_view why) noexcept {
  trouble_ = {Errc::unavailable, info_.name + " is lost: " + std::string(why)};
  return false;
}

}  // namespace

Result<std::unique_ptr<HapticDevice>> open_vrpn_device(std::string_view address) {
  Result<VrpnAddress> parsed = parse_address(address);
  if (!parsed) return parsed.error();
  Result<VrpnConnection> connection = connect(*parsed);
  if (!connection) return connection.error();
  connection->close();
  return std::unique_ptr<HapticDevice>(
      std::make_unique<PollingDevice>(std::make_unique<VrpnDevice>(std::move(*parsed))));
}

FoundDevice find_vrpn_device_at(const NetAddress& address) {
  FoundDevice device{"vrpn:NAME@" + describe(address), "vrpn", false, "", ""};
  Result<VrpnConnection> connection = VrpnConnection::connect(address, "palpate", 0.1);
  if (!connection) {
    device.what = connection.error().message;
    device.hint =
        "start vrpn_server with the device in its vrpn.cfg, here or elsewhere, and name "
        "it: vrpn:NAME@HOST[:PORT]";
    return device;
  }
  VrpnMessage message;
  VrpnKind kind = VrpnKind::other;
  connection->receive(message, kind, 0.1);  // the server gives names only; no device is meant
  device.is_usable = !connection->senders().empty();
  device.what = "a VRPN server at " + describe(address) + " with " +
                (device.is_usable ? join(connection->senders()) : "no device");
  if (device.is_usable) {
    device.uri = "vrpn:" + connection->senders().front() + '@' + describe(address);
  } else {
    device.hint = "add the device to the server's vrpn.cfg and start it again";
  }
  connection->close();
  return device;
}

FoundDevice find_vrpn_device() { return find_vrpn_device_at({"localhost", kVrpnPort}); }

}}  // namespace palpate::v0
