// Bodies by the distance fields of their meshes against exact polyhedra.
#include <gtest/gtest.h>

#include "eval/studies/accuracy.h"
#include "eval/studies/common_volume.h"
#include "palpate/contact/body_contact.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "src/math/internal/random.h"

namespace palpate::eval {
namespace {

Tool packed(const char* shape, double size, int num_spheres) {
  return Tool::pack(make_shape(shape, size).value(), {.max_spheres = num_spheres}).value();
}

TEST(Bodies, ShareWhatTheirMeshesShare) {
  for (const auto& [shape_a, shape_b] : {std::pair{"box", "box"}, std::pair{"octahedron", "box"},
                                         std::pair{"tetrahedron", "octahedron"}}) {
    const Tool a = packed(shape_a, 0.1, 500), b = packed(shape_b, 0.1, 500);
    const auto contact = make_body_pair_query(Place::cpu(), a, b).value();
    const double smaller = std::min(a.mesh_mass().volume, b.mesh_mass().volume);
    Random random(5);
    double exact_sum = 0, found_sum = 0, squares = 0;
    int num = 0;
    while (num < 100) {
      const Pose X_WA{{}, random.rotation(kPi)};
      const Quaternion turned = random.rotation(kPi);
      const Pose X_WB{random.in_box(0.1), turned};
      const double exact = common_volume(a.mesh(), X_WA, b.mesh(), X_WB);
      if (exact < 0.02 * smaller) continue;
      ++num;
      const double found = contact->measure(X_WA, X_WB).on_a.volume;
      exact_sum += exact;
      found_sum += found;
      squares += (found - exact) * (found - exact);
    }
    EXPECT_NEAR(found_sum / exact_sum, 1, 0.01) << shape_a << " and " << shape_b;
    EXPECT_LE(std::sqrt(squares / num), 0.01 * smaller) << shape_a << " and " << shape_b;
  }
}

TEST(Bodies, AFaceHasItsDirectionNoJumpsAndNoGain) {
  const Tool tool = packed("box", 0.1, 1000), block = packed("box", 0.3, 1000);
  const auto contact = make_body_pair_query(Place::cpu(), tool, block).value();
  const Pose X_WB{{0, 0, 1.15}, {}};
  const Measure measured{tool.mesh_mass().volume,
                         [&](const Pose& X_WT) { return contact->measure(X_WT, X_WB).on_a; }};
  int num = 0;
  for (const std::vector<ContactCase>& cases : {thesis_cases(), tilted_cases()}) {
    for (const ContactCase& c : cases) {
      if (c.scene != "wall" || c.tool_shape != "box") continue;
      ++num;
      const auto steps = exact_steps(c, tool, 0, 0.3, num_steps_over(c, 0.3, 5e-5));
      const WrenchError error = wrench_error(tool, steps, measured);
      EXPECT_LE(error.direction_worst * 180 / kPi, 1) << c.name;
      EXPECT_LE(error.jump_ratio(), 1.25) << c.name;
      EXPECT_LE(volume_error(tool, steps, measured).rms, 0.01) << c.name;
      EXPECT_LE(loop_work(c, tool, measured, 2000), 1e-6) << c.name;
    }
  }
  EXPECT_EQ(num, 2);
}

}  // namespace
}  // namespace palpate::eval
