// Rate limit of a client's actions.
#pragma once

#include <algorithm>

namespace palpate { inline namespace v0 {

/// Token bucket: a rate per second on average, and some at once. No clock, no thread.
class RateLimit {
 public:
  RateLimit(double per_second, double at_once)
      : per_second_(per_second), at_once_(at_once), left_(at_once) {}

  /// Takes one action now (s, does not decrease), which counts as `cost`. Returns the wait until
  /// the next one, s; 0: none.
  double take(double now, double cost = 1) {
    if (!has_begun_) last_ = now;
    has_begun_ = true;
    left_ = std::min(left_ + (now - last_) * per_second_, at_once_) - cost;
    last_ = now;
    return std::max(1 - left_, 0.0) / per_second_;
  }

 private:
  double per_second_, at_once_, left_, last_ = 0;
  bool has_begun_ = false;
};

}}  // namespace palpate::v0
