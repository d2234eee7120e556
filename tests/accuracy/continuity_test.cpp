// Jumps of the force between ticks while a cube sinks into noisy solids, see
// eval/studies/force_steps.h.
#include <algorithm>
#include <array>
#include <cstdio>

#include <gtest/gtest.h>

#include "eval/studies/force_steps.h"
#include "tests/accuracy/point_methods.h"

namespace palpate {
namespace {

class ForceSteps : public testing::TestWithParam<eval::Method> {};

TEST_P(ForceSteps, OfPointsThatEnterAreSmoothedByEntry) {
  const eval::Method& method = GetParam();
  eval::Context context({});
  const auto cube = eval::sinking_cube(context).value();
  for (const eval::NoisySolid& solid : eval::noisy_solids()) {
    const eval::RenderedScene seen = eval::see_noisy(solid);
    std::array<double, 4> largest{};
    for (const Continuity continuity :
         {Continuity::none, Continuity::kernel, Continuity::entry, Continuity::both}) {
      ContactOptions options = method.options;
      options.continuity = continuity;
      largest[static_cast<std::size_t>(continuity)] =
          std::ranges::max(eval::force_steps(eval::query_measure(*cube, seen, options)));
    }
    std::printf("%s, %-10s: none %6.3f %%, kernel %6.3f %%, entry %6.3f %%, both %6.3f %%\n",
                solid.name, method.name, 100 * largest[0], 100 * largest[1], 100 * largest[2],
                100 * largest[3]);
    if (method.options.method == MethodKind::graph) continue;  // whole spheres come and go
    // The way a wall enters this cube changes the force by 0.1 % a step.
    EXPECT_LT(largest[2], 0.0014);
    EXPECT_LT(largest[3], 0.0014);
    EXPECT_LE(largest[2], 1.001 * largest[0]);  // the wall's surface is as flat as the wall
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, ForceSteps, testing::ValuesIn(test::point_methods()),
                         test::name_of);

}  // namespace
}  // namespace palpate
