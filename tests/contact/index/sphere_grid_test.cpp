#include "src/contact/index/sphere_grid.h"

#include <algorithm>
#include <cmath>
#include <utility>

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
        (to_double(s.center) + r * random.direction() - view.origin) * view.cells_per_meter;
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

/// Squared distance, in cells, of a sphere's center from the nearest and farthest point of a cell
/// that is `larger` on every side.
struct FromCell {
  double nearest = 0, farthest = 0;

  FromCell(const Vec3d& center, const int (&cell)[3], double larger) {
    for (int axis = 0; axis < 3; ++axis) {
      const double low = cell[axis] - larger - center[axis];
      const double high = cell[axis] + 1 + larger - center[axis];
      const double near = std::clamp(0.0, low, high);
      nearest += near * near;
      farthest += std::max(low * low, high * high);
    }
  }
};

// Bounds of a cell and of a sphere have room for rounding, a thousandth of a cell around the cell
// and a ten thousandth around the sphere, and no more than that.
TEST(SphereGrid, CellsKnowTheirSpheresWithRoomForRounding) {
  const std::vector<Sphere> spheres = test::random_spheres(40, 0.1, 4);
  const SphereGrid grid(spheres);
  const SphereGridView view = grid.view();
  int num_full = 0, num_listed = 0, num_ends = 0;
  for (int number = 0; number < view.num_x * view.num_y * view.num_z; ++number) {
    const int cell[3] = {number % view.num_x, number / view.num_x % view.num_y,
                         number / view.num_x / view.num_y};
    std::vector<const CandidateBlock*> blocks;
    const std::int32_t tag = view.tags[number];
    if (tag < 0) {
      blocks.push_back(view.blocks - (tag + 1));
      while (blocks.back()->goes_on()) blocks.push_back(blocks.back() + 1);
    }
    std::vector<std::int32_t> listed;
    for (const CandidateBlock* block : blocks) {
      for (int slot = 0; slot < CandidateBlock::kSize; ++slot) {
        const auto at = static_cast<std::size_t>(slot);
        if (block->maybe_inside[at] < 0) {
          EXPECT_EQ(block->surely_inside[at], -1);
          EXPECT_EQ(block, blocks.back());
          ++num_ends;
          continue;
        }
        const Sphere& s = spheres[static_cast<std::size_t>(block->id(slot))];
        const Vec3d c = (to_double(s.center) - view.origin) * view.cells_per_meter;
        const double r = static_cast<double>(s.radius) * view.cells_per_meter;
        EXPECT_LT(norm(c - to_double(Vec3f{block->x[at], block->y[at], block->z[at]})), 1e-5);
        EXPECT_NEAR(std::sqrt(static_cast<double>(block->surely_inside[at])), r - 1e-4, 1e-5);
        EXPECT_NEAR(std::sqrt(static_cast<double>(block->maybe_inside[at])), r + 1e-4, 1e-5);
        listed.push_back(block->id(slot));
      }
    }
    EXPECT_TRUE(std::ranges::is_sorted(listed)) << number;
    num_listed += static_cast<int>(listed.size());
    num_full += tag > 0;
    for (std::size_t id = 0; id < spheres.size(); ++id) {
      const Vec3d c = (to_double(spheres[id].center) - view.origin) * view.cells_per_meter;
      const double r = static_cast<double>(spheres[id].radius) * view.cells_per_meter;
      const FromCell less(c, cell, 0.9e-3), more(c, cell, 1.1e-3);
      const bool is_full = tag == static_cast<std::int32_t>(id) + 1;
      const bool is_listed = std::ranges::binary_search(listed, static_cast<std::int32_t>(id));
      if (more.farthest < r * r) {
        ASSERT_TRUE(is_full) << id;
      }
      if (less.farthest > r * r) {
        ASSERT_FALSE(is_full) << id;
      }
      if (tag <= 0 && less.nearest < r * r) {
        ASSERT_TRUE(is_listed) << id;
      }
      if (more.nearest > r * r) {
        ASSERT_FALSE(is_listed) << id;
      }
    }
  }
  EXPECT_GT(num_full, 50);
  EXPECT_GT(num_listed, 800);
  EXPECT_GT(num_ends, 1000);
}

TEST(SphereGrid, LiesAroundAllSpheresWithAboutOneCellAndAHalfPerSphere) {
  for (const auto& [num, longest] :
       {std::pair{3, 12}, {500, 12}, {1000, 15}, {3375, 22}}) {  // 1.5 times the cube root
    std::vector<Sphere> spheres;
    for (int i = 0; i < num; ++i) {
      const float at = static_cast<float>(i) / static_cast<float>(num - 1);
      spheres.push_back({{0.01f * at - 0.1f, 0.2f * at + 1, 0.05f - 0.1f * at}, 1e-4f});
    }
    const SphereGrid grid(spheres);
    const SphereGridView view = grid.view();
    const Vec3d low{-0.1 - 1e-4, 1 - 1e-4, -0.05 - 1e-4},
        high{-0.09 + 1e-4, 1.2 + 1e-4, 0.05 + 1e-4};
    EXPECT_NEAR(view.cells_per_meter, longest / (high.y - low.y), 1e-4 * view.cells_per_meter);
    const int num_cells[3] = {view.num_x, view.num_y, view.num_z};
    for (int axis = 0; axis < 3; ++axis) {
      const double first = (low[axis] - view.origin[axis]) * view.cells_per_meter;
      const double last = (high[axis] - view.origin[axis]) * view.cells_per_meter;
      EXPECT_NEAR(first, 2e-3, 1e-4);
      EXPECT_GT(num_cells[axis], last + 1.5e-3);
      EXPECT_LE(num_cells[axis], last + 2.5e-3 + 1);
    }
  }
  std::vector<Sphere> many(2'000'000, Sphere{{0, 0, 0}, 1e-4f});
  many[0].center.x = 1;
  EXPECT_NEAR(SphereGrid(many).view().cells_per_meter, 128, 0.1);
}

}  // namespace
}  // namespace palpate
