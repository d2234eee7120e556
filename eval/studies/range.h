// Range and percentiles of numbers.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace palpate::eval {

/// NaN once one of the numbers is.
struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  void add(double x) {
    low = std::isnan(x) ? x : std::min(low, x);
    high = std::isnan(x) ? x : std::max(high, x);
  }
};

/// Returns the value at this share of the sorted ones, 0.5 being the median; 0 if there are none.
inline double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const auto last = static_cast<double>(values.size() - 1);
  return values[static_cast<std::size_t>(std::lround(share * last))];
}

}  // namespace palpate::eval
