// Friction of a contact patch: against Coulomb's law, over random paths, normals and noise, with
// all couplings.
#include "palpate/haptics/coupling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <vector>

#include "src/haptics/internal/friction.h"
#include "tests/haptics/friction_touch.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using namespace test;  // NOLINT: of friction_touch.h, all of it

double largest(const std::vector<double>& values) {
  return *std::max_element(values.begin(), values.end());
}

// ------------------------------------------------------------------------------ Coulomb's law

TEST(Friction, SlidesAgainstTheMotionWithMuN) {
  for (const CouplingKind kind : kAll) {
    for (const double mu : {0.1, 0.4, 1.2}) {
      for (const Vec3d& way : {Vec3d{1, 0, 0}, Vec3d{-0.6, 0.8, 0}}) {
        Touch touch(options_of(kind, mu), {}, pressed(-1e-3));
        for (int i = 0; i < 200; ++i) touch.to(pressed(1e-3 * std::min(1.0, i / 100.0)));
        double last = 0;
        for (int i = 0; i < 1500; ++i) {
          const double speed = i < 500 ? 0.05 : 0.1;
          last += speed * kTick;
          touch.to(pressed(1e-3, last * way));
          if (i < 400) continue;
          const double n = dot(touch.step.contact_W.force, touch.plate.n_W);
          ASSERT_GT(n, 0.5);
          ASSERT_LT(norm(touch.along() + mu * n * way), 1e-3 * mu * n)
              << static_cast<int>(kind) << " " << mu << " " << i;
        }
        // At the handle, too: the hand pulls with what friction takes, unless nothing is felt.
        const bool is_felt = kind != CouplingKind::none;
        const double pull = -dot(touch.step.desired_F_H_B.force, way);
        const double n = dot(touch.step.contact_W.force, touch.plate.n_W);
        EXPECT_NEAR(pull, is_felt ? mu * n : 0, 0.01 * mu * n) << static_cast<int>(kind);
      }
    }
  }
}

TEST(Friction, GrowsWithSpeedIfItIsViscous) {
  for (const CouplingKind kind : kAll) {
    CouplingOptions options = options_of(kind, 0.3);
    options.friction.viscous = 4;
    Touch touch(options, {}, pressed(1e-3));
    double way = 0;
    for (int i = 0; i < 2000; ++i) {
      const double speed = i < 1000 ? 0.02 : 0.08;
      way += speed * kTick;
      touch.to(pressed(1e-3, {way, 0, 0}));
      if (i % 1000 < 800) continue;
      const double n = dot(touch.step.contact_W.force, touch.plate.n_W);
      ASSERT_NEAR(-touch.along().x, n * (0.3 + 4 * speed), 0.005 * n) << static_cast<int>(kind);
    }
  }
}

// A scene that is turned as a whole is felt turned as a whole: a patch beside the middle of the
// tool, so that sliding and turning are one motion, on a viscous surface.
TEST(Friction, IsTheSameInEveryDirection) {
  test::Random random(31);
  for (const CouplingKind kind : kAll) {
    CouplingOptions options = options_of(kind, 0.3);
    options.friction.viscous = 4;
    for (int run = 0; run < 5; ++run) {
      const Pose X_WQ{{}, run == 0 ? axis_angle({0, 0, 1}, kPi / 2) : random.rotation(3)};
      Plate plate;
      plate.foot_T = {0.012, -0.02, -0.03};
      Plate turned = plate;
      turned.n_W = rotate(X_WQ.rotation, plate.n_W);
      const auto at = [](int i) {
        const double t = i * kTick;
        Pose X = pressed(1e-3, {0.02 * std::sin(9 * t), 0.015 * (1 - std::cos(11 * t)), 0});
        X.rotation = axis_angle({0, 0, 1}, 0.3 * std::sin(7 * t));
        return X;
      };
      Touch touch(options, plate, at(0)), other(options, turned, X_WQ * at(0));
      double largest_force = 0;
      for (int i = 0; i < 600; ++i) {
        touch.to(at(i));
        other.to(X_WQ * at(i));
        const Wrench &a = touch.step.contact_W, &b = other.step.contact_W;
        largest_force = std::max(largest_force, norm(touch.along()));
        ASSERT_LT(norm(rotate(X_WQ.rotation, a.force) - b.force), 1e-7 * (1 + norm(a.force)))
            << static_cast<int>(kind) << " " << run << " " << i;
        ASSERT_LT(norm(rotate(X_WQ.rotation, a.torque) - b.torque), 1e-7 * (1 + norm(a.torque)));
      }
      EXPECT_GT(largest_force, 0.3);
    }
  }
}

// A pull below the limit never creeps, not even by the last bit.
TEST(Friction, SticksWithoutCreepFor60Seconds) {
  for (const CouplingKind kind : {CouplingKind::virtual_coupling, CouplingKind::proxy}) {
    const double mu = 0.5;
    const CouplingOptions options = options_of(kind, mu);
    Touch touch(options, {}, pressed(1e-3));
    for (int i = 0; i < 1000; ++i) touch.to(pressed(1e-3));
    // The hand draws aside until friction holds 95 % of mu N.
    double aside = 0;
    const auto share = [&] {
      return -touch.along().x / (mu * dot(touch.step.contact_W.force, touch.plate.n_W));
    };
    for (int i = 0; i < 10'000 && share() < 0.95; ++i) {
      touch.to(pressed(1e-3, {aside += 1e-7, 0, 0}));
    }
    for (int i = 0; i < 1000; ++i) touch.to(pressed(1e-3, {aside, 0, 0}));
    EXPECT_NEAR(share(), 0.95, 5e-3);
    const Pose held = touch.step.X_WT;
    for (int i = 0; i < 60'000; ++i) touch.to(pressed(1e-3, {aside, 0, 0}));
    EXPECT_LT(norm(touch.step.X_WT.translation - held.translation), 1e-9) << static_cast<int>(kind);
    EXPECT_LT(norm(rotation_between(held.rotation, touch.step.X_WT.rotation)), 1e-9);
    // More than the limit, and it goes.
    for (int i = 0; i < 1000; ++i) touch.to(pressed(1e-3, {2 * aside, 0, 0}));
    EXPECT_GT(touch.step.X_WT.translation.x, held.translation.x + 1e-4);
  }
}

TEST(Friction, BreaksLooseAtTheStaticLimitAndSlidesAtTheKineticOne) {
  for (const CouplingKind kind : kAll) {
    CouplingOptions options = options_of(kind, 0.4);
    options.friction.static_ratio = 1.5;
    Touch touch(options, {}, pressed(1e-3));
    for (int i = 0; i < 500; ++i) touch.to(pressed(1e-3));
    std::vector<double> ratio;
    double way = 0;
    for (int i = 0; i < 4000; ++i) {
      way += 2e-6;
      touch.to(pressed(1e-3, {way, 0, 0}));
      ratio.push_back(-touch.along().x / dot(touch.step.contact_W.force, touch.plate.n_W));
    }
    EXPECT_NEAR(largest(ratio), 0.6, 0.006) << static_cast<int>(kind);
    const auto peak = std::max_element(ratio.begin(), ratio.end());
    EXPECT_NEAR(*std::min_element(peak, ratio.end()), 0.4, 0.05);
  }
}

TEST(Friction, ResistsTurningByTheTorsionRadius) {
  for (const CouplingKind kind : kAll) {
    Touch touch(options_of(kind, 0.6), {}, pressed(1e-3));
    for (int i = 0; i < 500; ++i) touch.to(pressed(1e-3));
    for (int i = 0; i < 3000; ++i) {
      const Pose turned{{0, 0, 0.03 - 1e-3}, axis_angle({0, 0, 1}, 5e-4 * i)};
      touch.to(turned);
    }
    const double n = dot(touch.step.contact_W.force, touch.plate.n_W);
    EXPECT_NEAR(touch.turning(), -0.6 * n * touch.plate.torsion_radius, 1e-3 * n * 0.006)
        << static_cast<int>(kind);
    EXPECT_LT(norm(touch.along()), 0.01 * n);
  }
}

// Sliding and turning share one limit: an ellipsoid of force and torque, and what is dissipated is
// the most that a force on it can take.
TEST(Friction, SlidingAndTurningShareTheLimit) {
  for (const double spin : {0.5, 2.0, 8.0}) {  // rad/s
    const double mu = 0.5, speed = 0.03;
    Touch touch(options_of(CouplingKind::direct, mu), {}, pressed(1e-3));
    for (int i = 0; i < 400; ++i) {
      touch.to({{speed * kTick * i, 0, 0.03 - 1e-3}, axis_angle({0, 0, 1}, spin * kTick * i)});
    }
    const double n = dot(touch.step.contact_W.force, touch.plate.n_W),
                 r = touch.plate.torsion_radius;
    const double f = norm(touch.along()), torque = touch.turning() / r;
    EXPECT_NEAR(std::hypot(f, torque), mu * n, 1e-6 * n);
    const double v = std::hypot(speed, r * spin);
    EXPECT_NEAR(touch.along().x, -mu * n * speed / v, 0.01 * n);
    EXPECT_NEAR(torque, -mu * n * r * spin / v, 0.01 * n);
  }
}

// The force of friction acts where the patch is.
TEST(Friction, ActsAtTheMiddleOfThePatch) {
  for (const CouplingKind kind : kAll) {
    Plate plate;
    plate.foot_T = {0.01, -0.02, -0.03};
    Touch touch(options_of(kind, 0.4), plate, pressed(1e-3));
    for (int i = 0; i < 800; ++i) touch.to(pressed(1e-3, {4e-5 * i, 3e-5 * i, 0}));
    const Vec3d f = touch.step.contact_W.force, arm = touch.step.contact_W.torque;
    EXPECT_LT(norm(arm - cross(touch.lever(), f) - touch.turning() * touch.plate.n_W),
              0.02 * norm(arm))
        << static_cast<int>(kind);
  }
}

// ------------------------------------------------------------------------------------- energy

/// A smooth closed path of 2 s that presses and slides and turns, from coefficients.
class ClosedPath {
 public:
  ClosedPath(test::Random& random, double press, double wide, double turn) {
    for (int k = 0; k < 3; ++k) {
      for (Vec3d& v : shift_[k]) v = wide / (k + 1) * random.in_box(1);
      for (Vec3d& v : turn_[k]) v = turn / (k + 1) * random.in_box(1);
    }
    press_ = press;
  }
  Pose at(double t) const {
    Vec3d shift, turn;
    for (int k = 0; k < 3; ++k) {
      const double c = 1 - std::cos(kPi * (k + 1) * t), s = std::sin(kPi * (k + 1) * t);
      shift += c * shift_[k][0] + s * shift_[k][1];
      turn += c * turn_[k][0] + s * turn_[k][1];
    }
    return {Vec3d{0, 0, 0.03 - press_} + shift, rotated({}, turn)};
  }

 private:
  double press_;
  std::array<std::array<Vec3d, 2>, 3> shift_, turn_;
};

/// Computes the energy given to the hand along a path, as the passivity observer sees it: each
/// force over the way that follows.
double energy_given(Touch& touch, const ClosedPath& path, int rounds) {
  double given = 0;
  Pose last = path.at(0);
  Wrench felt;
  const int num = 2000;
  for (int i = 0; i <= rounds * num; ++i) {
    const Pose X = path.at(2.0 * (i % num) / num);
    given += dot(felt.force, X.translation - last.translation) +
             dot(felt.torque, rotation_between(last.rotation, X.rotation));
    felt = touch.to(X).desired_F_H_B;
    last = X;
  }
  return given;
}

TEST(Friction, ClosedPathsOnlyEverLoseEnergy) {
  test::Random random(5);
  for (const CouplingKind kind : kCouplings) {
    for (int n = 0; n < 30; ++n) {
      const ClosedPath path(random, random.uniform(0, 2e-3), 0.004, n % 2 ? 0.1 : 0);
      Plate plate;
      plate.n_W = normalized(Vec3d{random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), 1});
      plate.foot_T = {random.uniform(-0.01, 0.01), random.uniform(-0.01, 0.01), -0.03};
      double lost[3];
      for (int i = 0; i < 3; ++i) {
        CouplingOptions options = options_of(kind, i == 0 ? 0 : i == 1 ? 0.2 : 0.8);
        if (i == 2) options.friction.static_ratio = n % 3 ? 1 : 1.5;
        if (i == 2 && n % 2)
          options.texture.kind = n % 4 == 1 ? TextureKind::grain : TextureKind::ridges;
        Touch touch(options, plate, path.at(0));
        energy_given(touch, path, 1);  // the first round begins loose
        lost[i] = -energy_given(touch, path, 2);
      }
      // A force that is held over a tick gives a little back, with friction no more than without.
      EXPECT_GT(lost[1], lost[0] - 1e-12) << static_cast<int>(kind) << " " << n;
      EXPECT_GT(lost[2], lost[0] - 1e-12) << static_cast<int>(kind) << " " << n;
    }
  }
}

/// The tool's motion against what friction does to it: never driven, whatever normals, forces and
/// radii do from tick to tick.
TEST(Friction, TakesFromTheToolWhateverTheSurfaceDoes) {
  test::Random random(6);
  for (int n = 0; n < 200; ++n) {
    CouplingOptions options = options_of(CouplingKind::none, random.uniform(0.05, 2));
    options.friction.static_ratio = random.uniform(1, 2);
    Plate plate;
    Touch touch(options, plate, pressed(1e-3));
    double given = 0;
    Pose X = pressed(1e-3);
    Vec3d n_W{0, 0, 1};
    for (int i = 0; i < 400; ++i) {
      const Pose before = X;
      X.translation += random.in_box(3e-5);
      X.rotation = rotated(X.rotation, random.in_box(2e-3));
      n_W = normalized(n_W + 0.02 * random.in_box(1));
      touch.plate.n_W = n_W;
      touch.plate.offset = dot(n_W, X * plate.foot_T) + random.uniform(0, 2e-3);
      touch.plate.torsion_radius = random.uniform(0, 0.02);
      touch.to(X);
      const Wrench friction{touch.step.contact_W.force - touch.normal.force,
                            touch.step.contact_W.torque - touch.normal.torque};
      given += dot(friction.force, X.translation - before.translation) +
               dot(friction.torque, rotation_between(before.rotation, X.rotation));
    }
    EXPECT_LT(given, 1e-12) << n;
    EXPECT_LT(norm(touch.along()), options.friction.coefficient * options.friction.static_ratio *
                                       norm(touch.normal.force) * (1 + 1e-9));
  }
}

// -------------------------------------------------------------------------- streams of frames

// 30 new surfaces a second, each a little off, blended over the time of a frame: what sticks stays.
TEST(Friction, NoiseOfFramesDoesNotMakeItSlip) {
  for (const CouplingKind kind : {CouplingKind::virtual_coupling, CouplingKind::proxy}) {
    for (const double share : {0.0, 0.5, 0.8}) {
      test::Random random(7);
      const double mu = 0.5;
      const CouplingOptions options = options_of(kind, mu);
      Touch touch(options, {}, pressed(1e-3));
      for (int i = 0; i < 500; ++i) touch.to(pressed(1e-3));
      const double n = dot(touch.step.contact_W.force, touch.plate.n_W);
      const double aside = share * mu * n / options.stiffness;
      Vec3d normals[2] = {{0, 0, 1}, {0, 0, 1}};
      double offsets[2] = {0, 0};
      Pose held;
      double largest_off = 0;
      for (int i = 0; i < 12'000; ++i) {
        if (i % 33 == 0) {
          normals[0] = normals[1];
          offsets[0] = offsets[1];
          normals[1] = normalized(Vec3d{0.003 * random.normal(), 0.003 * random.normal(), 1});
          offsets[1] = 1e-5 * random.normal();
        }
        const double t = i % 33 / 33.0;
        touch.plate.n_W = normalized((1 - t) * normals[0] + t * normals[1]);
        // The plate turns about where the foot stands.
        touch.plate.offset =
            (1 - t) * offsets[0] + t * offsets[1] +
            dot(touch.plate.n_W - Vec3d{0, 0, 1}, touch.step.X_WT * touch.plate.foot_T);
        touch.to(pressed(1e-3, {aside * std::min(1.0, i / 500.0), 0, 0}));
        if (i == 2000) held = touch.step.X_WT;
        if (i > 2000) {
          const Vec3d off = touch.step.X_WT.translation - held.translation;
          largest_off = std::max(largest_off, std::hypot(off.x, off.y));
        }
      }
      EXPECT_LT(largest_off, 1e-5) << static_cast<int>(kind) << " " << share;
    }
  }
}

// A sticking contact turns with the surface and holds as much.
TEST(Friction, HoldsAsMuchOnASurfaceThatTurns) {
  PatchFriction friction(options_of(CouplingKind::none, 1), 1e4, 0);
  LocalContact contact;
  contact.patch.torsion_radius = 0.01;
  TouchedPatch patch;
  const double slid = 5e-5;
  for (int i = 0; i <= 200; ++i) {
    const double angle = 0.005 * i;
    const Vec3d n{std::sin(angle), 0, std::cos(angle)};
    ASSERT_TRUE(friction.touch(contact, {2 * n, {}}, kTick, patch));
    const Vec3d d = i == 0 ? patch.slid_by({{slid, slid, 0}, {0, 0, 1e-3}}) : Vec3d{};
    const auto grip = friction.hold(patch, d, {}, kTick);
    friction.keep(patch, grip, kTick);
    const Vec3d f = patch.wrench(grip.force).linear;
    ASSERT_NEAR(dot(f, n), 0, 1e-12);
    ASSERT_NEAR(norm(f), 1e4 * std::sqrt(2.0) * slid, 1e-9);
    ASSERT_NEAR(f.y, -1e4 * slid, 1e-9);
    ASSERT_NEAR(grip.force.z, -1e4 * 1e-5, 1e-9);
  }
}

// Friction of a slide from rest opposes its way, at the limit, however different the compliance
// in the three directions: also where the limit is small beside 1 N.
TEST(Friction, HoldsBackAgainstTheWayThatWasSlid) {
  PatchFriction friction(options_of(CouplingKind::none, 0.2), 1e4, 1e-4);
  LocalContact contact;
  contact.patch.torsion_radius = 0.01;
  TouchedPatch patch;
  for (const double normal_force : {0.05, 0.5, 5.0}) {
    friction.reset();
    ASSERT_TRUE(friction.touch(contact, {{0, 0, normal_force}, {}}, kTick, patch));
    for (const Vec3d slid : {Vec3d{3e-4, -1e-4, 2e-4}, Vec3d{-2e-3, 5e-3, 1e-3}}) {
      const Mat3s compliance{2e-4, -3e-5, 5e-5, 4e-5, 1e-5, 9e-4};
      const auto grip = friction.hold(patch, slid, compliance, kTick);
      ASSERT_TRUE(grip.is_sliding);
      EXPECT_NEAR(norm(grip.force), 0.2 * normal_force, 1e-9 * normal_force);
      const double cosine = dot(grip.force, grip.slid) / (norm(grip.force) * norm(grip.slid));
      EXPECT_NEAR(cosine, -1, 1e-9);
    }
  }
}

// A surface that moves along its normal carries the tool and what sticks; a draught across stays.
TEST(Friction, ASurfaceThatMovesAlongItsNormalCarriesWhatSticks) {
  for (const CouplingKind kind : {CouplingKind::virtual_coupling, CouplingKind::proxy}) {
    const CouplingOptions options = options_of(kind, 0.8);
    Plate plate;
    plate.n_W = normalized(Vec3d{0.3, 0, 1});
    plate.offset = dot(plate.n_W, Vec3d{0, 0, 0});
    Touch touch(options, plate, pressed(1e-3));
    for (int i = 0; i < 1000; ++i) touch.to(pressed(2e-3));
    const Vec3d t = cross(Vec3d{0, 1, 0}, plate.n_W);
    const double before = dot(touch.along(), t);
    const Vec3d start = touch.step.X_WT.translation;
    // Hand and surface go 5 mm along the normal together.
    for (int i = 0; i <= 1000; ++i) {
      touch.plate.offset = 5e-6 * i;
      Pose hand = pressed(2e-3);
      hand.translation += 5e-6 * i * plate.n_W;
      touch.to(hand);
    }
    for (int i = 0; i < 500; ++i) {
      Pose hand = pressed(2e-3);
      hand.translation += 5e-3 * plate.n_W;
      touch.to(hand);
    }
    EXPECT_NEAR(dot(touch.along(), t), before, 0.01 * std::abs(before) + 1e-3);
    EXPECT_LT(norm(touch.step.X_WT.translation - start - 5e-3 * plate.n_W), 2e-5);
  }
}

// ---------------------------------------------------------------------------- state and limits

// Another coupling goes on with what sticks.
TEST(Friction, IsTakenOver) {
  for (const CouplingKind kind : kAll) {
    const CouplingOptions options = options_of(kind, 0.5);
    Touch touch(options, {}, pressed(1e-3));
    for (int i = 0; i < 900; ++i) touch.to(pressed(1e-3, {i * 1e-6, 0, 0}));
    Touch next(options, {}, pressed(1e-3));
    next.coupling->take_over(touch.coupling->state());
    EXPECT_EQ(next.coupling->state().friction.bristle_W,
              touch.coupling->state().friction.bristle_W);
    EXPECT_GT(norm(next.coupling->state().friction.bristle_W), 1e-6);
  }
}

// Without friction all bits are those of a program that knows none.
TEST(Friction, NoneChangesNoBit) {
  test::Random random(8);
  for (const CouplingKind kind : kAll) {
    Plate plain, with_patch;
    plain.torsion_radius = 0;
    Touch a(options_of(kind, 0), plain, pressed(0)), b(options_of(kind, 0), with_patch, pressed(0));
    const ClosedPath path(random, 1e-3, 3e-3, 0.1);
    for (int i = 0; i < 1000; ++i) {
      a.to(path.at(i * kTick));
      b.to(path.at(i * kTick));
      ASSERT_EQ(a.step.desired_F_H_B.force, b.step.desired_F_H_B.force);
      ASSERT_EQ(a.step.contact_W.torque, b.step.contact_W.torque);
    }
    EXPECT_EQ(b.coupling->state().friction.normal_W, Vec3d{});
  }
}

// Whatever comes in: numbers come out, and no memory is allocated.
TEST(Friction, SurvivesAnyInput) {
  test::Random random(9);
  const auto strange = [&](double usual) { return coupled_box::strange_number(random, usual); };
  for (const CouplingKind kind : kAll) {
    CouplingOptions options = options_of(kind, 0.7);
    options.friction.viscous = 3;
    options.friction.contact_damping = 10;
    options.texture.kind = TextureKind::grain;
    const auto coupling = make_coupling(options, kLimits, box_tool());
    coupling->reset(hand_at({}));
    const test::AllocationCounter counter;
    for (int i = 0; i < 30'000; ++i) {
      DeviceState state = hand_at({random.in_box(0.1), random.rotation(3)});
      state.X_BH.translation.x = strange(0.1);
      state.V_BH = {{strange(1), 0, 0}, {0, strange(10), 0}};
      state.is_valid = random.uniform() > 0.1;
      LocalContact contact;
      contact.is_valid = random.uniform() > 0.2;
      contact.time = strange(1);
      contact.volume = strange(1e-5);
      contact.p_WC = {strange(0.1), strange(0.1), 0};
      contact.F_C_W = {{strange(10), strange(1), strange(1)}, {strange(1), 0, strange(1)}};
      contact.max_stiffness = strange(1e6);
      contact.patch = {{strange(0.1), 0, strange(0.1)}, strange(0.02), 1, strange(0.1), {}};
      for (auto& row : contact.stiffness.m) {
        for (double& x : row) x = strange(random.uniform() < 0.1 ? 1e6 : 100);
      }
      const CouplingStep step = coupling->step(state, contact, i % 7 ? kTick : strange(1e-3));
      ASSERT_TRUE(is_finite(step.desired_F_H_B) && is_finite(step.contact_W))
          << static_cast<int>(kind) << " " << i;
      ASSERT_TRUE(is_finite(step.X_WT) && std::isfinite(step.stretch)) << i;
    }
    EXPECT_EQ(counter.count(), 0u);
  }
}

}  // namespace
}  // namespace palpate
