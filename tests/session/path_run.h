// Runs along a path, on a simulated clock and in memory.
#pragma once

#include <algorithm>
#include <functional>
#include <limits>
#include <thread>
#include <utility>
#include <vector>

#include "palpate/devices/devices.h"
#include "palpate/run/run_loop.h"
#include "src/run/internal/path_device.h"

namespace palpate::test {

struct PathLog {
  std::vector<FrameRecord> frames;
  std::vector<TickRecord> ticks;
  LoopReport report;
  std::size_t deepest_tick = 0;
};

using PathFunction = std::function<Pose(double time)>;

/// A tool without coupling, on one thread.
inline RunSettings path_settings(double rate = 1000) {
  RunSettings settings;
  settings.coupling.kind = CouplingKind::none;
  settings.contact_rate = rate;
  settings.num_threads = 1;
  return settings;
}

inline Result<std::unique_ptr<SteppedDevice>> path_device(
    PathFunction X_WT, double rate, double duration = std::numeric_limits<double>::infinity()) {
  return make_path_device(
      {std::move(X_WT), duration, rate, find_device_model("sigma.7")->limits, "a path"});
}

/// Until the frames end, or for `duration` with the last frame staying. Errors: also those that end
/// the run.
inline Result<PathLog> run_path(const Tool& tool, DepthSource& source, PathFunction X_WT,
                                const RunSettings& settings = path_settings(),
                                double duration = std::numeric_limits<double>::infinity()) {
  auto device = path_device(std::move(X_WT), settings.contact_rate, duration);
  if (!device) return device.error();
  PathLog log;
  RunObserver observer;
  observer.on_frame = [&](const FrameRecord& frame, const DepthFrame&) {
    log.frames.push_back(frame);
  };
  observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    for (TickRecord tick : ticks) {
      tick.compute_nanoseconds = 0;
      log.ticks.push_back(tick);
    }
  };
  SimulatedClock clock;
  clock.ends_with_frames = !(duration < std::numeric_limits<double>::infinity());
  auto loop = RunLoop::simulate(tool, source, **device, settings, clock, observer);
  if (!loop) return loop.error();
  if (const Status status = (*loop)->start(); !status) return status.error();
  while ((*loop)->is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  (*loop)->stop();
  log.report = (*loop)->report();
  if (const Status status = (*loop)->status(); !status) return status.error();
  const auto deepest = std::max_element(log.ticks.begin(), log.ticks.end(),
                                        [](const TickRecord& a, const TickRecord& b) {
                                          return a.penetration.volume < b.penetration.volume;
                                        });
  log.deepest_tick = static_cast<std::size_t>(deepest - log.ticks.begin());
  return log;
}

}  // namespace palpate::test
