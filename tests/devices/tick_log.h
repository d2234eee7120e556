// The other side of a device in tests: feels what it is told to and remembers the states.
#pragma once

#include <chrono>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/haptics/device.h"

namespace palpate::test {

/// May be set and read while the device ticks.
class TickLog {
 public:
  DeviceTick tick() {
    return [this](const DeviceState& state) {
      const std::lock_guard lock(mutex_);
      states_.push_back(state);
      return state.is_valid ? wrench_ : Wrench{};
    };
  }
  void set_force(const Vec3d& force) {
    const std::lock_guard lock(mutex_);
    wrench_.force = force;
  }
  std::vector<DeviceState> states() const {
    const std::lock_guard lock(mutex_);
    return states_;
  }
  std::size_t size() const { return states().size(); }
  DeviceState last() const {
    const std::lock_guard lock(mutex_);
    return states_.empty() ? DeviceState{} : states_.back();
  }
  std::size_t num_valid() const {
    std::size_t count = 0;
    for (const DeviceState& state : states()) count += state.is_valid;
    return count;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<DeviceState> states_;
  Wrench wrench_;
};

/// Waits until it is so; false if that takes longer than any machine needs.
inline bool eventually(const std::function<bool()>& is_so) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(2);
  while (!is_so()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

/// Waits until a device is lost for a reason with these words; then it ticks no more.
inline void wait_until_lost(HapticDevice& device, const TickLog& log, const std::string& words) {
  ASSERT_TRUE(eventually([&] { return !device.status(); }));
  EXPECT_NE(device.status().error().message.find(words), std::string::npos)
      << device.status().error().message;
  const std::size_t num_ticks = log.size();
  device.stop();
  EXPECT_EQ(log.size(), num_ticks);
}

}  // namespace palpate::test
