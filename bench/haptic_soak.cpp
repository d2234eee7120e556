// The whole haptic loop for any time: a simulated hand explores a simulated scene in real time.
// Reports latencies, and allocations and growth of memory during the run.
//   haptic_soak [--seconds 600] [--spheres 5000] [--method field] [--device touch] [--scene NAME]
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>
#include <thread>
#include <utility>

#include "bench/haptic_setup.h"
#include "palpate/devices/devices.h"
#include "palpate/run/run_loop.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/devices/transport/periodic_thread.h"
#include "src/run/internal/real_time.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate::bench {
namespace {

struct Options {
  double seconds = 600;
  int spheres = 5000;
  std::string method = "field", device = "touch", scene = "moving-box", backend = "cpu", csv;
  double ticks_per_second = 1000;
  int threads = 1;
  double patience = 0.02;  // s
};

/// Resident memory of this process, MiB.
double resident_mebibytes() {
  std::ifstream file("/proc/self/statm");
  long total = 0, resident = 0;
  file >> total >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1 << 20);
}

/// The pose in the middle of the scene's tool path, where it touches, and the hand's motion around
/// it: the path itself, back and forth with the frames, within the device's workspace.
struct Hand {
  Pose X_WB;
  HandTarget target;
};
Hand hand_for(const scenes::Scene& scene, double radius) {
  const auto& poses = scene.path_poses;
  const Pose X_WB = poses[poses.size() / 2];
  auto path = [&scene](double t) {
    const auto& times = scene.path_times;
    const auto next = std::upper_bound(times.begin(), times.end(), t);
    if (next == times.begin()) return scene.path_poses.front();
    if (next == times.end()) return scene.path_poses.back();
    const auto i = static_cast<std::size_t>(next - times.begin());
    return interpolate(scene.path_poses[i - 1], scene.path_poses[i],
                       (t - times[i - 1]) / (times[i] - times[i - 1]));
  };
  double farthest = 0;
  for (const Pose& X_WT : poses) {
    farthest = std::max(farthest, norm(X_WT.translation - X_WB.translation));
  }
  const double share = std::min(1.0, 0.8 * radius / farthest);
  const double duration = scene.duration;
  return {X_WB, [=, X_BW = inverse(X_WB)](double time) {
            const double turn = std::fmod(time, 2 * duration);
            Pose X_BT = X_BW * path(turn < duration ? turn : 2 * duration - turn);
            X_BT.translation = share * X_BT.translation;
            return X_BT;
          }};
}

/// Rows of results, printed and written.
class Table {
 public:
  void add(const std::string& name, double value, const char* unit) {
    std::printf("%-28s %12.5g %s\n", name.c_str(), value, unit);
    rows_ += name + "," + std::to_string(value) + "," + unit + "\n";
  }
  void add(const std::string& name, const LatencyHistogram& histogram, double unit,
           const char* unit_name) {
    const LatencyHistogram::Summary s = histogram.summary();
    std::printf("%-22s %10llu %10.4g %10.4g %10.4g %10.4g %s\n", name.c_str(),
                static_cast<unsigned long long>(s.num), s.p50 * unit, s.p99 * unit, s.p999 * unit,
                s.max * unit, unit_name);
    const std::pair<const char*, double> columns[] = {
        {"p50", s.p50}, {"p99", s.p99}, {"p99.9", s.p999}, {"max", s.max}};
    for (const auto& [column, value] : columns) {
      rows_ += name + " " + column + "," + std::to_string(value * unit) + "," + unit_name + "\n";
    }
  }
  bool write(const std::string& path, const std::string& what) const {
    std::ofstream file(path);
    file << "# " << what << "\nquantity,value,unit\n" << rows_;
    return static_cast<bool>(file.flush());
  }

 private:
  std::string rows_;
};

/// Latency floor of the machine: ticks with a constant computation of a few microseconds, in
/// real time, beside an ordinary busy thread like the one that computes surfaces.
struct Floor {
  LatencyHistogram wall, cpu, period;
};
Status measure_floor(double seconds, double rate, Floor& floor) {
  std::atomic<bool> is_done = false;
  std::atomic<double> sink = 0;
  const auto work = [&sink](int rounds) {
    double x = 0.5;
    for (int i = 0; i < rounds; ++i) x = 3.7 * x * (1 - x);  // chaotic: cannot be optimized away
    sink.store(x, std::memory_order_relaxed);
  };
  std::thread busy([&] {
    while (!is_done.load()) work(10000);
  });
  PeriodicThread ticks;
  double last = 0;
  const Status started = ticks.start(
      rate,
      [&](double, int) {
        const double begin = monotonic_now(), cpu_begin = thread_cpu_now();
        work(1500);
        const double computed = thread_cpu_now() - cpu_begin, took = monotonic_now() - begin;
        floor.cpu.record(static_cast<std::int64_t>(1e9 * computed));
        floor.wall.record(static_cast<std::int64_t>(1e9 * took));
        if (last > 0) {
          floor.period.record(static_cast<std::int64_t>(1e9 * (begin - last)));
        } else {
          request_real_time(80);
        }
        last = begin;
        return true;
      },
      [] {});
  if (started) std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  ticks.stop();
  is_done.store(true);
  busy.join();
  return started;
}

Status soak(const Options& options, const std::string& command) {
  const auto method = value_named<MethodKind>(options.method);
  const auto backend = value_named<Backend>(options.backend);
  const auto model = find_device_model(options.device);
  if (!method || !backend || !model) {
    return Error{Errc::invalid_argument, "no such method, backend or device"};
  }
  auto scene = scenes::make_scene(options.scene);
  if (!scene) return scene.error();
  if (scene->path_poses.empty()) {
    return Error{Errc::invalid_argument, "the scene has no path of its own; choose another one"};
  }

  std::printf("packing %d spheres and drawing %g s of %s ...\n", options.spheres, scene->duration,
              options.scene.c_str());
  auto tool = tool_for(*scene, options.spheres);
  if (!tool) return tool.error();
  DepthStreamInfo stream;
  auto frames = frames_of(*scene, {}, stream);
  if (!frames) return frames.error();
  LoopedSource source(stream, *std::move(frames));

  const Hand hand = hand_for(*scene, model->limits.workspace_radius);
  SimulatedDeviceOptions device_options;
  device_options.model = *model;
  device_options.target = hand.target;
  device_options.rate = options.ticks_per_second;
  auto device = SimulatedDevice::create(device_options);
  if (!device) return device.error();

  RunSettings settings;
  settings.contact.method = *method;
  settings.backend = *backend;
  settings.num_threads = options.threads;
  settings.coupling.X_WB = hand.X_WB;
  settings.safety.max_contact_age = settings.safety.max_tick = settings.safety.max_device_silence =
      options.patience;
  Floor floor;
  if (const Status measured = measure_floor(std::clamp(options.seconds / 10, 1.0, 30.0),
                                            options.ticks_per_second, floor);
      !measured) {
    return measured;
  }
  auto loop = RunLoop::create(*tool, source, **device, settings);
  if (!loop) return loop.error();
  if (const Status started = (*loop)->start(); !started) return started;

  // Waits until every thread has warmed up.
  std::this_thread::sleep_for(std::chrono::duration<double>(std::min(1.0, options.seconds / 10)));
  const double memory_before = resident_mebibytes();
  const test::AllocationCounter allocations;
  double max_energy = 0, max_force = 0;
  std::uint64_t in_contact = 0, looked = 0;
  const auto end =
      std::chrono::steady_clock::now() + std::chrono::duration<double>(options.seconds);
  while ((*loop)->is_running() && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    const auto record = (*loop)->latest();
    if (!record) continue;
    max_energy = std::max(max_energy, record->safety.energy);
    max_force = std::max(max_force, norm(record->F_H_B.force));
    in_contact += record->penetration.volume > 0 ? 1 : 0;
    ++looked;
  }
  const std::size_t num_allocations = allocations.count();
  const double memory_after = resident_mebibytes();
  (*loop)->stop();

  const LoopReport report = (*loop)->report();
  const LoopTimes& times = (*loop)->times();
  Table table;
  std::printf("%-22s %10s %10s %10s %10s %10s\n", "", "number", "p50", "p99", "p99.9", "max");
  table.add("bare tick", floor.wall, 1, "us");
  table.add("bare tick CPU time", floor.cpu, 1, "us");
  table.add("bare tick period", floor.period, 1, "us");
  table.add("haptic compute", times.haptic_compute, 1, "us");
  table.add("haptic CPU time", times.haptic_cpu, 1, "us");
  table.add("haptic period", times.haptic_period, 1, "us");
  table.add("contact compute", times.contact_compute, 1, "us");
  table.add("contact age", times.contact_age, 1e-3, "ms");
  table.add("surface compute", times.surface_compute, 1e-3, "ms");
  table.add("sensor to force", times.sensor_to_force, 1e-3, "ms");
  table.add("time", report.seconds, "s");
  table.add("ticks", static_cast<double>(report.num_ticks), "");
  table.add("contacts", static_cast<double>(report.num_contacts), "");
  table.add("frames", static_cast<double>(report.num_frames), "");
  table.add("missed ticks", static_cast<double>(report.num_missed), "");
  table.add("share in contact",
            100 * static_cast<double>(in_contact) /
                static_cast<double>(std::max<std::uint64_t>(looked, 1)),
            "%");
  table.add("largest force", max_force, "N");
  table.add("most energy given", max_energy, "J");
  table.add("allocations after start", static_cast<double>(num_allocations), "");
  table.add("memory at start", memory_before, "MiB");
  table.add("memory at end", memory_after, "MiB");
  for (const std::string& note : report.notes) std::printf("note: %s\n", note.c_str());
  if (report.fault != Fault::stopped) {
    std::printf("ended early: %s\n", std::string(describe(report.fault)).c_str());
  }
  if (!options.csv.empty() && !table.write(options.csv, command)) {
    return Error{Errc::io_failure, "cannot write " + options.csv};
  }
  return (*loop)->status();
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  palpate::bench::Options options;
  CLI::App app("Haptic loop in real time: a simulated hand on a simulated scene.");
  app.add_option("--seconds", options.seconds)->check(CLI::Range(1.0, 1e6));
  app.add_option("--spheres", options.spheres)->check(CLI::Range(1, 100000));
  app.add_option("--method", options.method);
  app.add_option("--device", options.device);
  app.add_option("--scene", options.scene);
  app.add_option("--backend", options.backend);
  app.add_option("--rate", options.ticks_per_second, "ticks per second");
  app.add_option("--threads", options.threads, "for surfaces");
  app.add_option("--patience", options.patience,
                 "s: how late contact and ticks may be; raise it on a busy machine");
  app.add_option("--csv", options.csv, "also written to this file");
  CLI11_PARSE(app, argc, argv);
  std::string command = "haptic_soak";
  for (int i = 1; i < argc; ++i) command += std::string(" ") + argv[i];
  const palpate::Status done = palpate::bench::soak(options, command);
  if (done) return 0;
  std::fprintf(stderr, "haptic_soak: %s\n", done.error().message.c_str());
  return 1;
}
