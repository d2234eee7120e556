// Derivatives by the numbers of poses, from those by motions of the tool: what automatic
// differentiation needs beside the results of a batch, in one launch instead of dozens.
//
//   motion: shift v of the center of mass C and small rotation w about C, in W;  (v, w) = J(x) dx
//   U with the derivative g by motions, and dg = H (v, w):
//     gradient by x:              J^T g
//     that of y . (J^T g) by x:   J^T H^T J y + (d/dx J^T y) g
#pragma once

#include <cstddef>

#include "palpate/core/core.h"
#include "palpate/gpu/devices.h"

namespace palpate { inline namespace v0 {

/// Poses X_WT as others have them, P x 7 numbers tx ty tz qx qy qz qw with quaternions of any
/// length, or P 4 x 4 matrices row by row.
struct PoseNumbers {
  const void* numbers = nullptr;
  std::size_t num = 0;     ///< P
  bool is_matrix = false;  ///< else seven numbers each
  bool is_single = false;  ///< float, else double: of all void arrays
  int gpu = kHostMemory;   ///< memory of all arrays
};

/// Arguments of put_pose_gradients. Steps are from pose to pose; 0: one entry for all.
struct PoseGradients {
  PoseNumbers poses;
  const double* p_TC = nullptr;  ///< P x 3, or one: center of mass of each tool
  std::ptrdiff_t center_step = 0;
  /// P x 3 each: g = factor * (by_shift, by_turn).
  const double *by_shift = nullptr, *by_turn = nullptr;
  std::ptrdiff_t shift_step = 3, turn_step = 3;
  double factor = 1;
  const void* scale = nullptr;  ///< P: multiplies all that is written; null: 1
  std::ptrdiff_t scale_step = 1;

  const void* along = nullptr;  ///< y, as poses; null: the gradient is written, else its derivative
  /// P x 6 x 6: minus the derivative of (by_shift, by_turn) by motions, as a stiffness is. Or null,
  /// then of a point that moves with the tool before a plane, P x 3: from C, in T.
  const double *stiffness = nullptr, *p_CQ = nullptr;

  void* to = nullptr;        ///< as poses; zeros where there is no pose; null: by_scale alone
  void* by_scale = nullptr;  ///< P: y . (J^T g); null: not computed
};

/// Writes gradients, or their derivatives along y. On a GPU the call only enqueues one launch in
/// the stream, and may be captured in a CUDA graph. O(P). Error: a GPU that failed.
Status put_pose_gradients(const PoseGradients& job, CallerStream stream = {});

/// Writes P x 7 numbers as a batch takes them; not finite where there is no pose: a quaternion of
/// zeros, a matrix that is no rigid motion, numbers that are not finite. Otherwise as above.
Status put_plain_poses(const PoseNumbers& poses, double* to, CallerStream stream = {});

/// The same on a GPU, which a build without CUDA has in tests only.
Status put_pose_gradients_cuda(const PoseGradients& job, CallerStream stream);
Status put_plain_poses_cuda(const PoseNumbers& poses, double* to, CallerStream stream);

}}  // namespace palpate::v0
