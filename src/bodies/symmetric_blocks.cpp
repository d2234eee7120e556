#include "src/bodies/symmetric_blocks.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

/// a -= b c^T.
void subtract_product(Mat6& a, const Mat6& b, const Mat6& c) {
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      double sum = 0;
      for (int k = 0; k < 6; ++k) sum += b.m[i][k] * c.m[j][k];
      a.m[i][j] -= sum;
    }
  }
}

/// Factors the lower half in place; the upper one stays.
bool factor_block(Mat6& a) {
  for (int j = 0; j < 6; ++j) {
    double diagonal = a.m[j][j];
    for (int k = 0; k < j; ++k) diagonal -= a.m[j][k] * a.m[j][k];
    if (!(diagonal > 0)) return false;
    a.m[j][j] = std::sqrt(diagonal);
    for (int i = j + 1; i < 6; ++i) {
      double value = a.m[i][j];
      for (int k = 0; k < j; ++k) value -= a.m[i][k] * a.m[j][k];
      a.m[i][j] = value / a.m[j][j];
    }
  }
  return true;
}

/// a = a l^-T, with a lower triangle l.
void divide(Mat6& a, const Mat6& l) {
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      double value = a.m[i][j];
      for (int k = 0; k < j; ++k) value -= a.m[i][k] * l.m[j][k];
      a.m[i][j] = value / l.m[j][j];
    }
  }
}

}  // namespace

SymmetricBlocks::SymmetricBlocks(int max_rows)
    : blocks_(place(max_rows, 0)), filled_(blocks_.size()) {}

void SymmetricBlocks::begin(int num_rows) noexcept {
  num_rows_ = num_rows;
  std::fill_n(filled_.begin(), place(num_rows, 0), std::uint8_t{0});
}

Mat6& SymmetricBlocks::at(int row, int column) noexcept {
  const std::size_t i = place(row, column);
  if (filled_[i] == 0) {
    filled_[i] = 1;
    blocks_[i] = {};
  }
  return blocks_[i];
}

bool SymmetricBlocks::factor() noexcept {
  for (int j = 0; j < num_rows_; ++j) {
    for (int k = 0; k < j; ++k) {
      if (is_there(j, k)) subtract_product(at(j, j), at(j, k), at(j, k));
    }
    if (!factor_block(at(j, j))) return false;
    for (int i = j + 1; i < num_rows_; ++i) {
      for (int k = 0; k < j; ++k) {
        if (is_there(i, k) && is_there(j, k)) subtract_product(at(i, j), at(i, k), at(j, k));
      }
      if (is_there(i, j)) divide(at(i, j), at(j, j));
    }
  }
  return true;
}

void SymmetricBlocks::solve(std::span<Vec6> x, int first) const noexcept {
  for (int i = first; i < num_rows_; ++i) {
    Vec6& own = x[static_cast<std::size_t>(i)];
    for (int k = first; k < i; ++k) {
      if (is_there(i, k)) own = own - blocks_[place(i, k)] * x[static_cast<std::size_t>(k)];
    }
    const Mat6& l = blocks_[place(i, i)];
    for (int r = 0; r < 6; ++r) {
      for (int c = 0; c < r; ++c) own[r] -= l.m[r][c] * own[c];
      own[r] /= l.m[r][r];
    }
  }
  for (int i = num_rows_ - 1; i >= 0; --i) {
    Vec6& own = x[static_cast<std::size_t>(i)];
    for (int k = i + 1; k < num_rows_; ++k) {
      if (!is_there(k, i)) continue;
      const Mat6& l = blocks_[place(k, i)];
      const Vec6& other = x[static_cast<std::size_t>(k)];
      for (int r = 0; r < 6; ++r) {
        for (int c = 0; c < 6; ++c) own[r] -= l.m[c][r] * other[c];
      }
    }
    const Mat6& l = blocks_[place(i, i)];
    for (int r = 5; r >= 0; --r) {
      for (int c = r + 1; c < 6; ++c) own[r] -= l.m[c][r] * own[c];
      own[r] /= l.m[r][r];
    }
  }
}

}}  // namespace palpate::v0
