#include "eval/studies/verdict_rules.h"

#include <algorithm>
#include <cmath>
#include <span>

namespace palpate::eval {
namespace {

constexpr double kAlike = 1.1;      // of two numbers: scatter and luck
constexpr double kAsGood = 1.25;    // not worse as far as anybody would say
constexpr double kFarFrom = 2;      // not as good, whoever looks
constexpr double kHalfStep = 0.75;  // of the largest step, if it shrinks with the steps

bool are_finite(double a, double b) { return std::isfinite(a) && std::isfinite(b); }

struct Share {
  int num = 0, num_below = 0;
};
/// At how many of the x in [from, to) is a below b?
Share share_below(const std::vector<double>& x, const std::vector<double>& a,
                  const std::vector<double>& b, double from, double to) {
  Share share;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (x[i] < from || x[i] >= to || !are_finite(a[i], b[i])) continue;
    ++share.num;
    share.num_below += a[i] < b[i];
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
  return a < b ? Verdict::agrees : a <= kAlike * b ? Verdict::differs : Verdict::contradicts;
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

Verdict are_true(std::initializer_list<bool> parts) {
  const auto num = std::count(parts.begin(), parts.end(), true);
  return num == static_cast<std::ptrdiff_t>(parts.size()) ? Verdict::agrees
         : num > 0                                        ? Verdict::differs
                                                          : Verdict::contradicts;
}

Verdict is_below_until(const std::vector<double>& x, const std::vector<double>& a,
                       const std::vector<double>& b, double limit) {
  const Share share = share_below(x, a, b, std::nextafter(0.0, 1.0), limit);
  if (share.num == 0) return Verdict::not_measured;
  return share.num_below == share.num ? Verdict::agrees
         : share.num_below > 0        ? Verdict::differs
                                      : Verdict::contradicts;
}

Verdict is_below_from(const std::vector<double>& x, const std::vector<double>& a,
                      const std::vector<double>& b, double from) {
  const Share before = share_below(x, a, b, -INFINITY, from);
  const Share after = share_below(x, a, b, from, INFINITY);
  if (before.num == 0 || after.num == 0) return Verdict::not_measured;
  if (after.num_below == 0) return Verdict::contradicts;
  return before.num_below == 0 && after.num_below == after.num ? Verdict::agrees : Verdict::differs;
}

Verdict begins_at(double measured, double claimed, double tolerance) {
  return std::abs(measured - claimed) <= tolerance ? Verdict::agrees : Verdict::differs;
}

Verdict is_continuous(double largest_step, double largest_of_half_steps) {
  if (!are_finite(largest_step, largest_of_half_steps)) return Verdict::not_measured;
  return largest_of_half_steps <= kHalfStep * largest_step ? Verdict::agrees
         : kAlike * largest_of_half_steps <= largest_step  ? Verdict::differs
                                                           : Verdict::contradicts;
}

Verdict is_better(double ours, double theirs) {
  if (!are_finite(ours, theirs)) return Verdict::not_measured;
  return kAlike * ours < theirs    ? Verdict::better
         : ours <= kAlike * theirs ? Verdict::even
                                   : Verdict::worse;
}

Verdict is_better_in_all(std::initializer_list<Verdict> verdicts) {
  return all_better({verdicts.begin(), verdicts.size()});
}
Verdict is_better_in_all(const std::vector<Verdict>& verdicts) { return all_better(verdicts); }

double largest_of(const std::vector<double>& values) {
  double largest = -INFINITY;
  for (const double value : values) {
    if (std::isnan(value)) return value;
    largest = std::max(largest, value);
  }
  return largest;
}

double least_of(const std::vector<double>& values) {
  double least = INFINITY;
  for (const double value : values) {
    if (std::isnan(value)) return value;
    least = std::min(least, value);
  }
  return least;
}

}  // namespace palpate::eval
