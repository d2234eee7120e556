// Order statistics of compute times.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace palpate {

struct Percentiles {
  double median = 0, p99 = 0, p999 = 0, max = 0;
};

/// Nearest rank; zeros for no values.
inline Percentiles percentiles(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    const double rank = std::ceil(share * static_cast<double>(values.size()));
    return values[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
  };
  return {at(0.5), at(0.99), at(0.999), values.back()};
}

}  // namespace palpate
