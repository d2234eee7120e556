// Tunnelling past the edge of a pillar, see eval/studies/pillar.h.
#include <array>
#include <cstdio>
#include <utility>

#include <gtest/gtest.h>

#include "eval/studies/interaction.h"
#include "eval/studies/pillar.h"
#include "tests/accuracy/point_methods.h"

namespace palpate {
namespace {

using eval::PillarSide;
using eval::WayError;

constexpr int kSpheres = 1500;
constexpr double kStep = 0.00025;  // m

WayError error_past_edge(eval::Context& context, bool with_noise, PillarSide side,
                         const ContactOptions& options) {
  const auto tool = eval::pillar_box(context, kSpheres).value();
  const auto frame = eval::seen_pillar(context, with_noise).value();
  const auto query = eval::query_on(frame, *tool);
  const auto X_WT = eval::pillar_way(side, kStep);
  return eval::way_error(eval::measured_volumes(*query, *tool, X_WT, options),
                         eval::exact_volumes(*tool, side, X_WT));
}

void print(const char* method, bool with_noise, PillarSide side, const char* edges,
           const WayError& error) {
  std::printf("%-10s %-5s %-10s edges %-6s: rms %5.2f %%, worst %5.2f %%, largest step %5.2f %%\n",
              method, eval::name_of(side), with_noise ? "noise" : "noise-free", edges,
              100 * error.rms, 100 * error.worst, 100 * error.largest_step);
}

class EdgesOfThePillar : public testing::TestWithParam<eval::Method> {};

// The noisy camera does not see what is left of the pillar: its projector is to the right.
TEST_P(EdgesOfThePillar, StopTunnelling) {
  eval::Context context({});
  for (const bool with_noise : {false, true}) {
    for (const PillarSide side : {PillarSide::right, PillarSide::left}) {
      std::array<WayError, 4> errors;
      for (const Edges edges : {Edges::none, Edges::center, Edges::strict, Edges::cut}) {
        ContactOptions options = GetParam().options;
        options.volumes = SphereVolumes::represented;
        options.edges = edges;
        constexpr const char* kNames[] = {"none", "center", "strict", "cut"};
        const auto which = static_cast<std::size_t>(edges);
        errors[which] = error_past_edge(context, with_noise, side, options);
        print(GetParam().name, with_noise, side, kNames[which], errors[which]);
      }
      EXPECT_GT(errors[0].worst, 0.1);  // the tool tunnels
      EXPECT_LT(errors[3].worst, 0.04);
      EXPECT_LT(errors[3].largest_step, 0.03);
    }
  }
}

// The field sees the room beside the pillar for what it is.
TEST(FieldAtThePillar, DoesNotTunnel) {
  eval::Context context({});
  for (const bool with_noise : {false, true}) {
    for (const PillarSide side : {PillarSide::right, PillarSide::left}) {
      const WayError error =
          error_past_edge(context, with_noise, side, {.method = MethodKind::field});
      print("field", with_noise, side, "", error);
      EXPECT_LT(error.worst, 0.1);
      EXPECT_LT(error.largest_step, 0.03);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, EdgesOfThePillar, testing::ValuesIn(test::point_methods()),
                         test::name_of);

}  // namespace
}  // namespace palpate
