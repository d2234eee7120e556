// Limits of known devices (vendor and CHAI3D 3.3 tables), for simulation and where a driver does
// not tell them.
#pragma once

#include <optional>
#include <span>
#include <string_view>

#include "palpate/haptics/device.h"

namespace palpate {

struct DeviceModel {
  std::string_view key;  ///< e.g. "touch", "omega.6", "inverse3"
  std::string_view name;
  DeviceLimits limits;
  double moving_mass = 0.1;  ///< kg, apparent at the handle
};

/// All of them; the first one is the default.
std::span<const DeviceModel> device_models();
std::optional<DeviceModel> find_device_model(std::string_view key);

}  // namespace palpate
