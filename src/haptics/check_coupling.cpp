#include <algorithm>
#include <cstdio>

#include "palpate/haptics/coupling.h"
#include "src/core/range.h"

namespace palpate {
namespace {

/// What is assumed of a tool that is not known here: its radius of gyration, m. Links stiffness
/// against turning to stiffness against moving where the device says nothing.
constexpr double kTypicalRadius = 0.05;

/// Where the device renders no force, the tool still stops at surfaces, N.
constexpr double kForceWithoutDevice = 5;

std::string number(double value) { return number_text(value, 3); }

bool is_pose(const Pose& X) {
  const Quaternion& q = X.rotation;
  return is_finite(X) && q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w > 0.5;
}

Status check_ranges(const CouplingOptions& o, double tick_seconds) {
  const Range ranges[] = {
      {"coupling stiffness (N/m)", o.stiffness, 0, 1e6},
      {"angular coupling stiffness (N m/rad)", o.angular_stiffness, 0, 1e4},
      {"damping ratio", o.damping_ratio, 0, 100},
      {"tool mass (kg)", o.tool_mass, 1e-4, 1e3},
      {"force at an eighth of the tool (N)", o.force_at_eighth, 0, 1e4},
      {"motion scale", o.motion_scale, 1e-4, 1e4},
      {"tick (s)", tick_seconds, 1e-6, 1},
  };
  if (const Range* const r = first_outside(ranges)) {
    return Error{Errc::invalid_argument, std::string("the ") + r->name + " is " + number(r->value) +
                                             "; give a number from " + number(r->low) + " to " +
                                             number(r->high)};
  }
  if (!is_pose(o.X_WB) || !is_pose(o.X_HT)) {
    return Error{Errc::invalid_argument,
                 "the pose of the device's base or of the tool in the hand is not a pose; give "
                 "finite numbers and a unit quaternion"};
  }
  return Done{};
}

/// Spring and damper along one degree of freedom, and what the device can bear.
struct Axis {
  double inertia, device_damping, max_stiffness, max_damping, damping_ratio, tick;

  double damping(double stiffness) const {
    const double wanted = 2 * damping_ratio * std::sqrt(inertia * stiffness);
    return max_damping > 0 ? std::min(wanted, max_damping) : wanted;
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

/// Fills in a stiffness or checks the given one, with what there is to say about it.
void settle(const Axis& axis, const std::string& what, const std::string& unit, double if_unknown,
            double& stiffness, std::vector<std::string>& warnings) {
  if (stiffness == 0) {
    stiffness = axis.best_stiffness(if_unknown);
    return;
  }
  if (axis.max_stiffness > 0 && stiffness > axis.max_stiffness) {
    warnings.push_back("the " + what + " is lowered from " + number(stiffness) +
                       " to the device's " + number(axis.max_stiffness) + " " + unit +
                       ": ask for no more than that");
    stiffness = axis.max_stiffness;
  }
  const double limit = axis.passive_limit(stiffness);
  if (stiffness >= limit) {
    warnings.push_back("the " + what + " of " + number(stiffness) + " " + unit +
                       " is not passive: 2 b / T is " + number(limit) +
                       ", so the device may shake; lower the stiffness below that, raise the "
                       "damping ratio, or tick faster");
  }
}

}  // namespace

Result<CheckedCoupling> check_coupling(const CouplingOptions& options, const DeviceLimits& limits,
                                       double tick_seconds) {
  if (const Status status = check_ranges(options, tick_seconds); !status) return status.error();
  for (double limit :
       {limits.max_force, limits.max_torque, limits.max_stiffness, limits.max_angular_stiffness,
        limits.max_damping, limits.damping, limits.angular_damping}) {
    if (limit >= 0 && std::isfinite(limit)) continue;
    return Error{Errc::invalid_argument, "a limit of the device is " + number(limit) +
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

  // What the hand does not feel needs no limit: only the tool hangs on it.
  const double square = kTypicalRadius * kTypicalRadius;
  const bool is_felt = limits.max_torque > 0;
  const Axis turn{o.tool_mass * square,
                  limits.angular_damping,
                  is_felt ? limits.max_angular_stiffness : 0,
                  is_felt ? limits.max_damping * square : 0,
                  o.damping_ratio,
                  tick_seconds};
  if (is_felt || o.angular_stiffness == 0) {
    settle(turn, "angular coupling stiffness", "N m/rad", o.stiffness * square, o.angular_stiffness,
           checked.warnings);
  }
  if (o.stiffness <= 0 || o.angular_stiffness <= 0) {
    return Error{Errc::invalid_argument,
                 "no stiffness of the coupling is passive without any damping; give a stiffness or "
                 "a damping ratio above 0"};
  }

  const double wanted = 2 * o.damping_ratio * std::sqrt(o.tool_mass * o.stiffness);
  const double damping = line.damping(o.stiffness);
  if (damping < wanted) {
    const double lowered = o.damping_ratio * damping / wanted;
    checked.warnings.push_back("the damping ratio is lowered from " + number(o.damping_ratio) +
                               " to " + number(lowered) + ", the device's " +
                               number(limits.max_damping) +
                               " N s/m; a lighter tool or a softer coupling needs less");
    o.damping_ratio = lowered;
  }
  if (o.kind == CouplingKind::proxy && o.hold == ContactHold::interpolation) {
    checked.warnings.push_back(
        "the proxy needs to know how contact changes and uses the local model, not interpolation");
    o.hold = ContactHold::local_model;
  }
  return checked;
}

}  // namespace palpate
