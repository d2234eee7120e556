// Friction of what is touched: objects, regions and belts with their own.
#include "palpate/haptics/coupling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/haptics/friction_touch.h"

namespace palpate {
namespace {

using namespace test;  // NOLINT: of friction_touch.h, all of it

TEST(Friction, OfAnObjectIsItsOwn) {
  Touch touch(options_of(CouplingKind::none, 0), {}, pressed(1e-3));
  for (int i = 0; i < 500; ++i) {
    const Pose X = pressed(1e-3, {5e-5 * i, 0, 0});
    LocalContact contact = touch.plate.contact(X, i);
    contact.patch.share = 0.25;
    contact.patch.own_friction = 0.75 * 0.4;
    touch.step = touch.coupling->step(hand_at(X), contact, kTick);
  }
  const double n = dot(touch.step.contact_W.force, touch.plate.n_W);
  EXPECT_NEAR(-touch.along().x, 0.3 * n, 1e-3 * n);
}

/// The force along a belt that runs under a tool, over the force into it; `hand` and `belt` in m/s,
/// `viscous` in s/m.
double drag_on_belt(CouplingKind kind, double hand, double belt, double viscous = 0) {
  CouplingOptions options = options_of(kind, 0.4);
  options.friction.viscous = viscous;
  const Plate plate;
  auto coupling = make_coupling(options, kLimits, box_tool());
  coupling->reset(hand_at(pressed(-1e-3)));
  CouplingStep step;
  step.X_WT = pressed(-1e-3);
  for (int i = 0; i < 1500; ++i) {
    const Pose X = pressed(i < 100 ? -1e-3 : 1e-3, {hand * kTick * std::max(0, i - 300), 0, 0});
    if (kind == CouplingKind::none) step.X_WT = X;
    LocalContact contact = plate.contact(step.X_WT, kTick * i);
    contact.patch.ground.velocity_W = {i <= 300 ? 0 : belt, 0, 0};
    DeviceState state = hand_at(X);
    state.V_BH.linear.x = i < 300 ? 0 : hand;
    step = coupling->step(state, contact, kTick);
  }
  return step.contact_W.force.x / dot(step.contact_W.force, plate.n_W);
}

// Friction depends on the velocity of the tool relative to the surface that it touches.
TEST(Friction, ABeltTakesTheToolAlong) {
  for (const CouplingKind kind : kAll) {
    EXPECT_NEAR(drag_on_belt(kind, 0, 0.05), 0.4, 1e-3) << name_of(kind);
    EXPECT_NEAR(drag_on_belt(kind, 0.05, 0), -0.4, 1e-3) << name_of(kind);
    EXPECT_NEAR(drag_on_belt(kind, 0.05, 0.03), -0.4, 1e-3) << name_of(kind);
    EXPECT_NEAR(drag_on_belt(kind, 0.03, 0.05), 0.4, 1e-3) << name_of(kind);
    // It sticks, and what the start has stretched stays.
    EXPECT_LT(std::abs(drag_on_belt(kind, 0.05, 0.05)), 0.1) << name_of(kind);

    // Viscous friction depends on it, too.
    EXPECT_NEAR(drag_on_belt(kind, 0, 0.05, 2), 0.4 + 2 * 0.05, 2e-3) << name_of(kind);
    EXPECT_NEAR(drag_on_belt(kind, 0.05, 0.03, 2), -0.4 - 2 * 0.02, 2e-3) << name_of(kind);
    EXPECT_LT(std::abs(drag_on_belt(kind, 0.05, 0.05, 2)), 0.1) << name_of(kind);
  }
}

// Without any friction, too.
TEST(Friction, ARegionMayBeViscousAlone) {
  Touch touch(options_of(CouplingKind::none, 0), {}, pressed(1e-3));
  for (int i = 0; i < 500; ++i) {
    const Pose X = pressed(1e-3, {5e-5 * i, 0, 0});
    LocalContact contact = touch.plate.contact(X, i);
    contact.patch.ground.share = 1;
    contact.patch.ground.viscous = 2;
    touch.step = touch.coupling->step(hand_at(X), contact, kTick);
  }
  const double n = dot(touch.step.contact_W.force, touch.plate.n_W);
  EXPECT_NEAR(-touch.along().x, 2 * 0.05 * n, 1e-3 * n);
}

// Regions: sliding at once with their coefficient, sticking with theirs, the rest with the usual.
TEST(Friction, OfRegionsIsTheirs) {
  Touch touch(options_of(CouplingKind::none, 0.2), {}, pressed(1e-3));
  double most = 0;
  for (int i = 0; i < 500; ++i) {
    const Pose X = pressed(1e-3, {1e-5 * i, 0, 0});
    LocalContact contact = touch.plate.contact(X, i);
    contact.patch.share = 0.25;
    contact.patch.ground = {0.75, 0.75 * 0.4, 0.75 * 0.6, 0, 0, 0, {}, {}};
    touch.step = touch.coupling->step(hand_at(X), contact, kTick);
    most = std::max(most, -touch.along().x);
  }
  const double n = dot(touch.step.contact_W.force, touch.plate.n_W);
  EXPECT_NEAR(most, (0.25 * 0.2 + 0.75 * 0.6) * n, 0.02 * n);
  EXPECT_NEAR(-touch.along().x, (0.25 * 0.2 + 0.75 * 0.4) * n, 1e-3 * n);
}

}  // namespace
}  // namespace palpate
