// The kinds of devices that open_device and find_devices know, one pair of functions each.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/devices/devices.h"

namespace palpate { inline namespace v0 {

struct NetAddress;

/// Damping of a mechanism that its largest stiffness implies: at 1 kHz a spring K is passive for
/// K < 2 b / T (Colgate and Schenkel), so b = K T / 2.
constexpr double assumed_damping(double max_stiffness) { return max_stiffness * 0.5e-3; }

/// Opens the device at the address after the kind's name and colon; empty: the first one found.
using OpenDevice = Result<std::unique_ptr<HapticDevice>>(std::string_view address);
/// Reports the usable devices of a kind; takes 0.3 s at most and never moves a device.
using FindDevice = FoundDevice();

OpenDevice open_simulated_device, open_replay_device, open_spacenav_device, open_haply_device,
    open_force_dimension_device, open_open_haptics_device, open_vrpn_device, open_ros2_device,
    open_page_device;
FindDevice find_spacenav_device, find_haply_device, find_force_dimension_device,
    find_open_haptics_device, find_vrpn_device, find_ros2_device, find_page_device;
/// Reports the devices of a VRPN server at a stated place.
FoundDevice find_vrpn_device_at(const NetAddress& address);

/// Open or find devices, waiting `patience` seconds for a driver: 30 in open_device, 10 in
/// find_devices.
Result<std::unique_ptr<HapticDevice>> open_device_within(double patience, std::string_view uri);
std::vector<FoundDevice> find_devices_within(double patience);

/// Returns the limits that forces are computed for although a device has no motors: those of a
/// sigma.7, which renders all six directions.
inline DeviceLimits input_only_limits() { return find_device_model("sigma.7")->limits; }

}}  // namespace palpate::v0
