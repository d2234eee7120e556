// The haptic thread's work at each tick: from the pose of the hand to its wrench.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>

#include "palpate/run/run_loop.h"
#include "src/core/internal/triple_buffer.h"
#include "src/run/internal/pipeline.h"
#include "src/run/loop/contact_stage.h"
#include "src/run/loop/queues/mailbox.h"
#include "src/run/loop/queues/record_queue.h"
#include "src/run/loop/surface_stage.h"

namespace palpate { inline namespace v0 {

/// Another coupling; null: only the revision changes. Once settled, it holds the previous one.
struct HapticChange {
  std::uint32_t revision = 0;
  std::unique_ptr<Coupling> coupling;
};

/// `tick` never allocates, locks or waits.
class HapticStage {
 public:
  struct Settings {
    double tick_seconds = 1e-3;
    bool wants_real_time = true;
    bool keeps_records = false;
  };
  HapticStage(HandPart hand, SurfaceStage& surfaces, ContactStage& contacts,
              const Settings& settings, LoopTimes& times);

  /// Before the device starts: when the loop began, s, monotonic.
  void set_start_time(double time) noexcept { hand_.set_start_time(time); }

  /// Haptic thread.
  Wrench tick(const DeviceState& state) noexcept;

  // Any thread.
  /// Lets the force fade out.
  void request_stop() noexcept { wants_stop_.store(true, std::memory_order_release); }
  /// Lets the force return after a fault; requests before the next tick count as one.
  void request_force() noexcept { wants_force_.store(true, std::memory_order_release); }
  /// Suspends the force, as a fault does, or resumes it.
  void suspend(bool is_suspended) noexcept {
    is_suspended_.store(is_suspended, std::memory_order_release);
  }
  /// True once the device has had no force at a tick since it was suspended.
  bool is_without_force() const noexcept {
    return num_without_force_.load(std::memory_order_acquire) > 1;
  }
  /// True once the force has faded out for good.
  bool has_faded() const noexcept { return has_faded_.load(std::memory_order_acquire); }
  Mailbox<HapticChange>& changes() noexcept { return changes_; }
  /// The lasting fault, if there is one.
  Fault fault() const noexcept { return fault_; }
  std::uint32_t num_faults() const noexcept { return num_faults_; }
  std::uint64_t num_ticks() const noexcept { return num_ticks_.load(std::memory_order_acquire); }
  std::uint64_t num_missed() const noexcept { return num_missed_; }
  std::uint64_t num_lost() const noexcept { return records_.num_lost(); }
  /// Error number of the request for real time; 0: granted or not requested.
  int real_time_error() const noexcept { return real_time_error_.load(); }
  /// The newest tick; one reader.
  std::optional<TickRecord> latest() noexcept;
  /// Publishing thread; empty unless records are kept.
  RecordQueue<TickRecord>& records() noexcept { return records_; }
  /// Likewise, snapshots of the hand, one a second.
  RecordQueue<HandSnapshot>& snapshots() noexcept { return snapshots_; }

 private:
  /// Start of a tick, s: on the clock, and in CPU time of the thread.
  struct TickStart {
    double time, cpu;
  };

  void keep_time(const TickStart& start, const TickRecord& record) noexcept;

  SurfaceStage& surfaces_;
  ContactStage& contacts_;
  const Settings settings_;
  LoopTimes& times_;

  // Used by the haptic thread only.
  HandPart hand_;
  double last_begin_ = 0;

  // Shared by the haptic thread and others.
  Mailbox<HapticChange> changes_;
  TripleBuffer<TickRecord> newest_;
  RecordQueue<TickRecord> records_;
  RecordQueue<HandSnapshot> snapshots_;
  std::atomic<std::uint64_t> num_ticks_ = 0, num_missed_ = 0;
  std::atomic<Fault> fault_ = Fault::none;
  std::atomic<std::uint32_t> num_faults_ = 0;
  std::atomic<bool> wants_stop_ = false, wants_force_ = false, has_faded_ = false;
  std::atomic<bool> is_suspended_ = false;
  std::atomic<int> num_without_force_ = 0;  // ticks in a row, while it is suspended
  std::atomic<int> real_time_error_ = 0;
};

}}  // namespace palpate::v0
