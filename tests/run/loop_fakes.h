// A depth source and a device under full control of a test.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "palpate/cloud/depth_source.h"
#include "palpate/haptics/device.h"

namespace palpate::test {

inline constexpr double kUnit = 0.0001;  // m per count

/// A wall seen square on, at a depth that may differ from frame to frame.
class WallSource final : public DepthSource {
 public:
  struct Options {
    std::function<double(int frame)> depth = [](int) { return 0.5; };  // m
    int num_frames = 1 << 30;
    int fails_at = -1, stalls_at = -1;  // frame numbers
    double stall_seconds = 0;
    double rate = 30;
    int width = 96, height = 72;
  };
  explicit WallSource(Options options) : options_(std::move(options)) {
    info_.width = options_.width;
    info_.height = options_.height;
    info_.intrinsics = {100, 100, 0.5 * (options_.width - 1), 0.5 * (options_.height - 1)};
    info_.unit = kUnit;
    info_.rate = options_.rate;
    info_.name = "a wall";
  }
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    if (number_ == options_.fails_at) return Error{Errc::io_failure, "the wall fell over"};
    if (number_ == options_.num_frames) return false;
    if (number_ == options_.stalls_at) {
      std::this_thread::sleep_for(std::chrono::duration<double>(options_.stall_seconds));
    }
    frame.width = info_.width;
    frame.height = info_.height;
    frame.unit = kUnit;
    frame.timestamp = 100 + number_ / info_.rate;
    frame.pixels.assign(
        static_cast<std::size_t>(info_.width) * static_cast<std::size_t>(info_.height),
        static_cast<std::uint16_t>(std::lround(options_.depth(number_) / kUnit)));
    ++number_;
    return true;
  }

 private:
  Options options_;
  DepthStreamInfo info_;
  int number_ = 0;
};

/// A wall that is seen once and then never again: a caller waits until it is cancelled.
class SilentSource final : public DepthSource {
 public:
  const DepthStreamInfo& info() const override { return wall_.info(); }
  Result<bool> next(DepthFrame& frame) override {
    if (num_given_++ == 0) return wall_.next(frame);
    is_waiting_ = true;
    is_cancelled_.wait(false);
    return false;
  }
  void cancel() noexcept override {
    is_cancelled_ = true;
    is_cancelled_.notify_all();
  }
  bool is_waiting() const { return is_waiting_; }

 private:
  WallSource wall_{WallSource::Options()};
  int num_given_ = 0;
  std::atomic<bool> is_cancelled_ = false, is_waiting_ = false;
};

/// Ticks a thousand times a second, with a hand that goes where the test wants it whatever it
/// feels.
class ScriptedDevice final : public HapticDevice {
 public:
  struct Options {
    std::function<Vec3d(double time)> hand = [](double) { return Vec3d{}; };
    double lost_after = 1e9;   // s since start
    double stuck_after = 1e9;  // likewise: it does not tick any more, and does not know it
    double leaps_after = 1e9;  // likewise: its clock is far ahead at one tick
    double first_tick = 0;     // s after start()
    std::optional<Error> refuses = std::nullopt;
  };
  explicit ScriptedDevice(Options options) : options_(std::move(options)) {
    info_.kind = "scripted";
    info_.name = "scripted device";
    info_.limits.max_force = 8;
    info_.limits.max_torque = 0.2;
    info_.limits.max_stiffness = 1000;
    info_.limits.max_angular_stiffness = 1;
    info_.limits.max_damping = 5;
    info_.limits.workspace_radius = 0.1;
    info_.limits.damping = 1;
    info_.limits.angular_damping = 0.01;
  }
  ~ScriptedDevice() override { stop(); }

  const DeviceInfo& info() const override { return info_; }
  Status start(DeviceTick tick) override {
    if (options_.refuses) return *options_.refuses;
    tick_ = std::move(tick);
    thread_ = std::thread([this] { run(); });
    return Done{};
  }
  void stop() noexcept override {
    is_stopping_ = true;
    if (thread_.joinable()) thread_.join();
    last_force_ = 0;
  }
  Status status() const override {
    if (is_lost_) return Error{Errc::unavailable, "somebody pulled the plug"};
    return Done{};
  }

  double last_force() const { return last_force_; }
  int num_ticks() const { return num_ticks_; }

 private:
  void run() {
    using Clock = std::chrono::steady_clock;
    std::this_thread::sleep_for(std::chrono::duration<double>(options_.first_tick));
    const auto start = Clock::now();
    bool has_leapt = false;
    for (auto due = start; !is_stopping_; due += std::chrono::milliseconds(1)) {
      std::this_thread::sleep_until(due);
      const auto now = Clock::now();
      const double time = std::chrono::duration<double>(now - start).count();
      if (time > options_.lost_after) {
        is_lost_ = true;
        return;
      }
      if (time > options_.stuck_after) {
        while (!is_stopping_) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        return;
      }
      DeviceState state;
      state.time = std::chrono::duration<double>(now.time_since_epoch()).count();
      state.X_BH.translation = options_.hand(time);
      state.V_BH.linear = (options_.hand(time + 1e-4) - state.X_BH.translation) * 1e4;
      state.is_valid = true;
      if (time > options_.leaps_after && !std::exchange(has_leapt, true)) state.time += 40;
      last_force_ = norm(tick_(state).force);
      ++num_ticks_;
    }
  }

  Options options_;
  DeviceInfo info_;
  DeviceTick tick_;
  std::atomic<bool> is_stopping_ = false, is_lost_ = false;
  std::atomic<double> last_force_ = 0;
  std::atomic<int> num_ticks_ = 0;
  std::thread thread_;
};

/// Its limits, and nothing else: what a pipeline asks of a device.
inline DeviceInfo device_info() {
  DeviceInfo info;
  info.limits = ScriptedDevice({}).info().limits;
  return info;
}

}  // namespace palpate::test
