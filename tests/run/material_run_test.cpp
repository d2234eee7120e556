// Materials by region of the image, and friction on bodies that move: against closed forms.
#include <gtest/gtest.h>

#include <cmath>

#include "src/run/region_lookup.h"
#include "tests/run/ticked_pipeline.h"

namespace palpate {
namespace {

constexpr double kWall = 0.5, kRadius = 0.015;
constexpr Material kWood{0.6}, kIce{0.1};

/// Wood where x < 0, ice where x > 0.
std::shared_ptr<const MaterialRegions> halves() {
  MaterialRegions regions{320, 240, {}, {{}, kWood, kIce}};
  for (int i = 0; i < 320 * 240; ++i) {
    regions.labels.push_back(i % 320 < 160 ? 1 : 2);
  }
  return std::make_shared<const MaterialRegions>(regions);
}

/// Computes the share of an even disc where x > 0.
double share_beyond(double middle, double radius) {
  const double d = std::clamp(middle / radius, -1.0, 1.0);
  return 0.5 + (d * std::sqrt(1 - d * d) + std::asin(d)) / kPi;
}

TEST(Regions, SharesAreThoseOfADiscAcrossABorder) {
  const std::vector streams{test::wall_stream()};
  const std::vector regions{halves()};
  const auto lookups = region_lookups(regions, streams);
  ASSERT_TRUE(lookups) << lookups.error().message;
  const SurfaceBlend camera;
  double last = 0, worst = 0, steepest = 0;
  for (int i = -250; i <= 250; ++i) {
    const double x = 1e-4 * i;
    const Ground ground =
        ground_at(*lookups, {&camera, 1}, {{x, 0.01, kWall}, {0, 0, -2}, 2 * kRadius / 3});
    EXPECT_NEAR(ground.share, 1, 1e-12);
    const double ice = (kWood.friction - ground.friction) / (kWood.friction - kIce.friction);
    worst = std::max(worst, std::abs(ice - share_beyond(x, kRadius)));
    if (i > -250) steepest = std::max(steepest, std::abs(ice - last));
    last = ice;
  }
  EXPECT_LT(worst, 0.015);
  // 0.1 mm is 2 / (pi R) of a disc at most, 0.4 %.
  EXPECT_LT(steepest, 0.01);
  // Beyond the image no material is known, and on its border that of half the disc.
  const double edge = -159.5 / 300 * kWall;
  EXPECT_EQ(ground_at(*lookups, {&camera, 1}, {{2 * edge, 0, kWall}, {0, 0, -1}, 0.01}).share, 0);
  EXPECT_NEAR(ground_at(*lookups, {&camera, 1}, {{edge, 0, kWall}, {0, 0, -1}, 0.01}).share, 0.5,
              0.05);
}

TEST(Regions, OfSeveralCamerasMeanTheirMean) {
  MaterialRegions other{320, 240, std::vector<std::uint8_t>(320 * 240, 1), {{}, Material{0.3}}};
  const std::vector streams(2, test::wall_stream());
  std::vector regions{halves(), std::make_shared<const MaterialRegions>(other)};
  const std::vector<SurfaceBlend> cameras(2);
  const TouchedDisc disc{{-0.05, 0, kWall}, {0, 0, -1}, 0.005};
  EXPECT_NEAR(ground_at(*region_lookups(regions, streams), cameras, disc).friction, 0.45, 1e-12);
  regions[0] = nullptr;
  EXPECT_NEAR(ground_at(*region_lookups(regions, streams), cameras, disc).friction, 0.3, 1e-12);
}

TEST(Regions, WhatCannotBeIsRefused) {
  std::vector streams{test::wall_stream()};
  const std::vector regions{halves()};
  streams[0].is_moving = true;
  EXPECT_FALSE(region_lookups(regions, streams));
  streams[0].is_moving = false;
  const std::vector two{halves(), halves()};
  EXPECT_FALSE(region_lookups(two, streams));
  MaterialRegions bad = *halves();
  bad.materials[1]->friction = -1;
  const std::vector wrong{std::make_shared<const MaterialRegions>(bad)};
  EXPECT_FALSE(region_lookups(wrong, streams));
}

/// A wall, or a floor that things lie on, and a hand that moves the tool.
struct World : test::TickedPipeline {
  World(const Tool& tool, const RunSettings& settings)
      : TickedPipeline(tool, test::wall_stream(), settings, [](int, double time) {
          const auto count = static_cast<std::uint16_t>(std::lround(kWall / 1e-5));
          return DepthFrame{320, 240, 1e-5, std::vector<std::uint16_t>(320 * 240, count), time};
        }) {}
};

// From wood onto ice: the force changes within the width of the tool, and never jumps.
TEST(Regions, AToolSlidesFromWoodOntoIce) {
  const Tool disc = test::packed(make_cylinder(kRadius, 0.03, 96), 2000);
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling}) {
    RunSettings settings = test::coupled_by(kind);
    settings.regions = {halves()};
    World world(disc, settings);
    double worst = 0, last = 0, jump = 0;
    const double press = kind == CouplingKind::none ? 2e-3 : 5e-3;
    for (int i = 0; i < 2800; ++i) {
      const double z = kWall - 0.017 + (0.002 + press) * std::min(1.0, i / 200.0);
      const double x = -0.03 + 2.5e-5 * std::max(0, i - 300);
      const TickRecord& tick = world.to({{x, 0, z}, {}});
      if (i < 500) continue;
      const Vec3d& f = tick.step.contact_W.force;
      const double at = tick.step.X_WT.translation.x,
                   mu = kWood.friction +
                        (kIce.friction - kWood.friction) * share_beyond(at, kRadius);
      const double felt = f.x / f.z;  // against the way; the wall pushes towards the camera
      worst = std::max(worst, std::abs(felt - mu));
      if (i > 500) jump = std::max(jump, std::abs(felt - last));
      last = felt;
    }
    EXPECT_LT(worst, 0.015) << name_of(kind);
    EXPECT_LT(jump, 0.004) << name_of(kind);
    EXPECT_NEAR(last, kIce.friction, 1e-3) << name_of(kind);
  }
}

// A block on the floor that the tool presses on and takes along: the hand pulls with what the floor
// takes, which is less than what the tool could hold.
TEST(FrictionOnBodies, IsWhatTheBodyFeels) {
  const Tool tool = test::packed(make_box({0.02, 0.02, 0.04}), 300);
  const auto block = std::make_shared<const Tool>(test::packed(make_box({0.08, 0.08, 0.03}), 800));
  const double floor = 0.3, grip = 0.9, mass = 0.05;
  RunSettings settings = test::coupled_by(CouplingKind::virtual_coupling);
  settings.coupling.friction.coefficient = grip;
  settings.objects = {{block, {{0, 0, kWall - 0.015}, {}}, {}, true, mass}};
  settings.bodies.gravity_y = 0;
  settings.bodies.gravity_z = 9.81;
  settings.bodies.friction = floor;
  settings.bodies.damping = 0;
  World world(tool, settings);
  double pull = 0, press = 0;
  Pose begin, end;
  const int num = 3000, last = 500;
  for (int i = 0; i < num; ++i) {
    const double top = kWall - 0.03 - 0.02;
    const double z = top - 0.002 + 0.005 * std::clamp((i - 200) / 300.0, 0.0, 1.0);
    const double x = 2e-5 * std::max(0, i - 700);  // 2 cm/s
    const TickRecord& tick = world.to({{x, 0, z}, {}});
    if (i < num - last) begin = world.pipeline().contact().bodies.of[0];
    if (i < num - last) continue;
    pull -= tick.step.contact_W.force.x / last;
    press -= tick.step.contact_W.force.z / last;
    end = world.pipeline().contact().bodies.of[0];
  }
  EXPECT_NEAR(end.translation.x - begin.translation.x, 2e-5 * last, 0.1 * 2e-5 * last);
  EXPECT_GT(press, 0.5);
  EXPECT_NEAR(pull, floor * (press + mass * 9.81), 0.05 * floor * (press + mass * 9.81));
  EXPECT_LT(pull, 0.8 * grip * press);
}

}  // namespace
}  // namespace palpate
