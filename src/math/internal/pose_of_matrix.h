// Rotation and pose from the entries of a matrix. Shared by host and device.
#pragma once

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// The unit quaternion of a rotation matrix, by the largest of its four components (Shepperd).
PALPATE_HOSTDEV inline Quaternion quaternion_of(const Mat3d& R) {
  const auto& m = R.m;
  const double xx = m[0][0], yy = m[1][1], zz = m[2][2];
  Quaternion q;
  if (xx + yy + zz > 0) {
    q = {m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1 + xx + yy + zz};
  } else if (xx >= yy && xx >= zz) {
    q = {1 + xx - yy - zz, m[0][1] + m[1][0], m[0][2] + m[2][0], m[2][1] - m[1][2]};
  } else if (yy >= zz) {
    q = {m[0][1] + m[1][0], 1 - xx + yy - zz, m[1][2] + m[2][1], m[0][2] - m[2][0]};
  } else {
    q = {m[0][2] + m[2][0], m[1][2] + m[2][1], 1 - xx - yy + zz, m[1][0] - m[0][1]};
  }
  return normalized(q);
}

/// True if all numbers are finite: is_finite on a device, too.
PALPATE_HOSTDEV inline bool is_all_finite(const Pose& X) {
  const Vec3d& t = X.translation;
  const Quaternion& q = X.rotation;
  const double sum = t.x + t.y + t.z + q.x + q.y + q.z + q.w;
  return sum - sum == 0;
}

/// The pose of a 4 x 4 matrix, row by row. One that is not finite, or no rigid motion up to 1e-3,
/// has a pose that is not finite.
template <class Real>
PALPATE_HOSTDEV Pose pose_of_matrix(const Real* matrix) {
  constexpr double kTolerance = 1e-3;
  double m[4][4];
  for (int i = 0; i < 16; ++i) m[i / 4][i % 4] = static_cast<double>(matrix[i]);
  Mat3d R;
  bool is_near =
      std::abs(m[3][0]) + std::abs(m[3][1]) + std::abs(m[3][2]) + std::abs(m[3][3] - 1) <=
      kTolerance;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      R.m[i][j] = m[i][j];
      const double product = m[i][0] * m[j][0] + m[i][1] * m[j][1] + m[i][2] * m[j][2];
      is_near = is_near && std::abs(product - (i == j ? 1 : 0)) <= kTolerance;
    }
  }
  const Vec3d x{m[0][0], m[1][0], m[2][0]}, y{m[0][1], m[1][1], m[2][1]},
      z{m[0][2], m[1][2], m[2][2]};
  Pose X{{m[0][3], m[1][3], m[2][3]}, {}};
  if (is_near && dot(cross(x, y), z) > 0) {
    X.rotation = quaternion_of(R);
  } else {
    X.rotation.x = static_cast<double>(NAN);
  }
  return X;
}

}}  // namespace palpate::v0
