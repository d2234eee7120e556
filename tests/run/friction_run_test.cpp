// Friction of packed tools on a wall that a depth camera sees: against closed forms.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "src/run/internal/pipeline.h"
#include "tests/run/live_loop_fixtures.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr double kMu = 0.5, kWall = 0.5, kPressed = 3e-3;

Tool packed(TriangleMesh mesh, int num_spheres) {
  PackOptions options;
  options.max_spheres = num_spheres;
  SpherePacking packing = pack_spheres(mesh, options).value();
  return Tool::build(std::move(mesh), std::move(packing), GapRule::relative, "tool").value();
}

RunSettings settings_of(CouplingKind kind) {
  RunSettings settings = test::patient_settings();
  settings.coupling.X_WB = {};
  settings.coupling.kind = kind;
  settings.coupling.friction.coefficient = kMu;
  return settings;
}

/// A wall in front of the camera, square on or tilted, and a hand that moves the tool.
class Wall {
 public:
  Wall(const Tool& tool, const RunSettings& settings, const Vec3d& normal = {0, 0, -1},
       double noise = 0)
      : normal_(normal), noise_(noise) {
    info_.width = 320;
    info_.height = 240;
    info_.intrinsics = {300, 300, 159.5, 119.5};
    info_.unit = 1e-5;
    info_.rate = 30;
    DeviceInfo device;
    device.limits = test::ScriptedDevice({}).info().limits;
    pipeline_.emplace(Pipeline::create(tool, info_, device, settings).value());
  }
  /// With the wall where `shift` puts it along its normal.
  const TickRecord& to(const Pose& X_BH, double shift = 0) {
    const double time = 1e-3 * static_cast<double>(num_ticks_);
    for (; num_frames_ / 30.0 <= time; ++num_frames_)
      pipeline_->push(frame(shift), num_frames_ / 30.0);
    DeviceState state;
    state.time = time;
    state.X_BH = X_BH;
    if (num_ticks_ > 0) state.V_BH.linear = (X_BH.translation - last_.translation) / 1e-3;
    last_ = X_BH;
    state.is_valid = true;
    ++num_ticks_;
    return pipeline_->tick(state);
  }
  Pipeline& pipeline() { return *pipeline_; }

 private:
  DepthFrame frame(double shift) {
    DepthFrame frame{info_.width, info_.height, info_.unit, {}, num_frames_ / 30.0};
    const double offset = normal_.z * kWall + shift;  // n.p
    for (int v = 0; v < info_.height; ++v) {
      for (int u = 0; u < info_.width; ++u) {
        const Vec3d ray{(u - 159.5) / 300, (v - 119.5) / 300, 1};
        const double z = offset / dot(normal_, ray) + noise_ * random_.normal();
        frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(z / info_.unit)));
      }
    }
    return frame;
  }

  Vec3d normal_;
  double noise_;
  test::Random random_{5};
  DepthStreamInfo info_;
  std::optional<Pipeline> pipeline_;
  int num_frames_ = 0, num_ticks_ = 0;
  Pose last_;
};

/// What is along the wall and what is against it.
struct Split {
  double into;
  Vec3d along;
};
Split split(const Vec3d& force, const Vec3d& n) {
  return {dot(force, n), force - dot(force, n) * n};
}

TEST(FrictionRun, SlidesWithMuNOnWallsOfAnyTilt) {
  const Tool tool = packed(make_box({0.04, 0.04, 0.04}), 400);
  for (const Vec3d& tilt : {Vec3d{0, 0, -1}, Vec3d{0.25, -0.1, -1}}) {
    const Vec3d n = normalized(tilt);
    Vec3d way = normalized(cross(n, Vec3d{0, 1, 0}));
    for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling,
                                    CouplingKind::direct, CouplingKind::proxy}) {
      Wall wall(tool, settings_of(kind), n);
      // The box stands flat on the wall.
      const Vec3d axis = cross(Vec3d{0, 0, -1}, n);
      const Quaternion q = norm(axis) > 0 ? axis_angle(axis, std::asin(norm(axis))) : Quaternion{};
      const double press =
          kind == CouplingKind::virtual_coupling || kind == CouplingKind::proxy ? 5e-3 : kPressed;
      Split got{};
      double worst = 0;
      for (int i = 0; i < 900; ++i) {
        const Vec3d start =
            Vec3d{0, 0, kWall} + n * (0.022 - (0.002 + press) * std::min(1.0, i / 200.0));
        const Vec3d p = start + way * (0.03e-3 * std::max(0, i - 200));
        const TickRecord& tick = wall.to({p, q});
        if (i < 600) continue;
        got = split(tick.step.contact_W.force, n);
        worst = std::max(worst, norm(got.along + kMu * got.into * way) / (kMu * got.into));
      }
      EXPECT_GT(got.into, 0.5);
      EXPECT_LT(worst, 0.01) << static_cast<int>(kind) << " " << tilt.x;
    }
  }
}

/// mu N and the torque about the normal, of a tool that turns on the wall.
double torsion_radius(const Tool& tool, double reach) {
  Wall wall(tool, settings_of(CouplingKind::none));
  double sum = 0;
  for (int i = 0; i < 800; ++i) {
    const double z = kWall - reach - 0.002 + (0.002 + kPressed) * std::min(1.0, i / 200.0);
    const TickRecord& tick =
        wall.to({{0, 0, z}, axis_angle({0, 0, 1}, 2e-3 * std::max(0, i - 200))});
    const Wrench& F = tick.step.contact_W;
    if (i >= 600) sum += F.torque.z / (kMu * F.force.z) / 200;
  }
  return sum;
}

TEST(FrictionRun, TurnsWithTheTorqueOfADiscAndOfARectangle) {
  const double radius = 0.015;
  const Tool disc = packed(make_cylinder(radius, 0.03, 96), 2000);
  EXPECT_NEAR(torsion_radius(disc, 0.015), 2 * radius / 3, 0.05 * 2 * radius / 3);
  const double a = 0.02, b = 0.01, d = std::hypot(a, b);
  const Tool box = packed(make_box({2 * a, 2 * b, 0.03}), 2000);
  const double mean =
      (2 * d + b * b / a * std::log((a + d) / b) + a * a / b * std::log((b + d) / a)) / 6;
  EXPECT_NEAR(torsion_radius(box, 0.015), mean, 0.05 * mean);
}

// 95 % of what holds, for a minute, and nothing creeps.
TEST(FrictionRun, WhatSticksToASurfaceOfFramesDoesNotCreep) {
  const Tool tool = packed(make_box({0.04, 0.04, 0.04}), 200);
  Wall wall(tool, settings_of(CouplingKind::virtual_coupling));
  const auto hand = [](double aside) { return Pose{{aside, 0, kWall - 0.02 + 5e-3}, {}}; };
  for (int i = 0; i < 500; ++i)
    wall.to({{0, 0, kWall - 0.022 + 7e-3 * std::min(1.0, i / 300.0)}, {}});
  double aside = 0;
  const auto share = [&](const TickRecord& tick) {
    const Split got = split(tick.step.contact_W.force, {0, 0, -1});
    return norm(got.along) / (kMu * got.into);
  };
  while (share(wall.to(hand(aside))) < 0.95 && aside < 0.02) aside += 1e-6;
  TickRecord tick;
  for (int i = 0; i < 2000; ++i) tick = wall.to(hand(aside));
  EXPECT_NEAR(share(tick), 0.95, 0.005);
  const Pose held = tick.step.X_WT;
  for (int i = 0; i < 10'000; ++i) tick = wall.to(hand(aside));  // a minute of it: bench/friction
  EXPECT_LT(norm(tick.step.X_WT.translation - held.translation), 2e-7);
  EXPECT_LT(2 * norm(Vec3d{(tick.step.X_WT.rotation * conjugate(held.rotation)).x,
                           (tick.step.X_WT.rotation * conjugate(held.rotation)).y,
                           (tick.step.X_WT.rotation * conjugate(held.rotation)).z}),
            1e-5);
}

// The noise of a camera, 30 times a second: what holds half of what it could stays where it is.
TEST(FrictionRun, NoiseDoesNotMakeItSlip) {
  const Tool tool = packed(make_box({0.04, 0.04, 0.04}), 200);
  double ways[2];
  for (const bool has_friction : {false, true}) {
    RunSettings settings = settings_of(CouplingKind::virtual_coupling);
    if (!has_friction) settings.coupling.friction.coefficient = 0;
    Wall wall(tool, settings, {0, 0, -1}, 1e-3);
    Vec3d low{1, 1, 1}, high{-1, -1, -1};
    for (int i = 0; i < 4000; ++i) {
      // Without friction nothing holds the tool aside.
      const double aside = has_friction ? 1e-3 * std::clamp((i - 500) / 500.0, 0.0, 1.0) : 0;
      const TickRecord& tick =
          wall.to({{aside, 0, kWall - 0.022 + 7e-3 * std::min(1.0, i / 300.0)}, {}});
      if (i < 1500) continue;
      const Vec3d p = tick.step.X_WT * Vec3d{0, 0, 0.02};  // its foot: noise may rock it
      low = {std::min(low.x, p.x), std::min(low.y, p.y), 0};
      high = {std::max(high.x, p.x), std::max(high.y, p.y), 0};
    }
    ways[has_friction] = norm(high - low);
  }
  EXPECT_LT(ways[1], 5e-5);
}

TEST(FrictionRun, TicksDoNotAllocate) {
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling,
                                  CouplingKind::direct, CouplingKind::proxy}) {
    Wall wall(test::box_tool(), settings_of(kind));
    wall.to({{0, 0, kWall - 0.024}, {}});
    const test::AllocationCounter counter;
    for (int i = 0; i < 30; ++i) wall.to({{1e-4 * i, 0, kWall - 0.022}, {}});
    EXPECT_EQ(counter.count(), 0u);
    EXPECT_GT(norm(wall.pipeline().contact().contact.F_C_W.force), 0);
  }
}

// A change of settings under way keeps what sticks.
TEST(FrictionRun, StaysThroughAChangeOfSettings) {
  Wall wall(test::box_tool(), settings_of(CouplingKind::virtual_coupling));
  TickRecord tick;
  for (int i = 0; i < 1200; ++i) {
    tick = wall.to(
        {{2e-3 * std::min(1.0, i / 600.0), 0, kWall - 0.027 + 8e-3 * std::min(1.0, i / 300.0)},
         {}});
  }
  const double before = tick.step.contact_W.force.x;
  EXPECT_LT(before, -0.1);
  RunSettings other = settings_of(CouplingKind::virtual_coupling);
  other.coupling.friction.coefficient = 0.9;
  ASSERT_TRUE(wall.pipeline().change(other));
  for (int i = 0; i < 200; ++i) tick = wall.to({{2e-3, 0, kWall - 0.019}, {}});
  EXPECT_NEAR(tick.step.contact_W.force.x, before, 0.02 * std::abs(before));
}

}  // namespace
}  // namespace palpate
