// The contact of a coupling between two queries: held, or extrapolated.
#pragma once

#include "palpate/haptics/coupling.h"
#include "src/haptics/internal/matrix6.h"

namespace palpate { inline namespace v0 {

class HeldContact {
 public:
  /// An angle of 1 counts as `length` meters.
  HeldContact(ContactHold hold, double length) : hold_(hold), length_(length) {}

  void reset() noexcept { *this = HeldContact(hold_, length_); }
  /// Takes the newest contact at this tick, `dt` after the last one.
  void update(const LocalContact& contact, double dt) noexcept;

  /// Returns the wrench on the tool at this pose. Beyond the end of the contact it continues along
  /// the line and pulls, so that a solver finds the end: see `pushes`.
  Wrench wrench(const Pose& X_WT) const noexcept;
  /// Returns the wrench on the tool at this pose, which ends with the contact.
  Wrench exact_wrench(const Pose& X_WT) const noexcept;
  /// Returns the energy stored in the contact with the tool at this pose, J.
  double energy(const Pose& X_WT) const noexcept;
  /// True if a solver's wrench still pushes along the measured force.
  bool pushes(const Wrench& wrench) const noexcept;
  bool is_there() const noexcept { return is_there_; }
  /// The newest one.
  const LocalContact& newest() const noexcept { return contact_; }

  /// Stiffness of the contact: symmetric, without negative eigenvalues.
  const Mat6& stiffness() const noexcept { return stiffness_; }
  /// Its largest stiffness, N/m.
  double max_stiffness() const noexcept { return contact_.max_stiffness; }

 private:
  Wrench between() const noexcept;

  ContactHold hold_;
  double length_;
  LocalContact contact_;  // the newest one
  Mat6 stiffness_;
  bool is_there_ = false;
  Wrench from_;  // interpolation: its first wrench, time since then and duration, s
  double elapsed_ = 0, interval_ = 0;
};

}}  // namespace palpate::v0
