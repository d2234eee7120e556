// Bodies that sample each other's distance fields: closed forms, finite differences, and the laws a
// force must keep.
#include "src/contact/bodies/solid_contact.h"

#include <cmath>
#include <cstring>
#include <utility>

#include <gtest/gtest.h>

#include "palpate/contact/body_contact.h"
#include "palpate/packing/packing.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/body_motion.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

using test::Random;
using test::random_body_pose;

Tool packed(const TriangleMesh& mesh, int num_spheres) {
  return Tool::pack(mesh, {.max_spheres = num_spheres}).value();
}

SolidContact contact_of(const Tool& a, const Tool& b, Isa isa = best_isa()) {
  return {ToolIndex::create(a), ToolIndex::create(b), isa};
}

/// Two unequal bodies, one of them with a hole; their fields are made once.
struct TorusAndBox {
  TorusAndBox() : torus(made().first), box(made().second) {}

  const Tool &torus, &box;

 private:
  static const std::pair<Tool, Tool>& made() {
    static const std::pair<Tool, Tool> bodies{
        packed(make_torus(0.05, 0.02, 24, 16), 700).with_solid_field(),
        packed(make_box({0.09, 0.07, 0.05}), 500).with_solid_field()};
    return bodies;
  }
};

/// Poses at which they share something.
template <class Visit>
void for_each_contact(const Tool& a, const Tool& b, int num, const Visit& visit) {
  SolidContact contact = contact_of(a, b);
  Random random(8);
  for (int found = 0; found < num;) {
    const Pose X_WB = random_body_pose(random, 0.1);
    const Pose X_WA = X_WB * random_body_pose(random, 0.06);
    const BodyPenetration result = contact.measure(X_WA, X_WB, true);
    if (!(result.on_a.volume > 1e-6)) continue;
    ++found;
    visit(contact, X_WA, X_WB, result);
  }
}

TEST(SolidContact, TwoBallsShareALens) {
  // Meshes of as much volume as the ball between their corners and their faces.
  const Tool large = packed(make_shape("sphere", 0.1).value(), 3000);
  const Tool small = packed(make_shape("sphere", 0.06).value(), 3000);
  const auto radius = [](const Tool& tool) {
    return std::cbrt(tool.mesh_mass().volume * 3 / (4 * kPi));
  };
  const double a = radius(large), b = radius(small), whole = sphere_volume(b);
  SolidContact contact = contact_of(large, small);
  for (const double share : {1.2, 0.95, 0.8, 0.6, 0.4}) {
    const Vec3d d = share * (a + b) * normalized(Vec3d{1, 2, -0.5});
    const BodyPenetration result = contact.measure({}, {d, axis_angle({1, 1, 0}, 1)});
    const double lens = lens_volume(a, b, norm(d));
    EXPECT_NEAR(result.on_a.volume, lens, 0.01 * whole) << share;
    if (share > 1) {
      EXPECT_EQ(result.on_a.volume, 0);
      EXPECT_EQ(result.num_pairs, 0);
      continue;
    }
    const Vec3d f = result.on_a.measure_W.force;
    EXPECT_LE(norm(cross(f, d)), 0.03 * norm(f) * norm(d));
    EXPECT_LT(dot(f, d), 0);
    EXPECT_LE(norm(result.on_a.measure_W.torque), 0.03 * norm(f) * a);
    EXPECT_GT(result.on_a.num_boundary_spheres, 0);
    EXPECT_GT(result.on_b.num_boundary_spheres, 0);
  }
}

TEST(SolidContact, AFaceIsFeltAsItIs) {
  const Tool cube = packed(make_box({0.1, 0.1, 0.1}), 1000);
  const Tool block = packed(make_box({0.4, 0.4, 0.4}), 300);
  SolidContact contact = contact_of(cube, block);
  for (const double depth : {0.0, 0.01, 0.03, 0.06, 0.1}) {
    // Face on face, turned about the normal; the block's face looks along -z, at its own z = -0.2.
    const Pose X_WA{{0.02, -0.01, -0.25 + depth}, axis_angle({0, 0, 1}, 0.5)};
    const BodyPenetration result = contact.measure(X_WA, {});
    const double exact = 0.01 * depth;
    const Vec3d f = result.on_a.measure_W.force;
    EXPECT_NEAR(result.on_a.volume, exact, 0.01 * 1e-3) << depth;
    EXPECT_LE(std::hypot(f.x, f.y), 1e-4 * norm(f)) << "less than 0.01 degrees off";
    EXPECT_NEAR(-f.z, result.on_a.volume, 1e-5 * exact);
    // The force of a face acts in the middle of what is behind it.
    EXPECT_LE(norm(result.on_a.measure_W.torque), 2e-3 * 0.05 * (exact + 1e-5));
    EXPECT_EQ(result.on_b.num_boundary_spheres, 0) << "coarse beside the cube: not asked";
  }
}

// Two cubes face on face, each of which samples the other: a square under even pressure.
TEST(SolidContact, MomentsAreThoseOfTheFace) {
  const Tool cube = packed(make_box({0.1, 0.1, 0.1}), 1000);
  SolidContact contact = contact_of(cube, cube);
  for (const double depth : {0.01, 0.02}) {
    const Pose X_WB{{0.3, -0.2, 0.1 - depth}, {}};
    const BodyPenetration result = contact.measure({{0.3, -0.2, 0}, {}}, X_WB, true);
    const double volume = 0.01 * depth;
    // Spheres at the rim of one face sample beside the other one.
    EXPECT_NEAR(result.on_a.volume, volume, 0.06 * volume);
    // Polar moment of a square: V (a^2 + a^2) / 12.
    EXPECT_NEAR(result.moments_a.polar, volume * 0.1 * 0.1 / 6, 0.2 * volume * 0.1 * 0.1 / 6);
  }
}

TEST(SolidContact, WhatLiesInAHoleIsKnownToBeFree) {
  const TorusAndBox bodies;
  const SolidPair pair(ToolIndex::create(bodies.box), ToolIndex::create(bodies.torus));
  const SolidFieldView field = view_of(*pair.field_b);  // of the torus
  SolidFrame frame;
  for (int axis = 0; axis < 3; ++axis) {
    frame.R_FE[axis][axis] = 1;
    frame.p_FC[axis] = field.box[axis] / 2;
  }
  const float room = 0.03f - 0.8660255f * field.spacing;  // the hole has a radius of 3 cm
  Cluster ball;
  for (const float share : {0.05f, 0.3f, 0.5f}) {
    ball.reach = share * room;
    EXPECT_TRUE(is_clear(field, frame, ball, 0.8660255f * field.spacing)) << share;
  }
  ball.reach = 0.031f;
  EXPECT_FALSE(is_clear(field, frame, ball, 0.8660255f * field.spacing));
}

/// Is a cube's face at z = side / 2 nearer than its others to all of another one behind it?
bool is_nearest_face(const Pose& X_WA, double side) {
  const auto corner = [&](int i) {
    return X_WA * (side / 2 * Vec3d{i & 1 ? 1.0 : -1.0, i & 2 ? 1.0 : -1.0, i & 4 ? 1.0 : -1.0});
  };
  for (int i = 0; i < 8; ++i) {
    for (const int j : {i ^ 1, i ^ 2, i ^ 4}) {
      const Vec3d a = corner(i), b = corner(j);
      if (a.z > side / 2) continue;
      // Ends of the part of this edge that is behind the face.
      const double t = b.z > side / 2 ? (side / 2 - a.z) / (b.z - a.z) : 0;
      for (const Vec3d& p : {a, a + t * (b - a)}) {
        if (std::max(std::abs(p.x), std::abs(p.y)) > p.z) return false;
      }
    }
  }
  return true;
}

// The spheres behind the face feel a corner, of which few say little: those of the corner, which
// feel the face, have to count more. With a half each these were 4.1, 1.9 and 0.9 degrees.
TEST(SolidContact, ACornerInTheFaceOfAnEqualCubeIsFeltAlongItsNormal) {
  const double side = 0.1;
  const Tool cube = packed(make_box({side, side, side}), 1000).with_solid_field();
  SolidContact contact = contact_of(cube, cube);
  const struct { double depth, max_off; } cases[] = {{0.05, 1}, {0.1, 0.25}, {0.15, 0.06}};
  for (const auto& [depth, max_off] : cases) {
    Random random(9);
    double squares = 0;
    int num = 0;
    for (int i = 0; i < 600; ++i) {
      const Quaternion turned = random.rotation(kPi);
      const double x = random.uniform(-0.01, 0.01), y = random.uniform(-0.01, 0.01);
      const Vec3d n = rotate(conjugate(turned), Vec3d{0, 0, 1});
      const double extent = side * (std::abs(n.x) + std::abs(n.y) + std::abs(n.z));
      const Pose X_WA{{x, y, side / 2 + (0.5 - depth) * extent}, turned};
      if (!is_nearest_face(X_WA, side)) continue;
      const Vec3d f = contact.measure(X_WA, {}).on_a.measure_W.force;
      const double off = std::atan2(std::hypot(f.x, f.y), f.z) * 180 / kPi;
      squares += off * off;
      ++num;
    }
    ASSERT_GT(num, 50);
    const double rms = std::sqrt(squares / num);
    RecordProperty("degrees_at_" + std::to_string(std::lround(100 * depth)), std::to_string(rms));
    EXPECT_LT(rms, max_off) << depth;
  }
}

/// Computes the volume of a cube behind a plane with normal n (in its axes), one corner at `depth`:
/// that of the corner's endless edges, less what lies beyond their ends.
double volume_behind(const Vec3d& n, double side, double depth) {
  double volume = 0;
  for (int ends = 0; ends < 8; ++ends) {
    double left = depth, sign = 1;
    for (int axis = 0; axis < 3; ++axis) {
      if ((ends >> axis & 1) == 0) continue;
      left -= side * std::abs(n[axis]);
      sign = -sign;
    }
    if (left > 0) volume += sign * left * left * left;
  }
  return volume / (6 * std::abs(n.x * n.y * n.z));
}

// Two cubes that sample each other: their weights change with the pose, which costs no energy.
TEST(SolidContact, EqualCubesPushWithoutJumpsAndWithoutGain) {
  const double side = 0.1, step = 5e-5;
  const Tool cube = packed(make_box({side, side, side}), 1000).with_solid_field();
  const Vec3d center = cube.sphere_mass().center_of_mass;
  SolidContact contact = contact_of(cube, cube);
  Random random(9);
  for (int i = 0; i < 6; ++i) {
    const Quaternion q = random.rotation(kPi);
    const double x = random.uniform(-0.01, 0.01), y = random.uniform(-0.01, 0.01);
    const Vec3d n = rotate(conjugate(q), Vec3d{0, 0, 1});
    const double extent = side * (std::abs(n.x) + std::abs(n.y) + std::abs(n.z));
    double jump = 0, exact_jump = 0, last = 0;
    for (double depth = step; depth < 0.15 * extent; depth += step) {
      const Pose X_WA{{x, y, (side + extent) / 2 - depth}, q};
      const double force = contact.measure(X_WA, {}).on_a.measure_W.force.z;
      jump = std::max(jump, std::abs(force - std::exchange(last, force)));
      exact_jump = std::max(exact_jump,
                            volume_behind(n, side, depth) - volume_behind(n, side, depth - step));
    }
    EXPECT_LT(jump, 1.25 * exact_jump) << i;
    // Around a loop in all six directions.
    const int num = 4000;
    double work = 0, all = 0;
    Pose before;
    VolumeWrench felt;
    for (int k = 0; k <= num; ++k) {
      const double t = 2 * kPi * k / num;
      const Pose X_WA{{x + 0.004 * std::sin(2 * t), y + 0.004 * std::cos(t),
                       (side + extent) / 2 - 0.004 - 0.008 * (1 - std::cos(t))},
                      axis_angle({1, 2, 3}, 0.2 * std::sin(t + 0.3)) * q};
      const VolumeWrench now = contact.measure(X_WA, {}).on_a.measure_W;
      if (k > 0) {
        const Quaternion turn = X_WA.rotation * conjugate(before.rotation);
        const double done = dot(now.force + felt.force, X_WA * center - before * center) / 2 +
                            dot(now.torque + felt.torque, Vec3d{turn.x, turn.y, turn.z});
        work += done;
        all += std::abs(done);
      }
      before = X_WA;
      felt = now;
    }
    EXPECT_LT(std::abs(work), 1e-6 * all) << i;
  }
}

TEST(SolidContact, WrenchIsTheGradientOfThePotential) {
  const TorusAndBox bodies;
  const double step = 1e-4;
  for_each_contact(bodies.torus, bodies.box, 12,
                   [&](SolidContact& contact, const Pose& X_WA, const Pose& X_WB,
                       const BodyPenetration& result) {
                     const auto check = [&](const VolumeWrench& wrench,
                                            const auto& measured_after) {
                       const std::array<double, 6> got = test::coordinates(wrench);
                       for (int k = 0; k < 6; ++k) {
                         const double length = k < 3 ? 1 : 0.05;
                         const double slope = (measured_after(k, step / length).on_a.potential -
                                               measured_after(k, -step / length).on_a.potential) /
                                              (2 * step / length);
                         EXPECT_NEAR(got[static_cast<std::size_t>(k)], -slope,
                                     1e-3 * length * result.on_a.volume)
                             << k;
                       }
                     };
                     check(result.on_a.measure_W, [&](int k, double h) {
                       const Vec3d C = bodies.torus.sphere_mass().center_of_mass;
                       return contact.measure(test::stepped(X_WA, C, k, h), X_WB);
                     });
                     check(result.on_b.measure_W, [&](int k, double h) {
                       const Vec3d C = bodies.box.sphere_mass().center_of_mass;
                       return contact.measure(X_WA, test::stepped(X_WB, C, k, h));
                     });
                   });
}

TEST(SolidContact, StiffnessIsTheSlopeOfTheWrench) {
  const TorusAndBox bodies;
  const double step = 2e-5;
  for_each_contact(bodies.torus, bodies.box, 12,
                   [&](SolidContact& contact, const Pose& X_WA, const Pose& X_WB,
                       const BodyPenetration& result) {
                     ASSERT_TRUE(result.stiffness_a && result.stiffness_b);
                     const auto check = [&](const Stiffness& k, const auto& wrench_after) {
                       // Scale of the stiffness: the area of the cut, m2.
                       double largest = 0;
                       for (int i = 0; i < 3; ++i) largest = std::max(largest, std::abs(k.m[i][i]));
                       for (int column = 0; column < 6; ++column) {
                         const double per = column < 3 ? 1 : 20;  // 1 / 0.05 m
                         const auto after = test::coordinates(wrench_after(column, step * per));
                         const auto before = test::coordinates(wrench_after(column, -step * per));
                         for (std::size_t row = 0; row < 6; ++row) {
                           const double slope = (after[row] - before[row]) / (2 * step * per);
                           const double length = (row < 3 ? 1 : 0.05) * (column < 3 ? 1 : 0.05);
                           // The field bends by steps from cell to cell.
                           EXPECT_NEAR(k.m[row][column], -slope, 0.03 * length * largest)
                               << row << " " << column;
                         }
                       }
                     };
                     check(*result.stiffness_a, [&](int k, double h) {
                       const Vec3d C = bodies.torus.sphere_mass().center_of_mass;
                       return contact.measure(test::stepped(X_WA, C, k, h), X_WB).on_a.measure_W;
                     });
                     check(*result.stiffness_b, [&](int k, double h) {
                       const Vec3d C = bodies.box.sphere_mass().center_of_mass;
                       return contact.measure(X_WA, test::stepped(X_WB, C, k, h)).on_b.measure_W;
                     });
                   });
}

TEST(SolidContact, StiffnessChangesNothingElse) {
  const TorusAndBox bodies;
  for_each_contact(bodies.torus, bodies.box, 5,
                   [&](SolidContact& contact, const Pose& X_WA, const Pose& X_WB,
                       const BodyPenetration& result) {
                     const BodyPenetration without = contact.measure(X_WA, X_WB);
                     EXPECT_FALSE(without.stiffness_a || without.stiffness_b);
                     EXPECT_EQ(without.on_a.volume, result.on_a.volume);
                     EXPECT_EQ(without.on_a.measure_W.force, result.on_a.measure_W.force);
                     EXPECT_EQ(without.on_b.measure_W.torque, result.on_b.measure_W.torque);
                   });
}

TEST(SolidContact, TotalMomentAboutAnyPointIsZero) {
  const TorusAndBox bodies;
  Random random(4);
  for_each_contact(
      bodies.torus, bodies.box, 30,
      [&](SolidContact&, const Pose& X_WA, const Pose& X_WB, const BodyPenetration& result) {
        const Vec3d P = random.in_box(1);
        const auto moment = [&](const VolumeWrench& w, const Vec3d& C) {
          return w.torque + cross(C - P, w.force);
        };
        const Vec3d total =
            moment(result.on_a.measure_W, X_WA * bodies.torus.sphere_mass().center_of_mass) +
            moment(result.on_b.measure_W, X_WB * bodies.box.sphere_mass().center_of_mass);
        EXPECT_EQ(result.on_b.measure_W.force, -result.on_a.measure_W.force);
        EXPECT_EQ(result.on_b.volume, result.on_a.volume);
        EXPECT_LE(norm(total), 1e-14 * result.on_a.volume);
      });
}

TEST(SolidContact, RolesCanBeSwapped) {
  const TorusAndBox bodies;
  SolidContact swapped = contact_of(bodies.box, bodies.torus);
  for_each_contact(
      bodies.torus, bodies.box, 10,
      [&](SolidContact&, const Pose& X_WA, const Pose& X_WB, const BodyPenetration& one) {
        const BodyPenetration other = swapped.measure(X_WB, X_WA, true);
        EXPECT_EQ(one.num_pairs, other.num_pairs);
        EXPECT_EQ(one.on_a.volume, other.on_b.volume);
        EXPECT_EQ(one.on_a.measure_W.force, other.on_b.measure_W.force);
        EXPECT_LE(norm(one.on_a.measure_W.torque - other.on_b.measure_W.torque),
                  1e-15 * one.on_a.volume);
        EXPECT_NEAR(one.stiffness_a->m[2][4], other.stiffness_b->m[2][4], 1e-12);
      });
}

TEST(SolidContact, SameBitsOnAllInstructionSets) {
  const TorusAndBox bodies;
  SolidContact baseline = contact_of(bodies.torus, bodies.box, Isa::baseline);
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    SolidContact wide = contact_of(bodies.torus, bodies.box, isa);
    for_each_contact(
        bodies.torus, bodies.box, 10,
        [&](SolidContact&, const Pose& X_WA, const Pose& X_WB, const BodyPenetration&) {
          const BodyPenetration want = baseline.measure(X_WA, X_WB, true);
          const BodyPenetration got = wide.measure(X_WA, X_WB, true);
          EXPECT_EQ(got.on_a.volume, want.on_a.volume);
          EXPECT_EQ(got.on_a.potential, want.on_a.potential);
          EXPECT_EQ(got.on_a.measure_W.torque, want.on_a.measure_W.torque);
          EXPECT_EQ(got.on_b.measure_W.force, want.on_b.measure_W.force);
          EXPECT_EQ(got.num_pairs, want.num_pairs);
          EXPECT_EQ(std::memcmp(got.stiffness_a->m, want.stiffness_a->m, sizeof(Stiffness)), 0);
          EXPECT_EQ(std::memcmp(got.stiffness_b->m, want.stiffness_b->m, sizeof(Stiffness)), 0);
        });
  }
}

// Far, near, inside: clusters leave out only spheres that touch nothing.
TEST(SolidContact, LeavesOutOnlyWhatIsFree) {
  const TorusAndBox bodies;
  const SolidPair pair(ToolIndex::create(bodies.torus), ToolIndex::create(bodies.box));
  const SolidFieldView field = view_of(*pair.field_b);
  const SphereClusters& clusters = pair.elements_a->clusters;
  Random random(6);
  int num_clear = 0, num_near = 0;
  for (int i = 0; i < 300; ++i) {
    SolidFrame frame, of_b;
    pair.place(random_body_pose(random, 0.12), random_body_pose(random, 0.03), frame, of_b);
    for (int cluster = 0; cluster < clusters.num_clusters(); ++cluster) {
      if (!is_clear(field, frame, clusters.clusters[static_cast<std::size_t>(cluster)],
                    pair.sampling_a.rounding[static_cast<std::size_t>(cluster)])) {
        ++num_near;
        continue;
      }
      ++num_clear;
      for (int k = 0; k < SphereClusters::kSize; ++k) {
        const auto place = static_cast<std::size_t>(cluster * SphereClusters::kSize + k);
        if (clusters.sphere_id[place] < 0) continue;
        const Vec3d c{static_cast<double>(clusters.x[place]),
                      static_cast<double>(clusters.y[place]),
                      static_cast<double>(clusters.z[place])};
        Vec3d p;
        for (int axis = 0; axis < 3; ++axis) {
          const auto& R = frame.R_FE[axis];
          p[axis] = static_cast<double>(R[0]) * c.x + static_cast<double>(R[1]) * c.y +
                    static_cast<double>(R[2]) * c.z + static_cast<double>(frame.p_FC[axis]);
        }
        // Farther from the box than its radius.
        double outside = 0, inside = -1;
        for (int axis = 0; axis < 3; ++axis) {
          const double off = std::max(-p[axis], p[axis] - static_cast<double>(field.box[axis]));
          inside = std::max(inside, off);
          outside += off > 0 ? off * off : 0;
        }
        const double distance = inside < 0 ? inside : std::sqrt(outside);
        ASSERT_GT(distance, static_cast<double>(pair.elements_a->radius[place]) * 0.9999);
      }
    }
  }
  EXPECT_GT(num_clear, 1000);
  EXPECT_GT(num_near, 500);
}

TEST(SolidContact, TheFinerWayCountsMore) {
  const auto weights = [](const Tool& a, const Tool& b) {
    const SolidPair pair(ToolIndex::create(a), ToolIndex::create(b));
    EXPECT_NEAR(pair.weights.a + pair.weights.b, 1, 1e-15);
    return pair.weights.a;
  };
  const Tool cube = packed(make_box({0.1, 0.1, 0.1}), 1000);
  const Tool coarse = packed(make_box({0.1, 0.1, 0.1}), 40);
  const Tool block = packed(make_box({1, 1, 1}), 1000);
  EXPECT_EQ(weights(cube, cube), 0.5);
  EXPECT_EQ(weights(cube, block), 1);
  EXPECT_EQ(weights(block, cube), 0);
  EXPECT_GT(weights(cube, coarse), 0.5);
  EXPECT_LT(weights(cube, coarse), 1);
  EXPECT_LT(weights(coarse, cube), 0.5);
}

// A sphere samples one of the two grids whose second moments enclose its own: the sum over all
// spheres up to any place is exact but for half a sphere's choice.
TEST(SolidSampling, GridsAreAsWideAsTheSpheres) {
  const TorusAndBox bodies;
  const SolidField& field = *bodies.box.solid_field();
  const double spacing = field.layout().spacing;
  const auto last = static_cast<std::int32_t>(field.levels().size()) - 1;
  ASSERT_GE(last, 2);
  // Radii from far below the spacing to nearly the widest grid.
  SpherePacking packing;
  double at = 0;
  const double widest = 1.9 * std::ldexp(spacing, last) / 0.9;
  for (int i = 0; i < 300; ++i) {
    const double radius = 0.3 * spacing * std::pow(widest / (0.3 * spacing), i / 299.0);
    at += radius;
    packing.spheres.push_back({to_float(Vec3d{at, 0, 0}), static_cast<float>(radius * 0.999)});
    at += radius;
  }
  const Tool row = Tool::build(make_box({2 * at, 1, 1}), std::move(packing)).value();
  const FieldElements elements(row, SphereVolumes::own);
  const SolidSampling sampling(elements, field);
  double volume = 0, squares = 0, owed = 0, largest_choice = 0;
  std::vector<int> num_by_level(static_cast<std::size_t>(last) + 1);
  for (std::size_t place = 0; place < elements.radius.size(); ++place) {
    const double radius = elements.radius[place];
    const double counts = elements.factor[place] * std::pow(radius, 3);
    volume += counts, squares += counts * radius * radius;
    // Squared width, in spacings: between those of the level and of the next one.
    const double desired = std::pow(0.8944272 * radius / spacing, 2);
    const std::int32_t level = sampling.level[place];
    ASSERT_TRUE(level >= 0 && level <= last);
    ++num_by_level[static_cast<std::size_t>(level)];
    const double got = std::ldexp(1.0, 2 * level);
    if (desired < 1) {
      EXPECT_EQ(level, 0) << radius;
    } else {
      EXPECT_LT(got, 4 * desired) << radius;
      if (level < last) {
        EXPECT_GT(4 * got, desired) << radius;
      }
      if (desired < std::ldexp(1.0, 2 * last)) {
        owed += counts * (desired - got);
        largest_choice = std::max(largest_choice, counts * 3 * desired);
        EXPECT_LE(std::abs(owed), 0.5 * largest_choice * (1 + 1e-6)) << radius;
      }
    }
    // The margin of a cluster is that of its coarsest grid: half the diagonal of a cell.
    const std::size_t cluster = place / SphereClusters::kSize;
    EXPECT_GE(static_cast<double>(sampling.rounding[cluster]),
              0.8660254 * std::ldexp(spacing, level));
  }
  EXPECT_EQ(sampling.rounding.size(), elements.clusters.clusters.size());
  for (const int num : num_by_level) EXPECT_GT(num, 0);
  EXPECT_NEAR(sampling.coarseness, squares / volume + spacing * spacing,
              1e-6 * (squares / volume + spacing * spacing));
  EXPECT_TRUE(sampling.is_possible);
}

// No cluster is given more room for rounding than its widest sphere requires.
TEST(SolidSampling, SmallSpheresNeedLittleRoomForRounding) {
  const TorusAndBox bodies;
  const SolidField& field = *bodies.box.solid_field();
  const double spacing = field.layout().spacing;
  for (const double radius : {0.5 * spacing, 1.5 * spacing, 3 * spacing}) {
    SpherePacking packing;
    for (int i = 0; i < 100; ++i) {
      packing.spheres.push_back(
          {to_float(Vec3d{2.01 * radius * i, 0, 0}), static_cast<float>(radius)});
    }
    const Tool row = Tool::build(make_box({1, 1, 1}), std::move(packing)).value();
    const SolidSampling sampling(FieldElements(row, SphereVolumes::own), field);
    const int requested = radius < spacing ? 0 : (radius < 2 * spacing ? 1 : 2);
    for (const float rounding : sampling.rounding) {
      EXPECT_NEAR(static_cast<double>(rounding), 0.8660254 * std::ldexp(spacing, requested),
                  1e-3 * spacing);
    }
    EXPECT_NEAR(sampling.coarseness, radius * radius + spacing * spacing, 1e-5 * spacing * spacing);
  }
  // Spheres wider than the widest grid cannot be felt so.
  SpherePacking packing;
  packing.spheres.push_back({{0, 0, 0}, 1.0f});
  const Tool ball = Tool::build(make_box({3, 3, 3}), std::move(packing)).value();
  EXPECT_FALSE(SolidSampling(FieldElements(ball, SphereVolumes::own), field).is_possible);
}

// The stored field and one that is made now are the same.
TEST(SolidContact, AFieldThatTheToolHasIsAsked) {
  const Tool torus = packed(make_torus(0.05, 0.02, 24, 16), 700);
  const Tool box = packed(make_box({0.09, 0.07, 0.05}), 500);
  ASSERT_EQ(torus.solid_field(), nullptr);
  const TorusAndBox bodies;
  EXPECT_EQ(bodies.torus.prefix(100)->solid_field(), bodies.torus.solid_field());
  SolidContact with = contact_of(bodies.torus, bodies.box), without = contact_of(torus, box);
  const Pose X_WA{{0.03, 0.02, 0.01}, axis_angle({1, 2, 3}, 0.7)};
  const BodyPenetration got = with.measure(X_WA, {}), want = without.measure(X_WA, {});
  ASSERT_GT(want.on_a.volume, 0);
  EXPECT_EQ(got.on_a.volume, want.on_a.volume);
  EXPECT_EQ(got.on_a.measure_W.torque, want.on_a.measure_W.torque);
}

TEST(SolidContact, SameBitsEveryTimeWithoutAllocation) {
  const TorusAndBox bodies;
  SolidContact contact = contact_of(bodies.torus, bodies.box);
  const Pose X_WA{{0.03, 0.02, 0.01}, axis_angle({1, 2, 3}, 0.7)};
  const BodyPenetration first = contact.measure(X_WA, {}, true);
  ASSERT_GT(first.on_a.volume, 0);
  const test::AllocationCounter counter;
  (void)contact.measure({{1, 0, 0}, {}}, {});
  const BodyPenetration second = contact.measure(X_WA, {}, true);
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_EQ(std::memcmp(&first.on_a.measure_W, &second.on_a.measure_W, sizeof(VolumeWrench)), 0);
  EXPECT_EQ(std::memcmp(&first.on_b.measure_W, &second.on_b.measure_W, sizeof(VolumeWrench)), 0);
  EXPECT_EQ(first.on_a.potential, second.on_a.potential);
}

TEST(SolidContact, NonFinitePosesAreReportedAndFarOnesMeasureNothing) {
  const Tool cube = packed(make_box({0.1, 0.1, 0.1}), 50);
  SolidContact contact = contact_of(cube, cube);
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    const BodyPenetration bad_a = contact.measure({{bad, 0, 0}, {}}, {});
    const BodyPenetration bad_b = contact.measure({}, {{}, {0, 0, bad, 1}});
    EXPECT_EQ(bad_a.on_a.status, StepStatus::non_finite_pose);
    EXPECT_EQ(bad_a.on_b.status.bits, 0u);
    EXPECT_EQ(bad_b.on_a.status.bits, 0u);
    EXPECT_EQ(bad_b.on_b.status, StepStatus::non_finite_pose);
    EXPECT_EQ(bad_a.on_a.volume, 0);
    EXPECT_EQ(norm(bad_b.on_b.measure_W.force), 0);
  }
  for (const double far : {0.3, 1.0, 1e30, 1e300}) {
    const BodyPenetration nothing = contact.measure({{far, 0, 0}, {}}, {{0, far, 0}, {}});
    EXPECT_EQ(nothing.on_a.volume, 0);
    EXPECT_EQ(norm(nothing.on_a.measure_W.torque), 0);
  }
  EXPECT_NEAR(contact.measure({}, {}).on_a.volume, 1e-3, 1e-4) << "on top of each other";
}

}  // namespace
}  // namespace palpate
