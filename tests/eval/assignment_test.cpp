// The reference for priorities is the program where the program has the priority.
#include "eval/assignment.h"

#include <gtest/gtest.h>

namespace palpate::eval {
namespace {

TEST(Assignment, ByDistanceIsWhatTheProgramMeasures) {
  for (const ContactCase& c : tilted_cases()) {
    const Tool tool = packed_tool(c, 200);
    const SeenScene seen = see(c, DepthNoise::gaussian);
    for (const bool is_average : {true, false}) {
      ContactOptions options;
      options.method = is_average ? MethodKind::weighted : MethodKind::simplified;
      options.volumes = SphereVolumes::represented;
      const Measure program = query_measure(tool, seen, options);
      const Measure reference =
          assignment_measure(tool, seen, AssignPriority::distance, is_average);
      // Of the same order: the nearest is the nearest.
      const Measure square = assignment_measure(tool, seen, AssignPriority::square, is_average);
      for (const ExactStep& step : exact_steps(c, tool, 0.1, 0.9, 8)) {
        const Penetration a = program.at(step.X_WT), b = reference.at(step.X_WT);
        EXPECT_NEAR(a.volume, b.volume, 2e-5 * program.whole) << c.name;
        EXPECT_LT(norm(a.measure_W.force - b.measure_W.force), 2e-5 * program.whole) << c.name;
        EXPECT_LT(norm(a.measure_W.torque - b.measure_W.torque), 2e-5 * program.whole * c.tool_size)
            << c.name;
        if (!is_average) {
          EXPECT_EQ(b.volume, square.at(step.X_WT).volume);
        }
      }
    }
  }
}

TEST(Assignment, WaysAlongTheGraphAreNoShorterThanStraightOnes) {
  // With one donor every priority is the same.
  const ContactCase c = tilted_cases().front();
  const Tool tool = packed_tool(c, 200);
  const SeenScene seen = see(c, DepthNoise::none);
  for (const ExactStep& step : exact_steps(c, tool, 0.0, 0.05, 20)) {
    const Measure along = assignment_measure(tool, seen, AssignPriority::along, true);
    const Measure straight = assignment_measure(tool, seen, AssignPriority::distance, true);
    const double volume = straight.at(step.X_WT).volume;
    // Planes of a wall without noise are all alike: whom one takes from makes no difference.
    EXPECT_NEAR(along.at(step.X_WT).volume, volume, 1e-4 * along.whole);
  }
}

}  // namespace
}  // namespace palpate::eval
