// Polled devices: one call reads the pose of the hand, another sends the wrench.
#pragma once

#include <atomic>
#include <memory>

#include "palpate/haptics/device.h"
#include "src/devices/periodic_thread.h"

namespace palpate::inline v0 {

/// What differs between such devices. `begin` is called from the thread of start(), all the others
/// (but info and trouble) from the ticking thread, which must not wait, allocate or throw.
class PolledDevice {
 public:
  virtual ~PolledDevice() = default;

  virtual const DeviceInfo& info() const = 0;
  /// Before the first tick: motors on. Errors: the device does not answer, what it said.
  virtual Status begin() = 0;
  /// Fills `state`, which comes as it was at the last tick, but with the new time. Nothing usable
  /// this time: is_valid = false. False: the device is lost or has refused to go on.
  virtual bool read(DeviceState& state) noexcept = 0;
  /// The wrench to render from now on. False: as above.
  virtual bool write(const Wrench& F_H_B) noexcept = 0;
  /// After the last tick, for whichever reason it was the last: motors off.
  virtual void end() noexcept = 0;
  /// What was wrong when read or write said false. From any thread, after that.
  virtual Error trouble() const = 0;
};

/// Gives a polled device a thread that polls it `info().rate` times a second: read, tick, write.
class PollingDevice final : public HapticDevice {
 public:
  explicit PollingDevice(std::unique_ptr<PolledDevice> device) : device_(std::move(device)) {}

  const DeviceInfo& info() const override { return device_->info(); }
  Status start(DeviceTick tick) override;
  void stop() noexcept override { thread_.stop(); }
  Status status() const override;

 private:
  bool round(double time) noexcept;

  std::unique_ptr<PolledDevice> device_;
  DeviceTick tick_;
  DeviceState state_;
  std::atomic<bool> is_lost_ = false;
  PeriodicThread thread_;  // last: stops before anything else goes
};

}  // namespace palpate::inline v0
