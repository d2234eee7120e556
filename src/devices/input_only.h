// Devices without motors.
#pragma once

#include "palpate/devices/devices.h"

namespace palpate { inline namespace v0 {

/// The limits that forces are computed for, although they are not rendered: those of a sigma.7,
/// which renders all six directions.
inline DeviceLimits input_only_limits() { return find_device_model("sigma.7")->limits; }

}}  // namespace palpate::v0
