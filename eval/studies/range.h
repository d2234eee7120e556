// The least and the largest of several numbers.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate::eval {

/// Not a number once one of them is none.
struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  void add(double x) {
    low = std::isnan(x) ? x : std::min(low, x);
    high = std::isnan(x) ? x : std::max(high, x);
  }
};

}  // namespace palpate::eval
