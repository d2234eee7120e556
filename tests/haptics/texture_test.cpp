// Texture of a surface, and damping of its contact: against their formulas.
#include "palpate/haptics/coupling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/haptics/friction_touch.h"

namespace palpate {
namespace {

using namespace test;  // NOLINT: of friction_touch.h, all of it

/// Forces along the surface at constant speed, from the first whole second on.
std::vector<double> texture_force(TextureKind kind, double speed, int ticks = 5000) {
  CouplingOptions options = options_of(CouplingKind::none, 0.5);
  options.texture.kind = kind;
  Touch touch(options, {}, pressed(1e-3));
  std::vector<double> felt;
  for (int i = 0; i < ticks; ++i) {
    touch.to(pressed(1e-3, {speed * kTick * i, 0, 0}));
    if (i >= 1000) felt.push_back(-touch.along().x / norm(touch.normal.force));
  }
  return felt;
}

double spread(const std::vector<double>& values) {
  double sum = 0, squares = 0;
  for (const double v : values) {
    sum += v;
    squares += v * v;
  }
  const double mean = sum / static_cast<double>(values.size());
  return std::sqrt(std::max(squares / static_cast<double>(values.size()) - mean * mean, 0.0));
}

TEST(Texture, RidgesComeAsOftenAsTheyLie) {
  const double speed = 0.04;  // 20 ridges of 2 mm per second
  const std::vector<double> felt = texture_force(TextureKind::ridges, speed);
  int crossings = 0;
  for (std::size_t i = 1; i < felt.size(); ++i) crossings += felt[i - 1] < 0.5 && felt[i] >= 0.5;
  EXPECT_NEAR(crossings, 4 * 20, 1);
  // 0.3 of the friction up and down, as far as the speed lets it.
  EXPECT_NEAR(spread(felt), 0.5 * 0.3 * 0.04 / 0.045 / std::sqrt(2.0), 0.003);
}

TEST(Texture, GrainIsSixWavesOfOneHeight) {
  // 8 s at 0.016 m/s are 64 lengths of 2 mm, after which all waves begin anew.
  const std::vector<double> felt = texture_force(TextureKind::grain, 0.016, 9000);
  ASSERT_EQ(felt.size(), 8000u);
  const auto height_of = [&felt](double waves_per_length) {
    double re = 0, im = 0;
    for (std::size_t i = 0; i < felt.size(); ++i) {
      const double angle = 2 * kPi * waves_per_length * 8 * kTick * static_cast<double>(i);
      re += felt[i] * std::cos(angle);
      im += felt[i] * std::sin(angle);
    }
    return 2 * std::hypot(re, im) / static_cast<double>(felt.size());
  };
  // Height of each wave: a depth of 0.3 of the friction, as far as the speed lets it.
  const double each = 0.5 * 0.3 * 0.016 / 0.021 / 6;
  double power = 0;
  for (const double waves : {64, 107, 173, 281, 449, 727}) {
    const double height = height_of(waves / 64);
    EXPECT_NEAR(height, each, 0.05 * each) << waves;
    power += 0.5 * height * height;
  }
  // There is nothing else.
  EXPECT_NEAR(power, spread(felt) * spread(felt), 0.05 * power);
}

TEST(Texture, IsLeftOutWhereItWouldComeTooFastOrNothingMoves) {
  for (const TextureKind kind : {TextureKind::ridges, TextureKind::grain}) {
    EXPECT_GT(spread(texture_force(kind, 0.05)), 0.01);
    EXPECT_LT(spread(texture_force(kind, 0.0)), 1e-9);
    EXPECT_LT(spread(texture_force(kind, 0.8)), 1e-3);  // 400 ridges per second
  }
  EXPECT_LT(spread(texture_force(TextureKind::none, 0.05)), 1e-9);
}

TEST(ContactDamping, PushesMoreComingThanGoingAndNeverPulls) {
  for (const CouplingKind kind :
       {CouplingKind::virtual_coupling, CouplingKind::direct, CouplingKind::none}) {
    for (const double damping : {2.0, 20.0, 100.0}) {
      CouplingOptions options = options_of(kind, 0);
      options.friction.contact_damping = damping;
      Touch touch(options, {}, pressed(0));
      double coming = 0, going = 0, least = 1e9, given = 0;
      double last = 0;
      for (int i = 0; i < 2000; ++i) {
        const double depth = 1e-3 * (1 - std::cos(2 * kPi * i / 1000.0)) / 2;
        const Wrench& felt =
            kind == CouplingKind::none ? touch.step.contact_W : touch.step.desired_F_H_B;
        given += felt.force.z * -(depth - last);
        last = depth;
        touch.to(pressed(depth));
        const double force = touch.step.contact_W.force.z;
        least = std::min(least, force);
        if (i % 1000 == 250) coming += force;
        if (i % 1000 == 750) going += force;
      }
      EXPECT_GE(least, -1e-12) << static_cast<int>(kind) << " " << damping;
      EXPECT_LT(given, 0);
      if (kind != CouplingKind::virtual_coupling) {  // whose tool comes later than the hand
        EXPECT_GT(coming, going) << static_cast<int>(kind) << " " << damping;
        // N (1 + c v), unless the device's damping is the limit.
        const double v = kPi * 1e-3, n = 3000 * 0.5e-3;
        const double bound = kind == CouplingKind::direct ? kLimits.max_damping : 1e9;
        EXPECT_NEAR(coming / 2, n + std::min(damping * n, bound) * v, 0.02 * n);
      }
    }
  }
}

}  // namespace
}  // namespace palpate
