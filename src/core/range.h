// Settings and the ranges they must be in.
#pragma once

#include <cstdio>
#include <span>
#include <string>

namespace palpate {

/// A setting by its name for people, and its least and greatest value.
struct Range {
  const char* name;
  double value, low, high;

  /// NaN is in no range.
  bool holds() const { return value >= low && value <= high; }
};

/// The first one that is out of its range, or null.
inline const Range* first_outside(std::span<const Range> ranges) {
  for (const Range& range : ranges) {
    if (!range.holds()) return &range;
  }
  return nullptr;
}

/// A number as people write it, of at most so many digits.
inline std::string number_text(double value, int digits = 6) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

}  // namespace palpate
