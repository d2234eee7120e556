#include "palpate/devices/devices.h"

#include <algorithm>
#include <memory>
#include <optional>

#include "src/core/internal/all_at_once.h"
#include "src/core/internal/bounded_call.h"
#include "src/core/internal/message_text.h"
#include "src/devices/device_kinds.h"

namespace palpate { inline namespace v0 {
namespace {

struct Kind {
  std::string_view name, usage;
  OpenDevice& open;
  FindDevice& find;
};

FoundDevice find_simulated_device() {
  return {"sim", "sim", true,
          "simulated hand on a " + std::string(device_models().front().name) +
              "; sim:MODEL for another device",
          ""};
}

FoundDevice find_replay_device() {
  return {"replay:FILE", "replay", true,
          "a recorded path, lines 't tx ty tz qx qy qz qw'; without forces", ""};
}

constexpr Kind kKinds[] = {
    {"sim", "sim[:MODEL]", open_simulated_device, find_simulated_device},
    {"replay", "replay:FILE", open_replay_device, find_replay_device},
    {"spacenav", "spacenav[:SOCKET]", open_spacenav_device, find_spacenav_device},
    {"haply", "haply[:URL]", open_haply_device, find_haply_device},
    {"forcedimension", "forcedimension[:ID]", open_force_dimension_device,
     find_force_dimension_device},
    {"openhaptics", "openhaptics[:NAME]", open_open_haptics_device, find_open_haptics_device},
    {"vrpn", "vrpn:NAME@HOST[:PORT]", open_vrpn_device, find_vrpn_device},
    {"ros2", "ros2:/POSE_TOPIC", open_ros2_device, find_ros2_device},
    {"page", "page", open_page_device, find_page_device},
};

constexpr double kFindPatience = 10, kOpenPatience = 30;  // s

/// Drivers may wait for a device for ever.
Result<std::unique_ptr<HapticDevice>> open_in_time(const Kind& kind, std::string_view address,
                                                   double patience) {
  const auto opened = std::make_shared<std::optional<Result<std::unique_ptr<HapticDevice>>>>();
  if (returns_within(patience, [opened, open = &kind.open, where = std::string(address)] {
        *opened = open(where);
      })) {
    return *std::move(*opened);
  }
  return Error{Errc::unavailable, "the driver of " + std::string(kind.name) +
                                      " has not returned for " + number_text(patience) +
                                      " s while the device was opened; "
                                      "switch the device off and on, end other programs that use "
                                      "it, and try again"};
}

}  // namespace

std::vector<std::string> device_kinds() {
  std::vector<std::string> names;
  for (const Kind& kind : kKinds) names.emplace_back(kind.name);
  return names;
}

std::vector<FoundDevice> find_devices() { return find_devices_within(kFindPatience); }

std::vector<FoundDevice> find_devices_within(double patience) {
  return find_all_at_once(kKinds, patience, [patience](const Kind& kind) {
    return FoundDevice{std::string(kind.name), std::string(kind.name), false,
                       "its driver has not returned for " + number_text(patience) + " s",
                       "switch the device off and on and end other programs that use it"};
  });
}

Result<std::unique_ptr<HapticDevice>> open_device(std::string_view uri) {
  return open_device_within(kOpenPatience, uri);
}

Result<std::unique_ptr<HapticDevice>> open_device_within(double patience, std::string_view uri) {
  const std::size_t colon = std::min(uri.find(':'), uri.size());
  const std::string_view name = uri.substr(0, colon);
  const auto kind = std::ranges::find(kKinds, name, &Kind::name);
  if (kind != std::end(kKinds))
    return open_in_time(*kind, uri.substr(std::min(colon + 1, uri.size())), patience);
  std::string known;
  for (const Kind& each : kKinds) known += (known.empty() ? "" : ", ") + std::string(each.usage);
  return Error{Errc::invalid_argument, "no kind of device is called '" +
                                           std::string(name.substr(0, 40)) + "'; give one of " +
                                           known};
}

}}  // namespace palpate::v0
