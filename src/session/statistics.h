// Order statistics.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace palpate {

/// The smallest value that at least this share of the values, which are ascending and at least one,
/// do not exceed.
template <class Value>
Value nearest_rank(const std::vector<Value>& sorted, double share) {
  const double rank = std::ceil(share * static_cast<double>(sorted.size()));
  return sorted[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
}

/// Of compute times.
struct Percentiles {
  double median = 0, p99 = 0, p999 = 0, max = 0;
};

/// Nearest rank; zeros for no values.
inline Percentiles percentiles(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  return {nearest_rank(values, 0.5), nearest_rank(values, 0.99), nearest_rank(values, 0.999),
          values.back()};
}

}  // namespace palpate
