// Trilinear interpolation in a grid of distances: weights of the eight neighbors of a place, and
// their gradient. Shared code for the evaluation on the host and the benchmark's kernel.
#pragma once

#include "palpate/core/core.h"

namespace palpate::eval {

/// A cell of eight distances of a grid that is stored along x first; `Real`: float or double.
template <class Real>
struct TrilinearCell {
  /// Finds the cell of `at`, in cells from the first distance. False: outside of a grid of `num`.
  PALPATE_HOSTDEV bool find(const Real (&at)[3], const int (&num)[3]) {
    for (int axis = 0; axis < 3; ++axis) {
      if (!(at[axis] >= 0 && at[axis] < static_cast<Real>(num[axis] - 1))) return false;
      cell_[axis] = static_cast<int>(at[axis]);
      share_[axis] = at[axis] - static_cast<Real>(cell_[axis]);
    }
    return true;
  }

  /// Returns the interpolated distance. Only after `find` was true.
  PALPATE_HOSTDEV Real distance(const float* distances, const int (&num)[3]) {
    const int row = num[0], slice = num[0] * num[1];
    const float* const d = distances + cell_[2] * slice + cell_[1] * row + cell_[0];
    for (int y = 0; y < 2; ++y) {
      for (int z = 0; z < 2; ++z) {
        const auto first = static_cast<Real>(d[z * slice + y * row]),
                   second = static_cast<Real>(d[z * slice + y * row + 1]);
        along_x_[z][y] = second - first;
        at_x_[z][y] = mix(first, second, share_[0]);
      }
    }
    for (int z = 0; z < 2; ++z) at_y_[z] = mix(at_x_[z][0], at_x_[z][1], share_[1]);
    return mix(at_y_[0], at_y_[1], share_[2]);
  }

  /// Computes the gradient, per cell. Only after `distance`.
  PALPATE_HOSTDEV void gradient(Real (&result)[3]) const {
    result[0] = mix(mix(along_x_[0][0], along_x_[0][1], share_[1]),
                    mix(along_x_[1][0], along_x_[1][1], share_[1]), share_[2]);
    result[1] = mix(at_x_[0][1] - at_x_[0][0], at_x_[1][1] - at_x_[1][0], share_[2]);
    result[2] = at_y_[1] - at_y_[0];
  }

 private:
  static PALPATE_HOSTDEV Real mix(Real a, Real b, Real t) { return a + t * (b - a); }

  int cell_[3] = {};
  Real share_[3] = {};
  Real along_x_[2][2] = {}, at_x_[2][2] = {}, at_y_[2] = {};  ///< by z, by z and y
};

}  // namespace palpate::eval
