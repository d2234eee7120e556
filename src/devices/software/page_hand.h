// The motion of a handle between the poses that a page sends.
#pragma once

#include <memory>

#include "palpate/devices/devices.h"
#include "src/devices/internal/polling_device.h"

namespace palpate { inline namespace v0 {

/// Follows the newest pose P as a critically damped spring does, exactly over each tick for the
/// pose that there is:
///
///   x(t) - P = ((x - P) + (v + w (x - P)) t) exp(-w t),   w = kFollow
///
/// so that a hand at constant speed u is followed 2 u / w behind, however its poses come. P counts
/// no farther away than the distance at which that speed is kFastest.
class PageHand final : public PolledDevice {
 public:
  static constexpr double kFollow = 60;       // 1/s
  static constexpr double kFastest = 1;       // m/s
  static constexpr double kFastestTurn = 10;  // rad/s
  static constexpr double kSilence = 0.3;     // s without a pose: nobody holds it
  static constexpr double kGivesWay = 0.5;    // s, after that
  /// Time constant with which it gives way to the stiffest spring, s.
  static constexpr double kYield = 0.02;

  explicit PageHand(std::shared_ptr<PageHandle> handle);

  Status begin() override;
  bool read(DeviceState& state) noexcept override;
  bool write(const Wrench& F_H_B) noexcept override;
  void end() noexcept override {}

 private:
  void take(const PageHandle::Update& news, const Pose& X_BH) noexcept;
  void follow(DeviceState& state, double seconds) const noexcept;
  void yield_to_spring(DeviceState& state, double seconds) const noexcept;

  std::shared_ptr<PageHandle> handle_;
  PageHandle::Update update_;
  Pose target_;           // X_BH
  Vec3d shift_;           // from the page's position to that of the handle
  Quaternion turn_;       // likewise
  Wrench felt_;           // F_H_B
  double last_time_ = 0;  // s; 0: no tick yet
  double held_time_ = 0;  // s: when it was held last; 0: not since the start
};

}}  // namespace palpate::v0
