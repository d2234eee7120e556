// A run for as long as wanted, while all that can happen to it does: faults by a plan, settings
// that change, pages that come and go, a recording in parts of which the old ones go.
//
//   soak [--minutes 10] [--simulated] [--seed 1]
//
// Simulated: on a simulated clock, as fast as it can be computed; else live, with a simulated hand.
// Afterwards: memory has stood still, every planned fault was found by its name and in its time and
// passed, the recording is no longer than it may be, and random parts of it repeat to the bit.
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "palpate/devices/devices.h"
#include "palpate/session/run.h"
#include "palpate/viewer/viewer.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_reader.h"
#include "tests/session/path_run.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/sanitized.h"
#include "tests/test_util/temporary_folder.h"
#include "tests/viewer/page_client.h"

namespace palpate {
namespace {

struct Options {
  double minutes = 10;
  bool is_simulated = false;
  unsigned seed = 1;
};

// Plan of the faults: one every twelve seconds or so.

enum class Trouble { silent_device, nonsense, stalled_camera, motors_off, leap_of_clock };
constexpr int kNumTroubles = 5;
struct Planned {
  double time = 0;  // s of the run
  Trouble trouble = Trouble::nonsense;
};

std::vector<Planned> make_plan(double seconds, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> gap(10, 14);
  std::vector<Planned> plan;
  for (double time = 5; (time += gap(random)) < seconds - 5;) {
    plan.push_back({time, static_cast<Trouble>(random() % kNumTroubles)});
  }
  return plan;
}

constexpr double kSeconds[kNumTroubles] = {0.05, 0.02, 0.9, 0.02, 0.02};  // of each: it is one
constexpr Fault kFaults[kNumTroubles] = {Fault::device, Fault::not_finite, Fault::stale_sensor,
                                         Fault::device, Fault::loop};
constexpr double kLeap = 0.3;  // s, backwards

/// The trouble at this time.
std::optional<Trouble> trouble_at(const std::vector<Planned>& plan, double time) {
  const auto next = std::upper_bound(plan.begin(), plan.end(), time,
                                     [](double t, const Planned& p) { return t < p.time; });
  if (next == plan.begin()) return std::nullopt;
  const Planned& last = *std::prev(next);
  if (time - last.time > kSeconds[static_cast<int>(last.trouble)]) return std::nullopt;
  return last.trouble;
}

/// Outcome of the plan, by the ticks of the run.
class Found {
 public:
  explicit Found(const std::vector<Planned>& plan) : plan_(plan), fates_(plan.size()) {}

  void look(const TickRecord& tick) {
    if (num_ticks_++ == 0) start_ = tick.device.time;
    const double time = tick.device.time - start_;
    const SafetyStatus& now = tick.safety;
    const bool is_new = std::exchange(num_faults_, now.num_faults) != now.num_faults;
    look_at_force(tick, time, is_new);
    while (next_ < plan_.size() && time > end_of(plan_[next_])) ++next_;
    for (std::size_t i = next_; i < plan_.size() && time >= begin_of(plan_[i]); ++i) {
      const Fault own = kFaults[static_cast<int>(plan_[i].trouble)];
      Fate& fate = fates_[i];
      const bool was_away = !fate.is_seen && !was_engaged_ && allowance(plan_[i]) == 0;
      fate.is_seen = true;
      fate.is_found |= is_new && now.fault == own;
      fate.is_covered |= was_away || (is_of_busy_computers(now.fault) && now.fault != own);
    }
    was_engaged_ = now.is_engaged();
  }
  /// Ticks with a force on the hand where there may be none, and faults whose force took longer
  /// than its fade and the longest tick.
  int num_forces_too_late() const { return num_forces_too_late_; }
  /// Number of faults that were found by their name and in their time.
  std::size_t num_found() const { return std::ranges::count_if(fates_, &Fate::is_found); }
  /// Number of faults not found while there was no force: a busy computer had taken it.
  std::size_t num_covered() const {
    return std::ranges::count_if(fates_, [](const Fate& f) { return !f.is_found && f.is_covered; });
  }
  /// Number of faults at a time of which no tick was recorded.
  std::size_t num_unseen() const {
    return std::ranges::count_if(fates_, [](const Fate& f) { return !f.is_seen; });
  }

 private:
  struct Fate {
    bool is_seen = false, is_found = false, is_covered = false;
  };
  void look_at_force(const TickRecord& tick, double time, bool is_new) {
    const SafetyStatus& now = tick.safety;
    const bool has_force = norm(tick.F_H_B.force) > 0 || norm(tick.F_H_B.torque) > 0;
    if (is_new) fault_time_ = time;
    const bool may_have = now.is_engaged() || now.state == ForceState::fading ||
                          now.state == ForceState::waiting;  // a dead-man switch that was let go
    const double longest = SafetyOptions{}.fade_seconds + SafetyOptions{}.max_tick;
    const bool is_late = now.state == ForceState::fading && time > fault_time_ + longest;
    num_forces_too_late_ += has_force && (!may_have || is_late);
  }
  static bool is_of_busy_computers(Fault fault) {
    return fault == Fault::loop || fault == Fault::stale_contact || fault == Fault::stale_sensor;
  }
  /// The clock of a camera is that of the device, but for a second or two; one that has leapt is
  /// off by its leap.
  static double allowance(const Planned& planned) {
    if (planned.trouble == Trouble::leap_of_clock) return kLeap;
    return planned.trouble == Trouble::stalled_camera ? 2 : 0;
  }
  static double begin_of(const Planned& planned) { return planned.time - allowance(planned); }
  static double end_of(const Planned& planned) {
    return planned.time + kSeconds[static_cast<int>(planned.trouble)] + allowance(planned);
  }

  const std::vector<Planned>& plan_;
  std::vector<Fate> fates_;
  std::size_t next_ = 0;
  std::uint64_t num_ticks_ = 0;
  std::uint32_t num_faults_ = 0;
  double start_ = 0, fault_time_ = 0;
  int num_forces_too_late_ = 0;
  bool was_engaged_ = false;
};

/// A wall with bumps that breathes, seen 30 times a second; on the computer's clock a stalled
/// camera sends nothing, on a simulated one its time stamps jump.
class Camera final : public DepthSource {
 public:
  explicit Camera(const std::vector<Planned>& plan) : plan_(plan) {
    info_.width = 80;
    info_.height = 60;
    info_.intrinsics = {75, 75, 39.5, 29.5};
    info_.unit = 0.0005;
    info_.name = "a wall that breathes";
  }
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    double time = number_++ / info_.rate;
    while (trouble_at(plan_, time) == Trouble::stalled_camera) time = number_++ / info_.rate;
    frame.width = info_.width;
    frame.height = info_.height;
    frame.unit = info_.unit;
    frame.timestamp = time;
    frame.pixels.clear();
    const double depth = 0.45 + 0.01 * std::sin(0.7 * time);
    for (int v = 0; v < frame.height; ++v) {
      for (int u = 0; u < frame.width; ++u) {
        const double z = depth + 0.004 * std::sin(0.2 * u + 0.3 * time) * std::cos(0.17 * v);
        const bool is_hole = (u * 7 + v * 3 + number_) % 41 == 0;
        frame.pixels.push_back(is_hole ? 0 : static_cast<std::uint16_t>(z / info_.unit));
      }
    }
    return true;
  }

 private:
  const std::vector<Planned>& plan_;
  DepthStreamInfo info_;
  int number_ = 0;
};

/// In and out of the wall every two seconds.
Pose hand_at(double time) {
  return {{0.005 * std::sin(0.3 * time), 0.004 * std::sin(0.5 * time),
           0.41 + 0.03 * std::sin(3 * time)},
          axis_angle({1, 2, 3}, 0.2 * std::sin(time))};
}

/// A device whose states are what the plan makes of them.
template <class Base>
class Troubled final : public Base {
 public:
  Troubled(std::unique_ptr<Base> device, const std::vector<Planned>& plan)
      : device_(std::move(device)), plan_(plan) {}
  const DeviceInfo& info() const override { return device_->info(); }
  Status start(DeviceTick tick) override {
    return device_->start([this, tick = std::move(tick)](const DeviceState& state) {
      if (!has_begun_.exchange(true)) start_ = state.time;
      DeviceState reported = state;
      const auto trouble = trouble_at(plan_, state.time - start_);
      if (trouble == Trouble::silent_device) reported.is_valid = false;
      if (trouble == Trouble::nonsense) reported.X_BH.translation.x = std::nan("");
      if (trouble == Trouble::motors_off) reported.has_force = false;
      if (trouble == Trouble::leap_of_clock) reported.time -= kLeap;
      const Wrench felt = tick(reported);
      largest_ = std::max(largest_.load(), norm(felt.force));
      return felt;
    });
  }
  void stop() noexcept override { device_->stop(); }
  Status status() const override { return device_->status(); }
  bool step() { return static_cast<SteppedDevice&>(*device_).step(); }
  double largest_force() const { return largest_; }

 private:
  std::unique_ptr<Base> device_;
  const std::vector<Planned>& plan_;
  std::atomic<bool> has_begun_ = false;
  double start_ = 0;
  std::atomic<double> largest_ = 0;
};

// Users in the meantime.

/// A user who changes settings, and pages that come, look, and go without closing.
class Visitors {
 public:
  Visitors(LiveView& view, int port, unsigned seed)
      : turning_([this, &view, seed] { turn(view, seed); }),
        looking_([this, port, seed] { look(port, seed); }) {}
  ~Visitors() {
    is_done_ = true;
    turning_.join();
    looking_.join();
  }
  int num_changes() const { return num_changes_; }
  int num_pages() const { return num_pages_; }

 private:
  void turn(LiveView& view, unsigned seed) {
    static constexpr const char* kCommands[] = {
        R"({"command":"set","key":"coupling.stiffness","value":300})",
        R"({"command":"set","key":"coupling.stiffness","value":600})",
        R"({"command":"set","key":"time.mode","value":"predict"})",
        R"({"command":"set","key":"time.mode","value":"interpolate"})",
        R"({"command":"set","key":"coupling.kind","value":"proxy"})",
        R"({"command":"set","key":"coupling.kind","value":"virtual"})",
        R"({"command":"set","key":"loop.binning","value":2})",
        R"({"command":"set","key":"loop.binning","value":1})",
        R"({"command":"set","key":"loop.spheres","value":60})",
        R"({"command":"set","key":"loop.spheres","value":0})",
        R"({"command":"mark","text":"somebody was here"})"};
    std::mt19937 random(seed);
    while (!is_done_) {
      if (view.command(kCommands[random() % std::size(kCommands)])) ++num_changes_;
      (void)view.command(R"({"command":"force"})");  // after the tool has been let go of in contact
      std::this_thread::sleep_for(std::chrono::milliseconds(200 + random() % 300));
    }
  }
  void look(int port, unsigned seed) {
    std::mt19937 random(seed + 1);
    while (!is_done_) {
      test::PageClient page(port);
      if (page.status() == 101) ++num_pages_;
      page.send(R"({"command":"show","what":["frame","contact","normals","samples"]})");
      test::Received message;
      for (unsigned i = random() % 40; i > 0 && !is_done_; --i) page.receive(message, 0.1);
    }
  }

  std::atomic<bool> is_done_ = false;
  std::atomic<int> num_changes_ = 0, num_pages_ = 0;
  std::thread turning_, looking_;
};

struct Memory {
  double resident = 0, heap = 0;  // MiB
};
Memory memory_now() {
  std::ifstream file("/proc/self/statm");
  long total = 0, resident = 0;
  file >> total >> resident;
  const struct mallinfo2 heap = mallinfo2();
  return {static_cast<double>(resident * sysconf(_SC_PAGESIZE)) / (1 << 20),
          static_cast<double>(heap.uordblks + heap.hblkhd) / (1 << 20)};
}

/// Between the means of the first and the last third of what came after it had settled.
double growth(const std::vector<Memory>& rows, double Memory::*which) {
  const std::size_t begin = rows.size() / 4, third = (rows.size() - begin) / 3;
  const auto mean = [&](std::size_t from) {
    double sum = 0;
    for (std::size_t i = from; i < from + third; ++i) sum += rows[i].*which;
    return sum / static_cast<double>(third);
  };
  return third == 0 ? 0 : mean(rows.size() - third) - mean(begin);
}

RunSettings soak_settings(bool is_simulated) {
  RunSettings settings;
  settings.coupling.kind = CouplingKind::virtual_coupling;
  settings.num_threads = 1;
  settings.safety.energy_tank = 100;  // changes of settings give the hand energy
  settings.safety.max_recoveries = 60;
  settings.safety.recover_seconds = 0.2;
  if (is_simulated) settings.wants_real_time = false;
  return settings;
}

int num_failures = 0;
void expect(bool is_good, const std::string& what) {
  std::printf("%s: %s\n", is_good ? "ok" : "FAILED", what.c_str());
  num_failures += !is_good;
}

/// The first and some of the parts that are gone by the end of a long run, as they were when they
/// had been written.
class KeptParts {
 public:
  KeptParts(std::filesystem::path run, std::filesystem::path folder)
      : run_(std::move(run)), folder_(std::move(folder)) {
    std::filesystem::create_directories(folder_);
  }
  /// Keeps the newest whole part.
  void keep_one() {
    const auto parts = recording_parts(run_);
    if (parts.size() < 2) return;
    const auto& part = parts[parts.size() - 2];  // the last one is being written
    std::error_code ignored;                     // it may just have gone, or been kept
    std::filesystem::create_hard_link(part, folder_ / part.filename(), ignored);
  }
  std::filesystem::path first() const { return folder_ / kRecordingFile; }
  std::vector<std::filesystem::path> all() const {
    std::vector<std::filesystem::path> parts;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
      parts.push_back(entry.path());
    }
    std::sort(parts.begin(), parts.end());
    return parts;
  }

 private:
  std::filesystem::path run_, folder_;
};

template <class Device>
Result<RunOutcome> run(const Options& options, const Tool& tool, Camera& camera, Device& device,
                       LiveView& view, const std::filesystem::path& folder, Found& found,
                       std::vector<Memory>& memory, KeptParts& kept) {
  RunOptions run;
  run.monitor = &view.monitor();
  run.recording = {.keep_seconds = 120, .split_bytes = 2e7};
  const double seconds = 60 * options.minutes;
  if (options.is_simulated) {
    run.clock = {.zero = 0, .ends_with_frames = false};
  } else {
    run.duration = seconds;
  }
  // A row for each sixtieth of the run, by the time of its ticks.
  std::atomic<double> time = 0;
  RunObserver& observer = view.monitor().observer;
  observer.on_ticks = [&, show = observer.on_ticks](std::span<const TickRecord> ticks) {
    time = ticks.back().time;
    for (const TickRecord& tick : ticks) found.look(tick);
    show(ticks);
  };
  run.keep_going = [&] {
    if (!std::filesystem::exists(kept.first())) kept.keep_one();
    if (time >= seconds / 60 * static_cast<double>(memory.size() + 1)) {
      memory.push_back(memory_now());
      if (memory.size() % 8 == 0) kept.keep_one();
    }
    return true;
  };
  return record_run(tool, camera, device, soak_settings(options.is_simulated), folder, run);
}

int soak(const Options& options) {
  const double seconds = 60 * options.minutes, begin = monotonic_now();
  const std::vector<Planned> plan = make_plan(seconds, options.seed);
  const test::TemporaryFolder root;
  const auto folder = root.path() / "run";
  const Tool tool = test::random_tool(120, 0.02, 7);
  Camera camera(plan);
  const auto view = LiveView::create(tool, {camera.info()}, "soak");
  ViewServerOptions server_options;
  server_options.port = 0;
  auto server = ViewServer::start(*view, server_options);
  if (!server) {
    std::printf("FAILED: %s\n", server.error().message.c_str());
    return 1;
  }
  const std::string url = (*server)->url();
  std::vector<Memory> memory;
  KeptParts kept(folder, root.path() / "kept");
  Found found(plan);
  Result<RunOutcome> outcome = Error{};
  double largest = 0, most = 0;
  int num_changes = 0, num_pages = 0;
  {
    Visitors people(*view, std::atoi(url.substr(url.rfind(':') + 1).c_str()), options.seed);
    if (options.is_simulated) {
      auto hand = test::path_device(hand_at, 1000, seconds);
      Troubled<SteppedDevice> device(*std::move(hand), plan);
      outcome = run(options, tool, camera, device, *view, folder, found, memory, kept);
      largest = device.largest_force();
      most = device.info().limits.max_force;
    } else {
      SimulatedDeviceOptions simulated;
      simulated.model = device_models().front();
      simulated.target = hand_at;
      Troubled<HapticDevice> device(*SimulatedDevice::create(simulated), plan);
      outcome = run(options, tool, camera, device, *view, folder, found, memory, kept);
      largest = device.largest_force();
      most = device.info().limits.max_force;
    }
    num_changes = people.num_changes();
    num_pages = people.num_pages();
  }
  if (!outcome) {
    std::printf("FAILED: %s\n", outcome.error().message.c_str());
    return 1;
  }
  const LoopReport& loop = outcome->loop;
  std::printf("%.0f s in %.0f s: %llu ticks, %u faults, %zu of %zu planned, %d changes, %d pages\n",
              loop.seconds, monotonic_now() - begin,
              static_cast<unsigned long long>(loop.num_ticks), loop.num_faults, found.num_found(),
              plan.size(), num_changes, num_pages);
  expect(outcome->failure.empty() && outcome->not_kept.empty(),
         "the run ended as it should: " + outcome->failure + outcome->not_kept);
  expect(loop.seconds >= seconds - 2, "it went on to its end");
  // On a computer that is too busy, its own faults may have taken the force before, or the records
  // of that time may be lost.
  const std::size_t num_covered = found.num_covered();
  const std::size_t num_unseen = loop.num_lost_records > 0 ? found.num_unseen() : 0;
  const bool is_exact = found.num_found() == plan.size() && loop.num_faults == plan.size();
  expect((is_exact || !options.is_simulated) &&
             found.num_found() + num_covered + num_unseen == plan.size() &&
             2 * found.num_found() > plan.size(),
         "every planned fault was found by its name and in its time: " +
             std::to_string(found.num_found()) + "; while a busy computer held the force back " +
             std::to_string(num_covered) + ", while records were lost " +
             std::to_string(num_unseen) + "; faults in all " + std::to_string(loop.num_faults));
  expect(outcome->peaks.num_engaged > 0.7 * static_cast<double>(loop.num_ticks),
         "the force came back: it was there at " + std::to_string(outcome->peaks.num_engaged) +
             " ticks");
  expect(largest > 0.1 && largest <= most, "the force kept its limit: " + std::to_string(largest));
  expect(found.num_forces_too_late() == 0, "no force was there for longer than its fade: " +
                                               std::to_string(found.num_forces_too_late()));
  expect(num_changes > 10 && num_pages > 3, "settings changed and pages came");
  char text[160];
  std::snprintf(text, sizeof text, "memory stood still: resident %+.2f MiB, heap %+.2f MiB",
                growth(memory, &Memory::resident), growth(memory, &Memory::heap));
  const bool is_flat = growth(memory, &Memory::resident) < 8 && growth(memory, &Memory::heap) < 8;
  expect(memory.size() >= 20 && (is_flat || test::kIsSanitized), text);

  auto parts = recording_parts(folder);
  std::uintmax_t bytes = 0;
  for (const auto& part : parts) bytes += std::filesystem::file_size(part);
  expect(parts.size() >= 3 && parts.size() <= 40, std::to_string(parts.size()) +
                                                      " parts of the recording, " +
                                                      std::to_string(bytes >> 20) + " MiB");
  std::mt19937 random(options.seed);
  std::shuffle(parts.begin(), parts.end(), random);
  parts.resize(std::min<std::size_t>(parts.size(), 4));
  parts.push_back(folder);
  const auto early = kept.all();
  parts.insert(parts.end(), early.begin(), early.end());
  const bool is_lossy = !options.is_simulated && loop.num_lost_records > 0;
  for (const auto& part : parts) {
    std::uint64_t num_ticks = 0, next = 0, num_missing = 0;
    TickRecord tick;
    auto reader = RunReader::open(part);
    Result<bool> got = reader ? reader->next_tick(tick) : reader.error();
    for (; got && *got; got = reader->next_tick(tick)) {
      if (num_ticks++ > 0) num_missing += tick.number - next;
      next = tick.number + 1;
    }
    expect(got && num_ticks > 0 && (num_missing == 0 || is_lossy),
           part.filename().string() + " can be read: " + std::to_string(num_ticks) + " ticks, " +
               std::to_string(num_missing) + " are missing " + (got ? "" : got.error().message));
  }
  const auto replay = replay_run(kept.first());
  expect(replay && replay->difference.empty() && (replay->note.empty() || is_lossy),
         "the first part repeats to the bit: " +
             (replay ? std::to_string(replay->num_ticks) + " ticks " + replay->difference +
                           replay->note
                     : replay.error().message));
  return num_failures == 0 ? 0 : 1;
}

}  // namespace
}  // namespace palpate

int main(int argc, char** argv) {
  std::setvbuf(stdout, nullptr, _IOLBF, BUFSIZ);  // what was said stays, whatever happens
  mallopt(M_ARENA_MAX, 1);  // so that the heap that is measured is that of all threads
  palpate::Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const bool has_value = i + 1 < argc;
    if (word == "--simulated") {
      options.is_simulated = true;
    } else if (word == "--minutes" && has_value) {
      options.minutes = std::atof(argv[++i]);
    } else if (word == "--seed" && has_value) {
      options.seed = static_cast<unsigned>(std::atoi(argv[++i]));
    } else {
      std::fprintf(stderr, "soak: unknown option %s\n", argv[i]);
      return 2;
    }
  }
  return palpate::soak(options);
}
