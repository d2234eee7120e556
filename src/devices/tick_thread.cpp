#include "src/devices/tick_thread.h"

#include <pthread.h>
#include <sched.h>
#include <time.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <system_error>
#include <utility>

namespace palpate {
namespace {

constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;

std::int64_t now() noexcept {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void sleep_until(std::int64_t moment) noexcept {
  const timespec when{static_cast<time_t>(moment / kNanosecondsPerSecond),
                      static_cast<long>(moment % kNanosecondsPerSecond)};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &when, nullptr) == EINTR) {
  }
}

/// Above all ordinary threads, below the kernel's own. Where it is not allowed, the loop goes on
/// as well as it can.
void ask_for_real_time() noexcept {
  sched_param parameters{};
  parameters.sched_priority = 80;
  pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
}

}  // namespace

double monotonic_seconds() noexcept { return 1e-9 * static_cast<double>(now()); }

Status TickThread::start(double rate, Round round, std::function<void()> finish) {
  if (thread_.joinable())
    return Error{Errc::invalid_argument, "the device is running already; stop it first"};
  wants_stop_.store(false);
  const auto period = std::llround(static_cast<double>(kNanosecondsPerSecond) / rate);
  auto run = [this, period, round = std::move(round), finish = std::move(finish)] {
    running_.store(std::this_thread::get_id());
    ask_for_real_time();
    std::int64_t due = now(), last = due - period;
    while (!wants_stop_.load(std::memory_order_acquire)) {
      const auto periods = static_cast<int>((due - last) / period);
      if (!round(1e-9 * static_cast<double>(now()), periods)) break;
      last = due;
      // The next beat that lies ahead.
      due += period * std::max<std::int64_t>(1, (now() - due) / period + 1);
      sleep_until(due);
    }
    finish();
    running_.store({});
  };
  try {
    thread_ = std::thread(std::move(run));
  } catch (const std::system_error& error) {
    return Error{Errc::unavailable, std::string("the system gives no thread for the device: ") +
                                        error.what() + "; end other programs and try again"};
  }
  return Done{};
}

void TickThread::stop() noexcept {
  wants_stop_.store(true, std::memory_order_release);
  if (running_.load() == std::this_thread::get_id()) return;
  if (thread_.joinable()) thread_.join();
}

}  // namespace palpate
