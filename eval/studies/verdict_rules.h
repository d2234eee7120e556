// From data to verdicts: each rule is a function of what was measured, and tested on data made up
// for every outcome.
#pragma once

#include <initializer_list>
#include <vector>

#include "eval/figure.h"

namespace palpate::eval {

// Claims of the thesis. A number that is not finite was not measured.

/// "a is less than b." Contradicted where it is more by over a tenth.
Verdict is_less(double a, double b);

/// "a is as good as b": not more by over a quarter; contradicted where it is twice as much.
Verdict is_as_good(double a, double b);

/// "a is `factor` times b": within a quarter of that. Contradicted where it is not even more than b
/// (or, for a factor below 1, not less).
Verdict is_times(double a, double b, double factor);

/// A claim of several parts: agrees if all are true, contradicts if none is.
Verdict are_true(std::initializer_list<bool> parts);

/// "Curve a lies below curve b for x in (0, limit)." Contradicted where it never does there.
Verdict is_below_until(const std::vector<double>& x, const std::vector<double>& a,
                       const std::vector<double>& b, double limit);

/// "Curve a lies below curve b from x = `from` on, and not before." Contradicted where it does at
/// no x from there on.
Verdict is_below_from(const std::vector<double>& x, const std::vector<double>& a,
                      const std::vector<double>& b, double from);

/// "It begins at about x = `claimed`": within `tolerance`; else differs. NaN: it never begins.
Verdict begins_at(double measured, double claimed, double tolerance);

/// "The curve is continuous": halving the steps along it has to make its largest step smaller, by
/// half where it is smooth; a jump stays. Contradicted where the step stays within a tenth.
Verdict is_continuous(double largest_step, double largest_of_half_steps);

// Is ours better?

/// Less is better; alike within a tenth.
Verdict is_better(double ours, double theirs);
/// The worst of several comparisons: better only if all are at least even and one is better.
Verdict is_better_in_all(std::initializer_list<Verdict> verdicts);
Verdict is_better_in_all(const std::vector<Verdict>& verdicts);

/// The largest and the least of numbers; NaN if any is.
double largest_of(const std::vector<double>& values);
double least_of(const std::vector<double>& values);

}  // namespace palpate::eval
