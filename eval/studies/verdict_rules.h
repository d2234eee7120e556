// Rules from data to verdicts: each is a function of measured values, tested on synthetic data for
// every outcome.
#pragma once

#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <vector>

#include "eval/figure.h"
#include "eval/studies/range.h"

namespace palpate::eval {

/// Ratio up to which two numbers are a tie, because of scatter.
inline constexpr double kAlike = 1.1;
/// True if a is less than b, and no tie.
constexpr bool is_clearly_less(double a, double b) { return kAlike * a < b; }

// Claims of the thesis. A number that is not finite was not measured. Each rule gives the opposite
// verdict for a and b exchanged; a tie is `differs`.

/// "a is less than b." Contradicted where b is clearly less.
Verdict is_less(double a, double b);

/// "a is as good as b": not more by over a quarter; contradicted where it is twice as much.
Verdict is_as_good(double a, double b);

/// "a is `factor` times b": within a quarter of that. Contradicted where it is not even more than b
/// (or, for a factor below 1, not less).
Verdict is_times(double a, double b, double factor);

/// "Of these, the first is best, the second good and the third bad": clearly less than the others;
/// as good as the best; more than the others and not as good as the best.
Verdict are_ranked(double best, double good, double bad);

/// A claim of several parts: agrees if all are true, contradicts if none is.
Verdict are_true(std::initializer_list<bool> parts);

/// A claim of several comparisons: agrees if all do, contradicts if some do and none agrees.
Verdict agrees_with(std::initializer_list<Verdict> parts);

/// "Curve a lies below curve b for x in (0, limit)": clearly somewhere and nowhere clearly above.
/// Contradicted where it is the other way round.
Verdict is_below_until(const std::vector<double>& x, const std::vector<double>& a,
                       const std::vector<double>& b, double limit);

/// "Curve a lies below curve b from x = `from` on, and not before", with ties left out.
/// Contradicted where it is somewhere above from there on and nowhere below.
Verdict is_below_from(const std::vector<double>& x, const std::vector<double>& a,
                      const std::vector<double>& b, double from);

/// "One after the other waits less": each value is a waiting time. Not comparable where all are
/// zero: then there is nothing to reduce.
Verdict waits_less_and_less(const std::vector<double>& waits);

/// "The curve is continuous": halving the steps along it has to make its largest step smaller, by
/// half where it is smooth; a jump stays. Contradicted where the step stays within a tenth.
Verdict is_continuous(double largest_step, double largest_of_half_steps);

// Is Palpate better?

/// Verdict where less is better; alike within a tenth.
Verdict is_better(double ours, double theirs);
/// The worst of several comparisons: better only if all are at least even and one is better.
Verdict is_better_in_all(std::initializer_list<Verdict> verdicts);
Verdict is_better_in_all(const std::vector<Verdict>& verdicts);

/// The same comparison in several cases: better or worse only if in all of them.
Verdict is_better_throughout(const std::vector<Verdict>& verdicts);

/// Time and error of a result. An error that is not positive is unknown.
struct Cost {
  double time = 0, error = 0;
};
/// "Ours is faster and as exact": better; worse if it is slower and no more exact. Times that are
/// alike are a tie: even.
Verdict is_faster_and_as_exact(const Cost& ours, const Cost& theirs);

// Do our own claims hold? A number that is not finite was not measured.

/// "It is less than `limit`"; in part where it is less than `in_part`.
Verdict holds_below(double value, double limit, double in_part = -INFINITY);
/// "It is at most `limit`"; in part where it is at most `in_part`.
Verdict holds_up_to(double value, double limit, double in_part = -INFINITY);
/// "It is more than `limit`."
Verdict holds_above(double value, double limit);
/// "All lie between these."
Verdict holds_between(const Range& values, double from, double to);
/// "It holds in all `num`"; in part where it holds in some.
Verdict holds_in_all(std::ptrdiff_t num_true, std::ptrdiff_t num);
/// A claim of several parts: holds if all do, fails if none does.
Verdict holds_with(std::initializer_list<Verdict> parts);

/// Return the largest and the smallest of numbers; NaN if any is.
double largest_of(const std::vector<double>& values);
double min_of(const std::vector<double>& values);

}  // namespace palpate::eval
