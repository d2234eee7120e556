// Inputs of runs: a path as a device, whose hand follows given poses on a simulated clock, and
// depth frames that are read before they are due.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "palpate/cloud/depth_source.h"
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

/// The same frames, read by a thread of its own up to `num_ahead` frames before they are requested:
/// one that takes long to be made, by a simulated camera or from a compressed file, is there when
/// it is due as long as frames on average take no longer than they are apart. Not for sensors,
/// whose frames would get old. Its end waits for the frame that is being read, unless the source
/// can be cancelled. Memory: `num_ahead`
/// + 1 frames. Error: the system starts no thread.
Result<std::unique_ptr<DepthSource>> read_ahead(std::unique_ptr<DepthSource> source,
                                                int num_ahead = 8);

}}  // namespace palpate::v0
