// Verdict rules on data made up for each outcome, also curves that a careless rule is fooled by.
#include "eval/studies/verdict_rules.h"

#include <cmath>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace palpate::eval {
namespace {

const double kNan = std::nan("");
const std::vector<double> kDepths{0, 10, 20, 30, 40, 60, 80, 100};

TEST(VerdictRules, Less) {
  EXPECT_EQ(is_less(1, 2), Verdict::agrees);
  EXPECT_EQ(is_less(3, 2), Verdict::contradicts);
  EXPECT_EQ(is_less(kNan, 2), Verdict::not_measured);
  EXPECT_EQ(is_less(1, INFINITY), Verdict::not_measured);
}

// 29 against 31 µs is the load of the machine, whichever way round it is.
TEST(VerdictRules, ATieIsNobodysAdvantage) {
  const std::vector<double> x{10, 20, 30}, low{29, 29, 29}, high{31, 31, 31}, far{50, 50, 50};
  for (const auto& [a, b] : {std::pair{29.0, 31.0}, {31.0, 29.0}, {30.0, 30.0}}) {
    EXPECT_EQ(is_less(a, b), Verdict::differs) << a;
    EXPECT_EQ(is_better(a, b), Verdict::even) << a;
    EXPECT_EQ(is_faster_and_as_exact({a, 1}, {b, 1}), Verdict::even) << a;
    EXPECT_FALSE(is_clearly_less(a, b)) << a;
  }
  for (const auto& [a, b] : {std::pair{low, high}, {high, low}, {low, low}}) {
    EXPECT_EQ(is_below_until(x, a, b, 40), Verdict::differs);
    EXPECT_EQ(is_below_from(x, a, b, 20), Verdict::differs);
  }
  // Beyond it, exchanging the two exchanges the verdicts.
  EXPECT_EQ(is_less(29, 50), Verdict::agrees);
  EXPECT_EQ(is_less(50, 29), Verdict::contradicts);
  EXPECT_EQ(is_below_until(x, low, far, 40), Verdict::agrees);
  EXPECT_EQ(is_below_until(x, far, low, 40), Verdict::contradicts);
  // A tie beside a win takes nothing from it, nor beside a loss.
  const std::vector<double> mixed{29, 50, 50};
  EXPECT_EQ(is_below_until(x, low, mixed, 40), Verdict::agrees);
  EXPECT_EQ(is_below_until(x, mixed, low, 40), Verdict::contradicts);
}

TEST(VerdictRules, RankedIsOneVerdictOfThreeParts) {
  EXPECT_EQ(are_ranked(1, 1.2, 3), Verdict::agrees);
  EXPECT_EQ(are_ranked(1, 1.05, 3), Verdict::differs);  // a tie: the first is not best
  EXPECT_EQ(are_ranked(1.2, 1, 3), Verdict::differs);
  EXPECT_EQ(are_ranked(1, 2, 3), Verdict::differs);       // the second is not good
  EXPECT_EQ(are_ranked(1, 1.2, 1.22), Verdict::differs);  // the third is not bad
  EXPECT_EQ(are_ranked(3, 2, 1), Verdict::contradicts);
  EXPECT_EQ(are_ranked(1, kNan, 3), Verdict::not_measured);
  EXPECT_EQ(are_ranked(1, 1.2, kNan), Verdict::not_measured);
}

TEST(VerdictRules, AsGoodNeedsTheOtherNumber) {
  EXPECT_EQ(is_as_good(0.48, 0.47), Verdict::agrees);
  EXPECT_EQ(is_as_good(0.8, 0.47), Verdict::differs);
  EXPECT_EQ(is_as_good(2.74, 0.47), Verdict::contradicts);
  EXPECT_EQ(is_as_good(0.1, kNan), Verdict::not_measured);
}

TEST(VerdictRules, Times) {
  EXPECT_EQ(is_times(1.7, 1, 1.7), Verdict::agrees);
  EXPECT_EQ(is_times(2.0, 1, 1.7), Verdict::agrees);
  EXPECT_EQ(is_times(4.1, 1, 1.7), Verdict::differs);
  EXPECT_EQ(is_times(1.1, 1, 1.7), Verdict::differs);
  EXPECT_EQ(is_times(0.9, 1, 1.7), Verdict::contradicts);
  EXPECT_EQ(is_times(1, 0, 1.7), Verdict::not_measured);
  EXPECT_EQ(is_times(0.9, 1, 0.93), Verdict::agrees);
  EXPECT_EQ(is_times(1.1, 1, 0.5), Verdict::contradicts);
}

TEST(VerdictRules, Parts) {
  EXPECT_EQ(are_true({true, true}), Verdict::agrees);
  EXPECT_EQ(are_true({true, false}), Verdict::differs);
  EXPECT_EQ(are_true({false, false}), Verdict::contradicts);
}

TEST(VerdictRules, SeveralComparisons) {
  const Verdict agrees = Verdict::agrees, differs = Verdict::differs, no = Verdict::contradicts;
  EXPECT_EQ(agrees_with({agrees, agrees}), agrees);
  EXPECT_EQ(agrees_with({agrees, differs}), differs);
  EXPECT_EQ(agrees_with({agrees, no}), differs);
  EXPECT_EQ(agrees_with({differs, differs}), differs);
  EXPECT_EQ(agrees_with({differs, no}), no);
  EXPECT_EQ(agrees_with({agrees, Verdict::not_measured}), Verdict::not_measured);
}

TEST(VerdictRules, BelowUntil) {
  const std::vector<double> other(kDepths.size(), 5);
  EXPECT_EQ(is_below_until(kDepths, {9, 1, 2, 3, 6, 7, 8, 9}, other, 40), Verdict::agrees);
  // Below everywhere is below until 40 too.
  EXPECT_EQ(is_below_until(kDepths, {1, 1, 1, 1, 1, 1, 1, 1}, other, 40), Verdict::agrees);
  EXPECT_EQ(is_below_until(kDepths, {1, 1, 6, 6, 6, 6, 6, 6}, other, 40), Verdict::differs);
  // Slower everywhere but where nothing is left to do.
  EXPECT_EQ(is_below_until(kDepths, {6, 6, 6, 6, 6, 6, 6, 1}, other, 40), Verdict::contradicts);
  // Faster only before there is any contact.
  EXPECT_EQ(is_below_until(kDepths, {1, 6, 6, 6, 6, 6, 6, 6}, other, 40), Verdict::contradicts);
  const std::vector<double> gaps{kNan, kNan, kNan, kNan, 1, 1, 1, 1};
  EXPECT_EQ(is_below_until(kDepths, gaps, other, 40), Verdict::not_measured);
}

TEST(VerdictRules, BelowFrom) {
  const std::vector<double> sizes{500, 3000, 8000, 13000, 17000};
  const std::vector<double> other(sizes.size(), 5);
  EXPECT_EQ(is_below_from(sizes, {9, 8, 7, 4, 3}, other, 13000), Verdict::agrees);
  EXPECT_EQ(is_below_from(sizes, {9, 8, 4, 4, 3}, other, 13000), Verdict::differs);
  EXPECT_EQ(is_below_from(sizes, {9, 8, 7, 4, 6}, other, 13000), Verdict::differs);
  // Loses where it should lose, but never wins.
  EXPECT_EQ(is_below_from(sizes, {9, 9, 9, 9, 9}, other, 13000), Verdict::contradicts);
  EXPECT_EQ(is_below_from(sizes, {9, 9, 9, 9, 9}, other, 20000), Verdict::not_measured);
}

TEST(VerdictRules, WaitsLessAndLessOnlyWhereAnythingWaits) {
  EXPECT_EQ(waits_less_and_less({30, 12, 3}), Verdict::agrees);
  EXPECT_EQ(waits_less_and_less({30, 12, 15}), Verdict::differs);
  EXPECT_EQ(waits_less_and_less({3, 12, 30}), Verdict::contradicts);
  EXPECT_EQ(waits_less_and_less({3, 1, -1}), Verdict::agrees);
  // Faster beside the other than alone, whatever is done: nothing was waited for.
  EXPECT_EQ(waits_less_and_less({-21, -20, -23}), Verdict::not_comparable);
  EXPECT_EQ(waits_less_and_less({30, kNan, 3}), Verdict::not_measured);
  EXPECT_EQ(waits_less_and_less({30}), Verdict::not_measured);
}

TEST(VerdictRules, Continuous) {
  EXPECT_EQ(is_continuous(2, 1), Verdict::agrees);
  EXPECT_EQ(is_continuous(2, 1.7), Verdict::differs);
  EXPECT_EQ(is_continuous(2, 2), Verdict::contradicts);
  EXPECT_EQ(is_continuous(2, kNan), Verdict::not_measured);
}

TEST(VerdictRules, Better) {
  EXPECT_EQ(is_better(1, 2), Verdict::better);
  EXPECT_EQ(is_better(1, 1.05), Verdict::even);
  EXPECT_EQ(is_better(1.05, 1), Verdict::even);
  EXPECT_EQ(is_better(2, 1), Verdict::worse);
  EXPECT_EQ(is_better(0, 0), Verdict::even);
  EXPECT_EQ(is_better(kNan, 1), Verdict::not_measured);
  EXPECT_EQ(is_better_in_all({Verdict::better, Verdict::even}), Verdict::better);
  EXPECT_EQ(is_better_in_all({Verdict::even, Verdict::even}), Verdict::even);
  EXPECT_EQ(is_better_in_all({Verdict::better, Verdict::worse}), Verdict::worse);
  EXPECT_EQ(is_better_in_all({Verdict::better, Verdict::not_measured}), Verdict::not_measured);
}

TEST(VerdictRules, BetterThroughoutIsOneOfThreeAnswers) {
  const Verdict better = Verdict::better, even = Verdict::even, worse = Verdict::worse;
  EXPECT_EQ(is_better_throughout({better, better}), better);
  EXPECT_EQ(is_better_throughout({worse, worse}), worse);
  EXPECT_EQ(is_better_throughout({better, worse}), even);
  EXPECT_EQ(is_better_throughout({better, even}), even);
  EXPECT_EQ(is_better_throughout({better, Verdict::not_measured}), Verdict::not_measured);
  EXPECT_EQ(is_better_throughout({}), Verdict::not_measured);
}

TEST(VerdictRules, FasterCountsOnlyAsExactlyAnswered) {
  EXPECT_EQ(is_faster_and_as_exact({1, 0.5}, {2, 0.5}), Verdict::better);
  EXPECT_EQ(is_faster_and_as_exact({1, 0.6}, {2, 0.5}), Verdict::even);  // by being careless
  EXPECT_EQ(is_faster_and_as_exact({2, 0.4}, {1, 0.5}), Verdict::even);  // for something
  EXPECT_EQ(is_faster_and_as_exact({2, 0.5}, {1, 0.5}), Verdict::worse);
  EXPECT_EQ(is_faster_and_as_exact({2, 0.6}, {1, 0.5}), Verdict::worse);
  EXPECT_EQ(is_faster_and_as_exact({1, 0}, {2, 0}), Verdict::better);  // errors are not known
  EXPECT_EQ(is_faster_and_as_exact({kNan, 1}, {2, 1}), Verdict::not_measured);
}

TEST(VerdictRules, HoldsBelowUpToAndAbove) {
  EXPECT_EQ(holds_below(1, 2), Verdict::holds);
  EXPECT_EQ(holds_below(2, 2), Verdict::fails);
  EXPECT_EQ(holds_below(2, 2, 3), Verdict::holds_in_part);
  EXPECT_EQ(holds_below(3, 2, 3), Verdict::fails);
  EXPECT_EQ(holds_below(kNan, 2, 3), Verdict::not_measured);
  EXPECT_EQ(holds_below(1, INFINITY), Verdict::not_measured);
  EXPECT_EQ(holds_up_to(2, 2), Verdict::holds);
  EXPECT_EQ(holds_up_to(2.5, 2), Verdict::fails);
  EXPECT_EQ(holds_up_to(3, 2, 3), Verdict::holds_in_part);
  EXPECT_EQ(holds_up_to(3.5, 2, 3), Verdict::fails);
  EXPECT_EQ(holds_up_to(kNan, 2), Verdict::not_measured);
  EXPECT_EQ(holds_above(2, 1), Verdict::holds);
  EXPECT_EQ(holds_above(1, 1), Verdict::fails);
  EXPECT_EQ(holds_above(kNan, 1), Verdict::not_measured);
}

TEST(VerdictRules, HoldsBetweenAndAGapIsNoEvidence) {
  Range range;
  EXPECT_EQ(holds_between(range, 0, 1), Verdict::not_measured);  // nothing was added
  range.add(0.2), range.add(0.8);
  EXPECT_EQ(holds_between(range, 0, 1), Verdict::holds);
  EXPECT_EQ(holds_between(range, 0.3, 1), Verdict::fails);
  EXPECT_EQ(holds_between(range, 0, 0.8), Verdict::fails);
  range.add(kNan), range.add(0.5);
  EXPECT_EQ(holds_between(range, 0, 1), Verdict::not_measured);
}

TEST(VerdictRules, HoldsInAllInSomeInNone) {
  EXPECT_EQ(holds_in_all(14, 14), Verdict::holds);
  EXPECT_EQ(holds_in_all(13, 14), Verdict::holds_in_part);
  EXPECT_EQ(holds_in_all(0, 14), Verdict::fails);
  EXPECT_EQ(holds_in_all(0, 0), Verdict::not_measured);
}

TEST(VerdictRules, HoldsWithItsParts) {
  const Verdict holds = Verdict::holds, part = Verdict::holds_in_part, fails = Verdict::fails;
  EXPECT_EQ(holds_with({holds, holds}), holds);
  EXPECT_EQ(holds_with({holds, fails}), part);
  EXPECT_EQ(holds_with({holds, part}), part);
  EXPECT_EQ(holds_with({part, fails}), part);
  EXPECT_EQ(holds_with({fails, fails}), fails);
  EXPECT_EQ(holds_with({holds, Verdict::not_measured}), Verdict::not_measured);
}

TEST(VerdictRules, ExtremesDoNotHideGaps) {
  EXPECT_EQ(largest_of({1, 3, 2}), 3);
  EXPECT_EQ(min_of({1, 3, 2}), 1);
  EXPECT_TRUE(std::isnan(largest_of({1, kNan})));
  EXPECT_TRUE(std::isnan(min_of({kNan, 1})));
}

// Every verdict belongs to one source, but for "not measured".
TEST(VerdictRules, Sources) {
  EXPECT_EQ(source_of(Verdict::agrees), Source::thesis);
  EXPECT_EQ(source_of(Verdict::not_comparable), Source::thesis);
  EXPECT_EQ(source_of(Verdict::better), Source::ours);
  EXPECT_EQ(source_of(Verdict::worse), Source::ours);
  EXPECT_EQ(source_of(Verdict::holds), Source::docs);
  EXPECT_EQ(source_of(Verdict::fails), Source::docs);
}

}  // namespace
}  // namespace palpate::eval
