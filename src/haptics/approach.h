// The approach of a tool without mass that takes over from another coupling.
#pragma once

#include <utility>

#include "palpate/haptics/local_contact.h"
#include "src/haptics/coupling/rotated.h"
#include "src/haptics/internal/matrix6.h"

namespace palpate { inline namespace v0 {

/// Moves a tool from where another coupling left it to where it belongs, within some tenths of a
/// second. Without such a takeover it is there at once.
class Approach {
 public:
  explicit Approach(const Vec3d& center_of_mass_T) : c_T_(center_of_mass_T) {}

  void begin(const Pose& from) noexcept {
    from_ = from;
    has_begun_ = false;
  }
  /// Returns the pose of the tool, `dt` after the last call, if it belongs at X_WT.
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
  static constexpr double kTime = 0.05;   // s, time constant
  static constexpr double kThere = 1e-6;  // m or rad

  Vec3d c_T_;
  Pose from_;
  Vec6 offset_;  // of the center of mass, and about it
  bool has_begun_ = true;
};

}}  // namespace palpate::v0
