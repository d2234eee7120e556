// How a tool without mass takes over from another coupling.
#pragma once

#include <utility>

#include "palpate/haptics/local_contact.h"
#include "src/haptics/internal/matrix6.h"
#include "src/haptics/rotated.h"

namespace palpate::inline v0 {

/// Such a tool is at once where it belongs. Unless another coupling had it elsewhere: then it comes
/// from there, within some tenths of a second.
class Approach {
 public:
  explicit Approach(const Vec3d& centre_of_mass_T) : c_T_(centre_of_mass_T) {}

  void begin(const Pose& from) noexcept {
    from_ = from;
    has_begun_ = false;
  }
  void remember(StateNumbers& numbers) noexcept {
    numbers(from_, offset_.linear, offset_.angular, has_begun_);
  }
  /// Where the tool is, `dt` after the last time, if it belongs to X_WT.
  Pose at(const Pose& X_WT, double dt) noexcept {
    if (!std::exchange(has_begun_, true)) {
      offset_ = {from_ * c_T_ - X_WT * c_T_, rotation_between(X_WT.rotation, from_.rotation)};
    } else {
      offset_ = kTime / (kTime + dt) * offset_;
    }
    if (norm(offset_.linear) + norm(offset_.angular) < kThere) offset_ = {};
    if (offset_.linear == Vec3d{} && offset_.angular == Vec3d{}) return X_WT;
    Pose X_WT_now;
    X_WT_now.rotation = rotated(X_WT.rotation, offset_.angular);
    X_WT_now.translation = X_WT * c_T_ + offset_.linear - rotate(X_WT_now.rotation, c_T_);
    return X_WT_now;
  }

 private:
  static constexpr double kTime = 0.05;   // s, to a third
  static constexpr double kThere = 1e-6;  // m or rad

  Vec3d c_T_;
  Pose from_;
  Vec6 offset_;  // of the centre of mass, and about it
  bool has_begun_ = true;
};

}  // namespace palpate::inline v0
