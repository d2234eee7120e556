// Poses of devices in one common base frame.
//
// All devices have one base frame B: x to the right, y up, z towards the hand, the origin in the
// middle of the workspace. So one placement in the scene fits them all. Makers have frames M of
// their own, which their drivers leave here.
#pragma once

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// The axes of a maker's right-handed frame M.
class MakerAxes {
 public:
  /// Axes of M that are x, y and z of B: 1, 2, 3 for x, y, z; negative: they point the other way.
  constexpr MakerAxes(int x, int y, int z) : axes_{x, y, z} {}

  Vec3d in_base(const Vec3d& v_M) const noexcept {
    Vec3d v_B;
    for (int i = 0; i < 3; ++i) v_B[i] = sign(i) * v_M[index(i)];
    return v_B;
  }
  /// The same turn about the same axis. A handle that M sees straight is straight in B.
  Quaternion in_base(const Quaternion& q_M) const noexcept {
    const Vec3d v_B = in_base(Vec3d{q_M.x, q_M.y, q_M.z});
    return {v_B.x, v_B.y, v_B.z, q_M.w};
  }
  Twist in_base(const Twist& V_M) const noexcept {
    return {in_base(V_M.linear), in_base(V_M.angular)};
  }

  Vec3d of_maker(const Vec3d& v_B) const noexcept {
    Vec3d v_M;
    for (int i = 0; i < 3; ++i) v_M[index(i)] = sign(i) * v_B[i];
    return v_M;
  }
  Wrench of_maker(const Wrench& F_B) const noexcept {
    return {of_maker(F_B.force), of_maker(F_B.torque)};
  }

 private:
  constexpr int index(int i) const { return (axes_[i] < 0 ? -axes_[i] : axes_[i]) - 1; }
  constexpr int sign(int i) const { return axes_[i] < 0 ? -1 : 1; }

  int axes_[3];
};

/// True if a device can have this pose: otherwise its driver or server is wrong. Rotations may be
/// off by rounding.
inline bool is_possible(const Pose& X_BH) noexcept {
  constexpr double kFarthest = 100;  // m
  const Quaternion& q = X_BH.rotation;
  const double square = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
  return is_finite(X_BH) && norm(X_BH.translation) < kFarthest && square > 0.25 && square < 4;
}

}}  // namespace palpate::v0
