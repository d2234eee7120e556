#include "palpate/haptics/safety.h"

namespace palpate {
namespace {

/// More than any device renders: N, N m, N s/m.
constexpr double kStrongest = 1e4;

}  // namespace

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
  for (const double limit : {limits.max_force, limits.max_torque, limits.max_damping}) {
    if (limit >= 0 && limit <= kStrongest) continue;
    return Error{Errc::invalid_argument, "a limit of the device is " + shortest_decimal(limit) +
                                             "; its driver has to tell numbers from 0 to " +
                                             shortest_decimal(kStrongest) + " (N, N m, N s/m)"};
  }
  if (const Status status = check_settings(options); !status) return status.error();
  return SafetyFilter(limits, options);
}

}  // namespace palpate
