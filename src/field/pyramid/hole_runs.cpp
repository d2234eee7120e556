#include "src/field/pyramid/hole_runs.h"

#include <algorithm>
#include <bit>

#include "src/field/pyramid/gap_rules.h"

namespace palpate { inline namespace v0 {

HoleRuns::HoleRuns(int width, int height)
    : words_((width + kBits - 1) / kBits),
      missing_(static_cast<std::size_t>(words_) * static_cast<std::size_t>(height)),
      filled_(2 * missing_.size()) {}

void HoleRuns::clear() {
  std::fill(missing_.begin(), missing_.end(), 0);
  std::fill(filled_.begin(), filled_.end(), 0);
}

/// Returns the first column from u on that is missing, or that is not; `end` if there is none.
int HoleRuns::next(int v, int u, int end, bool missing) const {
  while (u < end) {
    const std::uint64_t bits = missing_[word(v, u / kBits)];
    const std::uint64_t left = (missing ? bits : ~bits) >> u % kBits;
    if (left != 0) return std::min(u + std::countr_zero(left), end);
    u = (u / kBits + 1) * kBits;
  }
  return end;
}

void HoleRuns::put(const FieldImage& image, int v, int u, const TangentPlane& plane) {
  image.row(v)[u] = plane;
  missing_[word(v, u / kBits)] &= ~(std::uint64_t{1} << u % kBits);
  filled_[2 * word(v, 0) + static_cast<std::size_t>(u / 32)] |= 1u << u % 32;
}

void HoleRuns::fill_row(const Intrinsics& k, const FieldImage& image, const PixelWindow& window,
                        int v) {
  const float width = one_lane::rule_level(k, 0).width_u;
  const TangentPlane* const row = image.row(v);
  int end = window.left;
  for (;;) {
    const int begin = next(v, end, window.right, true);
    end = next(v, begin, window.right, false);
    if (end == window.right) return;
    if (begin == window.left || end - begin > kMaxRun) continue;
    const TangentPlane filling =
        filling_of_run(row[begin - 1], row[end], static_cast<float>(end - begin + 1) * width);
    if (!filling.is_surface()) continue;
    for (int u = begin; u < end; ++u) put(image, v, u, filling);
  }
}

void HoleRuns::fill_columns(const Intrinsics& k, const FieldImage& image, const PixelWindow& window,
                            int number) {
  const float width = one_lane::rule_level(k, 0).width_v;
  std::uint64_t above = ~std::uint64_t{0};
  for (int v = window.top; v < window.bottom; ++v) {
    const std::uint64_t here = missing_[word(v, number)];
    for (std::uint64_t begins = here & ~above; begins != 0; begins &= begins - 1) {
      const int u = number * kBits + std::countr_zero(begins);
      int end = v + 1;
      while (end < window.bottom && end - v <= kMaxRun && is_missing(end, u)) ++end;
      if (end == window.bottom || end - v > kMaxRun) continue;
      const TangentPlane filling = filling_of_run(image.row(v - 1)[u], image.row(end)[u],
                                                  static_cast<float>(end - v + 1) * width);
      if (!filling.is_surface()) continue;
      for (int row = v; row < end; ++row) put(image, row, u, filling);
    }
    above = here;
  }
}

}}  // namespace palpate::v0
