#include "src/devices/polling_device.h"

#include <utility>

namespace palpate::inline v0 {

Status PollingDevice::start(DeviceTick tick) {
  stop();
  tick_ = std::move(tick);
  state_ = {};
  if (const Status begun = device_->begin(); !begun) return begun.error();
  is_lost_.store(false, std::memory_order_release);
  const Status started = thread_.start(
      info().rate, [this](double time, int) { return round(time); }, [this] { device_->end(); });
  if (!started) device_->end();
  return started;
}

bool PollingDevice::round(double time) noexcept {
  state_.time = time;
  if (device_->read(state_) && device_->write(tick_(state_))) return true;
  is_lost_.store(true, std::memory_order_release);
  return false;
}

Status PollingDevice::status() const {
  if (is_lost_.load(std::memory_order_acquire)) return device_->trouble();
  return Done{};
}

}  // namespace palpate::inline v0
