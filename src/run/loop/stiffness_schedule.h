// Schedule of the contact stiffness, which changes slowly: computed at every query if both fit into
// 80 % of the period, else at every n-th.
#pragma once

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {

/// Chooses at which queries the stiffness is computed too: at each one if the two together fit into
/// the period of queries, else at each n-th, so that it takes at most as much time as is left.
class StiffnessSchedule {
 public:
  explicit StiffnessSchedule(double period) : budget_(kShare * period) {}

  /// True if the stiffness is due; called once before each query.
  bool is_due() {
    if (num_to_skip_ == 0) return true;
    --num_to_skip_;
    return false;
  }
  /// Records the time of a query, s, with or without the stiffness.
  void took(double query, bool with_stiffness) {
    if (!with_stiffness) {
      query_ += kSmoothing * (query - query_);
      return;
    }
    const double stiffness = std::max(query - query_, 0.0);
    stiffness_ = stiffness_ < 0 ? stiffness : stiffness_ + kSmoothing * (stiffness - stiffness_);
    const double left = std::max(budget_ - query_, budget_ / kMaxSkipped);
    num_to_skip_ = static_cast<int>(std::clamp(std::ceil(stiffness_ / left), 1.0, kMaxSkipped)) - 1;
  }

 private:
  static constexpr double kShare = 0.8, kSmoothing = 0.125, kMaxSkipped = 32;

  double budget_;
  double query_ = 0, stiffness_ = -1;  // s, running means
  int num_to_skip_ = 0;
};

}}  // namespace palpate::v0
