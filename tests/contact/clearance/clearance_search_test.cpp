// The search for the nearest sphere, against every pixel in double, on every instruction set.
#include "src/contact/clearance/clearance_search.h"

#include <cmath>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/clearance/clearance.h"
#include "src/contact/clearance/surface_plane.h"
#include "tests/test_util/clearance_truth.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/hull_scenes.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using test::HullScene;
using test::Random;

constexpr double kLimit = 0.4;

std::vector<SurfaceView> surfaces_of(const HullScene& scene) {
  std::vector<SurfaceView> surfaces;
  for (const SurfaceBlend& view : scene.views) surfaces.push_back(view.to);
  return surfaces;
}

/// Cameras and spheres of a search, made by hand, so that hits are seen before planes are fitted.
struct Searched {
  Searched(const std::vector<SurfaceView>& surfaces, const Tool& tool) : spheres(tool.spheres()) {
    fields.resize(surfaces.size());
    seen_free.resize(surfaces.size());
    for (std::size_t k = 0; k < surfaces.size(); ++k) {
      fields[k].update(surfaces[k].field, false);
      if (surfaces.size() > 1) seen_free[k].update(surfaces[k].seen_free, true);
      X_CW.push_back(inverse(surfaces[k].X_WC));
    }
  }

  ClearanceHit find(const Pose& X_WT, Isa isa, double limit = kLimit) const {
    std::vector<ClearanceCamera> cameras(fields.size());
    for (std::size_t k = 0; k < fields.size(); ++k) {
      cameras[k].field = &fields[k].image();
      if (fields.size() > 1) cameras[k].seen_free = &seen_free[k].image();
      const Pose X_CT = X_CW[k] * X_WT;
      const Mat3d R = rotation_matrix(X_CT.rotation);
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) cameras[k].R_CT[i][j] = static_cast<float>(R.m[i][j]);
        cameras[k].p_CT[i] = static_cast<float>(X_CT.translation[i]);
      }
    }
    ClearanceHit hit;
    clearance_kernels(isa).find_nearest(
        {view_of(spheres), cameras.data(), static_cast<int>(cameras.size()),
         static_cast<float>(limit), static_cast<float>(limit)},
        hit);
    return hit;
  }

  SphereClusters spheres;
  std::vector<ClearanceFrame> fields, seen_free;
  std::vector<Pose> X_CW;
};

double value_of(const ClearanceHit& hit) {
  if (hit.kind == ClearanceKind::deep) return -kLimit;
  return static_cast<double>(hit.value);
}

Pose random_pose(Random& random) {
  const double x = random.uniform(-0.5, 0.5), y = random.uniform(-0.4, 0.4);
  return {{x, y, random.uniform(0.05, 1.4)}, random.rotation(3.0)};
}

void compare(const std::vector<SurfaceView>& surfaces, Random& random, int num_poses) {
  const test::SolidScene truth(surfaces);
  int num_outside = 0, num_inside = 0;
  for (const int num_spheres : {1, 21, 100}) {
    const Tool tool = test::random_tool(num_spheres, 0.05, 3);
    const Searched searched(surfaces, tool);
    for (int i = 0; i < num_poses; ++i) {
      const Pose X_WT = random_pose(random);
      const double want = truth.clearance(tool, X_WT, kLimit);
      const ClearanceHit hit = searched.find(X_WT, best_isa());
      EXPECT_NEAR(value_of(hit), want, 2e-6) << "pose " << i << ", spheres " << num_spheres;
      num_outside += want > 0 && want < kLimit;
      num_inside += want < 0 && want > -kLimit;
      for (const Isa isa : {Isa::baseline, Isa::avx2}) {
        const ClearanceHit other = searched.find(X_WT, isa);
        EXPECT_EQ(value_of(other), value_of(hit));
        if (hit.kind == ClearanceKind::deep) continue;
        EXPECT_EQ(other.sphere, hit.sphere);
        EXPECT_EQ(other.pixel, hit.pixel);
        EXPECT_EQ(other.camera, hit.camera);
      }
    }
  }
  EXPECT_GT(num_outside, 0);
  EXPECT_GE(num_inside + num_outside, 4);
}

TEST(ClearanceSearch, EqualsItsDefinitionForOneCamera) {
  Random random(71);
  for (const DepthFieldOptions& field :
       {DepthFieldOptions{}, DepthFieldOptions{.unknown = UnknownSpace::solid},
        DepthFieldOptions{.unseen = UnseenSpace::fade, .thickness = 0.03},
        DepthFieldOptions{.unseen = UnseenSpace::free, .thickness = 0.02}}) {
    const HullScene scene = test::rough_scene(1, field, random);
    compare(surfaces_of(scene), random, 6);
  }
}

TEST(ClearanceSearch, EqualsItsDefinitionForSeveralCameras) {
  Random random(72);
  for (const int num_cameras : {2, 3}) {
    for (const DepthFieldOptions& field :
         {DepthFieldOptions{}, DepthFieldOptions{.unknown = UnknownSpace::solid},
          DepthFieldOptions{.unseen = UnseenSpace::free, .thickness = 0.03}}) {
      const HullScene scene = test::rough_scene(num_cameras, field, random);
      compare(surfaces_of(scene), random, 4);
    }
  }
}

TEST(ClearanceSearch, BallsBoundWhatIsSearched) {
  Random random(73);
  int num_far = 0, num_near = 0;
  for (const DepthFieldOptions& field :
       {DepthFieldOptions{}, DepthFieldOptions{.unknown = UnknownSpace::solid},
        DepthFieldOptions{.unseen = UnseenSpace::free, .thickness = 0.02}}) {
    const HullScene seen = test::rough_scene(1, field, random);
    const std::vector<SurfaceView> surfaces = surfaces_of(seen);
    const test::SolidScene truth(surfaces);
    ThreadPool pool(1);
    ClearanceScene scene;
    ASSERT_TRUE(scene.update(surfaces, {}, pool));
    const Tool tool = test::random_tool(21, 0.05, 3);
    const ClearanceTool searched = clearance_tool(tool);
    std::vector<Pose> poses;
    for (int i = 0; i < 21; ++i) poses.push_back(random_pose(random));
    PoseScreen screen;
    for (const double limit : {0.2, 0.02}) {
      std::vector<float> least;
      for (const Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
        screen.X_WT = poses.data();
        screen.num = static_cast<int>(poses.size());
        screen.limit = static_cast<float>(limit);
        std::fill_n(screen.tools, screen.num, &searched);
        scene.place(screen, clearance_kernels(isa));
        const std::vector<float> found(screen.least, screen.least + screen.num);
        if (least.empty()) least = found;
        EXPECT_EQ(found, least);
      }
      for (std::size_t i = 0; i < poses.size(); ++i) {
        const double want = truth.clearance(tool, poses[i], limit);
        EXPECT_LE(static_cast<double>(least[i]), want + 1e-7) << i;
        num_far += least[i] == screen.limit;
        num_near += want < limit;
      }
    }
  }
  EXPECT_GT(num_far, 10);
  EXPECT_GT(num_near, 10);
}

}  // namespace
}  // namespace palpate
