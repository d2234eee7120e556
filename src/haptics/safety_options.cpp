#include "palpate/haptics/safety.h"

namespace palpate { inline namespace v0 {
namespace {

/// Largest limit accepted of a device: N, N m, N s/m.
constexpr double kStrongest = 1e4;

}  // namespace

std::string_view describe(Fault fault) {
  switch (fault) {
    case Fault::none: return "no fault";
    case Fault::not_finite:
      return "a force or a pose was not a number: the force is off; look at the device's readings";
    case Fault::stale_contact:
      return "no contact was computed in time: the force is off; use a smaller tool or fewer "
             "spheres, or allow a larger contact age";
    case Fault::stale_sensor:
      return "no depth frame came in time: the force is off; look at the camera, close other "
             "programs if this computer is busy, or allow a larger sensor age";
    case Fault::device:
      return "the device reported no usable state in time, or has taken its force away: the force "
             "is off; check its cable, power and calibration, and whether it is too warm or moved "
             "too fast";
    case Fault::loop:
      return "ticks came too late or time ran backwards: the force is off; allow real-time "
             "scheduling and close other programs";
    case Fault::backend:
      return "the contact query failed: the force is off; look at the GPU, or use the CPU "
             "(--backend cpu)";
    case Fault::energy:
      return "the device gave the hand more energy than damping could take back: the force is off; "
             "lower the coupling's stiffness or the force";
    case Fault::sensor:
      return "the depth frames have failed: the force is off; look at the camera or its files";
    case Fault::stopped: return "the force was switched off on request";
  }
  return "unknown fault: the force is off";
}

std::string_view describe_change(const SafetyStatus& before, const SafetyStatus& after) {
  if (after.fault != before.fault && after.fault != Fault::none) return describe(after.fault);
  if (after.state == before.state) return {};
  switch (after.state) {
    case ForceState::waiting:
      return before.fault == Fault::none
                 ? "the dead-man switch or the coupling was let go: the force is off"
                 : "all is well again: the force comes back once the hand is free of contact";
    case ForceState::engaged: return "the force comes up";
    case ForceState::held_off:
      return "too many faults within a minute: the force stays off until you switch it on, on the "
             "page or by button 0 of the device";
    case ForceState::fading:
    case ForceState::off:
    case ForceState::ended: break;
  }
  return {};
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

}}  // namespace palpate::v0
