// Finding and opening haptic devices by the words of the command line.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/haptics/device.h"
#include "palpate/io/trajectory_file.h"

namespace palpate {

/// What can be used here.
struct FoundDevice {
  std::string uri;  ///< e.g. "haply:ws://localhost:10001"
  std::string kind;
  bool is_usable = false;
  std::string what;  ///< the device, or every path and address that was tried
  std::string hint;  ///< what to do next if it is not usable
};
/// Asks every kind; takes a second at most. Never fails, never moves a device.
std::vector<FoundDevice> find_devices();

/// sim[:MODEL], replay:FILE, spacenav[:SOCKET], haply[:URL], forcedimension[:ID],
/// openhaptics[:NAME], vrpn:NAME@HOST[:PORT], ros2:/POSE_TOPIC[@FRAME], ros2:FRAME@BASE. Errors: no
/// such kind; nothing there: what was tried, and what to do.
Result<std::unique_ptr<HapticDevice>> open_device(std::string_view uri);

/// A path that is played in real time: the handle goes where it says, in B, and feels nothing.
/// `name` is for humans.
std::unique_ptr<HapticDevice> make_replay_device(std::string name, std::vector<TimedPose> X_BH);

}  // namespace palpate
