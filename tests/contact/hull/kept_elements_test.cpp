// Elements that tiles show to be free are left out, and those of several clusters are packed into
// full vectors: neither may change a bit.
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/contact/contact.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/hull_scenes.h"

namespace palpate {
namespace {

using test::HullScene;
using test::Random;

void expect_same_bits(const ContactResult& a, const ContactResult& b) {
  const Penetration &p = a.penetration, &q = b.penetration;
  EXPECT_EQ(p.volume, q.volume);
  EXPECT_EQ(p.potential, q.potential);
  EXPECT_EQ(p.unseen_volume, q.unseen_volume);
  EXPECT_EQ(p.measure_W.force, q.measure_W.force);
  EXPECT_EQ(p.measure_W.torque, q.measure_W.torque);
  EXPECT_EQ(p.num_boundary_spheres, q.num_boundary_spheres);
  EXPECT_EQ(p.num_inside_spheres, q.num_inside_spheres);
  ASSERT_EQ(a.stiffness.has_value(), b.stiffness.has_value());
  for (int i = 0; a.stiffness && i < 36; ++i) {
    EXPECT_EQ(a.stiffness->m[i / 6][i % 6], b.stiffness->m[i / 6][i % 6]);
  }
}

/// A wall and a ball before it, seen from beside each other with noise of this deviation (m), or by
/// a camera by itself.
HullScene scene_of(int num_cameras, double noise, std::uint64_t seed) {
  Random random(seed);
  HullScene scene;
  const Camera camera{320, 240, {262.5, 262.5, 159.5, 119.5}};
  for (int k = 0; k < num_cameras; ++k) {
    // The first one is right before the wall, where tiles bound it sharply.
    const double a = k % 2 == 0 ? -0.25 * k : 0.5, y = k == 3 ? -0.5 : 0;
    const Pose X_WC = test::look_at({std::sin(a), y, 1 - std::cos(a)}, {0, 0, 1});
    std::vector<float> meters = test::depth_seen(
        [](const Vec3d& p, const Vec3d& d) {
          return std::min(test::to_wall(p, d, 1), test::to_ball(p, d, {0.15, 0, 0.95}, 0.05));
        },
        camera, X_WC);
    for (float& z : meters) z += static_cast<float>(noise * random.normal());
    test::add_view(scene, camera, X_WC, meters);
  }
  if (num_cameras == 1) test::set_apart(scene.views[0].from, scene.views[0].to);
  return scene;
}

/// Surfaces whose tiles tell nothing, so that all elements are sampled.
class WithoutTiles {
 public:
  explicit WithoutTiles(std::vector<SurfaceBlend> views) : views_(std::move(views)) {
    for (SurfaceBlend& view : views_) {
      for (SurfaceView* const surface : {&view.from, &view.to}) {
        for (DepthFieldView* const field : {&surface->field, &surface->seen_free}) {
          const auto num = static_cast<std::size_t>(field->tiles_wide * field->tiles_high);
          tiles_.push_back(std::make_unique<std::vector<DepthTile>>(num));
          field->tiles = tiles_.back()->data();
        }
      }
    }
  }
  const std::vector<SurfaceBlend>& views() const { return views_; }

 private:
  std::vector<SurfaceBlend> views_;
  std::vector<std::unique_ptr<std::vector<DepthTile>>> tiles_;
};

class KeptElements : public testing::TestWithParam<int> {
 protected:
  /// Calls f(query, poses, views) for tools with and without clusters that count as one ball, with
  /// and without noise (tiles bound a wall without noise sharply), between two frames and at one.
  template <class F>
  void for_scenes(const F& f) const {
    for (const double noise : {0.0, 0.0015}) for_scenes(noise, f);
  }
  template <class F>
  void for_scenes(double noise, const F& f) const {
    const HullScene scene = scene_of(GetParam(), noise, 1), later = scene_of(GetParam(), noise, 2);
    std::vector<SurfaceBlend> between = scene.views;
    for (std::size_t k = 0; k < between.size(); ++k) {
      between[k] = {scene.views[k].to, later.views[k].to, 0.4};
    }
    Random random(3);
    std::vector<Pose> poses;
    for (int i = 0; i < 12; ++i) {
      const double x = random.uniform(-0.1, 0.1), y = random.uniform(-0.05, 0.05);
      poses.push_back({{x, y, random.uniform(0.9, 1.1)}, random.rotation(3)});
    }
    for (const Tool& tool :
         {test::random_tool(40, 0.06, 3), test::random_tool(700, 0.06, 4), test::grid_tool()}) {
      for (const auto& views : {scene.views, between}) {
        f(*make_contact_query(Place::cpu(), tool, FieldMethod{}).value(), poses, views);
      }
    }
  }
};

TEST_P(KeptElements, TilesChangeNoBit) {
  for_scenes([](const ContactQuery& query, const std::vector<Pose>& poses,
                const std::vector<SurfaceBlend>& views) {
    const WithoutTiles all(views);
    for (const bool with_stiffness : {false, true}) {
      for (const Pose& X_WT : poses) {
        const ContactWants wants{.stiffness = with_stiffness};
        expect_same_bits(query.measure(views, X_WT, wants),
                         query.measure(all.views(), X_WT, wants));
      }
    }
  });
}

// With standard deviations elements stay where they are.
TEST_P(KeptElements, PackingChangesNoBit) {
  int num_touching = 0;
  for_scenes([&](const ContactQuery& query, const std::vector<Pose>& poses,
                 const std::vector<SurfaceBlend>& views) {
    for (const bool with_stiffness : {false, true}) {
      for (const Pose& X_WT : poses) {
        const ContactResult packed = query.measure(views, X_WT, {.stiffness = with_stiffness});
        expect_same_bits(packed,
                         query.measure(views, X_WT, {.stiffness = with_stiffness, .noise = true}));
        num_touching += packed.penetration.volume > 0;
      }
    }
  });
  EXPECT_GT(num_touching, 50);
}

INSTANTIATE_TEST_SUITE_P(Cameras, KeptElements, testing::Values(1, 2, 4));

}  // namespace
}  // namespace palpate
