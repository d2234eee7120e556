// Runs a recording again with other settings: the same hand and the same frames.
//
// The hand moves as it was recorded, whatever the force is now. The forces of both runs thus belong
// to the same motion and can be compared tick by tick.
#include <algorithm>
#include <cmath>
#include <deque>
#include <filesystem>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "palpate/session/run.h"
#include "src/session/internal/run_reader.h"

namespace palpate { inline namespace v0 {
namespace fs = std::filesystem;
namespace {

/// Returns the start of the run, s, on the clock of the recording. Error: there is no tick.
Result<double> start_of(const fs::path& path) {
  auto reader = RunReader::open(path);
  if (!reader) return reader.error();
  TickRecord tick;
  const auto got = reader->next_tick(tick);
  if (!got) return got.error();
  if (!*got) return Error{Errc::bad_input, path.string() + " has no ticks; record the run again"};
  return tick.device.time - tick.time;
}

/// The hand as it was recorded, whatever the force.
class RecordedHand final : public SteppedDevice {
 public:
  RecordedHand(RunReader reader, double start) : reader_(std::move(reader)), start_(start) {}

  const DeviceInfo& info() const override { return reader_.setup().device; }
  Status start(DeviceTick tick) override {
    tick_ = std::move(tick);
    return Done{};
  }
  void stop() noexcept override { tick_ = nullptr; }
  Status status() const override { return status_; }
  bool step() override {
    const auto got = reader_.next_tick(recorded_);
    if (!got) status_ = got.error();
    if (tick_ == nullptr || !got || !*got) return false;
    DeviceState state = recorded_.device;
    state.time -= start_;
    tick_(state);
    return true;
  }
  /// During a tick: its record, and its reader.
  const TickRecord& recorded() const { return recorded_; }
  const RunReader& reader() const { return reader_; }

 private:
  RunReader reader_;
  double start_;
  DeviceTick tick_;
  TickRecord recorded_;
  Status status_ = Done{};
};

/// The frames of a camera as they were captured, on the run's clock.
class RecordedFrames final : public DepthSource {
 public:
  RecordedFrames(RunReader reader, std::uint32_t camera, double start)
      : reader_(std::move(reader)), camera_(camera), start_(start) {}

  const DepthStreamInfo& info() const override { return reader_.setup().streams[camera_]; }
  Result<bool> next(DepthFrame& frame) override {
    RecordedDepth recorded;
    do {
      const auto got = reader_.next_frame(recorded);
      if (!got || !*got) return got;
    } while (recorded.record.camera != camera_);
    frame = std::move(recorded.frame);
    frame.timestamp = recorded.record.capture_time - start_;
    return true;
  }

 private:
  RunReader reader_;
  std::uint32_t camera_;
  double start_;
};

void compare(const TickRecord& before, const TickRecord& after, ForceComparison& forces) {
  const Vec3d &a = before.step.contact_W.force, &b = after.step.contact_W.force;
  const double off = norm(b - a);
  ++forces.num_ticks;
  forces.rms += off * off;
  if (off > forces.max) forces.max_time = after.time;
  forces.max = std::max(forces.max, off);
  forces.peak_before = std::max(forces.peak_before, norm(a));
  forces.peak_after = std::max(forces.peak_after, norm(b));
}

}  // namespace

Result<RetryOutcome> retry_run(const fs::path& folder, const fs::path& output,
                               const std::function<Status(RunSettings&)>& change,
                               const RunOptions& options,
                               const std::function<void(double share)>& progress) {
  const auto start = start_of(folder);
  if (!start) return start.error();
  auto ticks = RunReader::open(folder);
  if (!ticks) return ticks.error();
  if (const Status whole = ticks->begins_with_run(); !whole) return whole.error();
  const auto tool = ticks->load_tools();
  if (!tool) return tool.error();
  RunSettings settings = ticks->setup().settings;
  if (const Status status = change(settings); !status) return status.error();
  RunOptions run = options;
  run.probe = ticks->setup().probe;
  run.time_origin = ticks->setup().time_origin;
  run.clock.zero = 0;
  run.clock.ends_with_frames = false;

  std::deque<RecordedFrames> frames;
  std::vector<DepthSource*> sources;
  for (std::uint32_t k = 0; k < ticks->setup().streams.size(); ++k) {
    auto images = RunReader::open(folder);
    if (!images) return images.error();
    sources.push_back(&frames.emplace_back(*std::move(images), k, *start));
  }
  ReadShare share(*ticks, progress);
  RecordedHand hand(*std::move(ticks), *start);
  RetryOutcome outcome;
  RunMonitor monitor;
  monitor.observer.on_ticks = [&](std::span<const TickRecord> repeated) {
    for (const TickRecord& tick : repeated) compare(hand.recorded(), tick, outcome.forces);
    share.look(hand.reader());
    if (options.monitor != nullptr && options.monitor->observer.on_ticks) {
      options.monitor->observer.on_ticks(repeated);
    }
  };
  run.monitor = &monitor;
  auto done = record_run(*tool, DepthSources(std::move(sources)), hand, settings, output, run);
  if (!done) return done.error();
  outcome.run = *std::move(done);
  ForceComparison& forces = outcome.forces;
  if (forces.num_ticks > 0) {
    forces.rms = std::sqrt(forces.rms / static_cast<double>(forces.num_ticks));
  }
  return outcome;
}

}}  // namespace palpate::v0
