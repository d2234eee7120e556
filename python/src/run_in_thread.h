// A run in a C++ thread that continues while Python does other things.
#pragma once

#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "palpate/run/records.h"
#include "palpate/session/run.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "python/src/python_device.h"

namespace palpate::python {

/// Class palpate.Tick: one tick of a run.
struct PyTick {
  TickRecord record;
};

/// The inputs of a run, which owns them.
struct RunRequest {
  PyTool tool;
  std::vector<std::shared_ptr<DepthSource>> sources;
  std::unique_ptr<HapticDevice> device;
  std::shared_ptr<nb::object> raised_by_device;  ///< of a PythonDevice
  RunSettings settings;
  RunOptions options;
  std::filesystem::path folder;
  nb::object on_tick;
};

/// Calls record_run in a thread. From Python's threads, with the GIL.
class RunInThread {
 public:
  /// Starts the run.
  explicit RunInThread(RunRequest request);
  ~RunInThread();
  RunInThread(const RunInThread&) = delete;
  RunInThread& operator=(const RunInThread&) = delete;

  /// Waits until it ticks or has ended. palpate.Error: it failed to start.
  void wait_for_ticks();
  /// Ends the run soon: the force fades out first.
  void stop() { is_stopping_ = true; }
  bool is_running() const { return !has_ended_; }
  /// Waits for its end, at most `seconds`; false: it still runs. Ctrl-C ends the run and is raised.
  /// Raises exceptions of on_tick or the device again; palpate.Error: the run failed to start, or
  /// ended in a failure.
  bool wait(std::optional<double> seconds);
  /// Returns the newest tick; none if there was none yet.
  std::optional<TickRecord> latest() const;
  void mark(std::string text) { monitor_.marks.add(std::move(text)); }
  std::vector<std::string> notes() const;

 private:
  void run();
  void finish();
  void hear(std::span<const TickRecord> ticks);
  bool wait_without_gil(double seconds, bool until_ticking);
  void raise_what_went_wrong();

  RunRequest request_;
  RunMonitor monitor_;
  std::atomic<bool> is_stopping_ = false, has_ended_ = false;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<TickRecord> latest_;
  std::vector<std::string> notes_;
  std::optional<Error> error_;
  nb::object raised_;
  std::thread thread_;
};

}  // namespace palpate::python
