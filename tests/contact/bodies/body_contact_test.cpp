// Tree against tree: brute force over all pairs, closed forms, and the laws a force must keep.
#include "palpate/contact/body_contact.h"

#include <cstring>

#include <gtest/gtest.h>

#include "palpate/packing/packing.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/body_motion.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

using test::Random;

Tool tool_of(std::vector<Sphere> spheres, const Vec3d& box = {1, 1, 1}) {
  SpherePacking packing;
  packing.spheres = std::move(spheres);
  return Tool::build(make_box(box), std::move(packing)).value();
}

struct BruteForce {
  double volume = 0, potential = 0;
  Vec3d force, torque_a, torque_b;  // on A and on B, each about its own center of mass
  std::int64_t num_pairs = 0;
};

BruteForce brute_force(const Tool& a, const Tool& b, const Pose& X_WA, const Pose& X_WB) {
  BruteForce sum;
  const Vec3d C_a = X_WA * a.sphere_mass().center_of_mass;
  const Vec3d C_b = X_WB * b.sphere_mass().center_of_mass;
  for (const Sphere& s : a.spheres()) {
    const Vec3d p = X_WA * to_double(s.center);
    for (const Sphere& t : b.spheres()) {
      const Vec3d q = X_WB * to_double(t.center);
      const double ra = double(s.radius), rb = double(t.radius), d = norm(p - q);
      if (d >= ra + rb) continue;
      const double lens = lens_volume(ra, rb, d);
      const Vec3d f = lens * normalized(p - q);
      sum.volume += lens;
      sum.potential += lens_potential(ra, rb, d);
      sum.force += f;
      sum.torque_a += cross(p - C_a, f);
      sum.torque_b += cross(q - C_b, -f);
      ++sum.num_pairs;
    }
  }
  return sum;
}

void expect_near(const Vec3d& got, const Vec3d& want, double tolerance) {
  EXPECT_LE(norm(got - want), tolerance) << got.x << " " << got.y << " " << got.z << " but want "
                                         << want.x << " " << want.y << " " << want.z;
}

TEST(LensPotential, IsTheIntegralOfTheLens) {
  for (const auto& [a, b] : {std::pair{1.0, 1.0}, std::pair{1.0, 0.3}, std::pair{0.02, 1.0}}) {
    EXPECT_EQ(lens_potential(a, b, a + b), 0);
    EXPECT_EQ(lens_potential(a, b, 10), 0);
    EXPECT_EQ(lens_potential(a, b, 0.7 * (a + b)), lens_potential(b, a, 0.7 * (a + b)));
    for (const double share : {0.0, 0.2, 0.5, 0.7, 0.95, 0.99, 0.9999}) {
      const double low = share * (a + b);
      // Simpson's rule; the lens has a kink in its second derivative where containment ends.
      double sum = 0;
      for (const auto& [from, to] : {std::pair{low, std::max(low, std::abs(a - b))},
                                     std::pair{std::max(low, std::abs(a - b)), a + b}}) {
        const int n = 2000;
        const double h = (to - from) / n;
        for (int i = 0; i <= n; ++i) {
          const double weight = i == 0 || i == n ? 1 : (i % 2 == 1 ? 4 : 2);
          sum += weight * lens_volume(a, b, from + i * h) * h / 3;
        }
      }
      EXPECT_NEAR(lens_potential(a, b, low) / sum, 1, 1e-9) << a << " " << b << " " << share;
    }
  }
  // The lightest touch: two paraboloids, pi r t^3 / 6 for equal balls.
  EXPECT_NEAR(lens_potential(1, 1, 2 - 1e-6) / (kPi / 6 * 1e-18), 1, 1e-5);
}

TEST(BodyContact, TwoBallsInClosedForm) {
  const Tool large = tool_of({{{0.25f, 0, 0}, 0.5f}}), small = tool_of({{{0, 0, 0}, 0.125f}});
  BodyContact contact(large, small);
  const auto at = [&](double x) {
    return contact.measure({}, {{0.25 + x, 0, 0}, axis_angle({1, 1, 0}, 1)});
  };
  for (const double d : {0.7, 0.626}) {
    EXPECT_EQ(at(d).on_a.volume, 0);
    EXPECT_EQ(at(d).num_pairs, 0);
  }
  for (const double d : {0.6, 0.5, 0.4, 0.3, 0.1, -0.1, -0.45}) {
    const BodyPenetration result = at(d);
    const double lens = lens_volume(0.5, 0.125, std::abs(d));
    EXPECT_NEAR(result.on_a.volume, lens, 1e-15);
    EXPECT_EQ(result.on_b.volume, result.on_a.volume);
    expect_near(result.on_a.measure_W.force, {d > 0 ? -lens : lens, 0, 0}, 1e-15);
    expect_near(result.on_b.measure_W.force, {d > 0 ? lens : -lens, 0, 0}, 1e-15);
    expect_near(result.on_a.measure_W.torque, {}, 1e-15);
    expect_near(result.on_b.measure_W.torque, {}, 1e-15);
    EXPECT_EQ(result.on_a.num_boundary_spheres, 1);
    EXPECT_EQ(result.on_b.num_boundary_spheres, 1);
    EXPECT_EQ(result.num_pairs, 1);
  }
  // The one ball inside the other: all of it, and continuous where that begins.
  EXPECT_NEAR(at(0.2).on_a.volume, sphere_volume(0.125), 1e-15);
  EXPECT_NEAR(at(0.375 + 1e-7).on_a.volume, at(0.375 - 1e-7).on_a.volume, 1e-12);
  // No line of centers: a volume without a force.
  const BodyPenetration coincident = at(0);
  EXPECT_NEAR(coincident.on_a.volume, sphere_volume(0.125), 1e-15);
  EXPECT_EQ(norm(coincident.on_a.measure_W.force), 0);
  EXPECT_EQ(norm(coincident.on_b.measure_W.torque), 0);
}

TEST(BodyContact, EqualsBruteForceOnRandomPoses) {
  struct Case {
    int num_a, num_b, num_poses;
    double half_a, half_b;
  };
  Random random(3);
  for (const Case& c : {Case{1, 1, 100, 0.05, 0.05}, Case{1, 300, 100, 0.05, 0.05},
                        Case{300, 7, 100, 0.05, 0.01}, Case{500, 300, 60, 0.05, 0.08}}) {
    const Tool a = test::random_tool(c.num_a, c.half_a, 5);
    const Tool b = test::random_tool(c.num_b, c.half_b, 6);
    BodyContact contact(a, b);
    for (int i = 0; i < c.num_poses; ++i) {
      const Pose X_WB = test::random_body_pose(random, 0.3);
      const Pose X_WA = X_WB * test::random_body_pose(random, 0.7 * (c.half_a + c.half_b));
      const BruteForce want = brute_force(a, b, X_WA, X_WB);
      const BodyPenetration got = contact.measure(X_WA, X_WB);
      ASSERT_EQ(got.num_pairs, want.num_pairs) << i;
      const double tolerance = 1e-12 * std::max(want.volume, 1e-9);
      EXPECT_NEAR(got.on_a.volume, want.volume, tolerance);
      EXPECT_LE(got.on_a.volume, a.sphere_mass().volume * (1 + 1e-9));
      EXPECT_NEAR(contact.potential(X_WA, X_WB), want.potential, tolerance);
      expect_near(got.on_a.measure_W.force, want.force, tolerance);
      expect_near(got.on_a.measure_W.torque, want.torque_a, tolerance);
      expect_near(got.on_b.measure_W.force, -want.force, tolerance);
      expect_near(got.on_b.measure_W.torque, want.torque_b, tolerance);
    }
  }
}

TEST(BodyContact, TotalMomentAboutAnyPointIsZero) {
  const Tool a = test::random_tool(200, 0.05, 5), b = test::random_tool(300, 0.08, 6);
  BodyContact contact(a, b);
  Random random(4);
  for (int i = 0; i < 100; ++i) {
    const Pose X_WB = test::random_body_pose(random, 0.1),
               X_WA = X_WB * test::random_body_pose(random, 0.05);
    const BodyPenetration result = contact.measure(X_WA, X_WB);
    ASSERT_GT(result.num_pairs, 0);
    const Vec3d P = random.in_box(1);
    const auto moment = [&](const VolumeWrench& w, const Vec3d& C) {
      return w.torque + cross(C - P, w.force);
    };
    const Vec3d total = moment(result.on_a.measure_W, X_WA * a.sphere_mass().center_of_mass) +
                        moment(result.on_b.measure_W, X_WB * b.sphere_mass().center_of_mass);
    expect_near(total, {}, 1e-14 * result.on_a.volume);
  }
}

TEST(BodyContact, RolesCanBeSwapped) {
  const Tool a = test::random_tool(200, 0.05, 5), b = test::random_tool(300, 0.08, 6);
  BodyContact ab(a, b), ba(b, a);
  const Pose X_WA{{0.03, 0.02, 0.05}, axis_angle({1, 2, 3}, 0.7)}, X_WB{{0, 0.01, 0}, {}};
  const BodyPenetration one = ab.measure(X_WA, X_WB), other = ba.measure(X_WB, X_WA);
  EXPECT_EQ(one.num_pairs, other.num_pairs);
  EXPECT_EQ(one.on_a.num_boundary_spheres, other.on_b.num_boundary_spheres);
  EXPECT_EQ(one.on_b.num_boundary_spheres, other.on_a.num_boundary_spheres);
  EXPECT_NEAR(one.on_a.volume, other.on_a.volume, 1e-12 * one.on_a.volume);
  expect_near(one.on_a.measure_W.torque, other.on_b.measure_W.torque, 1e-12 * one.on_a.volume);
}

TEST(BodyContact, WrenchIsTheGradientOfThePotential) {
  const Tool a = test::random_tool(150, 0.05, 5), b = test::random_tool(200, 0.06, 6);
  BodyContact contact(a, b);
  Random random(8);
  const double step = 1e-6;
  for (int i = 0; i < 30; ++i) {
    const Pose X_WB = test::random_body_pose(random, 0.1),
               X_WA = X_WB * test::random_body_pose(random, 0.05);
    const BodyPenetration result = contact.measure(X_WA, X_WB);
    ASSERT_GT(result.num_pairs, 0);
    const auto check = [&](const VolumeWrench& wrench, auto potential_of_step) {
      const std::array<double, 6> got = test::coordinates(wrench);
      for (int k = 0; k < 6; ++k) {
        const double slope =
            (potential_of_step(k, step) - potential_of_step(k, -step)) / (2 * step);
        // A step of the potential is the work done on the body, with the sign turned.
        EXPECT_NEAR(got[static_cast<std::size_t>(k)], -slope, 1e-6 * result.on_a.volume) << k;
      }
    };
    check(result.on_a.measure_W, [&](int k, double h) {
      return contact.potential(test::stepped(X_WA, a.sphere_mass().center_of_mass, k, h), X_WB);
    });
    check(result.on_b.measure_W, [&](int k, double h) {
      return contact.potential(X_WA, test::stepped(X_WB, b.sphere_mass().center_of_mass, k, h));
    });
  }
}

TEST(BodyContact, ClosedPathsDoNoWork) {
  const Tool a = test::random_tool(150, 0.05, 5), b = test::random_tool(200, 0.06, 6);
  BodyContact contact(a, b);
  const Vec3d C_A = a.sphere_mass().center_of_mass;
  // Round and round in all six coordinates at once, in and out of contact: where the center of mass
  // is and how the tool is turned, both periodic.
  const auto center = [](double t) {
    return Vec3d{0.05 * std::cos(t), 0.06 * std::sin(t), 0.04 * std::sin(2 * t) + 0.03};
  };
  const auto turn = [](double t) {
    return axis_angle({0, 0, 1}, 0.8 * std::sin(t)) * axis_angle({1, 0, 0}, 0.6 * std::cos(t));
  };
  const auto pose = [&](double t) -> Pose {
    const Quaternion q = turn(t);
    return {center(t) - rotate(q, C_A), q};
  };
  double work = 0, absolute = 0;
  const int n = 20000;
  const double h = 2 * kPi / n, e = 1e-5;
  for (int i = 0; i < n; ++i) {
    const double t = (i + 0.5) * h;
    const Vec3d velocity = (center(t + e) - center(t - e)) / (2 * e);
    const Quaternion q = turn(t), before = turn(t - e), after = turn(t + e);
    const Quaternion rate =
        Quaternion{(after.x - before.x) / (2 * e), (after.y - before.y) / (2 * e),
                   (after.z - before.z) / (2 * e), (after.w - before.w) / (2 * e)} *
        conjugate(q);
    const Vec3d spin{2 * rate.x, 2 * rate.y, 2 * rate.z};
    const VolumeWrench w = contact.measure(pose(t), {}).on_a.measure_W;
    const double power = dot(w.force, velocity) + dot(w.torque, spin);
    work += power * h;
    absolute += std::abs(power) * h;
  }
  EXPECT_GT(absolute, 0);
  EXPECT_LE(std::abs(work) / absolute, 1e-9);
}

TEST(BodyContact, CubesShareTheBoxTheyOverlapIn) {
  const Tool tool = Tool::pack(make_box({0.1, 0.1, 0.1}), {.max_spheres = 4000}).value();
  const double fill = tool.sphere_mass().volume / tool.mesh_mass().volume;
  BodyContact contact(tool, tool);
  for (const Vec3d& shift :
       {Vec3d{0.07, 0, 0}, Vec3d{0.05, 0.03, -0.02}, Vec3d{0.02, 0.01, 0.015}}) {
    const BodyPenetration result = contact.measure({shift, {}}, {});
    const double overlap =
        (0.1 - std::abs(shift.x)) * (0.1 - std::abs(shift.y)) * (0.1 - std::abs(shift.z));
    // Two independent packings share fill^2 of the box, but these two are the same one.
    EXPECT_NEAR(result.on_a.volume / (fill * fill * overlap), 1, 0.12);
    EXPECT_GT(dot(result.on_a.measure_W.force, shift), 0);
  }
  // Exactly on top of each other: every sphere on itself, all volume and no direction.
  const BodyPenetration same = contact.measure({}, {});
  EXPECT_NEAR(same.on_a.volume, tool.sphere_mass().volume, 1e-9 * same.on_a.volume);
  EXPECT_EQ(same.on_a.num_boundary_spheres, static_cast<int>(tool.spheres().size()));
}

TEST(BodyContact, SameBitsEveryTimeWithoutAllocation) {
  const Tool a = test::random_tool(400, 0.05, 5), b = test::random_tool(300, 0.08, 6);
  BodyContact contact(a, b);
  const Pose X_WA{{0.03, 0.02, 0.05}, axis_angle({1, 2, 3}, 0.7)}, X_WB{{0, 0.01, 0}, {}};
  const BodyPenetration first = contact.measure(X_WA, X_WB);
  const test::AllocationCounter counter;
  (void)contact.measure({{1, 0, 0}, {}}, X_WB);
  (void)contact.potential(X_WA, X_WB);
  const BodyPenetration second = contact.measure(X_WA, X_WB);
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_EQ(std::memcmp(&first.on_a.measure_W, &second.on_a.measure_W, sizeof(VolumeWrench)), 0);
  EXPECT_EQ(std::memcmp(&first.on_b.measure_W, &second.on_b.measure_W, sizeof(VolumeWrench)), 0);
  EXPECT_EQ(first.on_a.volume, second.on_a.volume);
  EXPECT_EQ(first.on_a.num_boundary_spheres, second.on_a.num_boundary_spheres);
}

TEST(BodyContact, NonFinitePosesAreReportedAndFarOnesMeasureNothing) {
  const Tool a = test::random_tool(20, 0.05, 5);
  BodyContact contact(a, a);
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    const BodyPenetration bad_a = contact.measure({{bad, 0, 0}, {}}, {});
    const BodyPenetration bad_b = contact.measure({}, {{}, {0, 0, bad, 1}});
    EXPECT_EQ(bad_a.on_a.status, StepStatus::non_finite_pose);
    EXPECT_EQ(bad_a.on_b.status.bits, 0u);
    EXPECT_EQ(bad_b.on_a.status.bits, 0u);
    EXPECT_EQ(bad_b.on_b.status, StepStatus::non_finite_pose);
    for (const BodyPenetration& result : {bad_a, bad_b}) {
      EXPECT_EQ(result.on_a.volume, 0);
      EXPECT_EQ(norm(result.on_b.measure_W.force), 0);
    }
  }
  for (const double far : {1.0, 1e30, 1e300}) {
    EXPECT_EQ(contact.measure({{far, 0, 0}, {}}, {{0, far, 0}, {}}).on_a.volume, 0);
  }
}

}  // namespace
}  // namespace palpate
