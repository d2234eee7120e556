#include "src/contact/index/sphere_grid.h"

#include <gtest/gtest.h>

#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

// Cells by definition: tags and lists must agree with a test of the cell's corners and of the
// sphere.
TEST(SphereGrid, EveryPointOfASphereFindsItInItsCell) {
  const std::vector<Sphere> spheres = test::random_spheres(400, 0.1, 3);
  const SphereGrid grid(spheres);
  const SphereGridView view = grid.view();
  test::Random random(5);
  int num_full = 0;
  for (int i = 0; i < 200000; ++i) {
    const auto id = static_cast<std::int32_t>(random.bits() % spheres.size());
    const Sphere& s = spheres[static_cast<std::size_t>(id)];
    const double r = static_cast<double>(s.radius) * (i % 2 == 0 ? 1.0 : random.uniform());
    const Vec3d g =
        (to_double(s.centre) + r * random.direction() - view.origin) * view.cells_per_metre;
    ASSERT_TRUE(g.x >= 0 && g.y >= 0 && g.z >= 0 && g.x < view.num_x && g.y < view.num_y &&
                g.z < view.num_z);
    const std::int32_t tag =
        view.tags[(static_cast<int>(g.z) * view.num_y + static_cast<int>(g.y)) * view.num_x +
                  static_cast<int>(g.x)];
    ASSERT_NE(tag, 0);
    if (tag > 0) {
      ASSERT_EQ(tag - 1, id);
      ++num_full;
      continue;
    }
    const CandidateBlock* block = view.blocks - (tag + 1);
    bool listed = false;
    for (bool more = true; more && !listed; more = block->goes_on(), ++block) {
      for (int slot = 0; slot < CandidateBlock::kSize; ++slot) {
        listed |= block->maybe_inside[slot] > 0 && block->id(slot) == id;
      }
    }
    ASSERT_TRUE(listed);
  }
  EXPECT_GT(num_full, 1000);
}

}  // namespace
}  // namespace palpate
