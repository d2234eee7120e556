// Measurements against cameras that stand somewhere in the world.
#include <algorithm>

#include "src/contact/blend.h"

namespace palpate {
namespace {

Mat3d product(const Mat3d& a, const Mat3d& b) {
  Mat3d ab;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) ab.m[i][j] += a.m[i][k] * b.m[k][j];
    }
  }
  return ab;
}
Mat3d transposed(const Mat3d& a) {
  Mat3d t;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) t.m[i][j] = a.m[j][i];
  }
  return t;
}

/// What was measured in the frame of a camera, in the world.
void turn(const Quaternion& q_WC, ContactResult& result) {
  VolumeWrench& measure = result.penetration.measure_W;
  measure = {rotate(q_WC, measure.force), rotate(q_WC, measure.torque)};
  if (!result.stiffness) return;
  const Mat3d R_WC = rotation_matrix(q_WC), R_CW = transposed(R_WC);
  const auto turn_block = [&](auto& rows, int row, int column) {
    Mat3d block;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) block.m[i][j] = rows[row + i][column + j];
    }
    block = product(product(R_WC, block), R_CW);
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) rows[row + i][column + j] = block.m[i][j];
    }
  };
  for (const int row : {0, 3}) {
    for (const int column : {0, 3}) turn_block(result.stiffness->m, row, column);
  }
  turn_block(result.moments.first, 0, 0);
}

}  // namespace

ContactResult ContactQuery::measure(std::span<const CameraView> cameras, const Pose& X_WT,
                                    const ContactWants& wants) const noexcept {
  const auto is_valid = [](const CameraView& view) { return is_finite(view.X_WC); };
  if (!is_finite(X_WT) || !std::all_of(cameras.begin(), cameras.end(), is_valid)) {
    return unmeasured(StepStatus::non_finite_pose, wants, true);
  }
  if (cameras.empty() || cameras.size() > kMostCameras) {
    return unmeasured(StepStatus::no_surface, wants, true);
  }
  if (cameras.size() > 1) {
    return measure_hull(cameras, {X_WT.translation, normalized(X_WT.rotation)}, wants);
  }
  const auto& [surface, X_WC] = cameras.front();
  const bool is_at_origin = X_WC == Pose{};
  const Quaternion q_WC = normalized(X_WC.rotation);
  const Pose X_CT = is_at_origin ? X_WT : inverse({X_WC.translation, q_WC}) * X_WT;
  ContactResult result = measure(surface.from, surface.to, surface.progress, X_CT, wants);
  if (!is_at_origin) turn(q_WC, result);
  if (surface.to.seen_free.num_levels > 0 && !result.penetration.status.is_unmeasured()) {
    const Pose X{X_WT.translation, normalized(X_WT.rotation)};
    result.penetration.unseen_volume = measure_hull(cameras, X, {}).penetration.unseen_volume;
  }
  return result;
}

ContactResult ContactQuery::measure_hull(std::span<const CameraView>, const Pose&,
                                         const ContactWants& wants) const noexcept {
  return unmeasured(StepStatus::no_surface, wants, true);
}

}  // namespace palpate
