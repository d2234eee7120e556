// Two cameras of which one is said to be elsewhere: what the figure says has to hang together.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>

#include "eval/context.h"
#include "eval/figure.h"

namespace palpate::eval {
namespace {

FigureResult made() {
  Settings settings;
  settings.quick = true;
  Context context(settings);
  return rig_figures().front().make(context).value();
}

std::map<std::string, double> numbers_of(const FigureResult& result) {
  std::map<std::string, double> numbers;
  for (const Number& n : result.numbers) numbers[n.key] = n.value;
  return numbers;
}

TEST(RigFigures, MisplacedCamera) {
  const FigureResult result = made();
  const auto all = numbers_of(result);
  const auto at = [&](const std::string& key) {
    EXPECT_TRUE(all.contains(key)) << key;
    return all.contains(key) ? all.at(key) : NAN;
  };
  for (const std::string images : {"exact.", "noise."}) {
    const auto falsely = [&](const char* what, int mm) {
      return at(images + "false." + what + "." + std::to_string(mm) + "mm");
    };
    for (const char* what : {"true", "displaced", "bound", "together", "wrong", "calibrated"}) {
      double nearer = falsely(what, 0);
      for (const int mm : {1, 2, 3, 5, 8, 12, 16, 20}) {
        // The plane of a ball in parts may say a millionth of the tool where no part touches.
        EXPECT_LE(falsely(what, mm), nearer + 1e-3) << images << what << mm;
        nearer = falsely(what, mm);
      }
      EXPECT_EQ(nearer, 0) << images << what;
    }
    // The wrong pose is felt, both where it is exact and by the query; calibrate takes it away.
    EXPECT_GT(falsely("displaced", 3), 0.1);
    EXPECT_GT(falsely("wrong", 3), 3 * falsely("true", 3));
    EXPECT_NEAR(falsely("calibrated", 3), falsely("true", 3), 0.02);
    for (const int mm : {0, 1, 2, 3, 5, 8, 12}) {
      EXPECT_LE(falsely("displaced", mm), falsely("bound", mm)) << mm;
      EXPECT_LE(falsely("wrong", mm), falsely("bound", mm)) << mm;
    }
    EXPECT_LE(at(images + "beyond_agreeing"), 0.2);
    EXPECT_GT(at(images + "contact.wrong.volume_rms"), 2 * at(images + "contact.true.volume_rms"));
    EXPECT_LT(at(images + "contact.calibrated.volume_rms"),
              1.2 * at(images + "contact.true.volume_rms"));
    EXPECT_GT(at(images + "left.scene_mm.most"), 0);
    EXPECT_LE(at(images + "left.scene_mm.most"), 1);
    EXPECT_LE(at(images + "left.angle_deg.most"), 0.1);
  }
  // A ball of 30 mm, cut by a wall that 3 mm and 0.5 degrees over at most 1.2 m have moved.
  const double h = 0.003 + 0.5 * kPi / 180 * 1.2, r = 0.03;
  EXPECT_LT(at("exact.false.bound.0mm"), 100 * h * h * (3 * r - h) / (4 * r * r * r));
}

TEST(RigFigures, TwoRunsSayTheSame) {
  const FigureResult first = made(), second = made();
  EXPECT_EQ(numbers_of(first), numbers_of(second));
  for (std::size_t i = 0; i < first.tables.size(); ++i) {
    EXPECT_EQ(first.tables[i].rows, second.tables[i].rows) << first.tables[i].title;
  }
}

}  // namespace
}  // namespace palpate::eval
