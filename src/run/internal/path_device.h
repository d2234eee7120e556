// A path as a device: the hand follows given poses, on a simulated clock.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "palpate/haptics/device.h"

namespace palpate { inline namespace v0 {

struct PathDeviceOptions {
  std::function<Pose(double time)> X_BH;  ///< the handle at a time, s, from 0 to `duration`
  double duration = 0;                    ///< s; ticks at times before it
  double rate = 1000;                     ///< ticks per second
  DeviceLimits limits;                    ///< limits of computed forces
  std::string name;                       ///< for humans
};

/// Feels nothing. Errors: rate or duration out of range.
Result<std::unique_ptr<SteppedDevice>> make_path_device(PathDeviceOptions options);

}}  // namespace palpate::v0
