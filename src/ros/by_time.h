// Samples in the order of their times.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <vector>

namespace palpate::inline v0 {

/// `Timed` has a `time`. Messages mostly come in order; of two of one time the first one counts.
template <class Timed>
void insert_by_time(std::vector<Timed>& all, const Timed& one) {
  if (all.empty() || all.back().time < one.time) {
    all.push_back(one);
    return;
  }
  const auto at = std::ranges::lower_bound(all, one.time, {}, &Timed::time);
  if (at->time != one.time) all.insert(at, one);
}

/// The same of what goes on for ever: of all that is older than the newest one by more than `kept`
/// s, the newest is kept, and for a while others. A clock that was set back has started anew.
template <class Timed>
void insert_newest(std::vector<Timed>& all, const Timed& one, double kept) {
  constexpr double kLongestBack = 1;  // s that a message may be late
  if (!all.empty() && one.time < all.back().time - kLongestBack) all.clear();
  insert_by_time(all, one);
  const auto first = std::ranges::lower_bound(all, all.back().time - kept, {}, &Timed::time);
  // Not with each one, so that it costs little.
  if (first - all.begin() > std::max<std::ptrdiff_t>(all.end() - first, 1)) {
    all.erase(all.begin(), first - 1);
  }
}

/// s: how far the nearest of them is from a time. There is at least one.
template <class Timed>
double nearest_in_time(const std::vector<Timed>& all, double time) {
  const auto after = std::ranges::lower_bound(all, time, {}, &Timed::time);
  const double to = after == all.end() ? time - all.back().time : after->time - time;
  return after == all.begin() || after == all.end() ? std::abs(to)
                                                    : std::min(to, time - (after - 1)->time);
}

}  // namespace palpate::inline v0
