// The contact of a coupling between two queries: held, or extrapolated.
#pragma once

#include "palpate/haptics/coupling.h"
#include "src/haptics/internal/matrix6.h"

namespace palpate::inline v0 {

class HeldContact {
 public:
  /// An angle of 1 counts as `length` metres.
  HeldContact(ContactHold hold, double length) : hold_(hold), length_(length) {}

  void reset() noexcept { *this = HeldContact(hold_, length_); }
  /// What is known at this tick, `dt` after the last one.
  void update(const LocalContact& contact, double dt) noexcept;

  void remember(StateNumbers& numbers) noexcept {
    numbers(contact_, stiffness_.m, is_there_, from_, elapsed_, interval_);
  }

  /// On the tool at this pose, in newtons. Beyond the end of the contact it goes on along the line
  /// and pulls, so that a solver finds the end: see `pushes`.
  Wrench wrench(const Pose& X_WT) const noexcept;
  /// The wrench on the tool at this pose, as it is.
  Wrench exact_wrench(const Pose& X_WT) const noexcept;
  /// What is stored with the tool at this pose, J.
  double energy(const Pose& X_WT) const noexcept;
  /// Whether a wrench that a solver has arrived at is still one of contact.
  bool pushes(const Wrench& wrench) const noexcept;
  bool is_there() const noexcept { return is_there_; }
  /// The newest one.
  const LocalContact& newest() const noexcept { return contact_; }

  /// How it resists motion: symmetric, without negative eigenvalues.
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
  Wrench from_;  // interpolation: where it began, how long ago and how long it takes
  double elapsed_ = 0, interval_ = 0;
};

}  // namespace palpate::inline v0
