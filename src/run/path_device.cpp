#include "src/run/internal/run_inputs.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/math/internal/rotation_vector.h"

namespace palpate { inline namespace v0 {
namespace {

class PathDevice final : public SteppedDevice {
 public:
  explicit PathDevice(PathDeviceOptions options) : options_(std::move(options)) {
    info_.kind = "path";
    info_.name = options_.name;
    info_.limits = options_.limits;
    info_.rate = options_.rate;
  }

  const DeviceInfo& info() const override { return info_; }
  Status start(DeviceTick tick) override {
    tick_ = std::move(tick);
    num_ticks_ = 0;
    return Done{};
  }
  void stop() noexcept override { tick_ = nullptr; }
  Status status() const override { return Done{}; }

  bool step() override {
    const double time = static_cast<double>(num_ticks_) / options_.rate;
    if (tick_ == nullptr || !(time < options_.duration)) return false;
    ++num_ticks_;
    DeviceState state;
    state.time = time;
    state.X_BH = options_.X_BH(time);
    state.V_BH = velocity_at(time);
    state.is_valid = true;
    tick_(state);
    return true;
  }

 private:
  /// Returns the mean velocity of some ticks around this time: poses are far apart in comparison.
  Twist velocity_at(double time) const {
    constexpr double kReach = 0.005;  // s
    const double before = std::max(time - kReach, 0.0), after = time + kReach;
    const Pose from = options_.X_BH(before), to = options_.X_BH(after);
    const double dt = after - before;
    return {(to.translation - from.translation) / dt,
            rotation_vector(to.rotation * conjugate(from.rotation)) / dt};
  }

  PathDeviceOptions options_;
  DeviceInfo info_;
  DeviceTick tick_;
  std::uint64_t num_ticks_ = 0;
};

}  // namespace

Result<std::unique_ptr<SteppedDevice>> make_path_device(PathDeviceOptions options) {
  if (!(options.rate >= 1 && options.rate <= 100000)) {
    return Error{Errc::invalid_argument,
                 "the rate must be from 1 to 100000 ticks per second; 1000 is usual"};
  }
  if (!(options.duration > 0)) {
    return Error{Errc::invalid_argument, "the duration must be longer than 0 s"};
  }
  return std::unique_ptr<SteppedDevice>(std::make_unique<PathDevice>(std::move(options)));
}

}}  // namespace palpate::v0
