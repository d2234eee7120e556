#include "src/bodies/symmetric_blocks.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

/// Subtracts b c^T.
void subtract_product(Mat6& a, const Mat6& b, const Mat6& c) {
  a = sum(a, -1, product(b, transposed(c)));
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
    if (!factor_cholesky(at(j, j).m[0], 6)) return false;
    for (int i = j + 1; i < num_rows_; ++i) {
      for (int k = 0; k < j; ++k) {
        if (is_there(i, k) && is_there(j, k)) subtract_product(at(i, j), at(i, k), at(j, k));
      }
      if (!is_there(i, j)) continue;
      for (auto& row_of_block : at(i, j).m)
        solve_forward(at(j, j).m[0], 6, row_of_block);  // a L^-T
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
    solve_forward(blocks_[place(i, i)].m[0], 6, own);
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
    solve_backward(blocks_[place(i, i)].m[0], 6, own);
  }
}

}}  // namespace palpate::v0
