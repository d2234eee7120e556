// Place and width of a contact: against closed forms and sums over columns.
#include "palpate/haptics/local_contact.h"

#include <gtest/gtest.h>

#include <functional>
#include <utility>
#include <vector>

#include "src/haptics/tangents.h"
#include "src/math/internal/matrix6.h"
#include "tests/haptics/friction_touch.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

/// A flat patch of pressure p(x, y) over |x| < a, |y| < b in columns, with C at height `up` above
/// and `aside` of it, turned by q: what a measure and its stiffness say of it, and the truth.
struct Columns {
  VolumeWrench measure;
  double volume = 0;
  Stiffness stiffness;
  VolumeMoments moments;
  double mean_distance = 0;
  Vec3d lever_W;

  Columns(double a, double b, const Vec3d& foot, const Quaternion& q,
          const std::function<double(double, double)>& depth) {
    constexpr int kNum = 400;
    const Vec3d n = rotate(q, {0, 0, 1});
    std::vector<std::pair<Vec3d, double>> columns;
    for (int i = 0; i < kNum; ++i) {
      for (int j = 0; j < kNum; ++j) {
        const double x = a * (2 * (i + 0.5) / kNum - 1), y = b * (2 * (j + 0.5) / kNum - 1);
        const double h = depth(x, y);
        if (!(h > 0)) continue;
        const double area = 4 * a * b / kNum / kNum, v = area * h;
        const Vec3d l = rotate(q, Vec3d{x, y, 0} + foot), arm = cross(l, n);
        columns.emplace_back(l, v);
        volume += v;
        measure.force += v * n;
        measure.torque += v * cross(l, n);
        const Vec6 along{n, arm};
        for (int r = 0; r < 6; ++r) {
          for (int c = 0; c < 6; ++c) stiffness.m[r][c] += area * along[r] * along[c];
        }
        for (int r = 0; r < 3; ++r) {
          for (int c = 0; c < 3; ++c) {
            moments.first[r][c] += v * l[r] * n[c];
            stiffness.m[r + 3][c + 3] -= v * (l[r] * n[c] - (r == c ? dot(l, n) : 0));
          }
        }
        moments.polar += v * dot(arm, arm);
        lever_W += v * l;
      }
    }
    lever_W = lever_W / volume;
    for (const auto& [l, v] : columns) {
      const Vec3d off = l - lever_W;
      mean_distance += v / volume * norm(off - dot(off, n) * n);
    }
  }
  ContactPatch patch() const { return contact_patch(measure, volume, stiffness, moments); }
};

double of_rectangle(double a, double b) {  // mean distance from the middle of 2a x 2b, closed form
  const double d = std::hypot(a, b);
  return (2 * d + b * b / a * std::log((a + d) / b) + a * a / b * std::log((b + d) / a)) / 6;
}

TEST(ContactPatch, OfADiscAndOfRectanglesFromTheirMoments) {
  test::Random random(1);
  for (int n = 0; n < 6; ++n) {
    const Vec3d foot = random.in_box(0.1);
    const Quaternion q = random.rotation(3);
    const double r = 0.013;
    const Columns disc(r, r, foot, q,
                       [&](double x, double y) { return r * r - x * x - y * y > 0 ? 1e-3 : 0; });
    EXPECT_NEAR(norm(disc.patch().lever_W - disc.lever_W), 0, 1e-9);
    EXPECT_NEAR(disc.patch().torsion_radius, 2 * r / 3, 0.002 * r);
    for (const double aspect : {1.0, 1.5, 2.0, 4.0, 10.0}) {
      const double a = 0.02, b = a / aspect;
      const Columns rectangle(a, b, foot, q, [](double, double) { return 1e-3; });
      EXPECT_NEAR(rectangle.mean_distance, of_rectangle(a, b), 1e-4 * a);
      EXPECT_NEAR(rectangle.patch().torsion_radius, of_rectangle(a, b), 0.022 * of_rectangle(a, b))
          << aspect;
    }
    // Deeper parts press more: a ball on a plane, and a box on its edge.
    const Columns ball(r, r, foot, q, [&](double x, double y) { return r * r - x * x - y * y; });
    EXPECT_NEAR(ball.patch().torsion_radius, 8 * r / 15, 0.025 * r);
    const Columns edge(0.02, 0.005, foot, q,
                       [&](double x, double y) { return 1e-3 * (1 + 40 * x) * (y > 0 ? 1 : 2); });
    EXPECT_NEAR(norm(edge.patch().lever_W - edge.lever_W), 0, 1e-9);
    EXPECT_NEAR(edge.patch().torsion_radius, edge.mean_distance, 0.04 * edge.mean_distance);
  }
}

TEST(ContactPatch, OfTwoFeetAndOfNothing) {
  const ContactPatch a{{0.03, 0, 0}, 0.004, 1, 0, {}}, b{{-0.01, 0, 0}, 0.001, 0, 0.7, {}};
  const ContactPatch both = joined(a, 3, b, 1);
  EXPECT_NEAR(both.lever_W.x, 0.02, 1e-15);
  EXPECT_NEAR(both.share, 0.75, 1e-15);
  EXPECT_NEAR(both.own_friction, 0.175, 1e-15);
  EXPECT_NEAR(both.torsion_radius, std::sqrt(0.75 * 16e-6 + 0.25 * 1e-6 + 3.0 / 16 * 16e-4), 1e-12);
  EXPECT_EQ(joined(a, 0, b, 0).torsion_radius, a.torsion_radius);
  EXPECT_EQ(contact_patch({}, 0, {}, {}).torsion_radius, 0);
  EXPECT_EQ(guessed_patch({}, 0, test::box_tool(), {}).torsion_radius, 0);
  // Forces that cancel, a wrench without a volume, a tool without one.
  const VolumeWrench wrench{{0, 0, 1e-7}, {}};
  for (const ContactPatch& none :
       {guessed_patch({}, 1e-6, test::box_tool(), {}),
        guessed_patch(wrench, 0, test::box_tool(), {}), guessed_patch(wrench, 1e-6, {}, {}),
        contact_patch({}, 1e-6, {}, {}), contact_patch(wrench, 0, {}, {})}) {
    EXPECT_EQ(none.lever_W, Vec3d{});
    EXPECT_EQ(none.torsion_radius, 0);
  }
}

// The ground under two feet is the mean, weighted by the force on each.
TEST(ContactPatch, TheGroundUnderTwoFeetIsTheirMean) {
  test::Random random(4);
  const auto fill = [&](Ground& ground) {
    for (double* number : {&ground.share, &ground.friction, &ground.static_friction,
                           &ground.viscous, &ground.ridges, &ground.grain}) {
      *number = random.uniform(0.1, 1);
    }
    ground.velocity_W = random.in_box(1);
    ground.turning_W = random.in_box(1);
  };
  for (int i = 0; i < 20; ++i) {
    ContactPatch a, b;
    fill(a.ground);
    fill(b.ground);
    const double f = random.uniform(0.1, 9), g = random.uniform(0.1, 9);
    const Ground both = joined(a, f, b, g).ground;
    for (const auto number : {&Ground::share, &Ground::friction, &Ground::static_friction,
                              &Ground::viscous, &Ground::ridges, &Ground::grain}) {
      EXPECT_NEAR((f + g) * both.*number, f * a.ground.*number + g * b.ground.*number, 1e-12);
    }
    for (const auto v : {&Ground::velocity_W, &Ground::turning_W}) {
      EXPECT_LT(norm((f + g) * both.*v - f * a.ground.*v - g * b.ground.*v), 1e-12);
    }
  }
}

// A ball: as far out as it is, where the wrench points.
TEST(ContactPatch, IsGuessedFromTheWrench) {
  test::Random random(2);
  const double r = 0.02, v = 4.0 / 3 * kPi * r * r * r;
  MassProperties ball{v, {}, {}};
  for (int i = 0; i < 3; ++i) ball.inertia.m[i][i] = 0.4 * v * r * r;
  for (int i = 0; i < 100; ++i) {
    const Vec3d n = random.direction(), aside = 0.3 * r * cross(n, random.direction());
    const Vec3d force = 1e-7 * n;
    const ContactPatch patch =
        guessed_patch({force, cross(aside, force)}, 1e-7, ball, random.rotation(3));
    EXPECT_NEAR(norm(patch.lever_W - (aside - r * n)), 0, 1e-9);
    // A torque that no point of the tool explains: as far aside as the tool may be wide.
    const Vec3d far = 9 * r * normalized(aside);
    const ContactPatch widest =
        guessed_patch({force, cross(far, force)}, 1e-7, ball, random.rotation(3));
    EXPECT_NEAR(norm(widest.lever_W - (std::sqrt(3) * r * normalized(aside) - r * n)), 0, 1e-9);
  }
}

TEST(Tangents, TurnWithTheNormalAndKeepTheirLength) {
  test::Random random(3);
  for (int i = 0; i < 1000; ++i) {
    const Vec3d a = random.direction(), b = normalized(a + 0.9 * random.in_box(1));
    const Vec3d t = first_tangent(a);
    EXPECT_NEAR(dot(t, a), 0, 1e-15);
    EXPECT_NEAR(norm(t), 1, 1e-15);
    if (!(dot(a, b) > 0)) continue;
    const Vec3d v = 0.3 * t + 0.4 * cross(a, t), turned = rotated_along(v, a, b);
    EXPECT_NEAR(dot(turned, b), 0, 1e-14);
    EXPECT_NEAR(norm(turned), 0.5, 1e-14);
  }
}

}  // namespace
}  // namespace palpate
