// The end of the kernels of batches that say how sure they are: standard deviations of a pose.
#pragma once

#include <cmath>

#include "palpate/contact/contact.h"
#include "src/contact/noise/noise_sums_cuda.cuh"

namespace palpate { inline namespace v0 { namespace {

// Returns the standard deviation along an axis, which is a row of R. Rounding may leave a variance
// below 0; one that is no number stays so.
__device__ inline double deviation_along(const Mat3d& covariance, const Mat3d& R, int row) {
  const double(&to)[3] = R.m[row];
  double variance = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) variance += to[i] * covariance.m[i][j] * to[j];
  }
  return variance < 0 ? 0.0 : sqrt(variance);
}

// Writes the deviations of a pose, which the rows of R turn to W. Zeros if it is not measured.
__device__ inline void put_deviations(const BatchAnswers& out, int pose, bool is_measured,
                                      bool is_known, const Mat3d& R, const double* variances) {
  const int thread = static_cast<int>(threadIdx.x);
  if (thread >= kNumChanges) return;
  const MeasureNoise noise = measure_noise(variances);
  const int row = (thread + 2) % 3;
  const std::ptrdiff_t axis = 3 * static_cast<std::ptrdiff_t>(pose) + row;
  double* const to = thread == 0  ? (out.volume_std == nullptr ? nullptr : out.volume_std + pose)
                     : thread < 4 ? (out.force_std == nullptr ? nullptr : out.force_std + axis)
                                  : (out.torque_std == nullptr ? nullptr : out.torque_std + axis);
  if (to == nullptr) return;
  double deviation = thread == 0 ? sqrt(noise.volume)
                                 : deviation_along(thread < 4 ? noise.force : noise.torque, R, row);
  if (!is_known) deviation = NAN;
  *to = is_measured ? deviation : 0.0;
}

}}}  // namespace palpate::v0
