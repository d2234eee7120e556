// Friction of packed tools on a wall that a depth camera sees: against closed forms.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "tests/run/ticked_pipeline.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr double kMu = 0.5, kWall = 0.5, kPressed = 3e-3;

/// A wall in front of the camera, square on or tilted, and a hand that moves the tool.
struct Wall : test::TickedPipeline {
  Wall(const Tool& tool, const RunSettings& settings, const Vec3d& normal = {0, 0, -1},
       double noise = 0)
      : TickedPipeline(
            tool, test::wall_stream(), settings,
            [=, random = test::Random(5)](int, double time) mutable {
              DepthFrame frame{320, 240, 1e-5, {}, time};
              for (int v = 0; v < 240; ++v) {
                for (int u = 0; u < 320; ++u) {
                  const Vec3d ray{(u - 159.5) / 300, (v - 119.5) / 300, 1};
                  const double z = normal.z * kWall / dot(normal, ray) + noise * random.normal();
                  frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(z / frame.unit)));
                }
              }
              return frame;
            }) {}
};

/// Parts of a force into the wall and along it.
struct Split {
  double into;
  Vec3d along;
};
Split split(const Vec3d& force, const Vec3d& n) {
  return {dot(force, n), force - dot(force, n) * n};
}

// A hand that has moved away with the clutch presses against nothing: a tool that it takes hold of
// in contact must not push it off at once.
TEST(ClutchRun, InContactTheForceComesBackWithTheRamp) {
  constexpr std::uint32_t kClutch = 2;
  const Tool tool = test::packed(make_box({0.04, 0.04, 0.04}), 400);
  for (const CouplingKind kind :
       {CouplingKind::virtual_coupling, CouplingKind::direct, CouplingKind::proxy}) {
    RunSettings settings = test::coupled_by(kind);
    settings.coupling.clutch_button = 2;
    Wall wall(tool, settings);
    Pose handle{{0, 0, kWall - 0.04}, {}};
    for (int i = 0; i < 100; ++i) wall.to(handle);
    for (int i = 0; i < 1500; ++i) {
      handle.translation.z = kWall - 0.02 + std::min(3e-3, -0.02 + 1e-4 * i);
      wall.to(handle);
    }
    const TickRecord pressed = wall.to(handle);
    ASSERT_TRUE(pressed.safety.is_engaged());
    const double force = norm(pressed.F_H_B.force);
    ASSERT_GT(force, 0.5);
    for (int i = 0; i < 300; ++i) {
      handle.translation.z -= 1e-4;
      const TickRecord& tick = wall.to(handle, kClutch);
      EXPECT_LE(norm(tick.F_H_B.force), force);
      EXPECT_TRUE(tick.safety.is_engaged());
      EXPECT_TRUE(i <= 100 || norm(tick.F_H_B.force) == 0);
    }
    double last = 0, largest_step = 0;
    for (int i = 0; i < 1000; ++i) {
      const double now = norm(wall.to(handle).F_H_B.force);
      largest_step = std::max(largest_step, now - last);
      last = now;
      EXPECT_LE(now, 1.05 * force * (i + 1) * test::kTickSeconds / settings.safety.ramp_seconds);
    }
    EXPECT_GT(last, 0.9 * force);
    EXPECT_LT(largest_step, 2 * force * test::kTickSeconds / settings.safety.ramp_seconds);
  }
}

TEST(FrictionRun, SlidesWithMuNOnWallsOfAnyTilt) {
  const Tool tool = test::packed(make_box({0.04, 0.04, 0.04}), 400);
  for (const Vec3d& tilt : {Vec3d{0, 0, -1}, Vec3d{0.25, -0.1, -1}}) {
    const Vec3d n = normalized(tilt);
    Vec3d way = normalized(cross(n, Vec3d{0, 1, 0}));
    for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling,
                                    CouplingKind::direct, CouplingKind::proxy}) {
      Wall wall(tool, test::coupled_by(kind, kMu), n);
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
  Wall wall(tool, test::coupled_by(CouplingKind::none, kMu));
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
  const Tool disc = test::packed(make_cylinder(radius, 0.03, 96), 2000);
  EXPECT_NEAR(torsion_radius(disc, 0.015), 2 * radius / 3, 0.05 * 2 * radius / 3);
  const double a = 0.02, b = 0.01, d = std::hypot(a, b);
  const Tool box = test::packed(make_box({2 * a, 2 * b, 0.03}), 2000);
  const double mean =
      (2 * d + b * b / a * std::log((a + d) / b) + a * a / b * std::log((b + d) / a)) / 6;
  EXPECT_NEAR(torsion_radius(box, 0.015), mean, 0.05 * mean);
}

// 95 % of what holds, for a minute, and nothing creeps.
TEST(FrictionRun, WhatSticksToASurfaceOfFramesDoesNotCreep) {
  const Tool tool = test::packed(make_box({0.04, 0.04, 0.04}), 200);
  Wall wall(tool, test::coupled_by(CouplingKind::virtual_coupling, kMu));
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

// Noise of a camera, 30 times a second: a contact at half of its friction limit stays in place.
TEST(FrictionRun, NoiseDoesNotMakeItSlip) {
  const Tool tool = test::packed(make_box({0.04, 0.04, 0.04}), 200);
  double ways[2];
  for (const bool has_friction : {false, true}) {
    RunSettings settings = test::coupled_by(CouplingKind::virtual_coupling, kMu);
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

/// Two blocks in front of the wall, left and right, whose faces are 45 mm before it.
RunSettings with_blocks(CouplingKind kind) {
  static const auto block =
      std::make_shared<const Tool>(test::packed(make_box({0.08, 0.08, 0.03}), 800));
  RunSettings settings = test::coupled_by(kind, kMu);
  settings.objects.resize(2, {block, {{-0.06, 0, kWall - 0.03}, {}}});
  settings.objects[0].name = "left";
  settings.objects[1].name = "right";
  settings.objects[1].X_WB.translation.x = 0.06;
  return settings;
}

// From the change on the block holds back mu N, by the new mu; the other block has not changed.
TEST(FrictionRun, OfOneObjectChangesWhileTheToolSlidesOverIt) {
  const Tool tool = test::packed(make_box({0.02, 0.02, 0.02}), 200);
  const std::optional<double> own[] = {std::nullopt, 0.2, std::nullopt, 0.0};
  for (const auto& [kind, is_left] : {std::pair(CouplingKind::none, true),
                                      {CouplingKind::none, false},
                                      {CouplingKind::virtual_coupling, true},
                                      {CouplingKind::virtual_coupling, false}}) {
    const RunSettings settings = with_blocks(kind);
    Wall changed(tool, settings), same(tool, settings);
    const double press = kind == CouplingKind::none ? 2e-3 : 5e-3;
    double into = 0, worst = 0;
    for (int i = 0; i < 2200; ++i) {
      const std::optional<double> friction = own[std::max(0, i - 200) / 500];
      if (i > 200 && (i - 200) % 500 == 0) {
        RunSettings now = settings;
        now.objects[0].friction = friction;
        ASSERT_TRUE(changed.pipeline().change(now));
      }
      const Pose X_BH{{is_left ? -0.06 : 0.06, -0.02 + 2e-5 * std::max(0, i - 200),
                       kWall - 0.055 + press * std::min(1.0, i / 200.0)},
                      {}};
      const Wrench felt = changed.to(X_BH).step.contact_W, before = same.to(X_BH).step.contact_W;
      if (!is_left) {
        ASSERT_EQ(felt.force, before.force) << i;
        ASSERT_EQ(felt.torque, before.torque) << i;
      }
      if (i < 500 || (i - 200) % 500 < 300) continue;
      const Split got = split(felt.force, {0, 0, -1});
      const double mu = is_left ? friction.value_or(kMu) : kMu;
      into = got.into;
      worst = std::max(worst, norm(got.along + mu * into * Vec3d{0, 1, 0}) / (kMu * into));
    }
    EXPECT_GT(into, 0.5) << name_of(kind) << " " << is_left;
    EXPECT_LT(worst, 0.01) << name_of(kind) << " " << is_left;
  }
}

TEST(FrictionRun, AnObjectHasItsOwnStaticAndViscousFriction) {
  const Tool tool = test::packed(make_box({0.02, 0.02, 0.02}), 200);
  constexpr double kRatio = 1.6, kViscous = 2.5;
  RunSettings settings = with_blocks(CouplingKind::none);
  settings.objects[0].static_ratio = kRatio;
  settings.objects[0].viscous = kViscous;
  for (const bool is_left : {true, false}) {
    for (const double speed : {0.01, 0.03}) {  // m/s
      Wall wall(tool, settings);
      Split got{};
      double largest = 0;
      for (int i = 0; i < 1200; ++i) {
        const Pose X_BH{{is_left ? -0.06 : 0.06, -0.015 + 1e-3 * speed * std::max(0, i - 200),
                         kWall - 0.055 + 2e-3 * std::min(1.0, i / 200.0)},
                        {}};
        got = split(wall.to(X_BH).step.contact_W.force, {0, 0, -1});
        if (i > 200) largest = std::max(largest, norm(got.along) / got.into);
      }
      EXPECT_GT(got.into, 0.5);
      const double viscous = is_left ? kViscous * speed : 0;
      EXPECT_NEAR(norm(got.along) / got.into, kMu + viscous, 0.01 * kMu) << is_left << " " << speed;
      const double held = kMu * (is_left ? kRatio : 1);
      EXPECT_GT(largest, 0.98 * held) << is_left << " " << speed;
      EXPECT_LT(largest, 1.02 * held + viscous) << is_left << " " << speed;
    }
  }
}

TEST(FrictionRun, ObjectsHaveNamesOfTheirOwnAndStayWhatTheyAre) {
  Wall wall(test::box_tool(), with_blocks(CouplingKind::none));
  const auto refusal = [&](const auto& edit, bool at_start) {
    RunSettings settings = with_blocks(CouplingKind::none);
    edit(settings.objects);
    if (!at_start) {
      const Status status = wall.pipeline().change(settings);
      return status ? std::string() : status.error().message;
    }
    const auto made =
        Pipeline::create(test::box_tool(), test::wall_stream(), DeviceInfo{}, settings);
    return made ? std::string() : made.error().message;
  };
  using Objects = std::vector<SceneObject>;
  for (const bool at_start : {true, false}) {
    EXPECT_EQ(refusal([](Objects& o) { o[1].friction = 0.3; }, at_start), "");
    EXPECT_EQ(refusal([](Objects& o) { o[1].friction = 11; }, at_start),
              "objects.right.friction must be a number from 0 to 10 or auto, not 11");
    EXPECT_EQ(refusal([](Objects& o) { o[1].static_ratio = 0.5; }, at_start),
              "objects.right.static_ratio must be a number from 1 to 10 or auto, not 0.5");
  }
  EXPECT_EQ(refusal([](Objects& o) { o[1].name = "left"; }, true),
            "two objects are called 'left'; give each a name of its own");
  EXPECT_EQ(refusal([](Objects& o) { o[1].name = "a block"; }, true),
            "the name of an object must be up to 64 letters, digits and _, not 'a block'");
  EXPECT_EQ(refusal([](Objects& o) { o[0].name = o[1].name = ""; }, true), "");
  for (const auto edit :
       {+[](Objects& o) { o.pop_back(); }, +[](Objects& o) { o[0].name = "up"; },
        +[](Objects& o) { o[0].X_WB.translation.x = 0; }, +[](Objects& o) { o[0].moves = true; }}) {
    EXPECT_EQ(refusal(edit, false),
              "objects stay what they are while the loop runs, but for their friction; end it and "
              "start again");
  }
}

// A stage of a live run takes a change of friction.
TEST(FrictionRun, AnotherFrictionIsTakenWithoutAllocation) {
  RunSettings settings = with_blocks(CouplingKind::none);
  settings.objects[1].moves = true;
  ContactScale scale;
  scale.object_frictions = {{0.2}, {0.4, 1.5, 0.1}};
  const auto part = make_contact_part(ToolIndex::create(test::box_tool()), settings, {});
  ASSERT_TRUE(part) << part.error().message;
  const test::AllocationCounter counter;
  (*part)->use(scale);
  EXPECT_EQ(counter.count(), 0u);
}

TEST(FrictionRun, TicksDoNotAllocate) {
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling,
                                  CouplingKind::direct, CouplingKind::proxy}) {
    const RunSettings settings = with_blocks(kind);
    Wall wall(test::box_tool(), settings);
    wall.to({{0, 0, kWall - 0.024}, {}});
    RunSettings other = settings;
    other.objects[0].friction = 0.2;
    other.objects[1].viscous = 0.1;
    ASSERT_TRUE(wall.pipeline().change(other));
    const test::AllocationCounter counter;
    for (int i = 0; i < 30; ++i) wall.to({{1e-4 * i, 0, kWall - 0.022}, {}});
    EXPECT_EQ(counter.count(), 0u);
    EXPECT_GT(norm(wall.pipeline().contact().contact.F_C_W.force), 0);
    EXPECT_GT(wall.pipeline().contact().contact.patch.own_friction, 0) << name_of(kind);
  }
}

// A change of settings under way keeps what sticks.
TEST(FrictionRun, StaysThroughAChangeOfSettings) {
  Wall wall(test::box_tool(), test::coupled_by(CouplingKind::virtual_coupling, kMu));
  TickRecord tick;
  for (int i = 0; i < 1200; ++i) {
    tick = wall.to(
        {{2e-3 * std::min(1.0, i / 600.0), 0, kWall - 0.027 + 8e-3 * std::min(1.0, i / 300.0)},
         {}});
  }
  const double before = tick.step.contact_W.force.x;
  EXPECT_LT(before, -0.1);
  RunSettings other = test::coupled_by(CouplingKind::virtual_coupling, kMu);
  other.coupling.friction.coefficient = 0.9;
  ASSERT_TRUE(wall.pipeline().change(other));
  for (int i = 0; i < 200; ++i) tick = wall.to({{2e-3, 0, kWall - 0.019}, {}});
  EXPECT_NEAR(tick.step.contact_W.force.x, before, 0.02 * std::abs(before));
}

}  // namespace
}  // namespace palpate
