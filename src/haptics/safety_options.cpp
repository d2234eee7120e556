#include <string>

#include "palpate/haptics/safety.h"
#include "src/core/range.h"

namespace palpate {
std::string_view describe(Fault fault) {
  switch (fault) {
    case Fault::none: return "no fault";
    case Fault::not_finite:
      return "a force or a pose was not a number: the force is off; look at the device's readings "
             "and begin again";
    case Fault::stale_contact:
      return "no contact was computed in time: the force is off; use a smaller tool or fewer "
             "spheres, or allow a larger contact age";
    case Fault::stale_sensor:
      return "no depth frame came in time: the force is off; look at the camera, or allow a larger "
             "sensor age";
    case Fault::device:
      return "the device told no usable state in time: the force is off; look at its cable, power "
             "and calibration";
    case Fault::loop:
      return "ticks came too late or time ran backwards: the force is off; allow real-time "
             "scheduling and close other programs";
    case Fault::backend:
      return "the contact query failed: the force is off; begin again, with the CPU backend if the "
             "GPU is lost";
    case Fault::energy:
      return "the device gave the hand more energy than damping could take back: the force is off; "
             "lower the coupling's stiffness or the force";
    case Fault::stopped: return "the force was switched off as asked";
  }
  return "unknown fault: the force is off";
}

Result<SafetyFilter> SafetyFilter::create(const DeviceLimits& limits,
                                          const SafetyOptions& options) {
  constexpr double kTiny = 1e-6, kLong = 3600;
  const Range ranges[] = {
      {"the device's largest force (N)", limits.max_force, 0, 1e4},
      {"the device's largest torque (N m)", limits.max_torque, 0, 1e4},
      {"the device's largest damping (N s/m)", limits.max_damping, 0, 1e4},
      {"force share", options.force_share, 0, 1},
      {"slew limit (N/s)", options.max_slew, kTiny, 1e7},
      {"torque slew limit (N m/s)", options.max_torque_slew, kTiny, 1e7},
      {"ramp (s)", options.ramp_seconds, 0, kLong},
      {"engaging force (N)", options.engage_force, 0, 1e4},
      {"number of ticks to engage", static_cast<double>(options.engage_ticks), 1, 1e6},
      {"engaging timeout (s)", options.engage_timeout, 0, kLong},
      {"fade (s)", options.fade_seconds, 0, 1},
      {"contact age limit (s)", options.max_contact_age, kTiny, kLong},
      {"sensor age limit (s)", options.max_sensor_age, kTiny, kLong},
      {"device silence limit (s)", options.max_device_silence, kTiny, kLong},
      {"tick limit (s)", options.max_tick, kTiny, kLong},
      {"energy tank (J)", options.energy_tank, kTiny, 1e3},
  };
  if (const Range* const r = first_outside(ranges)) {
    return Error{Errc::invalid_argument, std::string("safety: ") + r->name + " is " +
                                             number_text(r->value) + "; give a number from " +
                                             number_text(r->low) + " to " + number_text(r->high)};
  }
  return SafetyFilter(limits, options);
}

}  // namespace palpate
