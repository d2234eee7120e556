// Several cameras joined: against the definition in double, against exact solids, and against what
// one camera measures.
#include "src/contact/hull/depth_hull.h"

#include <algorithm>
#include <cstring>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/contact/contact.h"
#include "palpate/field/sensor.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/hull_scenes.h"
#include "tests/test_util/hull_truth.h"
#include "tests/test_util/random_frame.h"

namespace palpate {
namespace {

using test::HullScene;
using test::Random;

std::vector<Isa> isas() {
  std::vector<Isa> all;
  for (Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
    if (isa <= best_isa()) all.push_back(isa);
  }
  return all;
}

std::unique_ptr<ContactQuery> make_query(const Tool& tool, SphereVolumes volumes,
                                         Isa isa = best_isa(), ThreadPool* pool = nullptr) {
  return make_contact_query(Place::cpu(), tool, FieldMethod{volumes}, {isa, pool}).value();
}

Pose random_pose(Random& random) {
  const double x = random.uniform(-0.25, 0.25), y = random.uniform(-0.2, 0.2);
  return {{x, y, random.uniform(0.7, 1.4)}, random.rotation(3.0)};
}

void expect_same_bits(const ContactResult& a, const ContactResult& b) {
  EXPECT_EQ(a.penetration.volume, b.penetration.volume);
  EXPECT_EQ(a.penetration.potential, b.penetration.potential);
  EXPECT_EQ(a.penetration.unseen_volume, b.penetration.unseen_volume);
  EXPECT_EQ(a.penetration.measure_W.force, b.penetration.measure_W.force);
  EXPECT_EQ(a.penetration.measure_W.torque, b.penetration.measure_W.torque);
  EXPECT_EQ(a.penetration.status, b.penetration.status);
  ASSERT_EQ(a.stiffness.has_value(), b.stiffness.has_value());
  if (!a.stiffness) return;
  EXPECT_EQ(std::memcmp(a.stiffness->m, b.stiffness->m, sizeof b.stiffness->m), 0);
}

TEST(DepthHull, EqualsItsDefinition) {
  Random random(11);
  for (const int num_cameras : {2, 3, 5}) {
    for (const DepthFieldOptions& field :
         {DepthFieldOptions{}, DepthFieldOptions{.unknown = UnknownSpace::solid},
          DepthFieldOptions{.unseen = UnseenSpace::fade, .thickness = 0.03}}) {
      const HullScene scene = test::rough_scene(num_cameras, field, random);
      int num_with_force = 0;
      for (const int num_spheres : {1, 33, 400}) {
        const Tool tool = test::random_tool(num_spheres, 0.06, 3);
        for (int i = 0; i < 25; ++i) {
          const Pose X_WT = random_pose(random);
          for (const SphereVolumes volumes : {SphereVolumes::own, SphereVolumes::represented}) {
            const Penetration want = test::hull_truth(tool, scene.views, X_WT, volumes);
            const double scale = full_volume(tool, volumes);
            num_with_force += want.volume > 0.01 * scale && want.volume < 0.99 * scale;
            for (const Isa isa : isas()) {
              const Penetration got =
                  make_query(tool, volumes, isa)->measure(scene.views, X_WT).penetration;
              EXPECT_NEAR(got.volume, want.volume, 3e-5 * scale);
              EXPECT_NEAR(got.potential, want.potential, 4e-6 * scale);
              EXPECT_NEAR(norm(got.measure_W.force - want.measure_W.force), 0, 2e-4 * scale);
              EXPECT_NEAR(norm(got.measure_W.torque - want.measure_W.torque), 0, 2e-5 * scale);
              EXPECT_NEAR(got.num_inside_spheres, want.num_inside_spheres, 1);
              EXPECT_NEAR(got.num_boundary_spheres, want.num_boundary_spheres, 1);
              if (num_spheres > 100) {
                EXPECT_NEAR(got.unseen_volume, want.unseen_volume, 0.02 * scale);
              }
            }
          }
        }
      }
      EXPECT_GT(num_with_force, 10);
    }
  }
}

TEST(DepthHull, WrenchIsMinusTheDerivativeOfThePotential) {
  Random random(12);
  const HullScene scene = test::rough_scene(3, {}, random);
  const Tool tool = test::random_tool(150, 0.06, 5);
  const Vec3d C_T = tool.sphere_mass().center_of_mass;
  const auto truth = [&](const Pose& X_WT) {
    return test::hull_truth(tool, scene.views, X_WT, SphereVolumes::own, 1e9);
  };
  for (int i = 0; i < 25; ++i) {
    const Pose X_WT = random_pose(random);
    const Penetration at = truth(X_WT);
    const auto potential = [&](const Vec3d& shift, const Vec3d& turn) {
      const Quaternion q{turn.x / 2, turn.y / 2, turn.z / 2, 1};
      Pose moved{{}, normalized(q) * X_WT.rotation};
      moved.translation = X_WT * C_T + shift - rotate(moved.rotation, C_T);
      return truth(moved).potential;
    };
    for (int axis = 0; axis < 3; ++axis) {
      constexpr double kStep = 1e-6;
      Vec3d step;
      step[axis] = kStep;
      const double force = -(potential(step, {}) - potential(-step, {})) / (2 * kStep);
      const double torque = -(potential({}, step) - potential({}, -step)) / (2 * kStep);
      EXPECT_NEAR(at.measure_W.force[axis], force, 2e-4 * at.volume + 1e-12);
      EXPECT_NEAR(at.measure_W.torque[axis], torque, 2e-5 * at.volume + 1e-13);
    }
  }
}

TEST(DepthHull, StiffnessIsMinusTheDerivativeOfTheWrench) {
  Random random(13);
  const HullScene scene = test::smooth_scene(3);
  const Tool tool = test::random_tool(300, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  const Vec3d C_T = tool.sphere_mass().center_of_mass;
  int num_with_force = 0;
  std::vector<double> errors;
  for (int i = 0; i < 30; ++i) {
    const Pose X_WT{random.in_box(0.08) + Vec3d{0, 0, 0.8}, random.rotation(3.0)};
    const ContactResult at = query->measure(scene.views, X_WT, {.stiffness = true});
    ASSERT_TRUE(at.stiffness);
    expect_same_bits(query->measure(scene.views, X_WT), {at.penetration, {}, {}});
    if (at.penetration.volume < 0.05 * tool.sphere_mass().volume) continue;
    ++num_with_force;
    const auto wrench = [&](const Vec3d& shift, const Vec3d& turn) {
      const Quaternion q{turn.x / 2, turn.y / 2, turn.z / 2, 1};
      Pose moved{{}, normalized(q) * X_WT.rotation};
      moved.translation = X_WT * C_T + shift - rotate(moved.rotation, C_T);
      return query->measure(scene.views, moved).penetration.measure_W;
    };
    double largest = 0;
    for (const auto& row : at.stiffness->m) {
      for (int k = 0; k < 3; ++k) largest = std::max(largest, std::abs(row[k]));
    }
    for (int axis = 0; axis < 6; ++axis) {
      constexpr double kStep = 2e-4, kReach = 0.06;
      Vec3d shift, turn;
      (axis < 3 ? shift : turn)[axis % 3] = axis < 3 ? kStep : kStep / kReach;
      const VolumeWrench more = wrench(shift, turn), less = wrench(-shift, -turn);
      const double step = 2 * (axis < 3 ? kStep : kStep / kReach);
      const double scale = largest * (axis < 3 ? 1 : kReach);
      for (int k = 0; k < 3; ++k) {
        const double by_force = -(more.force[k] - less.force[k]) / step;
        const double by_torque = -(more.torque[k] - less.torque[k]) / step;
        errors.push_back(std::abs(at.stiffness->m[k][axis] - by_force) / scale);
        errors.push_back(std::abs(at.stiffness->m[k + 3][axis] - by_torque) / (scale * kReach));
      }
    }
  }
  // Second derivatives of the field jump between pixels.
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.005);
  EXPECT_LT(errors[errors.size() * 95 / 100], 0.05);
  EXPECT_GT(num_with_force, 10);
}

TEST(DepthHull, GivesTheSameBitsWithAnyThreadsAndInstructionSet) {
  Random random(14);
  const HullScene scene = test::rough_scene(4, {}, random);
  const Tool tool = test::random_tool(2000, 0.08, 4);
  ThreadPool pool(3);
  const auto first = make_query(tool, SphereVolumes::represented, Isa::baseline);
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT = random_pose(random);
    for (const bool stiffness : {false, true}) {
      const ContactWants wants{.stiffness = stiffness};
      const ContactResult want = first->measure(scene.views, X_WT, wants);
      for (const Isa isa : isas()) {
        expect_same_bits(make_query(tool, SphereVolumes::represented, isa, &pool)
                             ->measure(scene.views, X_WT, wants),
                         want);
      }
      expect_same_bits(first->measure(scene.views, X_WT, wants), want);
    }
  }
}

TEST(DepthHull, OneCameraIsMeasuredInItsOwnFrame) {
  Random random(15);
  const HullScene scene = test::rough_scene(1, {}, random);
  const Tool tool = test::random_tool(300, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  SurfaceBlend in_camera = scene.views[0];
  in_camera.from.X_WC = in_camera.to.X_WC = {};
  for (int i = 0; i < 20; ++i) {
    const Pose X_CT{random.in_box(0.15) + Vec3d{0, 0, 0.8}, random.rotation(3.0)};
    const ContactWants wants{.stiffness = true};
    const ContactResult in_C = query->measure(in_camera.to, X_CT, wants);
    expect_same_bits(query->measure(std::vector<SurfaceBlend>{in_camera}, X_CT, wants), in_C);
    const Pose X_WC{random.in_box(2), random.rotation(3.0)};
    SurfaceBlend in_world = in_camera;
    in_world.from.X_WC = in_world.to.X_WC = X_WC;
    const ContactResult in_W =
        query->measure(std::vector<SurfaceBlend>{in_world}, X_WC * X_CT, wants);
    const double volume = in_C.penetration.volume;
    EXPECT_NEAR(in_W.penetration.volume, volume, 1e-6 * tool.sphere_mass().volume);
    EXPECT_NEAR(norm(in_W.penetration.measure_W.force -
                     rotate(X_WC.rotation, in_C.penetration.measure_W.force)),
                0, 1e-5 * volume + 1e-12);
    EXPECT_NEAR(norm(in_W.penetration.measure_W.torque -
                     rotate(X_WC.rotation, in_C.penetration.measure_W.torque)),
                0, 1e-6 * volume + 1e-13);
    // A motion along the camera's x changes the force in W as in the camera frame.
    Vec3d change_C, change_W;
    const Vec3d x_W = rotate(X_WC.rotation, {1, 0, 0});
    for (int row = 0; row < 3; ++row) {
      change_C[row] = in_C.stiffness->m[row][0];
      for (int k = 0; k < 3; ++k) change_W[row] += in_W.stiffness->m[row][k] * x_W[k];
    }
    EXPECT_NEAR(norm(change_W - rotate(X_WC.rotation, change_C)), 0, 1e-3 * norm(change_C) + 1e-9);
  }
}

// Each of a camera's two frames keeps the pose that the camera had there.
TEST(DepthHull, OneCameraThatHasMovedIsMeasuredFromBothPlaces) {
  Random random(17);
  const HullScene scene = test::rough_scene(2, {}, random);
  const Tool tool = test::random_tool(300, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  SurfaceView from = scene.views[0].to, to = scene.views[1].to;
  test::set_apart(from, to);
  const ContactWants wants{.stiffness = true};
  int num_with_force = 0;
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT = random_pose(random);
    const double t = random.uniform(0, 1);
    const ContactResult got = query->measure(from, to, t, X_WT, wants);
    const ContactResult a = query->measure(from, X_WT, wants), b = query->measure(to, X_WT, wants);
    const auto between = [&](double before, double now) { return (1 - t) * before + t * now; };
    EXPECT_EQ(got.penetration.volume, between(a.penetration.volume, b.penetration.volume));
    EXPECT_EQ(got.penetration.measure_W.force.x,
              between(a.penetration.measure_W.force.x, b.penetration.measure_W.force.x));
    EXPECT_EQ(got.stiffness->m[2][4], between(a.stiffness->m[2][4], b.stiffness->m[2][4]));
    expect_same_bits(query->measure(from, to, 1, X_WT, wants), b);
    num_with_force += a.penetration.volume > 0 && b.penetration.volume > 0;
  }
  EXPECT_GT(num_with_force, 5);
}

TEST(DepthHull, WhoSeesNothingAbstains) {
  Random random(16);
  const HullScene scene = test::rough_scene(3, {}, random);
  const Tool tool = test::random_tool(300, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  // A camera that looks the other way, and one that has no frame yet.
  std::vector<SurfaceBlend> more(scene.views.begin(), scene.views.begin() + 2);
  SurfaceBlend away = scene.views[2];
  away.from.X_WC = away.to.X_WC = {{0, 0, -5}, axis_angle({0, 1, 0}, kPi)};
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT = random_pose(random);
    const ContactResult want = query->measure(more, X_WT);
    const std::vector<SurfaceBlend> with_empty{more[0], {}, more[1]};
    expect_same_bits(query->measure(with_empty, X_WT), want);
    const std::vector<SurfaceBlend> with_away{more[0], more[1], away};
    EXPECT_NEAR(query->measure(with_away, X_WT).penetration.volume, want.penetration.volume,
                1e-9 + 1e-4 * want.penetration.volume);
  }
}

TEST(DepthHull, BlackPixelsOfOneCameraCarveNothing) {
  // Both cameras look at a wall; in one of them a patch has no measurement.
  const HullScene whole = test::wall_scene(2, false), patched = test::wall_scene(2, true);
  for (const double size : {0.03, 0.012}) {
    const Tool tool = test::random_tool(300, size, 5);
    const auto query = make_query(tool, SphereVolumes::own);
    for (const double depth : {0.0, 0.01, 0.03, 0.1}) {
      const Pose X_WT{{0, 0, 0.8 + depth}, {}};
      const double want = query->measure(whole.views, X_WT).penetration.volume;
      EXPECT_NEAR(query->measure(patched.views, X_WT).penetration.volume, want, 0.02 * want);
      // The view with the patch, alone or twice, measures nothing there.
      for (const std::size_t num : {1u, 2u}) {
        const std::vector<SurfaceBlend> unmeasured(num, patched.views[1]);
        EXPECT_LT(query->measure(unmeasured, X_WT).penetration.volume, 0.1 * want) << num;
      }
    }
  }
}

// Deep in the unseen space behind a wall: pushed out, released at its back, or released.
TEST(DepthHull, WhatLiesInUnseenSpaceIsAsTheFieldsSay) {
  const Tool tool = test::random_tool(300, 0.03, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  const double whole = tool.sphere_mass().volume;
  for (const auto& [field, volume, force] :
       {std::tuple{DepthFieldOptions{}, 1.0, 1.0},
        {DepthFieldOptions{.unseen = UnseenSpace::free, .thickness = 0.03}, 0.0, 0.0},
        {DepthFieldOptions{.unseen = UnseenSpace::fade, .thickness = 0.03}, 1.0, 0.0}}) {
    HullScene scene;
    for (int k = 0; k < 2; ++k) {
      const Pose X_WC = test::look_at({0.2 * k, 0, 0}, {0, 0, 0.8});
      const auto wall = [](const Vec3d& p, const Vec3d& d) { return test::to_wall(p, d, 0.8); };
      test::add_view(scene, test::vga(), X_WC, test::depth_seen(wall, test::vga(), X_WC), field);
    }
    const Penetration deep = query->measure(scene.views, {{0, 0, 0.95}, {}}).penetration;
    EXPECT_NEAR(deep.volume, volume * whole, 1e-4 * whole);
    EXPECT_NEAR(-deep.measure_W.force.z, force * whole, 0.02 * whole);
    EXPECT_NEAR(deep.unseen_volume, whole, 1e-4 * whole);
    const Penetration near = query->measure(scene.views, {{0, 0, 0.8}, {}}).penetration;
    EXPECT_NEAR(-near.measure_W.force.z, 0.5 * whole, 0.1 * whole);
  }
}

// Space beyond each border of an image is unseen; space in front of a measured wall is not.
TEST(DepthHull, BeyondTheBordersOfAnImageSpaceIsUnseen) {
  HullScene scene;
  const auto wall = [](const Vec3d& p, const Vec3d& d) { return test::to_wall(p, d, 0.8); };
  for (int k = 0; k < 2; ++k) {
    test::add_view(scene, test::vga(), {}, test::depth_seen(wall, test::vga(), {}));
  }
  // A tool so small that at the middle of each border all else around it has been measured.
  const Tool tool = test::random_tool(300, 0.012, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  const double whole = tool.sphere_mass().volume, x = 0.8 * 320 / 525, y = 0.8 * 240 / 525;
  EXPECT_LT(query->measure(scene.views, {{0, 0, 0.78}, {}}).penetration.unseen_volume, 0.9 * whole);
  for (const Vec3d& border : {Vec3d{-x, 0, 0}, {x, 0, 0}, {0, -y, 0}, {0, y, 0}}) {
    const Pose X_WT{border + Vec3d{0, 0, 0.75}, {}};
    const double unseen = query->measure(scene.views, X_WT).penetration.unseen_volume;
    const Penetration want = test::hull_truth(tool, scene.views, X_WT, SphereVolumes::own);
    EXPECT_GT(unseen, 0.2 * whole) << border.x << " " << border.y;
    EXPECT_NEAR(unseen, want.unseen_volume, 0.02 * whole) << border.x << " " << border.y;
  }
}

TEST(DepthHull, NothingIsWhereNoCameraLooks) {
  const HullScene scene = test::wall_scene(2, false);
  const Tool tool = test::random_tool(100, 0.03, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  for (const Vec3d& p : {Vec3d{3, 0, 0.8}, {0, -3, 2}, {0, 0, -1}, {0, 0, -0.2}}) {
    const Penetration at = query->measure(scene.views, {p, {}}).penetration;
    EXPECT_EQ(at.volume, 0);
    EXPECT_EQ(norm(at.measure_W.force), 0);
    EXPECT_NEAR(at.unseen_volume, tool.sphere_mass().volume, 1e-9);
  }
}

// Cameras that look elsewhere are left out: with them all is as without, to the last bit.
TEST(DepthHull, CamerasThatLookElsewhereChangeNothing) {
  Random random(18);
  for (const UnknownSpace unknown : {UnknownSpace::free, UnknownSpace::solid}) {
    const HullScene scene = test::rough_scene(2, {.unknown = unknown}, random);
    HullScene away = test::rough_scene(5, {.unknown = unknown}, random);
    // The tool is beside the image of three, and behind two.
    const Pose places[] = {{{6, 0, -1}, {}},
                           {{-7, 1, -1}, axis_angle({0, 0, 1}, 0.3)},
                           {{0.2, -6.5, -0.8}, {}},
                           {{0, 0, 4}, {}},
                           {{-3, 0, 1}, axis_angle({0, 1, 0}, -1.6)}};
    for (std::size_t k = 0; k < away.views.size(); ++k) {
      away.views[k].to.X_WC = away.views[k].from.X_WC = places[k];
    }
    std::vector<SurfaceBlend> all = scene.views;
    all.insert(all.end(), away.views.begin(), away.views.end());
    const std::vector<SurfaceBlend> backwards(all.rbegin(), all.rend());
    const Tool tool = test::random_tool(300, 0.05, 3);
    const double scale = tool.sphere_mass().volume;
    const auto query = make_query(tool, SphereVolumes::own);
    int num_with_force = 0;
    for (int i = 0; i < 40; ++i) {
      const Pose X_WT{
          {random.uniform(-0.15, 0.15), random.uniform(-0.1, 0.1), random.uniform(0.9, 1.3)},
          random.rotation(3.0)};
      const ContactWants wants{.stiffness = i % 2 == 0};
      const ContactResult without = query->measure(scene.views, X_WT, wants);
      num_with_force += without.penetration.volume > 0.01 * scale;
      const ContactResult got = query->measure(all, X_WT, wants);
      // With unknown space not free, surfaces go on beyond the image and count.
      if (unknown == UnknownSpace::free) expect_same_bits(got, without);
      const Penetration want = test::hull_truth(tool, backwards, X_WT, SphereVolumes::own);
      const Penetration last = query->measure(backwards, X_WT).penetration;
      EXPECT_NEAR(last.volume, want.volume, 3e-5 * scale);
      EXPECT_NEAR(norm(last.measure_W.force - want.measure_W.force), 0, 2e-4 * scale);
      EXPECT_NEAR(last.unseen_volume, want.unseen_volume, 0.02 * scale);
    }
    EXPECT_GT(num_with_force, 5);
  }
}

/// True if the point's own pixel sees it, in double.
bool is_seen_by(const SurfaceView& surface, const Vec3d& p_C) {
  const DepthFieldView& field = surface.field;
  const Intrinsics& k = field.intrinsics;
  const double u = std::floor(k.fx * p_C.x / p_C.z + k.cx + 0.5);
  const double v = std::floor(k.fy * p_C.y / p_C.z + k.cy + 0.5);
  const DepthFieldLevel& level = field.levels[0];
  if (!(p_C.z > 0.02 && u >= 0 && v >= 0 && u < level.width && v < level.height)) return false;
  const auto column = static_cast<int>(u), row = static_cast<int>(v);
  if (field.filled_behind[row * field.filled_stride + column / 32] >> column % 32 & 1) return false;
  const auto at =
      2 * (static_cast<std::ptrdiff_t>(v) * level.stride + static_cast<std::ptrdiff_t>(u));
  const double offset = level.planes[at], slope = level.planes[at + 1];
  return slope > 0 && offset - p_C.z * slope >= -kSeenBehind;
}

// A single camera measures the unseen volume, too, on request.
TEST(DepthHull, OneCameraSaysWhatItDoesNotSee) {
  Random random(19);
  const Tool tool = test::random_tool(400, 0.06, 3);
  const double scale = tool.mesh_mass().volume;
  const FieldElements elements(tool, SphereVolumes::represented);
  for (const UnseenSpace unseen : {UnseenSpace::solid, UnseenSpace::free}) {
    HullScene scene = test::rough_scene(1, {.unseen = unseen}, random);
    SurfaceBlend& view = scene.views[0];
    test::set_apart(view.from, view.to);
    int num_parts = 0;
    for (int i = 0; i < 40; ++i) {
      Pose X_WT = random_pose(random);
      if (i % 8 == 0) X_WT.translation.z = -0.5;
      if (i % 8 == 1) X_WT.translation.x = 0.6 * X_WT.translation.z;  // the image's border
      const Pose X_CT = inverse(view.to.X_WC) * X_WT;
      const Vec3d C_T = tool.sphere_mass().center_of_mass;
      double want = 0;
      for (std::size_t e = 0; e < elements.factor.size(); ++e) {
        const SphereClusters& c = elements.clusters;
        if (c.sphere_id[e] < 0) continue;
        const Vec3d p_C = X_CT * (C_T + Vec3d{double{c.x[e]}, double{c.y[e]}, double{c.z[e]}});
        if (!is_seen_by(view.to, p_C)) {
          want += double{elements.factor[e]} * sphere_volume(double{elements.radius[e]});
        }
      }
      num_parts += want > 0.05 * scale && want < 0.95 * scale;
      std::vector<std::uint8_t> marks(tool.spheres().size(), 7);
      std::vector<std::int8_t> deciders(marks.size());
      for (const Isa isa : isas()) {
        const auto query = make_query(tool, SphereVolumes::represented, isa);
        const Penetration plain = query->measure(scene.views, X_WT).penetration;
        const Penetration at =
            query->measure(scene.views, X_WT, {.unseen_volume = true}).penetration;
        EXPECT_NEAR(at.unseen_volume, want, 0.01 * scale);
        EXPECT_EQ(plain.unseen_volume, 0);
        EXPECT_EQ(at.volume, plain.volume);
        query->measure(scene.views, X_WT, {.deciders = deciders, .unseen = marks});
      }
      int num_wrong = 0;
      for (std::size_t s = 0; s < marks.size(); ++s) {
        EXPECT_EQ(deciders[s], 0);
        num_wrong +=
            marks[s] != !is_seen_by(view.to, X_CT * to_double(tool.represented_balls()[s].center));
      }
      EXPECT_LE(num_wrong, 2);
    }
    EXPECT_GT(num_parts, 4);
  }
}

TEST(DepthHull, SpheresInUnseenSpaceAreMarked) {
  Random random(20);
  const HullScene scene = test::rough_scene(3, {}, random);
  const Tool tool = test::random_tool(200, 0.06, 3);
  const auto query = make_query(tool, SphereVolumes::own);
  int num_marked = 0;
  for (int i = 0; i < 30; ++i) {
    const Pose X_WT = random_pose(random);
    std::vector<std::uint8_t> marks(200, 7);
    query->measure(scene.views, X_WT, {.unseen = marks});
    int num_wrong = 0;
    for (std::size_t s = 0; s < marks.size(); ++s) {
      const Sphere& sphere = tool.spheres()[s];
      const auto truth = test::hull_of(scene.views, X_WT * to_double(sphere.center),
                                       static_cast<double>(sphere.radius));
      num_wrong += marks[s] != (truth.seen_phi < -kSeenBehind);
      num_marked += marks[s] == 1;
    }
    EXPECT_LE(num_wrong, 1);
  }
  EXPECT_GT(num_marked, 300);
}

TEST(DepthHull, RefusesWhatItCannotMeasure) {
  Random random(17);
  const HullScene scene = test::rough_scene(2, {}, random);
  const Tool tool = test::random_tool(50, 0.03, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  const Pose X_WT{{0, 0, 0.9}, {}};
  const auto status = [&](std::vector<SurfaceBlend> views, const Pose& pose) {
    std::vector<SphereState> states(50, SphereState::inside);
    const ContactResult got = query->measure(views, pose, {.stiffness = true, .states = states});
    EXPECT_EQ(got.penetration.volume, 0);
    EXPECT_EQ(states[7], SphereState::outside);
    EXPECT_TRUE(got.stiffness);
    return got.penetration.status;
  };
  std::vector<SurfaceBlend> views = scene.views;
  EXPECT_EQ(status({}, X_WT), StepStatus::no_surface);
  EXPECT_EQ(status({SurfaceBlend{}, SurfaceBlend{}}, X_WT), StepStatus::no_surface);
  EXPECT_EQ(status(std::vector<SurfaceBlend>(kMaxCameras + 1, views[0]), X_WT),
            StepStatus::no_surface);
  test::set_apart(views[1].to);
  EXPECT_EQ(status(views, X_WT), StepStatus::no_surface);
  views = scene.views;
  EXPECT_EQ(status(views, {{NAN, 0, 0}, {}}), StepStatus::non_finite_pose);
  views[1].to.X_WC.translation.x = INFINITY;
  EXPECT_EQ(status(views, X_WT), StepStatus::non_finite_pose);
  views = scene.views;
  for (auto* field : {&views[1].to.field, &views[1].to.seen_free}) {
    field->requested = {0, 0, 20, 20};
  }
  EXPECT_EQ(status(views, X_WT), StepStatus::outside_window);
}

TEST(DepthHull, BetweenTwoMomentsOfEachCameraItIsThatOfTheirFieldsBetween) {
  Random random(18);
  const HullScene first = test::rough_scene(3, {}, random),
                  second = test::rough_scene(3, {}, random);
  const Tool tool = test::random_tool(200, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  const double scale = tool.sphere_mass().volume;
  for (int i = 0; i < 30; ++i) {
    std::vector<SurfaceBlend> views = first.views;
    for (std::size_t k = 0; k < views.size(); ++k) {
      views[k] = {first.views[k].to, second.views[k].to, k == 0 ? 1.0 : random.uniform(0, 1)};
      if (i % 2 == 0) views[k].from.X_WC = views[k].to.X_WC;  // else it has moved
    }
    const Pose X_WT = random_pose(random);
    const Penetration got = query->measure(views, X_WT).penetration;
    const Penetration want = test::hull_truth(tool, views, X_WT, SphereVolumes::own);
    EXPECT_NEAR(got.volume, want.volume, 3e-5 * scale);
    EXPECT_NEAR(norm(got.measure_W.force - want.measure_W.force), 0, 2e-4 * scale);
    EXPECT_NEAR(got.potential, want.potential, 4e-6 * scale);
  }
}

TEST(DepthHull, DescribesItsSpheres) {
  Random random(19);
  const HullScene scene = test::rough_scene(2, {}, random);
  const Tool tool = test::random_tool(200, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  std::vector<SphereState> states(200);
  std::vector<Plane<float>> planes(200);
  for (int i = 0; i < 10; ++i) {
    const Pose X_WT = random_pose(random);
    query->measure(scene.views, X_WT, {.states = states, .planes = planes});
    for (std::size_t s = 0; s < states.size(); ++s) {
      const double r = tool.spheres()[s].radius;
      const Vec3d c_T = to_double(tool.spheres()[s].center);
      const test::HullSample at = test::hull_of(scene.views, X_WT * c_T, r).at;
      if (std::abs(std::abs(at.phi) - r) < 1e-5) continue;
      EXPECT_EQ(states[s], test::state_at(at.phi, r));
      if (at.phi >= r || norm(at.gradient) < 0.1) continue;
      const Vec3d n_T = to_double(planes[s].normal);
      EXPECT_NEAR(norm(rotate(X_WT.rotation, n_T) - normalized(at.gradient)), 0, 1e-2);
      EXPECT_NEAR(dot(n_T, c_T) - static_cast<double>(planes[s].offset), at.phi, 2e-5);
    }
  }
}

TEST(DepthHull, AllocatesNothing) {
  Random random(20);
  const HullScene scene = test::rough_scene(4, {}, random);
  const Tool tool = test::random_tool(500, 0.06, 5);
  const auto query = make_query(tool, SphereVolumes::own);
  const Pose X_WT{{0, 0, 0.9}, {}};
  const test::AllocationCounter counter;
  query->measure(scene.views, X_WT);
  query->measure(scene.views, X_WT, {.stiffness = true});
  EXPECT_EQ(counter.count(), 0);
}

// Share of a tool ball in contact behind, beside and in front of a ball of 60 mm in front of a
// wall: by exact rays, and measured.
TEST(DepthHull, FeelsWhatTheExactHullLeavesOver) {
  const Tool tool = test::ball_tool(0.03);
  const auto query = make_query(tool, SphereVolumes::represented);
  for (const int num_cameras : {1, 2, 3, 4}) {
    const HullScene scene = test::ball_before_wall(num_cameras);
    for (const auto& [from, to] : {std::pair{Vec3d{0, 0, 1.08}, Vec3d{0, 0, 1.25}},
                                   {Vec3d{0.05, 0, 1.18}, Vec3d{0.15, 0, 1.18}},
                                   {Vec3d{0, 0, 0.85}, Vec3d{0, 0, 0.95}}}) {
      double mean = 0, worst = 0;
      for (int i = 0; i <= 20; ++i) {
        const Vec3d p = from + (i / 20.0) * (to - from);
        const double felt =
            query->measure(scene.views, {p, {}}).penetration.volume / tool.mesh_mass().volume;
        const double error = felt - test::exact_hull_share(scene, p, 0.03);
        mean += error / 21;
        worst = std::max(worst, std::abs(error));
      }
      EXPECT_LT(std::abs(mean), num_cameras > 1 ? 0.005 : 0.015) << num_cameras << " cameras";
      EXPECT_LT(worst, 0.045) << num_cameras << " cameras";
    }
  }
}

}  // namespace
}  // namespace palpate
