#include "palpate/devices/devices.h"

#include <algorithm>
#include <cctype>

#include "src/devices/device_kinds.h"

namespace palpate { inline namespace v0 {
namespace {

// Forces, torques, stiffnesses, damping limits and radii are those of the tables in CHAI3D 3.3.0
// (CPhantomDevices.cpp, CDeltaDevices.cpp), of the Inverse3 those of the CHAI3D port for Haply
// devices (CHaplyDevices.cpp). Where makers name larger forces (sigma.7: 20 N) the smaller one is
// taken. A torque of 0: orientation is sensed at most, not driven.
//
// No maker specifies the damping of the mechanism: the one that the stiffness implies is assumed.
// Moving masses are estimates too.

constexpr DeviceModel model(std::string_view key, std::string_view name, double max_force,
                            double max_torque, double max_stiffness, double max_angular_stiffness,
                            double max_damping, double workspace_radius, double moving_mass) {
  return {key,
          name,
          {.max_force = max_force,
           .max_torque = max_torque,
           .max_stiffness = max_stiffness,
           .max_angular_stiffness = max_angular_stiffness,
           .max_damping = max_damping,
           .workspace_radius = workspace_radius,
           .damping = assumed_damping(max_stiffness),
           .angular_damping = assumed_damping(max_angular_stiffness)},
          moving_mass};
}

constexpr DeviceModel kModels[] = {
    //                                           N     N m   N/m  N m/rad N s/m  m      kg
    model("touch", "3D Systems Touch", 3.3, 0, 400, 0, 4, 0.075, 0.045),
    model("omni", "Phantom Omni", 3.3, 0, 700, 0, 5, 0.1, 0.045),
    model("desktop", "Phantom Desktop", 7.9, 0, 1000, 0, 5, 0.1, 0.045),
    model("premium-1.5-6dof", "Phantom Premium 1.5 6DOF", 8.5, 0.188, 800, 0.3, 5, 0.12, 0.1),
    model("premium-3.0-6dof", "Phantom Premium 3.0 6DOF", 22, 0.188, 1000, 0.3, 5, 0.25, 0.2),
    model("omega.3", "Force Dimension omega.3", 12, 0, 5000, 0, 30, 0.075, 0.2),
    model("omega.6", "Force Dimension omega.6", 12, 0, 5000, 0, 30, 0.075, 0.25),
    model("omega.7", "Force Dimension omega.7", 12, 0, 5000, 0, 30, 0.075, 0.3),
    model("sigma.7", "Force Dimension sigma.7", 12, 0.2, 4000, 1, 30, 0.075, 0.35),
    model("lambda.7", "Force Dimension lambda.7", 12, 0.2, 8000, 1, 30, 0.1125, 0.4),
    model("delta.3", "Force Dimension delta.3", 20, 0, 5000, 0, 30, 0.15, 0.3),
    model("falcon", "Novint Falcon", 8, 0, 3000, 0, 20, 0.04, 0.15),
    model("inverse3", "Haply Inverse3", 10, 0, 1000, 0, 6, 0.15, 0.15),
    model("phantom", "unknown Phantom", 6, 0, 1000, 0, 8, 0.1, 0.1),
};

bool is_same_letter(char a, char b) {
  const auto lower = [](char c) { return std::tolower(static_cast<unsigned char>(c)); };
  return lower(a) == lower(b);
}

}  // namespace

std::span<const DeviceModel> device_models() { return kModels; }

std::optional<DeviceModel> find_device_model(std::string_view key) {
  const auto found = std::ranges::find_if(kModels, [key](const DeviceModel& candidate) {
    return std::ranges::equal(candidate.key, key, is_same_letter);
  });
  if (found == std::end(kModels)) return std::nullopt;
  return *found;
}

}}  // namespace palpate::v0
