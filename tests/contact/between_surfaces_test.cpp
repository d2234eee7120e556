#include <cmath>

#include <gtest/gtest.h>

#include "eval/studies/method_queries.h"
#include "palpate/math/geometry.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

constexpr int kWidth = 96, kHeight = 72;
const Intrinsics kCamera{100, 100, 47.5, 35.5};
const MethodKind kAllMethods[] = {MethodKind::weighted, MethodKind::simplified, MethodKind::graph,
                                  MethodKind::field};

/// A wall at some depth, with everything that queries read.
class Wall {
 public:
  explicit Wall(double depth)
      : cloud_(kWidth, kHeight, kCamera),
        field_(std::move(DepthField::create(kWidth, kHeight)).value()) {
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const Vec3d p{(u - kCamera.cx) * depth / kCamera.fx, (v - kCamera.cy) * depth / kCamera.fy,
                      depth};
        cloud_.set(static_cast<std::size_t>(v * kWidth + u), to_float(p), {0, 0, -1});
      }
    }
    ThreadPool pool(1);
    field_.update(cloud_.view(), pool);
  }
  SurfaceView surfaces() const { return {cloud_.view(), field_.view()}; }

 private:
  PointCloud cloud_;
  DepthField field_;
};

const Tool& tool() {
  static const Tool made = test::random_tool(200, 0.03, 7);
  return made;
}

std::unique_ptr<eval::MethodQueries> plain_query() {
  return std::make_unique<eval::MethodQueries>(Backend::cpu, tool());
}

Pose pose_at(double z) { return {{0.003, -0.002, z}, axis_angle({1, 2, 3}, 0.4)}; }

ContactOptions options_of(MethodKind method) {
  ContactOptions options;
  options.method = method;
  options.volumes = SphereVolumes::own;
  return options;
}

TEST(BetweenSurfaces, WeighsBothSurfaces) {
  const Wall old_wall(0.5), new_wall(0.495);
  const auto plain = plain_query();
  eval::MethodQueries blended(Backend::cpu, tool());
  for (const MethodKind method : kAllMethods) {
    const ContactOptions options = options_of(method);
    const auto on = [&](const Wall& wall) {
      plain->set_cloud(wall.surfaces().cloud);
      plain->set_field(wall.surfaces().field);
      return plain->query(pose_at(0.49), options);
    };
    const Penetration from = on(old_wall), to = on(new_wall);
    ASSERT_GT(to.volume, from.volume);
    for (const double t : {0.0, 0.25, 1.0}) {
      blended.set_blend({old_wall.surfaces(), new_wall.surfaces(), t});
      const Penetration got = blended.query(pose_at(0.49), options);
      EXPECT_EQ(got.volume, t < 1 ? (1 - t) * from.volume + t * to.volume : to.volume);
      EXPECT_NEAR(
          norm(got.measure_W.force - ((1 - t) * from.measure_W.force + t * to.measure_W.force)), 0,
          1e-18);
      EXPECT_NEAR(
          norm(got.measure_W.torque - ((1 - t) * from.measure_W.torque + t * to.measure_W.torque)),
          0, 1e-20);
      EXPECT_EQ(got.num_boundary_spheres, to.num_boundary_spheres);
      EXPECT_EQ(got.num_inside_spheres, to.num_inside_spheres);
    }
  }
}

// Between two frames of a wall that moves by a few millimeters, the force is that of the wall on
// its way, as moving the points themselves would give: every sphere's cap volume is nearly linear
// over such a distance.
TEST(BetweenSurfaces, FollowsAMovingWall) {
  const Wall old_wall(0.5), new_wall(0.4975);
  const Pose X_WT = pose_at(0.492);
  eval::MethodQueries query(Backend::cpu, tool());
  for (const double t : {0.0, 0.3, 0.5, 0.8, 1.0}) {
    query.set_blend({old_wall.surfaces(), new_wall.surfaces(), t});
    const double depth = 0.5 - 0.0025 * t;
    double expected = 0;
    for (const Sphere& s : tool().spheres()) {
      expected += cap_volume(static_cast<double>(s.radius), depth - (X_WT * to_double(s.center)).z);
    }
    const Penetration got = query.query(X_WT, options_of(MethodKind::field));
    EXPECT_NEAR(got.volume, expected, 0.005 * expected) << t;
    // Deep spheres are pushed by up to 5 % more (kSteepening).
    EXPECT_NEAR(-got.measure_W.force.z, expected, 0.05 * expected) << t;
  }
}

TEST(BetweenSurfaces, IsTheGradientOfOnePotentialAtEveryInstant) {
  const Wall old_wall(0.5), new_wall(0.48);
  eval::MethodQueries query(Backend::cpu, tool());
  const ContactOptions options = options_of(MethodKind::field);
  for (const double t : {0.2, 0.5, 0.9}) {
    query.set_blend({old_wall.surfaces(), new_wall.surfaces(), t});
    constexpr double kStep = 1e-4;
    const double force = query.query(pose_at(0.49), options).measure_W.force.z;
    const double slope = (query.query(pose_at(0.49 + kStep), options).potential -
                          query.query(pose_at(0.49 - kStep), options).potential) /
                         (2 * kStep);
    EXPECT_NEAR(force, -slope, 2e-3 * std::abs(force)) << t;
    // And the stiffness is the slope of the force.
    const double force_slope = (query.query(pose_at(0.49 + kStep), options).measure_W.force.z -
                                query.query(pose_at(0.49 - kStep), options).measure_W.force.z) /
                               (2 * kStep);
    query.query(pose_at(0.49), options);
    EXPECT_NEAR(query.stiffness().m[2][2], -force_slope, 0.01 * std::abs(force_slope)) << t;
  }
}

// A wall that appears or vanishes as a whole fades linearly.
TEST(BetweenSurfaces, WhatAppearsFadesIn) {
  const Wall wall(0.5);
  const PointCloud nothing(kWidth, kHeight, kCamera);
  ThreadPool pool(1);
  DepthField empty = std::move(DepthField::create(kWidth, kHeight)).value();
  empty.update(nothing.view(), pool);
  const SurfaceView none{nothing.view(), empty.view()};
  eval::MethodQueries query(Backend::cpu, tool());
  for (const MethodKind method : kAllMethods) {
    const auto volume = [&](const SurfaceView& from, const SurfaceView& to, double t) {
      query.set_blend({from, to, t});
      return query.query(pose_at(0.5), options_of(method)).volume;
    };
    const double whole = volume(none, wall.surfaces(), 1);
    ASSERT_GT(whole, 0);
    for (double t = 0; t <= 1; t += 0.125) {
      EXPECT_NEAR(volume(none, wall.surfaces(), t), t * whole, 1e-9 * whole);
      EXPECT_NEAR(volume(wall.surfaces(), none, t), (1 - t) * whole, 1e-9 * whole);
    }
  }
}

TEST(BetweenSurfaces, SettingOneSurfaceLeavesNothingToBlend) {
  const Wall old_wall(0.5), new_wall(0.49);
  eval::MethodQueries query(Backend::cpu, tool());
  query.set_blend({old_wall.surfaces(), old_wall.surfaces(), 0.5});
  query.set_cloud(new_wall.surfaces().cloud);
  query.set_field(new_wall.surfaces().field);
  const auto plain = plain_query();
  plain->set_cloud(new_wall.surfaces().cloud);
  plain->set_field(new_wall.surfaces().field);
  for (const MethodKind method : kAllMethods) {
    EXPECT_EQ(query.query(pose_at(0.49), options_of(method)).volume,
              plain->query(pose_at(0.49), options_of(method)).volume);
  }
}

TEST(BetweenSurfaces, DoesNotAllocate) {
  const Wall old_wall(0.5), new_wall(0.49);
  eval::MethodQueries query(Backend::cpu, tool());
  const SurfaceBlend moment{old_wall.surfaces(), new_wall.surfaces(), 0.5};
  for (const MethodKind method : kAllMethods) query.by(options_of(method));
  const test::AllocationCounter counter;
  for (const MethodKind method : kAllMethods) {
    query.set_blend(moment);
    query.query(pose_at(0.49), options_of(method));
    query.stiffness();
  }
  EXPECT_EQ(counter.count(), 0u);
}

}  // namespace
}  // namespace palpate
