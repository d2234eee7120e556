// Elements of a cluster that are packed into full vectors for all cameras but the first: who asks
// for their places, for the noise, has them measured where they are, and gets the same bits.
#include <cstring>

#include <gtest/gtest.h>

#include "palpate/contact/contact.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/hull_scenes.h"

namespace palpate {
namespace {

using test::HullScene;
using test::Random;

TEST(HullClusters, PackedElementsHaveTheBitsOfThoseByThemselves) {
  Random random(41);
  const HullScene rough = test::rough_scene(4, {}, random), smooth = test::smooth_scene(3);
  const HullScene memories = test::rough_memories(3, random);
  // Of more than 4,096 spheres clusters that lie deep count as one ball each.
  const Tool small = test::random_tool(1500, 0.08, 4), large = test::grid_tool();
  int num_touching = 0;
  for (const HullScene* const scene : {&rough, &smooth, &memories}) {
    for (const Tool* const tool : {&small, &large}) {
      for (const Isa isa : {Isa::baseline, best_isa()}) {
        const auto query =
            make_contact_query(Backend::cpu, *tool, FieldMethod{}, {isa, nullptr}).value();
        for (int i = 0; i < 6; ++i) {
          const double x = random.uniform(-0.2, 0.2), y = random.uniform(-0.15, 0.15);
          const Pose X_WT{{x, y, random.uniform(0.7, 1.2)}, random.rotation(3)};
          const bool stiffness = i % 2 == 0;
          const ContactResult packed = query->measure(scene->views, X_WT, {.stiffness = stiffness});
          const ContactResult apart =
              query->measure(scene->views, X_WT, {.stiffness = stiffness, .noise = true});
          const Penetration &a = packed.penetration, &b = apart.penetration;
          EXPECT_EQ(a.volume, b.volume);
          EXPECT_EQ(a.potential, b.potential);
          EXPECT_EQ(a.measure_W.force, b.measure_W.force);
          EXPECT_EQ(a.measure_W.torque, b.measure_W.torque);
          EXPECT_EQ(a.unseen_volume, b.unseen_volume);
          EXPECT_EQ(a.num_boundary_spheres, b.num_boundary_spheres);
          EXPECT_EQ(a.num_inside_spheres, b.num_inside_spheres);
          if (stiffness) {
            EXPECT_EQ(std::memcmp(packed.stiffness->m, apart.stiffness->m, sizeof(Stiffness)), 0);
          }
          num_touching += a.num_boundary_spheres > 20;
        }
      }
    }
  }
  EXPECT_GT(num_touching, 20);
}

}  // namespace
}  // namespace palpate
