// A haptic device of one's own, on a simulated clock: it says where the hand is and gets a wrench.
#include <cmath>
#include <cstdio>
#include <thread>

#include "palpate/mesh/mesh.h"
#include "palpate/run/run_loop.h"

using namespace palpate;

class OwnDevice : public SteppedDevice {
 public:
  const DeviceInfo& info() const override { return info_; }
  Status start(DeviceTick tick) override { return tick_ = std::move(tick), Status(Done{}); }
  void stop() noexcept override { tick_ = nullptr; }
  Status status() const override { return Done{}; }
  /// A real driver reads its encoders here, a thousand times a second, and drives its motors.
  bool step() override {
    if (!tick_ || num_ticks_ >= 1000) return false;
    const double time = num_ticks_++ / info_.rate, z = 0.43 + 0.04 * std::sin(3.14 * time);
    const Wrench F_H_B = tick_({.time = time, .X_BH = {{0, 0, z}, {}}, .is_valid = true});
    if (num_ticks_ % 100 == 0) std::printf("%.1f s: %6.2f N\n", time, F_H_B.force.z);
    return true;
  }

 private:
  DeviceInfo info_{.kind = "own",
                   .name = "a device of one's own",
                   .limits = {.max_force = 8,              // N
                              .max_torque = 0.1,           // N m
                              .max_stiffness = 2000,       // N/m
                              .max_angular_stiffness = 5,  // N m/rad
                              .max_damping = 10,           // N s/m
                              .workspace_radius = 0.1,     // m
                              .damping = 1,                // N s/m, of the mechanism itself
                              .angular_damping = 0.01}};   // N m s/rad
  DeviceTick tick_;
  int num_ticks_ = 0;
};

/// A camera in front of a wall, 0.5 m away: two seconds of images.
class Wall : public DepthSource {
 public:
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    frame = {.width = 320,
             .height = 240,
             .unit = 0.001,
             .pixels = std::vector<std::uint16_t>(320 * 240, 500),
             .timestamp = num_frames_ / 30.0};
    return num_frames_++ < 60;
  }

 private:
  DepthStreamInfo info_{.width = 320,
                        .height = 240,
                        .intrinsics = {260, 260, 159.5, 119.5},
                        .num_frames = 60,
                        .name = "a wall"};
  int num_frames_ = 0;
};

int main() {
  const Tool tool = Tool::pack(make_cylinder(0.02, 0.1, 64), {.max_spheres = 2000}).value();
  OwnDevice device;
  Wall camera;
  const auto loop = RunLoop::simulate(tool, camera, device, {}).value();
  if (!loop->start()) return 1;
  while (loop->is_running()) std::this_thread::yield();
  std::printf("ended: %s\n", loop->report().ending.c_str());
}
