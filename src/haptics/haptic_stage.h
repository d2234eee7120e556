// What the device's own thread does at each tick: from where the hand is to what it feels.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>

#include "palpate/core/triple_buffer.h"
#include "palpate/haptics/haptic_loop.h"
#include "src/haptics/contact_stage.h"
#include "src/haptics/handover.h"
#include "src/haptics/record_queue.h"
#include "src/haptics/surface_stage.h"

namespace palpate {

/// Another coupling, or none: only the number changes. Once settled, the one before.
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
  HapticStage(std::unique_ptr<Coupling> coupling, SafetyFilter safety, SurfaceStage& surfaces,
              ContactStage& contacts, const Settings& settings, LoopTimes& times);

  /// Before the first tick: when the loop began, s, monotonic.
  void set_start_time(double time) noexcept { start_time_.store(time); }

  /// Haptic thread.
  Wrench tick(const DeviceState& state) noexcept;

  // Any thread.
  /// The force fades out.
  void ask_to_stop() noexcept { wants_stop_.store(true, std::memory_order_release); }
  bool has_faded() const noexcept { return has_faded_.load(std::memory_order_acquire); }
  Handover<HapticChange>& changes() noexcept { return changes_; }
  Fault fault() const noexcept { return fault_; }
  std::uint64_t num_ticks() const noexcept { return num_ticks_.load(std::memory_order_acquire); }
  std::uint64_t num_missed() const noexcept { return num_missed_; }
  std::uint64_t num_lost() const noexcept { return records_.num_lost(); }
  /// Of asking for real time; 0: granted or not wanted.
  int real_time_error() const noexcept { return real_time_error_.load(); }
  /// The newest tick; one reader.
  bool latest(HapticRecord& record) noexcept;
  /// Publishing thread; empty unless records are kept.
  RecordQueue<HapticRecord>& records() noexcept { return records_; }

 private:
  /// When a tick began: by the clock, and by what the thread has computed until then.
  struct TickStart {
    double time, cpu;
  };

  double step_seconds(const DeviceState& state) noexcept;
  void take_change() noexcept;
  void keep_time(const TickStart& start, const HapticRecord& record) noexcept;

  SurfaceStage& surfaces_;
  ContactStage& contacts_;
  const Settings settings_;
  LoopTimes& times_;

  // Of the haptic thread.
  std::unique_ptr<Coupling> coupling_;
  SafetyFilter safety_;
  std::uint32_t revision_ = 0;
  bool has_tool_ = false, is_stopping_ = false;
  double last_state_time_ = 0, last_begin_ = 0, first_tick_ = 0;

  // Between the haptic thread and others.
  Handover<HapticChange> changes_;
  TripleBuffer<HapticRecord> newest_;
  RecordQueue<HapticRecord> records_;
  std::atomic<std::uint64_t> num_ticks_ = 0, num_missed_ = 0;
  std::atomic<Fault> fault_ = Fault::none;
  std::atomic<bool> wants_stop_ = false, has_faded_ = false;
  std::atomic<int> real_time_error_ = 0;
  std::atomic<double> start_time_ = 0;
};

}  // namespace palpate
