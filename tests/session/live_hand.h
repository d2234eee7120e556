// A hand for live runs over a SyntheticStream, and settings that no busy machine stops.
#pragma once

#include <cmath>
#include <memory>

#include "palpate/devices/devices.h"
#include "palpate/math/geometry.h"
#include "palpate/run/run_loop.h"

namespace palpate::test {

inline void be_patient(SafetyOptions& safety) {
  safety.max_contact_age = safety.max_sensor_age = 60;
  safety.energy_tank = 100;  // late ticks give the hand energy
  safety.max_tick = safety.max_device_silence = 60;
}

inline RunSettings patient_settings() {
  RunSettings settings;
  settings.wants_real_time = false;
  settings.num_threads = 1;
  settings.coupling.X_WB.translation = {0, 0, 0.42};
  be_patient(settings.safety);
  return settings;
}

/// A hand that presses into the wall once a second and turns a little: z = 0.04 - 0.06 cos(2 pi t)
/// in front of the device's base.
inline double pressing_depth(double time) { return 0.04 - 0.06 * std::cos(2 * kPi * time); }

/// A device that goes where `depth` (s to m) says, by 3 mm and 0.2 rad to and fro.
inline std::unique_ptr<SimulatedDevice> pressing_device(double (*depth)(double) = pressing_depth) {
  SimulatedDeviceOptions options;
  options.model = device_models().front();
  options.target = [depth](double time) {
    return Pose{{0.005, 0.003 * std::sin(9 * time), depth(time)},
                axis_angle({1, 2, 3}, 0.2 * std::sin(5 * time))};
  };
  return *SimulatedDevice::create(options);
}

}  // namespace palpate::test
