#include "palpate/devices/devices.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

#include "src/core/internal/triple_buffer.h"
#include "src/devices/device_kinds.h"
#include "src/devices/internal/twist_between.h"
#include "src/devices/software/simulated_hand.h"
#include "src/devices/transport/periodic_thread.h"

namespace palpate { inline namespace v0 {
namespace {

/// v, shortened to `most` in the same direction.
Vec3d limited(const Vec3d& v, double most) {
  const double length = norm(v);
  return length > most ? v * (most / length) : v;
}

/// Encoders and driver of the device: rounds positions and derives velocities from them.
class Sensor {
 public:
  Sensor(double quantum, double velocity_filter, double tick_seconds)
      : quantum_(quantum),
        tick_seconds_(tick_seconds),
        share_(velocity_filter > 0 ? 1 - std::exp(-tick_seconds / velocity_filter) : 1) {}

  /// At rest at a pose.
  void reset(const Pose& X_BH) {
    state_ = {};
    state_.X_BH = rounded(X_BH);
    state_.is_valid = true;
  }
  /// The next state, so many ticks after the last one.
  const DeviceState& look(const Pose& X_BH, double time, int num_ticks) {
    const Pose X_BNow = rounded(X_BH);
    const Twist V_B = twist_between(state_.X_BH, X_BNow, tick_seconds_ * num_ticks);
    state_.V_BH.linear += share_ * (V_B.linear - state_.V_BH.linear);
    state_.V_BH.angular += share_ * (V_B.angular - state_.V_BH.angular);
    state_.X_BH = X_BNow;
    state_.time = time;
    return state_;
  }

 private:
  Pose rounded(Pose X_BH) const {
    if (quantum_ > 0)
      for (int i = 0; i < 3; ++i)
        X_BH.translation[i] = quantum_ * std::round(X_BH.translation[i] / quantum_);
    return X_BH;
  }

  double quantum_, tick_seconds_, share_;
  DeviceState state_;
};

class DeviceInMemory final : public SimulatedDevice {
 public:
  explicit DeviceInMemory(const SimulatedDeviceOptions& options)
      : options_(options),
        hand_(options.model, options.hand, options.target, 1 / options.rate),
        sensor_(options.quantum, options.velocity_filter, 1 / options.rate) {
    info_.kind = "sim";
    info_.name = "simulated " + std::string(options.model.name);
    info_.limits = options.model.limits;
    info_.rate = options.rate;
    publish(0);
  }

  const DeviceInfo& info() const override { return info_; }

  Status start(DeviceTick tick) override {
    stop();
    tick_ = std::move(tick);
    hand_.reset();
    sensor_.reset(hand_.X_BH());
    F_H_B_ = {};
    num_ticks_ = 0;
    has_refused_ = false;
    is_running_ = true;
    if (!options_.in_real_time) return Done{};
    // Overslept ticks move the hand on under the last wrench, but not for more than 0.1 s: no
    // driver leaves motors on for longer.
    return thread_.start(
        options_.rate,
        [this, most = static_cast<int>(options_.rate / 10)](double time, int periods) {
          return round(time, std::min(periods, most));
        },
        [] {});
  }

  void stop() noexcept override {
    is_running_ = false;
    thread_.stop();
  }

  Status status() const override {
    if (has_refused_)
      return Error{Errc::bad_input,
                   "the simulated device received a wrench that is not finite and has shut down; "
                   "check what computes it"};
    return Done{};
  }

  void run(int num_ticks) override {
    if (options_.in_real_time) return;
    for (int i = 0; i < num_ticks && is_running_; ++i)
      if (!round(static_cast<double>(num_ticks_) / options_.rate, 1)) is_running_ = false;
  }

  DeviceState true_state() const override { return truth().state; }
  double energy_given() const override { return truth().energy_given; }

 private:
  struct Truth {
    DeviceState state;
    double energy_given = 0;
  };

  /// Moves the hand on since the last round, then computes its new wrench.
  bool round(double time, int periods) noexcept {
    if (num_ticks_ > 0)
      for (int i = 0; i < periods; ++i) hand_.advance(F_H_B_);
    num_ticks_ += periods;
    publish(time);
    const Wrench desired = tick_(sensor_.look(hand_.X_BH(), time, periods));
    if (!is_finite(desired)) {
      has_refused_ = true;
      return false;
    }
    // Motors are limited.
    F_H_B_ = {limited(desired.force, info_.limits.max_force),
              limited(desired.torque, info_.limits.max_torque)};
    return true;
  }

  void publish(double time) noexcept {
    auto& [state, energy] = truth_.draft();
    state = {.time = time, .X_BH = hand_.X_BH(), .V_BH = hand_.V_BH(), .is_valid = true};
    energy = hand_.energy_given();
    truth_.publish();
  }

  const Truth& truth() const {
    truth_.refresh();
    return truth_.value();
  }

  SimulatedDeviceOptions options_;
  DeviceInfo info_;
  SimulatedHand hand_;
  Sensor sensor_;
  DeviceTick tick_;
  Wrench F_H_B_;
  std::int64_t num_ticks_ = 0;
  std::atomic<bool> has_refused_ = false, is_running_ = false;
  mutable TripleBuffer<Truth> truth_;
  PeriodicThread thread_;  // last: stops before the other members are destroyed
};

}  // namespace

Result<std::unique_ptr<SimulatedDevice>> SimulatedDevice::create(
    const SimulatedDeviceOptions& options) {
  if (const Status checked = check_settings(options); !checked) return checked.error();
  return std::unique_ptr<SimulatedDevice>(std::make_unique<DeviceInMemory>(options));
}

Result<std::unique_ptr<HapticDevice>> open_simulated_device(std::string_view address) {
  const auto model = address.empty() ? device_models().front() : find_device_model(address);
  if (!model) {
    std::string known;
    for (const DeviceModel& each : device_models()) known += " " + std::string(each.key);
    return Error{Errc::not_found, "no model of a device is called '" + std::string(address) +
                                      "'; known are:" + known};
  }
  SimulatedDeviceOptions options;
  options.model = *model;
  options.target = exploring_hand(model->limits.workspace_radius);
  auto device = SimulatedDevice::create(options);
  if (!device) return device.error();
  return std::unique_ptr<HapticDevice>(std::move(*device));
}

}}  // namespace palpate::v0
