// Real-time scheduling and locked memory for threads.
#pragma once

#include <cstdint>
#include <string>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// SCHED_FIFO for the calling thread, unless a driver has given it a real-time class already. 0 or
/// the error number. No allocation.
int request_real_time(int priority) noexcept;

/// Returns the number of threads to compute with, of those allowed (0: any number): at most one for
/// each core, as more would only wait for each other.
int num_threads_for(int allowed) noexcept;

/// Keeps the program's memory from being paged out, as long as any of these holds it: several runs
/// of one program share it.
class MemoryLock {
 public:
  MemoryLock() = default;
  ~MemoryLock() { release(); }
  MemoryLock(const MemoryLock&) = delete;
  MemoryLock& operator=(const MemoryLock&) = delete;

  /// Locks all memory that exists now; called again, memory that has come since. 0 or the error
  /// number.
  int hold() noexcept;
  void release() noexcept;
  bool is_held() const noexcept { return is_held_; }

 private:
  bool is_held_ = false;
};

/// One sentence for humans: what was refused, and what to do.
std::string scheduler_refused(const char* which_thread, int error_number);
std::string memory_lock_refused(int error_number);
/// Explains why depth frames were left out: `num_late` came too late by themselves; `period`, s, is
/// the time between two.
std::string frames_left_out(std::uint64_t num, std::uint64_t num_late,
                            const LatencyHistogram& surface_compute, double period);

}}  // namespace palpate::v0
