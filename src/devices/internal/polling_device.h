// Polled devices: one call reads the pose of the hand, another sends the wrench.
#pragma once

#include <atomic>
#include <memory>

#include "palpate/haptics/device.h"
#include "src/devices/transport/periodic_thread.h"
#include "src/devices/transport/tick_door.h"

namespace palpate { inline namespace v0 {

/// Driver of one polled device. `begin` is called while start() waits for it, all the others
/// (but info, trouble and cut_force) from the ticking thread, which must not wait, allocate or
/// throw.
class PolledDevice {
 public:
  virtual ~PolledDevice() = default;

  const DeviceInfo& info() const { return info_; }
  /// Before the first tick: motors on. Errors: the device does not answer, or what it reported.
  virtual Status begin() = 0;
  /// Fills `state`, which comes as it was at the last tick, but with the new time. Nothing usable
  /// this time: is_valid = false. False: the device is lost or has refused to go on.
  virtual bool read(DeviceState& state) noexcept = 0;
  /// The wrench to render from now on. False: as above.
  virtual bool write(const Wrench& F_H_B) noexcept = 0;
  /// After the last tick, for whichever reason it was the last: motors off.
  virtual void end() noexcept = 0;
  /// Returns the reason why read or write returned false. From any thread, after that.
  virtual Error trouble() const { return trouble_; }
  /// Motors off while another call hangs in the driver, from a thread of its own. May hang as well.
  virtual void cut_force() noexcept {}

 protected:
  DeviceInfo info_;
  Error trouble_;
};

/// Gives a polled device a thread that polls it `info().rate` times a second: read, tick, write.
/// A driver that hangs is given up: its thread keeps the device and never ticks again.
class PollingDevice final : public HapticDevice {
 public:
  explicit PollingDevice(std::unique_ptr<PolledDevice> device)
      : polled_(std::make_shared<Polled>(std::move(device))) {}
  ~PollingDevice() override { stop(); }

  const DeviceInfo& info() const override { return polled_->device->info(); }
  Status start(DeviceTick tick) override;
  void stop() noexcept override;
  Status status() const override;

 private:
  struct Polled {
    explicit Polled(std::unique_ptr<PolledDevice> polled) : device(std::move(polled)) {}
    bool round(double time) noexcept;
    void end() noexcept;

    std::unique_ptr<PolledDevice> device;
    DeviceTick tick;
    DeviceState state;
    TickDoor door;
    std::atomic<bool> is_lost = false, is_given_up = false;
    std::atomic<bool> is_settled = false;  // by its end, or by the end of the patience
  };
  void give_up() noexcept;
  Error stuck() const;

  const std::shared_ptr<Polled> polled_;
  PeriodicThread thread_;
};

}}  // namespace palpate::v0
