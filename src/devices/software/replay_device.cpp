// A recorded path as a device: the hand repeats its motion, and forces are ignored.
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "palpate/io/files.h"
#include "src/devices/device_kinds.h"
#include "src/devices/internal/polling_device.h"
#include "src/devices/internal/twist_between.h"

namespace palpate { inline namespace v0 {
namespace {

class Replay final : public PolledDevice {
 public:
  Replay(std::string file, std::vector<TimedPose> poses)
      : file_(std::move(file)), poses_(std::move(poses)) {
    info_.kind = "replay";
    info_.name = "recorded path " + file_;
    info_.limits = input_only_limits();
    double radius = 0;
    for (const TimedPose& pose : poses_) radius = std::max(radius, norm(pose.X_WT.translation));
    if (radius > 0) info_.limits.workspace_radius = radius;
  }

  Status begin() override {
    start_time_ = -1;
    return Done{};
  }

  bool read(DeviceState& state) noexcept override {
    if (start_time_ < 0) start_time_ = state.time;
    const double first = poses_.front().time, last = poses_.back().time;
    const double time = first + (state.time - start_time_);
    if (time > last) return false;
    // Poses are far apart, compared with ticks: the velocity of some ticks around this one.
    constexpr double kReach = 0.005;  // s
    const double before = std::max(time - kReach, first), after = std::min(time + kReach, last);
    state.X_BH = pose_at(poses_, time);
    state.V_BH = after > before ? twist_between(pose_at(poses_, before), pose_at(poses_, after),
                                                after - before)
                                : Twist{};
    state.is_valid = true;
    return true;
  }

  bool write(const Wrench&) noexcept override { return true; }
  void end() noexcept override {}

  Error trouble() const override { return {Errc::cancelled, "the path " + file_ + " has ended"}; }

 private:
  std::string file_;
  std::vector<TimedPose> poses_;
  double start_time_ = -1;
};

}  // namespace

Result<std::unique_ptr<HapticDevice>> open_replay_device(std::string_view address) {
  if (address.empty())
    return Error{Errc::invalid_argument,
                 "replay needs a file with lines 't tx ty tz qx qy qz qw'; give replay:FILE"};
  auto poses = load_trajectory(std::string(address));
  if (!poses) return poses.error();
  return make_replay_device(std::string(address), std::move(*poses));
}

std::unique_ptr<HapticDevice> make_replay_device(std::string name, std::vector<TimedPose> X_BH) {
  return std::make_unique<PollingDevice>(
      std::make_unique<Replay>(std::move(name), std::move(X_BH)));
}

}}  // namespace palpate::v0
