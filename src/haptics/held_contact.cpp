#include "src/haptics/held_contact.h"

#include <algorithm>

namespace palpate { inline namespace v0 {
namespace {

/// A cap of volume V and depth h on a round or flat tool is cut at an area of 3 to 12 times
/// V^(2/3), and the force grows with the depth as the volume does, by that area.
constexpr double kAreaOfCap = 6;

/// Force and torque above which a contact is not usable, N and N m.
constexpr double kLargestWrench = 1e6;

/// Longest time over which wrenches are interpolated, s.
constexpr double kMaxInterval = 0.1;

/// Sets a stiffness along the wrench for measures that have no derivative (those of the thesis):
/// most likely, the contact resists more of the same motion.
void assume_stiffness(LocalContact& contact) {
  const double force = norm(contact.F_C_W.force);
  if (!(force > 0 && contact.volume > 0)) return;
  contact.max_stiffness = kAreaOfCap * force / std::cbrt(contact.volume);
  const Vec6 along = (1 / force) * to_vec6(contact.F_C_W);
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      contact.stiffness.m[i][j] = contact.max_stiffness * along[i] * along[j];
    }
  }
}

bool is_zero(const Stiffness& k) {
  return std::all_of(&k.m[0][0], &k.m[0][0] + 36, [](double x) { return x == 0; });
}

bool is_same(const LocalContact& a, const LocalContact& b) {
  return a.is_valid == b.is_valid && a.time == b.time && a.X_WT == b.X_WT;
}

Wrench blend(const Wrench& a, const Wrench& b, double t) {
  return {a.force + (b.force - a.force) * t, a.torque + (b.torque - a.torque) * t};
}

}  // namespace

void HeldContact::update(const LocalContact& contact, double dt) noexcept {
  elapsed_ += dt;
  if (!is_same(contact, contact_)) {
    from_ = between();
    const double interval = contact.time - contact_.time;
    interval_ = contact_.is_valid && interval > 0 ? std::min(interval, kMaxInterval) : 0;
    elapsed_ = 0;
  }
  contact_ = contact;
  if (is_zero(contact_.stiffness)) assume_stiffness(contact_);
  stiffness_ = positive_part(contact_.stiffness.m, length_);
  is_there_ = contact_.is_valid && norm(contact_.F_C_W.force) < kLargestWrench &&
              norm(contact_.F_C_W.torque) < kLargestWrench && is_finite(contact_.X_WT) &&
              is_finite(contact_.p_WC);
}

Wrench HeldContact::between() const noexcept {
  if (!is_there_) return {};
  return elapsed_ < interval_ ? blend(from_, contact_.F_C_W, elapsed_ / interval_) : contact_.F_C_W;
}

Wrench HeldContact::wrench(const Pose& X_WT) const noexcept {
  if (!is_there_) return {};
  if (hold_ == ContactHold::interpolation) return between();
  const Wrench line = contact_line(contact_, X_WT);
  return pushes(line) ? limit_contact(contact_, line) : line;
}

Wrench HeldContact::exact_wrench(const Pose& X_WT) const noexcept {
  return hold_ == ContactHold::interpolation ? between() : contact_.at(X_WT);
}

/// Sums the measured energy and the work of moving the tool along the line since.
double HeldContact::energy(const Pose& X_WT) const noexcept {
  if (!contact_.is_valid && std::isfinite(contact_.energy)) return std::max(contact_.energy, 0.0);
  if (!is_there_) return 0;
  const Vec6 motion = motion_since(contact_, X_WT);
  const Vec6 mean = 0.5 * (to_vec6(contact_.F_C_W) + to_vec6(exact_wrench(X_WT)));
  const double work = -dot(mean.linear, motion.linear) - dot(mean.angular, motion.angular);
  return std::max(contact_.energy + work, 0.0);
}

bool HeldContact::pushes(const Wrench& wrench) const noexcept {
  const Vec3d& measured =
      hold_ == ContactHold::interpolation ? between().force : contact_.F_C_W.force;
  return measured == Vec3d{} || dot(wrench.force, measured) > 0;
}

}}  // namespace palpate::v0
