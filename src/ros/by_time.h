// What was told of at times, in their order.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace palpate {

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

/// Of what goes on for ever only the newest are kept, at least `num` of them.
template <class Timed>
void keep_newest(std::vector<Timed>& all, std::size_t num) {
  if (all.size() > 2 * num) {
    all.erase(all.begin(), all.end() - static_cast<std::ptrdiff_t>(num));
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

}  // namespace palpate
