#include <cmath>

#include <gtest/gtest.h>

#include "palpate/contact/contact.h"
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

Pose pose_at(double z) { return {{0.003, -0.002, z}, axis_angle({1, 2, 3}, 0.4)}; }

std::unique_ptr<ContactQuery> query_by(MethodKind method) {
  const ContactOptions options{.method = method, .volumes = SphereVolumes::own};
  return make_contact_query(Place::cpu(), tool(), contact_method(options).value()).value();
}

TEST(BetweenSurfaces, WeighsBothSurfaces) {
  const Wall old_wall(0.5), new_wall(0.495);
  for (const MethodKind method : kAllMethods) {
    const auto query = query_by(method);
    const auto on = [&](const Wall& wall) {
      return query->measure(wall.surfaces(), pose_at(0.49)).penetration;
    };
    const Penetration from = on(old_wall), to = on(new_wall);
    ASSERT_GT(to.volume, from.volume);
    for (const double t : {0.0, 0.25, 1.0}) {
      const Penetration got =
          query->measure(old_wall.surfaces(), new_wall.surfaces(), t, pose_at(0.49)).penetration;
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
  const auto query = query_by(MethodKind::field);
  for (const double t : {0.0, 0.3, 0.5, 0.8, 1.0}) {
    const double depth = 0.5 - 0.0025 * t;
    double expected = 0;
    for (const Sphere& s : tool().spheres()) {
      expected += cap_volume(static_cast<double>(s.radius), depth - (X_WT * to_double(s.center)).z);
    }
    const Penetration got =
        query->measure(old_wall.surfaces(), new_wall.surfaces(), t, X_WT).penetration;
    EXPECT_NEAR(got.volume, expected, 0.005 * expected) << t;
    // Deep spheres are pushed by up to 5 % more (kSteepening).
    EXPECT_NEAR(-got.measure_W.force.z, expected, 0.05 * expected) << t;
  }
}

TEST(BetweenSurfaces, IsTheGradientOfOnePotentialAtEveryInstant) {
  const Wall old_wall(0.5), new_wall(0.48);
  const auto query = query_by(MethodKind::field);
  for (const double t : {0.2, 0.5, 0.9}) {
    constexpr double kStep = 1e-4;
    const auto at = [&](double z) {
      return query->measure(old_wall.surfaces(), new_wall.surfaces(), t, pose_at(z),
                            {.stiffness = true});
    };
    const ContactResult here = at(0.49), low = at(0.49 - kStep), high = at(0.49 + kStep);
    const double force = here.penetration.measure_W.force.z;
    const double slope = (high.penetration.potential - low.penetration.potential) / (2 * kStep);
    EXPECT_NEAR(force, -slope, 2e-3 * std::abs(force)) << t;
    // And the stiffness is the slope of the force.
    const double force_slope =
        (high.penetration.measure_W.force.z - low.penetration.measure_W.force.z) / (2 * kStep);
    EXPECT_NEAR(here.stiffness->m[2][2], -force_slope, 0.01 * std::abs(force_slope)) << t;
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
  for (const MethodKind method : kAllMethods) {
    const auto query = query_by(method);
    const auto volume = [&](const SurfaceView& from, const SurfaceView& to, double t) {
      return query->measure(from, to, t, pose_at(0.5)).penetration.volume;
    };
    const double whole = volume(none, wall.surfaces(), 1);
    ASSERT_GT(whole, 0);
    for (double t = 0; t <= 1; t += 0.125) {
      EXPECT_NEAR(volume(none, wall.surfaces(), t), t * whole, 1e-9 * whole);
      EXPECT_NEAR(volume(wall.surfaces(), none, t), (1 - t) * whole, 1e-9 * whole);
    }
  }
}

TEST(BetweenSurfaces, DoesNotAllocate) {
  const Wall old_wall(0.5), new_wall(0.49);
  std::vector<std::unique_ptr<ContactQuery>> queries;
  for (const MethodKind method : kAllMethods) queries.push_back(query_by(method));
  const test::AllocationCounter counter;
  for (const auto& query : queries) {
    query->measure(old_wall.surfaces(), new_wall.surfaces(), 0.5, pose_at(0.49));
    query->measure(old_wall.surfaces(), new_wall.surfaces(), 0.5, pose_at(0.49),
                   {.stiffness = true});
  }
  EXPECT_EQ(counter.count(), 0u);
}

}  // namespace
}  // namespace palpate
