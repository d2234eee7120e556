#include "src/devices/internal/polling_device.h"

#include <utility>

#include "src/core/internal/bounded_call.h"
#include "src/core/internal/guarded.h"
#include "src/devices/device_pose.h"

namespace palpate { inline namespace v0 {
namespace {

// s. A robot's first pose may take ten, and what a device says goodbye to a few tenths.
constexpr double kBeginPatience = 20, kStopPatience = 2, kCutPatience = 0.25;

}  // namespace

Status PollingDevice::start(DeviceTick tick) {
  stop();
  if (polled_->is_given_up) return stuck();
  polled_->tick = std::move(tick);
  polled_->state = {};
  polled_->is_lost = polled_->is_settled = false;
  const auto begun = std::make_shared<Status>(Done{});
  const bool has_returned = returns_within(kBeginPatience, [polled = polled_, begun] {
    *begun = polled->device->begin();
    if (polled->door.is_closed()) polled->device->end();
  });
  if (!has_returned) {
    give_up();
    return stuck();
  }
  if (!*begun) return begun->error();
  const Status started = thread_.start(
      info().rate, [polled = polled_](double time, int) { return polled->round(time); },
      [polled = polled_] { polled->end(); });
  if (!started) polled_->device->end();
  return started;
}

void PollingDevice::stop() noexcept {
  if (polled_->is_given_up || thread_.stop_within(kStopPatience)) return;
  if (!polled_->is_settled.exchange(true)) count_hung_calls(1);
  give_up();
}

void PollingDevice::give_up() noexcept {
  polled_->door.close();
  polled_->is_given_up = true;
  const auto cut = [this] {
    returns_within(kCutPatience, [polled = polled_] { polled->device->cut_force(); });
  };
  guarded(cut, [](const Error&) {});
}

bool PollingDevice::Polled::round(double time) noexcept {
  state.time = time;
  const DeviceState last = state;
  bool is_there = device->read(state);
  if (state.is_valid && !is_possible(state.X_BH)) {
    state = last;
    state.is_valid = false;
  }
  if (is_there) {
    if (!door.enter()) return false;
    const Wrench F_H_B = tick(state);
    door.leave();
    is_there = device->write(F_H_B);
  }
  if (!is_there) is_lost.store(true, std::memory_order_release);
  return is_there;
}

void PollingDevice::Polled::end() noexcept {
  device->end();
  if (is_settled.exchange(true)) count_hung_calls(-1);
}

Status PollingDevice::status() const {
  if (polled_->is_given_up) return stuck();
  if (polled_->is_lost.load(std::memory_order_acquire)) return polled_->device->trouble();
  return Done{};
}

Error PollingDevice::stuck() const {
  return {Errc::io_failure, info().name +
                                ": its driver does not return from a call; let go of it, switch it "
                                "off and on, and start again"};
}

}}  // namespace palpate::v0
