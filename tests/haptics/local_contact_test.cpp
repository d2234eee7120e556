#include "palpate/haptics/local_contact.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "palpate/math/geometry.h"
#include "src/math/internal/matrix6.h"
#include "src/math/internal/rotation_vector.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

/// A ball of radius r at c_T of the tool's frame above the wall z = 0 of the scene, z up: V = cap,
/// F = V e_z at the ball's center, K = A e_z e_z^T; all in closed form.
struct BallOnWall {
  double radius = 0.02;
  Vec3d c_T{0.03, -0.01, 0.02}, center_of_mass_T{-0.02, 0.01, 0.005};

  Penetration measure(const Pose& X_WT) const {
    const Vec3d c_W = X_WT * c_T;
    Penetration p;
    p.volume = cap_volume(radius, c_W.z);
    p.measure_W.force = {0, 0, p.volume};
    p.measure_W.torque = cross(c_W - X_WT * center_of_mass_T, p.measure_W.force);
    return p;
  }
  /// Computes the stiffness by central differences of the measure.
  Stiffness stiffness(const Pose& X_WT) const {
    const double step = 1e-6;
    const Vec3d C = X_WT * center_of_mass_T;
    Stiffness k;
    for (int j = 0; j < 6; ++j) {
      Vec6 motion;
      motion[j] = step;
      const auto moved = [&](double s) {
        Pose X{{}, rotated(X_WT.rotation, s * motion.angular)};
        X.translation = C + s * motion.linear - rotate(X.rotation, center_of_mass_T);
        const VolumeWrench measured = measure(X).measure_W;
        return to_vec6(Wrench{measured.force, measured.torque});
      };
      const Vec6 slope = (1 / (2 * step)) * (moved(1) - moved(-1));
      for (int i = 0; i < 6; ++i) k.m[i][j] = -slope[i];
    }
    return k;
  }
  LocalContact contact(const Pose& X_WT, double gain) const {
    return local_contact(measure(X_WT), stiffness(X_WT), X_WT, center_of_mass_T, {gain}, 1.5, 0.01);
  }
};

Pose at_depth(const BallOnWall& scene, double depth, const Quaternion& q) {
  Pose X_WT{{}, q};
  X_WT.translation.z = scene.radius - depth - (X_WT * scene.c_T).z;
  return X_WT;
}

constexpr double kGain = 1e6;

TEST(LocalContact, IsTheMeasureInNewtonsAtItsPose) {
  const BallOnWall scene;
  test::Random random(1);
  for (int i = 0; i < 50; ++i) {
    const Pose X_WT = at_depth(scene, random.uniform(1e-4, 0.01), random.rotation(3));
    const LocalContact contact = scene.contact(X_WT, kGain);
    const Penetration p = scene.measure(X_WT);
    ASSERT_TRUE(contact.is_valid);
    EXPECT_EQ(contact.time, 1.5);
    EXPECT_EQ(contact.surface_age, 0.01);
    EXPECT_EQ(contact.volume, p.volume);
    const Wrench here = contact.at(X_WT);
    EXPECT_NEAR(norm(here.force - kGain * p.measure_W.force), 0, 1e-12);
    EXPECT_NEAR(norm(here.torque - kGain * p.measure_W.torque), 0, 1e-12);
    // The only stiffness against moving is that of the wall: area of the cut disc.
    const double z = (X_WT * scene.c_T).z;
    const double area = kPi * (scene.radius * scene.radius - z * z);
    EXPECT_NEAR(contact.max_stiffness, kGain * area, 1e-5 * kGain * area);
  }
}

TEST(LocalContact, IsFirstOrderAroundItsPose) {
  const BallOnWall scene;
  test::Random random(2);
  for (int i = 0; i < 50; ++i) {
    const Pose X_WT = at_depth(scene, 0.008, random.rotation(3));
    const LocalContact contact = scene.contact(X_WT, kGain);
    const Vec3d shift = random.direction(), turn = 20 * random.direction();
    // Half the step: a quarter of the error, for force and torque.
    double force_error[2], torque_error[2];
    for (int half = 0; half < 2; ++half) {
      const double s = half == 0 ? 4e-5 : 2e-5;
      Pose X{{}, rotated(X_WT.rotation, s * turn)};
      X.translation =
          X_WT * scene.center_of_mass_T + s * shift - rotate(X.rotation, scene.center_of_mass_T);
      const VolumeWrench truth = scene.measure(X).measure_W;
      const Wrench model = contact.at(X);
      force_error[half] = norm(model.force - kGain * truth.force);
      torque_error[half] = norm(model.torque - kGain * truth.torque);
    }
    EXPECT_LT(force_error[0], 0.02 * norm(contact.F_C_W.force));
    EXPECT_NEAR(force_error[1] / force_error[0], 0.25, 0.05);
    EXPECT_NEAR(torque_error[1] / torque_error[0], 0.25, 0.05);
  }
}

// The torque of a turn is at most four times the force at the stiffness's radius of gyration.
TEST(LocalContact, TorqueIsLimitedByForceTimesLever) {
  LocalContact contact;
  contact.is_valid = true;
  contact.F_C_W = {{0, 0, 2}, {}};
  constexpr double kLever = 0.05, kStiffness = 300;
  for (int i = 0; i < 6; ++i)
    contact.stiffness.m[i][i] = kStiffness * (i < 3 ? 1 : kLever * kLever);
  const auto torque_at = [&](double angle) {
    return norm(contact.at({{}, axis_angle({1, 0, 0}, angle)}).torque);
  };
  const double per_angle = kStiffness * kLever * kLever, most = 4 * 2 * kLever;
  EXPECT_NEAR(torque_at(0.5 * most / per_angle), 0.5 * most, 1e-12);
  EXPECT_NEAR(torque_at(1.5 * most / per_angle), most, 1e-12);
  contact.F_C_W.torque = {0, 3 * kLever * 2, 0};  // a measured torque counts where it is larger
  const Wrench turned = contact.at({{}, axis_angle({0, 1, 0}, -3.0)});
  EXPECT_NEAR(norm(turned.torque), std::min(3 * most / 4 + per_angle * 3, 3 * most), 1e-12);
}

TEST(LocalContact, EndsWithoutAJumpAndNeverPulls) {
  const BallOnWall scene;
  const Pose X_WT = at_depth(scene, 0.005, axis_angle({1, 2, 3}, 0.7));
  const LocalContact contact = scene.contact(X_WT, kGain);
  const double reach = norm(contact.F_C_W.force) / contact.max_stiffness;
  double last_force = 1e9, last_torque = 1e9;
  for (double lift = 0; lift < 3 * reach; lift += reach / 100) {
    Pose X = X_WT;
    X.translation.z += lift;
    const Wrench wrench = contact.at(X);
    EXPECT_GE(wrench.force.z, 0);
    EXPECT_LE(norm(wrench.force), last_force);
    EXPECT_LE(norm(wrench.torque), last_torque + 1e-12);
    if (lift > 1.001 * reach) {
      EXPECT_EQ(norm(wrench.force) + norm(wrench.torque), 0);
    }
    if (std::abs(lift - reach) < reach / 50) {
      EXPECT_LT(norm(wrench.torque), 0.05 * norm(contact.F_C_W.torque));
    }
    last_force = norm(wrench.force);
    last_torque = norm(wrench.torque);
  }
}

// Whatever the numbers: bounded by four times the measurement, along it never negative.
TEST(LocalContact, IsBoundedWhereverTheToolIs) {
  test::Random random(3);
  for (int i = 0; i < 20'000; ++i) {
    LocalContact contact;
    contact.is_valid = true;
    contact.X_WT = {random.in_box(1), random.rotation(3)};
    contact.p_WC = random.in_box(1);
    contact.F_C_W = {random.in_box(10), random.in_box(1)};
    double trace_force = 0, trace_torque = 0;
    for (int r = 0; r < 6; ++r) {
      for (double& x : contact.stiffness.m[r]) x = 1e4 * random.uniform(-1, 1);
      (r < 3 ? trace_force : trace_torque) += contact.stiffness.m[r][r];
    }
    const Pose X{random.in_box(i % 2 ? 1 : 1e3), random.rotation(kPi)};
    const Wrench wrench = contact.at(X);
    const double force = norm(contact.F_C_W.force);
    const double lever =
        trace_force > 0 && trace_torque > 0 ? std::sqrt(trace_torque / trace_force) : 0;
    ASSERT_LE(norm(wrench.force), 4 * force * (1 + 1e-12));
    ASSERT_LE(norm(wrench.torque),
              4 * std::max(norm(contact.F_C_W.torque), force * lever) * (1 + 1e-12));
    ASSERT_GE(dot(wrench.force, contact.F_C_W.force), 0);
  }
}

TEST(LocalContact, IsZeroWithoutAMeasurementOrAPose) {
  const BallOnWall scene;
  const Pose X_WT = at_depth(scene, 0.005, {});
  EXPECT_EQ(norm(LocalContact{}.at(X_WT).force), 0);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(norm(scene.contact(X_WT, kGain).at({{nan, 0, 0}, {}}).force), 0);
  EXPECT_FALSE(local_contact(scene.measure(X_WT), {}, {{nan, 0, 0}, {}}, {}, {1}, 0, 0).is_valid);
  Penetration p = scene.measure(X_WT);
  p.measure_W.torque.y = nan;
  EXPECT_FALSE(local_contact(p, {}, X_WT, {}, {1}, 0, 0).is_valid);
  p = scene.measure(X_WT);
  p.status = StepStatus::backend_failed;
  const LocalContact failed = local_contact(p, {}, X_WT, {}, {1}, 0, 0);
  EXPECT_FALSE(failed.is_valid);
  EXPECT_EQ(failed.status, p.status);
}

TEST(LocalContact, LargestStiffnessIsTheLargestEigenvalue) {
  test::Random random(4);
  for (int i = 0; i < 2000; ++i) {
    // Q diag(e) Q^T plus a skew part, which does not count.
    const double e[3] = {random.uniform(-1, 1), i % 3 ? random.uniform(-1, 1) : 0.5,
                         i % 5 ? random.uniform(-1, 1) : 0.5};
    const Mat3d q = rotation_matrix(random.rotation(kPi));
    Stiffness k;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        for (int j = 0; j < 3; ++j) k.m[r][c] += q.m[r][j] * e[j] * q.m[c][j];
      }
    }
    k.m[0][1] += 0.3, k.m[1][0] -= 0.3;
    const LocalContact contact = local_contact({}, k, {}, {}, {1000}, 0, 0);
    const double want = 1000 * std::max({e[0], e[1], e[2], 0.0});
    EXPECT_NEAR(contact.max_stiffness, want, 1e-4);
  }
}

TEST(LocalContact, ThesisScaleReachesTheDevicesForceAtAnEighth) {
  const double volume = 3e-5;
  const VolumeStiffness scale = thesis_volume_stiffness(10, volume);
  EXPECT_DOUBLE_EQ(scale.newtons_per_cubic_meter * volume / 8, 10);
  EXPECT_EQ(thesis_volume_stiffness(10, 0).newtons_per_cubic_meter, 0);
  EXPECT_EQ(thesis_volume_stiffness(10, -1).newtons_per_cubic_meter, 0);
  EXPECT_EQ(
      thesis_volume_stiffness(std::numeric_limits<double>::quiet_NaN(), 1).newtons_per_cubic_meter,
      0);
}

TEST(LocalContact, DoesNotAllocate) {
  const BallOnWall scene;
  const Pose X_WT = at_depth(scene, 0.005, {});
  const Penetration p = scene.measure(X_WT);
  const Stiffness k = scene.stiffness(X_WT);
  const test::AllocationCounter counter;
  const LocalContact contact = local_contact(p, k, X_WT, {}, {1}, 0, 0);
  EXPECT_GT(contact.at(X_WT).force.z, 0);
  EXPECT_EQ(counter.count(), 0u);
}

TEST(RotationVector, TakesTheShortWayAndComesBack) {
  test::Random random(5);
  for (double angle : {0.0, 1e-12, 1e-7, 0.1, 1.0, 3.1, 179 * kPi / 180, kPi}) {
    for (int i = 0; i < 20; ++i) {
      const Vec3d axis = random.direction();
      const Quaternion q = axis_angle(axis, angle);
      for (double sign : {1.0, -1.0}) {
        const Vec3d v = rotation_vector({sign * q.x, sign * q.y, sign * q.z, sign * q.w});
        EXPECT_NEAR(norm(v), angle, 1e-12);
        if (angle < 3.14) {
          EXPECT_LT(norm(v - axis * angle), 1e-12);
        }
      }
      const Vec3d long_way = rotation_vector(axis_angle(axis, 2 * kPi - angle));
      EXPECT_NEAR(norm(long_way), angle, 1e-12);
    }
  }
}

}  // namespace
}  // namespace palpate
