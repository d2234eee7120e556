// Stored energy that couplings report, against the work that the hand does: for all couplings,
// with friction, walls and scales, and through the safety filter.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/haptics/friction_touch.h"
#include "tests/haptics/safety_rig.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using test::kCouplings;  // all couplings that give a force

/// A hand that goes to and fro over a plate, into it, and out of it; from where it is free.
struct Wander {
  Wander(test::Random& random, double motion_scale) : scale(motion_scale) {
    for (Vec3d* v : {&phase, &turn_phase}) *v = random.in_box(3);
    speed = random.uniform(4, 10);
  }
  Pose at(double time) const {
    const auto wave = [&](double frequency, double shift) {
      return std::sin(speed * frequency * time + shift) - std::sin(shift);
    };
    const double depth = 0.006 * (1 - std::cos(1.7 * speed * time));
    const Vec3d tool{0.02 * wave(1, phase.x), 0.01 * wave(1.3, phase.y), 0.0345 - depth};
    return {tool / scale, axis_angle({0, 0, 1}, 0.2 * wave(0.9, turn_phase.z)) *
                              axis_angle({1, 0, 0}, 0.05 * wave(0.7, turn_phase.x))};
  }
  Vec3d phase, turn_phase;
  double scale = 1, speed = 0;
};

/// J: the work of a hand on its coupling and what that has stored, together; without the ticks of a
/// loop, so that only what the coupling itself does is seen.
struct Books {
  double largest_rise = 0, largest_fall = 0, most_stored = 0;
};
Books keep_books(const CouplingOptions& options, test::Random& random) {
  constexpr double kStep = 1e-4;
  const Wander hand(random, options.motion_scale);
  const test::Plate plate;
  const auto coupling = make_coupling(options, test::kLimits, test::box_tool());
  coupling->reset(test::hand_at(hand.at(0)));
  CouplingStep last = coupling->step(test::hand_at(hand.at(0)), {}, kStep);
  double given = 0, least = last.stored, most = last.stored;
  Books books;
  for (int i = 1; i < 20'000; ++i) {
    const double time = i * kStep;
    DeviceState state = test::hand_at(hand.at(time));
    const Pose before = hand.at(time - kStep);
    const Vec3d way = state.X_BH.translation - before.translation;
    const Vec3d turn = rotation_between(before.rotation, state.X_BH.rotation);
    state.V_BH = {way / kStep, turn / kStep};
    const CouplingStep step = coupling->step(state, plate.contact(last.X_WT, time), kStep);
    given += dot(0.5 * (last.desired_F_H_B.force + step.desired_F_H_B.force), way) +
             dot(0.5 * (last.desired_F_H_B.torque + step.desired_F_H_B.torque), turn);
    const double sum = given + step.stored;
    books.largest_rise = std::max(books.largest_rise, sum - least);
    books.largest_fall = std::max(books.largest_fall, most - sum);
    books.most_stored = std::max(books.most_stored, step.stored);
    least = std::min(least, sum);
    most = std::max(most, sum);
    last = step;
  }
  return books;
}

CouplingOptions options_of(CouplingKind kind, double friction, double scale, bool has_walls) {
  CouplingOptions options;
  options.kind = kind;
  options.friction.coefficient = friction;
  options.motion_scale = scale;
  if (has_walls) {
    options.workspace_x = 0.01;
    options.X_WB.translation = {0.003, 0, 0};
  }
  const auto checked = check_coupling(options, test::kLimits, test::kTick, test::box_tool());
  EXPECT_TRUE(checked.has_value()) << checked.error().message;
  return checked->options;
}

// The stored energy of moving objects outlasts ticks in which the tool's own contact is not
// measured.
TEST(StoredEnergy, OfObjectsOutlivesAContactThatIsNotMeasured) {
  for (const CouplingKind kind : kCouplings) {
    const auto coupling =
        make_coupling(options_of(kind, 0.4, 1, false), test::kLimits, test::box_tool());
    const DeviceState hand = test::hand_at({{0, 0, 0.1}, {}});
    coupling->reset(hand);
    LocalContact contact = test::Plate{}.contact(hand.X_BH, 0);
    ASSERT_TRUE(contact.is_valid);
    for (const bool is_measured : {true, false, true}) {
      contact.time += 1e-3;
      contact.is_valid = is_measured;
      contact.energy = 0.3;
      EXPECT_GE(coupling->step(hand, contact, 1e-3).stored, 0.3) << is_measured;
    }
  }
}

// Whatever a hand gets back, it had put in before, and it was stored.
TEST(StoredEnergy, TheHandGetsBackNoMoreThanThat) {
  test::Random random(41);
  for (const CouplingKind kind : kCouplings) {
    for (const double friction : {0.0, 0.4}) {
      for (const double scale : {1.0, 2.0, 0.7}) {
        for (const bool has_walls : {false, true}) {
          const Books books = keep_books(options_of(kind, friction, scale, has_walls), random);
          const auto which = testing::Message() << name_of(kind) << ", friction " << friction
                                                << ", scale " << scale << ", walls " << has_walls;
          EXPECT_GT(books.most_stored, 5e-3) << which;
          EXPECT_LT(books.largest_rise, 0.01 * books.most_stored + 1e-5) << which;
          if (friction > 0) {
            EXPECT_GT(books.largest_fall, 0.01) << which;
          } else if (kind != CouplingKind::virtual_coupling) {  // which has a damper
            EXPECT_LT(books.largest_fall, 0.01 * books.most_stored + 1e-5) << which;
          }
        }
      }
    }
  }
}

// A hand that swings the tool through the air, and presses it by a centimeter: all of that is given
// back, nothing is held back, and the tank of 10 mJ is a fraction of it.
TEST(StoredEnergy, TheFilterHoldsNothingBackOfWhatTheHandHasPutIn) {
  for (const CouplingKind kind : kCouplings) {
    test::safety_rig::Rig rig({}, test::kLimits);
    test::Touch touch(options_of(kind, 0, 1, false), {}, test::pressed(-0.02));
    const auto to = [&](double depth, double aside) {
      touch.to(test::pressed(depth, {aside, 0, 0}));
      rig.input.state.X_BH = test::pressed(depth, {aside, 0, 0});
      rig.input.stored = touch.step.stored;
      return rig.tick(touch.step.desired_F_H_B);
    };
    for (int i = 0; i < 600; ++i) to(-0.02, 0);
    ASSERT_EQ(rig.filter.status().gain, 1);
    double most_stored = 0, least = 0;
    for (int i = 0; i < 6000; ++i) {
      const double t = i * test::kTick;
      const bool swings = i < 2000;  // then it presses, for 2 s each
      const double aside = swings ? 0.08 * (1 - std::cos(4 * kPi * t)) : 0;  // at up to 1 m/s
      const double way = kind == CouplingKind::direct ? 0.026 : 0.03;  // no more than the limit
      const double depth = -0.02 + (swings ? 0 : way) * std::pow(std::sin(kPi * t / 2), 2);
      const Wrench out = to(depth, aside);
      ASSERT_EQ(out.force, touch.step.desired_F_H_B.force) << name_of(kind) << ", tick " << i;
      ASSERT_EQ(rig.filter.status().damping, 0);
      most_stored = std::max(most_stored, rig.input.stored);
      least = std::min(least, rig.filter.status().energy);
    }
    EXPECT_GT(most_stored, 0.05) << name_of(kind);
    EXPECT_LT(least, -0.04) << name_of(kind);
  }
}

// A method without a potential: what a ball, a cube or a rod really stores, by the integral of the
// force on the way in, is less than what is said, and not much less.
TEST(StoredEnergy, WithoutAPotentialItIsMoreThanAnyCompactToolStores) {
  constexpr double kGain = 1e5;
  const auto expect = [&](double volume, double integral, double most) {
    Penetration penetration;
    penetration.volume = volume;
    penetration.measure_W.force = {0, 0, volume};
    const double said = stored_energy(penetration, {kGain});
    EXPECT_GE(said, kGain * integral);
    EXPECT_LE(said, most * kGain * integral);
    penetration.potential = integral;
    EXPECT_DOUBLE_EQ(stored_energy(penetration, {kGain}), kGain * integral);
  };
  const double r = 0.03, a = 0.04;
  for (const double share : {0.05, 0.2, 0.45}) {  // of the radius; the last: an eighth of the ball
    const double d = share * r;
    expect(kPi * d * d * (r - d / 3), kPi * d * d * d * (r / 3 - d / 12), 8);
  }
  for (const double share : {0.02, 0.125}) {  // of a cube, face first
    expect(a * a * share * a, a * a * share * a * share * a / 2, 20);
  }
  expect(a * a * 1.25 * a, a * a * 1.25 * a * 1.25 * a / 2, 1.1);  // an eighth of a rod, end first
  EXPECT_EQ(stored_energy({}, {kGain}), 0);
}

// Between two queries: the work of the way since the last one.
TEST(StoredEnergy, GoesOnBetweenTwoQueries) {
  const test::Plate plate;
  const LocalContact contact = plate.contact(test::pressed(0.002), 1);
  const CouplingOptions options = options_of(CouplingKind::direct, 0, 1, false);
  const auto coupling = make_coupling(options, test::kLimits, test::box_tool());
  coupling->reset(test::hand_at(test::pressed(0.002)));
  const auto stored_at = [&](double depth) {
    return coupling->step(test::hand_at(test::pressed(depth)), contact, test::kTick).stored;
  };
  for (const double depth : {0.002, 0.004, 0.001, 1e-6}) {
    EXPECT_NEAR(stored_at(depth), plate.k * depth * depth / 2, 1e-12) << depth;
  }
  EXPECT_EQ(stored_at(-0.001), 0);
}

}  // namespace
}  // namespace palpate
