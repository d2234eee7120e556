#include "eval/studies/verdict_rules.h"

#include <algorithm>
#include <cmath>
#include <span>

namespace palpate::eval {
namespace {

constexpr double kAsExact = 1.02;   // errors of two libraries on the same image
constexpr double kAsGood = 1.25;    // irrelevantly worse at most
constexpr double kFarFrom = 2;      // clearly not as good
constexpr double kHalfStep = 0.75;  // of the largest step, if it shrinks with the steps

bool are_finite(double a, double b) { return std::isfinite(a) && std::isfinite(b); }

struct Share {
  int num = 0, num_below = 0, num_above = 0;

  bool is_below() const { return num_below > 0 && num_above == 0; }
  bool is_above() const { return num_above > 0 && num_below == 0; }
};
/// Counts the x in [from, to) at which a is clearly below b, and clearly above.
Share share_below(const std::vector<double>& x, const std::vector<double>& a,
                  const std::vector<double>& b, double from, double to) {
  Share share;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (x[i] < from || x[i] >= to || !are_finite(a[i], b[i])) continue;
    ++share.num;
    share.num_below += is_clearly_less(a[i], b[i]);
    share.num_above += is_clearly_less(b[i], a[i]);
  }
  return share;
}

Verdict all_better(std::span<const Verdict> verdicts) {
  bool is_any_better = false;
  for (const Verdict verdict : verdicts) {
    if (verdict == Verdict::worse || verdict == Verdict::not_measured) return verdict;
    is_any_better = is_any_better || verdict == Verdict::better;
  }
  return is_any_better ? Verdict::better : Verdict::even;
}

}  // namespace

Verdict is_less(double a, double b) {
  if (!are_finite(a, b)) return Verdict::not_measured;
  return is_clearly_less(a, b)   ? Verdict::agrees
         : is_clearly_less(b, a) ? Verdict::contradicts
                                 : Verdict::differs;
}

Verdict is_as_good(double a, double b) {
  if (!are_finite(a, b)) return Verdict::not_measured;
  return a <= kAsGood * b    ? Verdict::agrees
         : a <= kFarFrom * b ? Verdict::differs
                             : Verdict::contradicts;
}

Verdict is_times(double a, double b, double factor) {
  if (!are_finite(a, b) || !(b > 0)) return Verdict::not_measured;
  const double measured = a / b;
  if (measured <= kAsGood * factor && factor <= kAsGood * measured) return Verdict::agrees;
  return (measured > 1) == (factor > 1) ? Verdict::differs : Verdict::contradicts;
}

Verdict are_ranked(double best, double good, double bad) {
  if (!are_finite(best, good) || !std::isfinite(bad)) return Verdict::not_measured;
  const double least = std::min({best, good, bad});
  return are_true({is_clearly_less(best, std::min(good, bad)),
                   is_as_good(good, least) == Verdict::agrees,
                   bad > std::max(best, good) && is_as_good(bad, least) != Verdict::agrees});
}

Verdict are_true(std::initializer_list<bool> parts) {
  const auto num = std::count(parts.begin(), parts.end(), true);
  return num == static_cast<std::ptrdiff_t>(parts.size()) ? Verdict::agrees
         : num > 0                                        ? Verdict::differs
                                                          : Verdict::contradicts;
}

Verdict agrees_with(std::initializer_list<Verdict> parts) {
  const auto num = [&](Verdict v) { return std::count(parts.begin(), parts.end(), v); };
  if (num(Verdict::not_measured) > 0) return Verdict::not_measured;
  if (num(Verdict::agrees) == static_cast<std::ptrdiff_t>(parts.size())) return Verdict::agrees;
  return num(Verdict::agrees) == 0 && num(Verdict::contradicts) > 0 ? Verdict::contradicts
                                                                    : Verdict::differs;
}

Verdict is_below_until(const std::vector<double>& x, const std::vector<double>& a,
                       const std::vector<double>& b, double limit) {
  const Share share = share_below(x, a, b, std::nextafter(0.0, 1.0), limit);
  if (share.num == 0) return Verdict::not_measured;
  return share.is_below()   ? Verdict::agrees
         : share.is_above() ? Verdict::contradicts
                            : Verdict::differs;
}

Verdict is_below_from(const std::vector<double>& x, const std::vector<double>& a,
                      const std::vector<double>& b, double from) {
  const Share before = share_below(x, a, b, -INFINITY, from);
  const Share after = share_below(x, a, b, from, INFINITY);
  if (before.num == 0 || after.num == 0) return Verdict::not_measured;
  if (after.is_above()) return Verdict::contradicts;
  return before.num_below == 0 && after.is_below() ? Verdict::agrees : Verdict::differs;
}

Verdict waits_less_and_less(const std::vector<double>& waits) {
  int num_falling = 0, num_waiting = 0;
  for (std::size_t i = 0; i < waits.size(); ++i) {
    if (!std::isfinite(waits[i])) return Verdict::not_measured;
    num_waiting += waits[i] > 0;
    num_falling += i > 0 && waits[i] < waits[i - 1];
  }
  if (waits.size() < 2) return Verdict::not_measured;
  if (num_waiting == 0) return Verdict::not_comparable;
  return num_falling + 1 == static_cast<int>(waits.size()) ? Verdict::agrees
         : num_falling > 0                                 ? Verdict::differs
                                                           : Verdict::contradicts;
}

Verdict is_continuous(double largest_step, double largest_of_half_steps) {
  if (!are_finite(largest_step, largest_of_half_steps)) return Verdict::not_measured;
  return largest_of_half_steps <= kHalfStep * largest_step ? Verdict::agrees
         : kAlike * largest_of_half_steps <= largest_step  ? Verdict::differs
                                                           : Verdict::contradicts;
}

Verdict is_better(double ours, double theirs) {
  if (!are_finite(ours, theirs)) return Verdict::not_measured;
  return is_clearly_less(ours, theirs)   ? Verdict::better
         : is_clearly_less(theirs, ours) ? Verdict::worse
                                         : Verdict::even;
}

Verdict is_better_in_all(std::initializer_list<Verdict> verdicts) {
  return all_better({verdicts.begin(), verdicts.size()});
}
Verdict is_better_in_all(const std::vector<Verdict>& verdicts) { return all_better(verdicts); }

Verdict is_better_throughout(const std::vector<Verdict>& verdicts) {
  const auto are_all = [&](Verdict verdict) {
    return !verdicts.empty() &&
           std::all_of(verdicts.begin(), verdicts.end(), [&](Verdict v) { return v == verdict; });
  };
  const auto is_missing = [](Verdict v) { return v == Verdict::not_measured; };
  if (verdicts.empty() || std::any_of(verdicts.begin(), verdicts.end(), is_missing)) {
    return Verdict::not_measured;
  }
  return are_all(Verdict::better)  ? Verdict::better
         : are_all(Verdict::worse) ? Verdict::worse
                                   : Verdict::even;
}

Verdict is_faster_and_as_exact(const Cost& ours, const Cost& theirs) {
  if (!are_finite(ours.time, theirs.time)) return Verdict::not_measured;
  const bool is_known = ours.error > 0 && theirs.error > 0;
  const bool is_less_exact = is_known && ours.error > kAsExact * theirs.error;
  const bool is_more_exact = is_known && theirs.error > kAsExact * ours.error;
  if (is_clearly_less(ours.time, theirs.time) && !is_less_exact) return Verdict::better;
  return is_clearly_less(theirs.time, ours.time) && !is_more_exact ? Verdict::worse : Verdict::even;
}

Verdict holds_below(double value, double limit, double in_part) {
  if (!are_finite(value, limit)) return Verdict::not_measured;
  return value < limit ? Verdict::holds : value < in_part ? Verdict::holds_in_part : Verdict::fails;
}

Verdict holds_up_to(double value, double limit, double in_part) {
  if (!are_finite(value, limit)) return Verdict::not_measured;
  return value <= limit     ? Verdict::holds
         : value <= in_part ? Verdict::holds_in_part
                            : Verdict::fails;
}

Verdict holds_above(double value, double limit) { return holds_below(limit, value); }

Verdict holds_between(const Range& values, double from, double to) {
  if (!are_finite(values.low, values.high)) return Verdict::not_measured;
  return values.low > from && values.high < to ? Verdict::holds : Verdict::fails;
}

Verdict holds_in_all(std::ptrdiff_t num_true, std::ptrdiff_t num) {
  if (num == 0) return Verdict::not_measured;
  return num_true == num ? Verdict::holds : num_true > 0 ? Verdict::holds_in_part : Verdict::fails;
}

Verdict holds_with(std::initializer_list<Verdict> parts) {
  const auto num = [&](Verdict v) { return std::count(parts.begin(), parts.end(), v); };
  if (num(Verdict::not_measured) > 0) return Verdict::not_measured;
  const auto all = static_cast<std::ptrdiff_t>(parts.size());
  return num(Verdict::holds) == all   ? Verdict::holds
         : num(Verdict::fails) == all ? Verdict::fails
                                      : Verdict::holds_in_part;
}

double largest_of(const std::vector<double>& values) {
  double largest = -INFINITY;
  for (const double value : values) {
    if (std::isnan(value)) return value;
    largest = std::max(largest, value);
  }
  return largest;
}

double min_of(const std::vector<double>& values) {
  double least = INFINITY;
  for (const double value : values) {
    if (std::isnan(value)) return value;
    least = std::min(least, value);
  }
  return least;
}

}  // namespace palpate::eval
