// The runs of missing pixels in a depth image, and the filling of those between two separate
// surfaces (gap_rules.h).
#pragma once

#include <cstdint>
#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "src/field/pyramid/field_rows.h"

namespace palpate { inline namespace v0 {

/// Each word of a row stands for kBits columns, from its lowest bit on. Rows do not depend on each
/// other, nor do words of columns.
class HoleRuns {
 public:
  static constexpr int kBits = 64;

  HoleRuns(int width, int height);

  /// Forgets all pixels.
  void clear();
  /// The bits of a row's missing pixels, to be set.
  std::uint64_t* missing(int v) { return missing_.data() + word(v, 0); }

  /// Fills the runs of row v of level 0 inside of a window. Their pixels are not missing any more.
  void fill_row(const Intrinsics& k, const FieldImage& image, const PixelWindow& window, int v);
  /// Fills the runs that are left in the columns of word `number`, inside of a window.
  void fill_columns(const Intrinsics& k, const FieldImage& image, const PixelWindow& window,
                    int number);
  int words_in_row() const { return words_; }

  /// A bit for each pixel that was filled; words of 32, 2 words_in_row() in a row.
  const std::uint32_t* filled() const { return filled_.data(); }

 private:
  std::size_t word(int v, int number) const {
    return static_cast<std::size_t>(v) * static_cast<std::size_t>(words_) +
           static_cast<std::size_t>(number);
  }
  bool is_missing(int v, int u) const {
    return (missing_[word(v, u / kBits)] >> u % kBits & 1) != 0;
  }
  int next(int v, int u, int end, bool missing) const;
  void put(const FieldImage& image, int v, int u, const TangentPlane& plane);

  int words_;
  std::vector<std::uint64_t> missing_;
  std::vector<std::uint32_t> filled_;
};

}}  // namespace palpate::v0
