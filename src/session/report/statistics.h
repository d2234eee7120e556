// Order statistics.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace palpate { inline namespace v0 {

/// The smallest value that at least this share of the values, which are ascending and at least one,
/// do not exceed.
template <class Value>
Value nearest_rank(const std::vector<Value>& sorted, double share) {
  const double rank = std::ceil(share * static_cast<double>(sorted.size()));
  return sorted[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
}

}}  // namespace palpate::v0
