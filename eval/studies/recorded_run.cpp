#include "eval/studies/recorded_run.h"

#include <stdlib.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "palpate/session/run.h"
#include "src/run/internal/path_device.h"

namespace palpate::eval {
namespace {

namespace fs = std::filesystem;

constexpr double kRate = 1000;  // Hz

/// One frame, again and again.
class StillPicture final : public DepthSource {
 public:
  explicit StillPicture(const FirstFrame& picture) : picture_(picture) {}

  const DepthStreamInfo& info() const override { return picture_.stream; }
  Result<bool> next(DepthFrame& frame) override {
    if (num_given_++ > 0) return false;
    frame = picture_.frame;
    frame.timestamp = 0;
    return true;
  }

 private:
  const FirstFrame& picture_;
  int num_given_ = 0;
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

Result<RecordedRun> RecordedRun::record(const Tool& tool, const FirstFrame& picture,
                                        const std::vector<Pose>& X_WT) {
  auto folder = temporary_folder();
  if (!folder) return folder.error();
  const auto at = [&](double time) {
    const auto i = static_cast<std::size_t>(std::lround(kRate * time));
    return X_WT[std::min(i, X_WT.size() - 1)];
  };
  DeviceLimits limits;
  limits.max_force = 10;
  auto device = make_path_device(
      {at, static_cast<double>(X_WT.size()) / kRate, kRate, limits, "the hand of the evaluation"});
  if (!device) return device.error();
  RunSettings settings;
  settings.coupling.kind = CouplingKind::none;
  settings.contact_rate = kRate;
  settings.num_threads = 1;
  RunOptions options;
  options.clock.ends_with_frames = false;
  StillPicture source(picture);
  const auto done = record_run(tool, source, **device, settings, **folder / "recorded", options);
  if (!done) return done.error();
  if (!done->failure.empty()) return Error{Errc::bad_input, done->failure};
  return RecordedRun(*std::move(folder));
}

Result<std::vector<Penetration>> RecordedRun::by(const ContactOptions& options) const {
  std::vector<Penetration> measured;
  RunMonitor monitor;
  monitor.observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    for (const TickRecord& tick : ticks) measured.push_back(tick.penetration);
  };
  RunOptions run;
  run.monitor = &monitor;
  const auto done = retry_run(
      *folder_ / "recorded", *folder_ / "again",
      [&](RunSettings& settings) -> Status {
        settings.contact = options;
        return Done{};
      },
      run);
  if (!done) return done.error();
  if (!done->run.failure.empty()) return Error{Errc::bad_input, done->run.failure};
  return measured;
}

}  // namespace palpate::eval
