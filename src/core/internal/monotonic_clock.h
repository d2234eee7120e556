// The clock that everything live is timed by, and sleeping by it.
#pragma once

namespace palpate { inline namespace v0 {

/// The monotonic clock of this computer, s: DeviceState::time.
double monotonic_now() noexcept;

/// Returns the CPU time of the calling thread, s: without the time that it waited or that others
/// ran on its core. 0 where the system does not report it.
double thread_cpu_now() noexcept;

/// Sleeps until monotonic_now() is `time`. No allocation.
void sleep_until(double time) noexcept;

}}  // namespace palpate::v0
