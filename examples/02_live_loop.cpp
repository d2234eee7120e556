// A hand feels a wall a thousand times a second: threads for camera, surface, contact and hand.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <optional>
#include <thread>

#include "palpate/devices/devices.h"
#include "palpate/mesh/mesh.h"
#include "palpate/run/run_loop.h"

using namespace palpate;

/// A camera in front of a wall, 0.5 m away, thirty times a second.
class Wall : public DepthSource {
 public:
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    std::this_thread::sleep_for(std::chrono::milliseconds(33));
    frame = {.width = 320,
             .height = 240,
             .unit = 0.001,
             .pixels = std::vector<std::uint16_t>(320 * 240, 500),
             .timestamp = ++num_frames_ / 30.0};
    return true;
  }

 private:
  DepthStreamInfo info_{
      .width = 320, .height = 240, .intrinsics = {260, 260, 159.5, 119.5}, .name = "a wall"};
  int num_frames_ = 0;
};

int main() {
  const Tool tool = Tool::pack(make_cylinder(0.02, 0.1, 64), {.max_spheres = 2000}).value();

  // A device that exists in memory only, and a hand that pushes it 2 cm into the wall and back.
  const SimulatedDeviceOptions hand{
      .model = device_models().front(), .target = [](double t) {
        return Pose{.translation = {0, 0, 0.02 * (1 - std::cos(2 * t))}};
      }};
  const auto device = SimulatedDevice::create(hand).value();

  RunSettings settings;
  settings.coupling.X_WB.translation = {0, 0, 0.43};  // the device's base in front of the camera

  Wall camera;
  const auto loop = RunLoop::create(tool, camera, *device, settings).value();
  if (const Status started = loop->start(); !started) {
    std::fprintf(stderr, "%s\n", started.error().message.c_str());
    return 1;
  }
  for (int i = 0; i < 12; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(250));
    const std::optional<TickRecord> tick = loop->latest();
    if (!tick) continue;
    const double depth = tick->step.X_WT.translation.z + 0.05 - 0.5;
    std::printf("%.2f s: %5.1f mm deep, %6.2f N\n", tick->time, 1000 * depth, tick->F_H_B.force.z);
  }
  loop->stop();
  std::printf("%llu ticks\n", static_cast<unsigned long long>(loop->report().num_ticks));
}
