// Cholesky's factors of symmetric positive definite matrices, and systems solved with them. A
// matrix is n rows of n numbers, one row after the other.
#pragma once

#include <cmath>

namespace palpate { inline namespace v0 {

/// Replaces the lower half of a matrix, which alone is read, by its triangular factor L: a = L L^T.
/// False if it is not positive definite: a pivot is at most `least`.
inline bool factor_cholesky(double* a, int n, double least = 0) {
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j <= i; ++j) {
      double value = a[i * n + j];
      for (int k = 0; k < j; ++k) value -= a[i * n + k] * a[j * n + k];
      if (j < i) {
        a[i * n + j] = value / a[j * n + j];
      } else if (value > least) {
        a[i * n + i] = std::sqrt(value);
      } else {
        return false;
      }
    }
  }
  return true;
}

/// Replaces b by the x of L x = b, with the triangular factor L.
template <class Vector>
void solve_forward(const double* l, int n, Vector&& b) {
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < i; ++k) b[i] -= l[i * n + k] * b[k];
    b[i] /= l[i * n + i];
  }
}

/// Replaces b by the x of L^T x = b, with the triangular factor L.
template <class Vector>
void solve_backward(const double* l, int n, Vector&& b) {
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) b[i] -= l[k * n + i] * b[k];
    b[i] /= l[i * n + i];
  }
}

}}  // namespace palpate::v0
