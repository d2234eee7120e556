// A thread with a metronome: the clock of devices that do not bring their own.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <thread>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Runs rounds at absolute times of the monotonic clock, so that lateness does not add up. Beats
/// that were overslept are left out, never made up for in a burst. Nothing is allocated between
/// start and the end.
class PeriodicThread {
 public:
  /// `time`: s, monotonic; `periods`: beats since the last round, 1 when in time. Returns false to
  /// make this round the last one.
  using Round = std::function<bool(double time, int periods)>;

  PeriodicThread() = default;
  ~PeriodicThread() { stop(); }
  PeriodicThread(const PeriodicThread&) = delete;
  PeriodicThread& operator=(const PeriodicThread&) = delete;

  /// `rate` rounds a second from now on. `finish` runs in the same thread after the last round, for
  /// whichever reason it was the last. Errors: runs already; the system gives no thread.
  Status start(double rate, Round round, std::function<void()> finish);
  /// Stops: no round runs or comes any more, and `finish` has run. From within a round: this one is
  /// the last.
  void stop() noexcept;
  /// The same for rounds that may hang: waits for about `patience` seconds in which this program
  /// runs. False: the thread is given up. Should it come back, it calls `finish` and no round. So
  /// both must own all that they need.
  bool stop_within(double patience) noexcept;

 private:
  struct Shared {
    std::atomic<std::thread::id> running;  // of the thread while it runs: what rounds may read
    std::atomic<bool> wants_stop = false, has_ended = false;
  };
  bool request_stop() noexcept;

  std::thread thread_;
  std::shared_ptr<Shared> shared_ = std::make_shared<Shared>();
};

}}  // namespace palpate::v0
