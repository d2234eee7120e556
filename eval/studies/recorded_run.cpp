#include "eval/studies/recorded_run.h"

#include <stdlib.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "palpate/devices/devices.h"
#include "palpate/session/run.h"
#include "src/haptics/internal/hand.h"
#include "src/run/internal/run_inputs.h"

namespace palpate::eval {
namespace {

namespace fs = std::filesystem;

constexpr double kRate = 1000;  // Hz

class FramesInMemory final : public DepthSource {
 public:
  FramesInMemory(const DepthStreamInfo& stream, std::span<const DepthFrame> frames)
      : stream_(stream), frames_(frames) {}

  const DepthStreamInfo& info() const override { return stream_; }
  Result<bool> next(DepthFrame& frame) override {
    if (num_given_ == frames_.size()) return false;
    frame = frames_[num_given_++];
    frame.timestamp -= frames_.front().timestamp;
    return true;
  }

 private:
  const DepthStreamInfo& stream_;
  std::span<const DepthFrame> frames_;
  std::size_t num_given_ = 0;
};

/// A simulated hand on the clock of a computed run, without waiting.
class SteppedHand final : public SteppedDevice {
 public:
  explicit SteppedHand(std::unique_ptr<SimulatedDevice> device) : device_(std::move(device)) {}

  const DeviceInfo& info() const override { return device_->info(); }
  Status start(DeviceTick tick) override { return device_->start(std::move(tick)); }
  void stop() noexcept override { device_->stop(); }
  Status status() const override { return device_->status(); }
  bool step() override {
    device_->run(1);
    return static_cast<bool>(device_->status());
  }

 private:
  std::unique_ptr<SimulatedDevice> device_;
};

Result<std::shared_ptr<const fs::path>> temporary_folder() {
  std::string name = (fs::temp_directory_path() / "palpate-eval-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) {
    return Error{Errc::io_failure, "cannot make a folder " + name + " for a run"};
  }
  return std::shared_ptr<const fs::path>(new fs::path(name), [](const fs::path* path) {
    std::error_code ignored;
    fs::remove_all(*path, ignored);
    delete path;
  });
}

}  // namespace

std::unique_ptr<DepthSource> frames_in_memory(const DepthStreamInfo& stream,
                                              const std::vector<DepthFrame>& frames) {
  return std::make_unique<FramesInMemory>(stream, frames);
}

Result<RecordedRun> RecordedRun::record(const Tool& tool, DepthSource& source, HapticDevice& device,
                                        const RunSettings& settings, bool ends_with_frames) {
  auto folder = temporary_folder();
  if (!folder) return folder.error();
  RunOptions options;
  options.clock.ends_with_frames = ends_with_frames;
  const auto done = record_run(tool, source, device, settings, **folder / "recorded", options);
  if (!done) return done.error();
  if (!done->failure.empty()) return Error{Errc::bad_input, done->failure};
  return RecordedRun(*std::move(folder));
}

Result<RecordedRun> RecordedRun::record(const Tool& tool, const FirstFrame& picture,
                                        const std::vector<Pose>& X_WT) {
  const auto at = [&](double time) {
    const auto i = static_cast<std::size_t>(std::lround(kRate * time));
    return X_WT[std::min(i, X_WT.size() - 1)];
  };
  DeviceLimits limits;
  limits.max_force = kFullForce;
  auto device = make_path_device(
      {at, static_cast<double>(X_WT.size()) / kRate, kRate, limits, "the hand of the evaluation"});
  if (!device) return device.error();
  RunSettings settings;
  settings.coupling.kind = CouplingKind::none;
  settings.contact_rate = kRate;
  settings.num_threads = 1;
  FramesInMemory source(picture.stream, {&picture.frame, 1});
  return record(tool, source, **device, settings, false);
}

Result<RecordedRun> RecordedRun::touch(const Tool& tool, const DepthStreamInfo& stream,
                                       const std::vector<DepthFrame>& frames,
                                       const std::function<Pose(double time)>& X_WT) {
  RunSettings settings;
  settings.time.average.kind = usual_average({&stream, 1});
  settings.coupling.kind = CouplingKind::direct;
  settings.coupling.force_at_eighth = kFullForce / 8;
  place_hand({}, X_WT(0), settings.coupling);
  SimulatedDeviceOptions hand;
  hand.model = device_models().front();
  hand.in_real_time = false;
  hand.rate = kRate;
  hand.target = [&](double time) { return handle_at(settings.coupling, X_WT(time)); };
  auto device = SimulatedDevice::create(hand);
  if (!device) return device.error();
  SteppedHand stepped(*std::move(device));
  FramesInMemory source(stream, frames);
  return record(tool, source, stepped, settings, true);
}

Result<std::vector<TickRecord>> RecordedRun::by(const ContactOptions& options) const {
  std::vector<TickRecord> all;
  RunMonitor monitor;
  monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    all.insert(all.end(), ticks.begin(), ticks.end());
  };
  RunOptions run;
  run.monitor = &monitor;
  const auto done = retry_run(
      *folder_ / "recorded", *folder_ / "again",
      [&](RunSettings& settings) -> Status {
        settings.contact = options;
        settings.coupling.kind = CouplingKind::none;
        return Done{};
      },
      run);
  if (!done) return done.error();
  if (!done->run.failure.empty()) return Error{Errc::bad_input, done->run.failure};
  return all;
}

Result<std::string> RecordedRun::repeat() const {
  const auto done = replay_run(*folder_ / "recorded");
  if (!done) return done.error();
  return done->difference;
}

}  // namespace palpate::eval
