// Symmetric positive definite systems of which a few blocks of 6 x 6 are there: who touches whom.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/haptics/internal/matrix6.h"

namespace palpate::inline v0 {

/// Cholesky by blocks. What is zero costs nothing: bodies that do not touch each other, directly or
/// by others, are solved as if alone.
class SymmetricBlocks {
 public:
  /// With room for so many rows of blocks.
  explicit SymmetricBlocks(int max_rows);

  /// All zero.
  void begin(int num_rows) noexcept;
  /// Of the lower half: row >= column.
  Mat6& at(int row, int column) noexcept;
  /// In place. False: not positive definite.
  bool factor() noexcept;
  /// In place: from the right hand side to the solution, of which there is none before row
  /// `first` on the right hand side.
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

}  // namespace palpate::inline v0
