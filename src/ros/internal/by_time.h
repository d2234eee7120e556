// Samples in the order of their times.
#pragma once

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>

namespace palpate { inline namespace v0 {

/// Samples by time, s.
template <class Value>
using ByTime = std::map<double, Value>;

/// Inserts a sample; of two of one time the first one counts. Of all that is older than the newest
/// one by more than `kept` s, only the newest is kept. If `kept` is finite, a jump back by more
/// than 1 s drops all: the clock has started anew.
template <class Value>
void insert_by_time(ByTime<Value>& all, double time, const Value& reported, double kept) {
  constexpr double kLongestBack = 1;  // s that a message may be late
  const bool is_live = std::isfinite(kept);
  if (is_live && !all.empty() && time < all.rbegin()->first - kLongestBack) all.clear();
  all.try_emplace(all.end(), time, reported);
  if (!is_live) return;
  const auto first = all.lower_bound(all.rbegin()->first - kept);
  if (first != all.begin()) all.erase(all.begin(), std::prev(first));
}

/// Returns how far the nearest sample is from a time, s. `all` is not empty.
template <class Value>
double nearest_in_time(const ByTime<Value>& all, double time) {
  const auto after = all.lower_bound(time);
  if (after == all.begin()) return after->first - time;
  const double since = time - std::prev(after)->first;
  return after == all.end() ? since : std::min(after->first - time, since);
}

}}  // namespace palpate::v0
