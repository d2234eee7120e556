// Symmetric positive definite systems with sparse 6 x 6 blocks: one for each pair that touches.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/math/internal/matrix6.h"

namespace palpate { inline namespace v0 {

/// Cholesky by blocks. Zero blocks cost nothing: bodies that do not touch each other, directly or
/// by others, are solved as if alone.
class SymmetricBlocks {
 public:
  /// Allocates memory for `max_rows` rows of blocks.
  explicit SymmetricBlocks(int max_rows);

  /// Sets all blocks to zero.
  void begin(int num_rows) noexcept;
  /// Returns a block of the lower half: row >= column.
  Mat6& at(int row, int column) noexcept;
  /// Factors the system in place. False: not positive definite.
  bool factor() noexcept;
  /// Replaces the right hand side by the solution; the right hand side is zero before row `first`.
  void solve(std::span<Vec6> x, int first = 0) const noexcept;

 private:
  std::size_t place(int row, int column) const noexcept {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(row + 1) / 2 +
           static_cast<std::size_t>(column);
  }
  bool is_there(int row, int column) const noexcept { return filled_[place(row, column)] != 0; }

  int num_rows_ = 0;
  std::vector<Mat6> blocks_;
  std::vector<std::uint8_t> filled_;
};

}}  // namespace palpate::v0
