// The least and the largest of several numbers.
#pragma once

#include <algorithm>
#include <limits>

namespace palpate::eval {

struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  void add(double x) { low = std::min(low, x), high = std::max(high, x); }
};

}  // namespace palpate::eval
