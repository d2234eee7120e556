// A run that goes on in a thread of C++ while Python does something else.
#pragma once

#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "palpate/session/run.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "python/src/python_device.h"

namespace palpate::python {

/// All that a run needs, and owns.
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

/// record_run in a thread. From Python's threads, with the GIL.
class RunInThread {
 public:
  /// Begins.
  explicit RunInThread(RunRequest request);
  ~RunInThread();
  RunInThread(const RunInThread&) = delete;
  RunInThread& operator=(const RunInThread&) = delete;

  /// Until it ticks or has ended. palpate.Error: nothing has run.
  void wait_for_ticks();
  /// Ends the run soon: the force fades out first.
  void stop() { is_stopping_ = true; }
  bool is_running() const { return !has_ended_; }
  /// Until it has ended, or so many seconds; was it in time? Ctrl-C ends the run and is raised.
  /// What on_tick or the device raised is raised; palpate.Error: nothing has run, or it ended in a
  /// failure.
  bool wait(std::optional<double> seconds);
  /// The newest tick; none: there was none yet.
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
