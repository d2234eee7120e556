#include "src/core/internal/monotonic_clock.h"

#include <time.h>

#include <cerrno>
#include <chrono>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

double seconds_of(const timespec& time) {
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace

double monotonic_now() noexcept {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double thread_cpu_now() noexcept {
#if defined(CLOCK_THREAD_CPUTIME_ID)
  timespec now{};
  return clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now) == 0 ? seconds_of(now) : 0;
#else
  return monotonic_now();  // the only thread
#endif
}

void sleep_until(double time) noexcept {
  const double whole = std::floor(time);
  const timespec when{static_cast<time_t>(whole), static_cast<long>(1e9 * (time - whole))};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &when, nullptr) == EINTR) {
  }
}

}}  // namespace palpate::v0
