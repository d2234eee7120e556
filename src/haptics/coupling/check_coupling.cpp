#include <algorithm>

#include "palpate/haptics/coupling.h"
#include "src/core/internal/message_text.h"
#include "src/haptics/coupling/couplings.h"

namespace palpate { inline namespace v0 {
namespace {

/// Default of force_at_eighth for devices without force, N: the tool still stops at surfaces.
constexpr double kForceWithoutDevice = 5;

/// Spring and damper along one degree of freedom, and what the device can bear.
struct Axis {
  double inertia, device_damping, max_stiffness, max_damping, damping_ratio, tick;

  double damping(double stiffness) const {
    const double desired = 2 * damping_ratio * std::sqrt(inertia * stiffness);
    return max_damping > 0 ? std::min(desired, max_damping) : desired;
  }
  /// A spring that is held over a tick T gives back K T / 2 times v^2 more than it took; what takes
  /// it is damping: of the mechanism and, for motions well below the tick rate, of the coupling.
  /// (Colgate and Schenkel 1997: b > K T / 2 - B cos(w T).)
  double passive_limit(double stiffness) const {
    return 2 * (device_damping + damping(stiffness)) / tick;
  }
  /// The largest stiffness that the device allows and that is passive.
  double best_stiffness(double if_unknown) const {
    const double top = max_stiffness > 0 ? max_stiffness : if_unknown;
    if (top < passive_limit(top)) return top;
    // The limit grows as the root of the stiffness and no faster: bisection.
    double low = 0, high = top;
    for (int i = 0; i < 60; ++i) {
      const double middle = (low + high) / 2;
      (middle < passive_limit(middle) ? low : high) = middle;
    }
    return low;
  }
};

/// Fills in a stiffness or checks the given one; adds warnings.
void settle(const Axis& axis, const std::string& what, const std::string& unit, double if_unknown,
            double& stiffness, std::vector<std::string>& warnings) {
  if (stiffness == 0) {
    stiffness = axis.best_stiffness(if_unknown);
    return;
  }
  if (axis.max_stiffness > 0 && stiffness > axis.max_stiffness) {
    warnings.push_back("the " + what + " is lowered from " + number_text(stiffness) +
                       " to the device's " + number_text(axis.max_stiffness) + " " + unit +
                       ": use no higher value");
    stiffness = axis.max_stiffness;
  }
  const double limit = axis.passive_limit(stiffness);
  if (stiffness >= limit) {
    warnings.push_back("the " + what + " of " + number_text(stiffness) + " " + unit +
                       " is not passive: 2 b / T is " + number_text(limit) +
                       ", so the device may shake; lower the stiffness below that, raise the "
                       "damping ratio, or tick faster");
  }
}

}  // namespace

Result<CheckedCoupling> check_coupling(const CouplingOptions& options, const DeviceLimits& limits,
                                       double tick_seconds, const MassProperties& tool) {
  if (const Status status = check_settings(options); !status) return status.error();
  if (!(tick_seconds >= 1e-6 && tick_seconds <= 1)) {
    return Error{Errc::invalid_argument, "the device ticks every " + number_text(tick_seconds) +
                                             " s; its driver must report 1e-06 to 1 s"};
  }
  for (double limit :
       {limits.max_force, limits.max_torque, limits.max_stiffness, limits.max_angular_stiffness,
        limits.max_damping, limits.damping, limits.angular_damping}) {
    if (limit >= 0 && std::isfinite(limit)) continue;
    return Error{Errc::invalid_argument, "a limit of the device is " + number_text(limit) +
                                             "; its driver has to tell finite numbers, 0 or more"};
  }

  CheckedCoupling checked{options, {}};
  CouplingOptions& o = checked.options;
  o.X_WB.rotation = normalized(o.X_WB.rotation);
  o.X_HT.rotation = normalized(o.X_HT.rotation);
  if (o.force_at_eighth == 0) {
    o.force_at_eighth = limits.max_force > 0 ? limits.max_force : kForceWithoutDevice;
  }

  const Axis line{o.tool_mass,        limits.damping,  limits.max_stiffness,
                  limits.max_damping, o.damping_ratio, tick_seconds};
  settle(line, "coupling stiffness", "N/m", 1000, o.stiffness, checked.warnings);
  const double desired = 2 * o.damping_ratio * std::sqrt(o.tool_mass * o.stiffness);
  const double damping = line.damping(o.stiffness);
  if (damping < desired) {
    const double lowered = o.damping_ratio * damping / desired;
    // The default was not set by the user.
    const bool is_requested = options.damping_ratio != CouplingOptions{}.damping_ratio;
    if (is_requested)
      checked.warnings.push_back("the damping ratio is lowered from " +
                                 number_text(o.damping_ratio) + " to " + number_text(lowered) +
                                 ", the device's " + number_text(limits.max_damping) +
                                 " N s/m; a lighter tool or a softer coupling needs less");
    o.damping_ratio = lowered;
  }

  // The tool's radius of gyration at the hand's scale. Without torque on the device the angular
  // spring needs no limit: only the tool hangs on it.
  const double radius = radius_of_gyration(tool) / o.motion_scale;
  const bool has_torque = limits.max_torque > 0;
  const Axis turn{o.tool_mass * radius * radius,
                  limits.angular_damping,
                  has_torque ? limits.max_angular_stiffness : 0,
                  0,
                  o.damping_ratio,
                  tick_seconds};
  if (has_torque || o.angular_stiffness == 0) {
    settle(turn, "angular coupling stiffness", "N m/rad", o.stiffness * radius * radius,
           o.angular_stiffness, checked.warnings);
  }
  if (o.stiffness <= 0 || o.angular_stiffness <= 0) {
    return Error{Errc::invalid_argument,
                 "no stiffness of the coupling is passive without any damping; give a stiffness or "
                 "a damping ratio above 0"};
  }
  // The mechanism alone damps a wall: the spring that holds the tool stands still there.
  o.wall_stiffness = std::min(o.stiffness, 2 * limits.damping / tick_seconds);
  if (o.kind == CouplingKind::proxy && o.hold == ContactHold::interpolation) {
    checked.warnings.push_back(
        "the proxy needs to know how contact changes and uses the local model, not interpolation");
    o.hold = ContactHold::local_model;
  }
  return checked;
}

}}  // namespace palpate::v0
