#include "src/devices/transport/periodic_thread.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <utility>

#include "src/core/internal/guarded.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;

std::int64_t now() noexcept {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

Status PeriodicThread::start(double rate, Round round, std::function<void()> finish) {
  if (thread_.joinable())
    return Error{Errc::invalid_argument, "the device is running already; stop it first"};
  shared_ = std::make_shared<Shared>();
  const auto period = std::llround(static_cast<double>(kNanosecondsPerSecond) / rate);
  const auto tick_all = [shared = shared_, period, round = std::move(round)] {
    std::int64_t due = now(), last = due - period;
    while (!shared->wants_stop.load(std::memory_order_acquire)) {
      const auto periods = static_cast<int>((due - last) / period);
      if (!round(1e-9 * static_cast<double>(now()), periods)) break;
      last = due;
      // The next beat that lies ahead.
      due += period * std::max<std::int64_t>(1, (now() - due) / period + 1);
      sleep_until(1e-9 * static_cast<double>(due));
    }
  };
  // A round that throws is the last one: the loop sees that no tick comes.
  auto run = [shared = shared_, tick_all, finish = std::move(finish)] {
    shared->running.store(std::this_thread::get_id());
    guarded(tick_all, [](const Error&) {});
    guarded(finish, [](const Error&) {});
    shared->running.store({});
    shared->has_ended.store(true, std::memory_order_release);
  };
  return start_thread(thread_, "of the device", std::move(run));
}

/// Returns false if there is nothing to wait for.
bool PeriodicThread::request_stop() noexcept {
  shared_->wants_stop.store(true, std::memory_order_release);
  return shared_->running.load() != std::this_thread::get_id() && thread_.joinable();
}

void PeriodicThread::stop() noexcept {
  if (request_stop()) thread_.join();
}

/// Counts its own rounds: time in which the whole process stands still does not count.
bool PeriodicThread::stop_within(double patience) noexcept {
  if (!request_stop()) return true;
  constexpr auto kLook = std::chrono::milliseconds(1);
  for (double left = patience; !shared_->has_ended.load(std::memory_order_acquire); left -= 1e-3) {
    if (left <= 0) {
      thread_.detach();
      return false;
    }
    std::this_thread::sleep_for(kLook);
  }
  thread_.join();
  return true;
}

}}  // namespace palpate::v0
