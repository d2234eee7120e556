// The field method: against brute force in double, against closed forms, and against itself: the
// wrench must be the derivative of the potential.
#include "src/contact/field/field_contact.h"

#include <cstring>

#include <gtest/gtest.h>

#include "palpate/contact/contact.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/contact_queries.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/field_truth.h"
#include "tests/test_util/frozen_field.h"

namespace palpate {
namespace {

using test::FrozenField;
using test::Random;

std::vector<Isa> isas() {
  std::vector<Isa> all;
  for (Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
    if (isa <= best_isa()) all.push_back(isa);
  }
  return all;
}

constexpr ContactOptions kOwn{.method = MethodKind::field, .volumes = SphereVolumes::own};
constexpr ContactOptions kRepresented{.method = MethodKind::field,
                                      .volumes = SphereVolumes::represented};

constexpr double kThickness = DepthFieldOptions{}.thickness;

FrozenField rough_wall(std::uint64_t seed, UnseenSpace unseen = UnseenSpace::solid,
                       double thickness = kThickness) {
  return FrozenField(test::noisy_wall(160, 120, 140, 0.6, 0.002, seed),
                     {.unseen = unseen, .thickness = thickness});
}

// A wall with so little noise that no gradient is shortened.
FrozenField calm_wall(std::uint64_t seed, UnseenSpace unseen = UnseenSpace::solid,
                      double thickness = kThickness) {
  return FrozenField(test::noisy_wall(160, 120, 140, 0.6, 0.00005, seed),
                     {.unseen = unseen, .thickness = thickness});
}

// A block in front of a wall: silhouettes on all sides, in the middle of where the tools are.
FrozenField block_before_wall(std::uint64_t seed) {
  return FrozenField(test::stepped_wall(160, 120, 140, 0.6, 0.12, 0.002, seed, [](int u, int v) {
                       return u > 50 && u < 100 && v > 40 && v < 85;
                     }).cloud);
}

FrozenField plane(const Plane<double>& plane) {
  PointCloud cloud(200, 200, Intrinsics{150, 150, 99.5, 99.5});
  for (int v = 0; v < 200; ++v) {
    for (int u = 0; u < 200; ++u) {
      const Vec3d ray{(u - 99.5) / 150, (v - 99.5) / 150, 1};
      const double z = plane.offset / dot(plane.normal, ray);
      cloud.set(static_cast<std::size_t>(v * 200 + u), to_float(z * ray), to_float(plane.normal));
    }
  }
  return FrozenField(std::move(cloud));
}

std::unique_ptr<ContactQuery> make_query(const Tool& tool, SphereVolumes volumes,
                                         Isa isa = best_isa(), ThreadPool* pool = nullptr) {
  return make_contact_query(Place::cpu(), tool, FieldMethod{volumes}, {isa, pool}).value();
}

Pose random_pose(Random& random) {
  const double x = random.uniform(-0.15, 0.15), y = random.uniform(-0.1, 0.1);
  return {{x, y, random.uniform(0.5, 0.75)}, random.rotation(3.0)};
}

Penetration brute_force(const Tool& tool, const FrozenField& scene, const Pose& X_WT,
                        SphereVolumes volumes, double longest = test::kLongest) {
  return test::field_truth(tool, scene.field.view(), X_WT, volumes, longest);
}

void expect_equals_brute_force(const FrozenField& scene) {
  Random random(2);
  for (const int num_spheres : {1, 33, 700}) {
    const Tool tool = test::random_tool(num_spheres, 0.06, 3);
    for (const Isa isa : isas()) {
      test::ContactQueries queries(tool, {isa});
      for (int i = 0; i < 60; ++i) {
        const Pose X_WT = random_pose(random);
        for (const ContactOptions& options : {kOwn, kRepresented}) {
          const Penetration got = queries.measure(scene.surface(), X_WT, options);
          const Penetration want = brute_force(tool, scene, X_WT, options.counted());
          const double scale = full_volume(tool, options);
          EXPECT_NEAR(got.volume, want.volume, 2e-5 * scale);
          EXPECT_NEAR(got.potential, want.potential, 2e-6 * scale);
          EXPECT_NEAR(norm(got.measure_W.force - want.measure_W.force), 0, 1e-4 * scale);
          EXPECT_NEAR(norm(got.measure_W.torque - want.measure_W.torque), 0, 1e-5 * scale);
          EXPECT_NEAR(got.num_inside_spheres, want.num_inside_spheres, 1);
          EXPECT_NEAR(got.num_boundary_spheres, want.num_boundary_spheres, 1);
        }
      }
    }
  }
}

TEST(FieldContact, EqualsBruteForce) {
  expect_equals_brute_force(rough_wall(1));
  expect_equals_brute_force(rough_wall(1, UnseenSpace::fade, 0.03));
}

TEST(FieldContact, EqualsBruteForceAtSilhouettes) {
  expect_equals_brute_force(block_before_wall(1));
}

void expect_derivative_of_the_potential(const FrozenField& scene) {
  const Tool tool = test::random_tool(200, 0.06, 5);
  const Vec3d C_T = tool.sphere_mass().center_of_mass;
  Random random(6);
  for (int i = 0; i < 40; ++i) {
    const Pose X_WT = random_pose(random);
    const Penetration at = brute_force(tool, scene, X_WT, SphereVolumes::own, 1e9);
    const auto potential = [&](const Vec3d& shift, const Vec3d& turn) {
      // Turned about the center of mass, which stays where it is.
      Quaternion q{turn.x / 2, turn.y / 2, turn.z / 2, 1};
      Pose moved{{}, normalized(q) * X_WT.rotation};
      moved.translation = X_WT * C_T + shift - rotate(moved.rotation, C_T);
      return brute_force(tool, scene, moved, SphereVolumes::own).potential;
    };
    for (int axis = 0; axis < 3; ++axis) {
      constexpr double kStep = 1e-6;
      Vec3d step;
      step[axis] = kStep;
      const double force = -(potential(step, {}) - potential(-step, {})) / (2 * kStep);
      const double torque = -(potential({}, step) - potential({}, -step)) / (2 * kStep);
      EXPECT_NEAR(at.measure_W.force[axis], force, 1e-4 * at.volume + 1e-12);
      EXPECT_NEAR(at.measure_W.torque[axis], torque, 1e-5 * at.volume + 1e-13);
    }
  }
}

TEST(FieldContact, WrenchIsMinusTheDerivativeOfThePotential) {
  expect_derivative_of_the_potential(rough_wall(4));
  expect_derivative_of_the_potential(rough_wall(4, UnseenSpace::fade, 0.03));
}

TEST(FieldContact, WrenchIsMinusTheDerivativeOfThePotentialAtSilhouettes) {
  expect_derivative_of_the_potential(block_before_wall(4));
}

// Differences of the wrench in double, over steps that are small against a pixel.
TEST(FieldContact, StiffnessIsTheDerivativeOfTheWrench) {
  const FrozenField scene = calm_wall(20);
  const Tool tool = test::random_tool(150, 0.06, 21);
  const Vec3d C_T = tool.sphere_mass().center_of_mass;
  const auto query = make_query(tool, SphereVolumes::own);
  Random random(22);
  int num_compared = 0;
  for (int i = 0; i < 60; ++i) {
    const Pose X_WT = random_pose(random);
    const ContactResult at = query->measure(scene.surface(), X_WT, {.stiffness = true});
    const double volume = at.penetration.volume;
    const Stiffness& got = *at.stiffness;
    // If a gradient was shortened, the stiffness is only the symmetric part.
    const auto force_along = [&](double longest) {
      return brute_force(tool, scene, X_WT, SphereVolumes::own, longest).measure_W.force;
    };
    if (norm(force_along(test::kLongest) - force_along(1e9)) > 0) continue;
    ++num_compared;
    for (int column = 0; column < 6; ++column) {
      constexpr double kStep = 1e-7;
      const auto wrench = [&](double step) {
        Vec3d shift, turn;
        (column < 3 ? shift : turn)[column % 3] = step;
        Pose moved{{},
                   normalized(Quaternion{turn.x / 2, turn.y / 2, turn.z / 2, 1}) * X_WT.rotation};
        moved.translation = X_WT * C_T + shift - rotate(moved.rotation, C_T);
        return brute_force(tool, scene, moved, SphereVolumes::own).measure_W;
      };
      const VolumeWrench low = wrench(-kStep), high = wrench(kStep);
      for (int axis = 0; axis < 3; ++axis) {
        const double force = -(high.force[axis] - low.force[axis]) / (2 * kStep);
        const double torque = -(high.torque[axis] - low.torque[axis]) / (2 * kStep);
        // Second derivatives jump between pixels: a few elements may lie on such a line.
        EXPECT_NEAR(got.m[axis][column], force, 0.02 * std::abs(force) + 0.4 * volume) << column;
        EXPECT_NEAR(got.m[axis + 3][column], torque, 0.02 * std::abs(torque) + 0.02 * volume)
            << column;
      }
    }
  }
  EXPECT_GT(num_compared, 10);
}

// Round a closed path of translation and rotation hardly any net work is done. Measured: 4.8e-4 of
// all work, because gradients where two levels meet are a little longer than a force may be; with
// none shortened 1e-7.
class ClosedLoops : public testing::TestWithParam<std::pair<UnseenSpace, double>> {};

TEST_P(ClosedLoops, CostNoWork) {
  const FrozenField scene = calm_wall(7, GetParam().first, GetParam().second);
  const Tool tool = test::random_tool(500, 0.05, 8);
  const auto query = make_query(tool, SphereVolumes::represented);
  const Vec3d C_T = tool.sphere_mass().center_of_mass;
  constexpr int kSteps = 8000;
  const auto pose = [](int k) {
    const double a = 2 * kPi * k / kSteps;
    const Quaternion q = axis_angle({1, 0.3, 0.2}, 0.4 * std::sin(a)) *
                         axis_angle({0, 1, -0.5}, 0.3 * std::cos(2 * a));
    return Pose{{0.05 * std::cos(a), 0.04 * std::sin(a), 0.59 + 0.03 * std::sin(a + 1)}, q};
  };
  double net = 0, total = 0;
  Penetration last = query->measure(scene.surface(), pose(0)).penetration;
  for (int k = 1; k <= kSteps; ++k) {
    const Penetration next = query->measure(scene.surface(), pose(k)).penetration;
    const Quaternion turn = pose(k).rotation * conjugate(pose(k - 1).rotation);
    const Vec3d shift = pose(k) * C_T - pose(k - 1) * C_T;
    const double work =
        0.5 * dot(last.measure_W.force + next.measure_W.force, shift) +
        dot(last.measure_W.torque + next.measure_W.torque, Vec3d{turn.x, turn.y, turn.z});
    net += work;
    total += std::abs(work);
    last = next;
  }
  EXPECT_GT(last.volume, 0.1 * full_volume(tool, SphereVolumes::represented));
  EXPECT_LT(std::abs(net) / total, 1e-3);
}

INSTANTIATE_TEST_SUITE_P(Thickness, ClosedLoops,
                         testing::Values(std::pair{UnseenSpace::solid, kThickness},
                                         std::pair{UnseenSpace::free, 0.02},
                                         std::pair{UnseenSpace::fade, 0.02}));

// The surface passes between two layers of spheres, has a hole in the middle of the tool, and is
// left far behind: contact neither drops nor doubles.
TEST(FieldContact, SweepsBetweenLayersThroughAHoleAndCleanThrough) {
  SpherePacking layers;
  for (const float z : {-0.012f, 0.012f}) {
    for (int i = 0; i < 49; ++i) {
      const auto at = [](int k) { return 0.01f * static_cast<float>(k - 3); };
      layers.spheres.push_back({{at(i % 7), at(i / 7), z}, 0.0049f});
    }
  }
  const Tool tool = Tool::build(make_box({0.08, 0.08, 0.04}), std::move(layers)).value();
  PointCloud holed = plane({{0, 0, -1}, -0.5}).cloud;
  for (int v = 95; v < 105; ++v) {
    for (int u = 95; u < 105; ++u) {
      holed.set(static_cast<std::size_t>(v * 200 + u), {NAN, NAN, NAN}, {0, 0, -1});
    }
  }
  const FrozenField scene(std::move(holed));
  const auto query = make_query(tool, SphereVolumes::represented);
  const double full = full_volume(tool, kRepresented);
  double last = 0;
  for (double z = 0.47; z < 0.8; z += 0.0001) {
    const Penetration got = query->measure(scene.surface(), {{0, 0, z}, {}}).penetration;
    EXPECT_GE(got.volume, last - 1e-6 * full) << z;
    EXPECT_NEAR(-got.measure_W.force.z, got.volume, 5e-2 * got.volume + 1e-6 * full) << z;
    last = got.volume;
    // The two layers stand for the whole box.
    if (std::abs(z - 0.5) < 0.02) {
      EXPECT_NEAR(got.volume / full, 0.5 + (z - 0.5) / 0.04, 0.06) << z;
    }
  }
  EXPECT_NEAR(last / full, 1, 1e-4);
}

// A tool that is pushed clean through a wall of some thickness comes out behind it, or is let go.
TEST(FieldContact, BehindTheThicknessThereIsNothing) {
  const Tool tool = test::random_tool(300, 0.02, 23);
  for (const UnseenSpace unseen : {UnseenSpace::solid, UnseenSpace::free, UnseenSpace::fade}) {
    const FrozenField scene(plane({{0, 0, -1}, -0.5}).cloud, {.unseen = unseen});
    const auto query = make_query(tool, SphereVolumes::own);
    const Penetration inside = query->measure(scene.surface(), {{0, 0, 0.525}, {}}).penetration;
    const Penetration behind = query->measure(scene.surface(), {{0, 0, 0.65}, {}}).penetration;
    EXPECT_NEAR(inside.volume / full_volume(tool, kOwn), 1, 1e-4);
    EXPECT_NEAR(inside.measure_W.force.z / inside.volume, -1, 0.05);
    const double left = unseen == UnseenSpace::solid ? 1 : 0;
    EXPECT_NEAR(behind.volume / full_volume(tool, kOwn), unseen == UnseenSpace::fade ? 1 : left,
                1e-4);
    EXPECT_NEAR(-behind.measure_W.force.z / full_volume(tool, kOwn), left, 0.05);
  }
}

TEST(FieldContact, MeasuresTheWholeToolWhenAllOfItIsInside) {
  const Tool tool = test::random_tool(300, 0.05, 9);
  const Plane<double> wall{{0, 0, -1}, -0.5};
  const FrozenField scene = plane(wall);
  test::ContactQueries queries(tool);
  const Pose deep{{0, 0, 0.65}, axis_angle({1, 2, 3}, 0.7)};
  for (const ContactOptions& options : {kOwn, kRepresented}) {
    const double volume = full_volume(tool, options);
    const Penetration got = queries.measure(scene.surface(), deep, options);
    EXPECT_NEAR(got.volume / volume, 1, 1e-5);
    EXPECT_NEAR(got.measure_W.force.z / volume, -1, 0.05);
    EXPECT_EQ(got.num_inside_spheres, 300);
  }
}

// A flat surface cuts every sphere by an exact cap; only spheres felt in parts are approximate.
TEST(FieldContact, HalfSpaceAgreesWithCaps) {
  const Tool tool = test::random_tool(400, 0.05, 10);
  const Vec3d n = normalized(Vec3d{0.2, -0.3, -1});
  const Plane<double> wall{n, dot(n, {0, 0, 0.6})};
  const FrozenField scene = plane(wall);
  const auto query = make_query(tool, SphereVolumes::own);
  const double all = full_volume(tool, SphereVolumes::own);
  Random random(11);
  for (int i = 0; i < 100; ++i) {
    const Pose X_WT{
        {random.uniform(-0.05, 0.05), random.uniform(-0.05, 0.05), random.uniform(0.52, 0.68)},
        random.rotation(3.0)};
    double volume = 0;
    for (const Sphere& s : tool.spheres()) {
      volume += cap_volume(static_cast<double>(s.radius),
                           dot(n, X_WT * to_double(s.center)) - wall.offset);
    }
    const Penetration got = query->measure(scene.surface(), X_WT).penetration;
    EXPECT_NEAR(got.volume, volume, 5e-3 * all);
    // Deep spheres are pushed by up to 5 % more, in the same direction.
    EXPECT_NEAR(norm(cross(got.measure_W.force, n)), 0, 2e-3 * all);
    EXPECT_NEAR(dot(got.measure_W.force, n), got.volume, 0.05 * got.volume + 1e-4 * all);
  }
}

TEST(FieldContact, AnyThreadsAndInstructionSetsGiveTheSameBits) {
  const FrozenField scene = rough_wall(12);
  const Tool tool = test::random_tool(900, 0.06, 13);
  Random random(14);
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT = random_pose(random);
    const Penetration want = make_query(tool, SphereVolumes::represented, Isa::baseline)
                                 ->measure(scene.surface(), X_WT)
                                 .penetration;
    for (const Isa isa : isas()) {
      for (const int threads : {1, 3}) {
        ThreadPool pool(threads);
        const auto query = make_query(tool, SphereVolumes::represented, isa, &pool);
        query->measure(scene.surface(), {{0, 0, 0.6}, {}});  // earlier queries do not matter
        const Penetration got = query->measure(scene.surface(), X_WT).penetration;
        EXPECT_EQ(std::memcmp(&got.measure_W, &want.measure_W, sizeof(VolumeWrench)), 0);
        EXPECT_EQ(got.volume, want.volume);
        EXPECT_EQ(got.potential, want.potential);
      }
    }
  }
}

/// A wall that takes a step of a few centimeters between two frames, and another camera's picture
/// of it.
struct TwoFrames {
  FrozenField from, to;
};
std::vector<TwoFrames> frame_pairs() {
  std::vector<TwoFrames> pairs;
  pairs.push_back({rough_wall(31), rough_wall(32)});
  pairs.push_back({block_before_wall(33), rough_wall(34)});
  pairs.push_back(
      {rough_wall(35, UnseenSpace::free, 0.03), rough_wall(36, UnseenSpace::free, 0.03)});
  // Elements between the two touch only one.
  pairs.push_back({rough_wall(37), FrozenField(test::noisy_wall(160, 120, 140, 0.7, 0.002, 38))});
  // No pass for both: other sizes, other cameras, other thicknesses.
  pairs.push_back({rough_wall(39), FrozenField(test::noisy_wall(96, 72, 140, 0.6, 0.002, 40))});
  pairs.push_back({rough_wall(41), FrozenField(test::noisy_wall(160, 120, 150, 0.6, 0.002, 42))});
  pairs.push_back({rough_wall(43), rough_wall(44, UnseenSpace::free, 0.03)});
  return pairs;
}

double weighed(double alpha, double from, double to) { return (1 - alpha) * from + alpha * to; }

// Against two measurements of one frame each, to the last bit.
TEST(FieldContact, OnePassBetweenTwoFramesGivesTheBitsOfTwo) {
  const Tool tool = test::random_tool(900, 0.06, 13);
  const auto index = ToolIndex::create(tool);
  const std::vector<TwoFrames> pairs = frame_pairs();
  Random random(45);
  int num_of_both = 0, num_of_one = 0;
  for (const Isa isa : isas()) {
    const auto query = make_contact_query(Place::cpu(), index, FieldMethod{}, {isa}).value();
    for (const TwoFrames& pair : pairs) {
      const SurfaceView from{{}, pair.from.field.view()}, to{{}, pair.to.field.view()};
      for (int i = 0; i < 20; ++i) {
        const Pose X_WT = random_pose(random);
        const double alpha = random.uniform(0, 1);
        const ContactWants wants{.stiffness = i % 2 == 0};
        const ContactResult a = query->measure(from, X_WT, wants),
                            b = query->measure(to, X_WT, wants);
        const ContactResult got = query->measure(from, to, alpha, X_WT, wants);
        const Penetration &p = a.penetration, &q = b.penetration, &r = got.penetration;
        num_of_both += p.volume > 0 && q.volume > 0;
        num_of_one += (p.volume > 0) != (q.volume > 0);
        EXPECT_EQ(r.volume, weighed(alpha, p.volume, q.volume));
        EXPECT_EQ(r.potential, weighed(alpha, p.potential, q.potential));
        for (int axis = 0; axis < 3; ++axis) {
          EXPECT_EQ(r.measure_W.force[axis],
                    weighed(alpha, p.measure_W.force[axis], q.measure_W.force[axis]));
          EXPECT_EQ(r.measure_W.torque[axis],
                    weighed(alpha, p.measure_W.torque[axis], q.measure_W.torque[axis]));
        }
        EXPECT_EQ(r.num_boundary_spheres, q.num_boundary_spheres);
        EXPECT_EQ(r.num_inside_spheres, q.num_inside_spheres);
        ASSERT_EQ(got.stiffness.has_value(), wants.stiffness);
        for (int k = 0; wants.stiffness && k < 36; ++k) {
          EXPECT_EQ(got.stiffness->m[k / 6][k % 6],
                    weighed(alpha, a.stiffness->m[k / 6][k % 6], b.stiffness->m[k / 6][k % 6]));
        }
      }
    }
  }
  EXPECT_GT(num_of_both, 100);
  EXPECT_GT(num_of_one, 5);
}

// The stiffness and its two frames cost no bits of the measure.
TEST(FieldContact, StiffnessChangesNoBitOfTheMeasure) {
  const Tool tool = test::random_tool(900, 0.06, 13);
  const FrozenField scene = block_before_wall(46);
  const auto query = make_contact_query(Place::cpu(), tool, FieldMethod{}).value();
  Random random(47);
  for (int i = 0; i < 40; ++i) {
    const Pose X_WT = random_pose(random);
    const SurfaceView surface{{}, scene.field.view()};
    const Penetration plain = query->measure(surface, X_WT).penetration;
    const Penetration with = query->measure(surface, X_WT, {.stiffness = true}).penetration;
    EXPECT_EQ(plain.volume, with.volume);
    EXPECT_EQ(plain.potential, with.potential);
    EXPECT_EQ(std::memcmp(&plain.measure_W, &with.measure_W, sizeof(VolumeWrench)), 0);
  }
}

TEST(FieldContact, OneFrameWithoutSurfaceSaysSo) {
  const Tool tool = test::random_tool(100, 0.06, 13);
  const FrozenField scene = rough_wall(48);
  const auto query = make_contact_query(Place::cpu(), tool, FieldMethod{}).value();
  const SurfaceView none, wall{{}, scene.field.view()};
  const Pose X_WT{{0, 0, 0.6}, {}};
  const double whole = query->measure(wall, X_WT).penetration.volume;
  for (const auto& [from, to] : {std::pair(none, wall), std::pair(wall, none)}) {
    const Penetration got = query->measure(from, to, 0.25, X_WT, {.stiffness = true}).penetration;
    EXPECT_TRUE(got.status.has(StepStatus::no_surface));
    EXPECT_EQ(got.volume, (to.field.num_levels > 0 ? 0.25 : 0.75) * whole);
  }
}

TEST(FieldContact, AllocatesNothing) {
  const FrozenField scene = rough_wall(15);
  const Tool tool = test::random_tool(100, 0.06, 16);
  const auto query = make_query(tool, SphereVolumes::represented);
  const test::AllocationCounter counter;
  for (int i = 0; i < 10; ++i) query->measure(scene.surface(), {{0, 0, 0.55 + 0.01 * i}, {}});
  EXPECT_EQ(counter.count(), 0);
}

TEST(FieldContact, StatesAndPlanesDescribeTheContact) {
  const Tool tool = test::random_tool(100, 0.05, 17);
  const Plane<double> wall{{0, 0, -1}, -0.6};
  const FrozenField scene = plane(wall);
  test::ContactQueries queries(tool);
  const Pose X_WT{{0, 0, 0.6}, axis_angle({1, 1, 0}, 0.4)};
  for (const ContactOptions& options : {kOwn, kRepresented}) {
    const auto whole = test::whole_contact(queries.by(options), scene.surface(), X_WT);
    const Penetration& got = whole.penetration;
    int num_inside = 0, num_boundary = 0;
    for (std::size_t id = 0; id < tool.spheres().size(); ++id) {
      const Sphere ball = field_ball(tool, id, options.counted());
      const double distance = 0.6 - (X_WT * to_double(ball.center)).z;
      const double r = ball.radius;
      const SphereState state = whole.states[id];
      num_inside += state == SphereState::inside;
      num_boundary += state == SphereState::boundary;
      if (std::abs(std::abs(distance) - r) < 1e-6) continue;
      EXPECT_EQ(state, distance >= r   ? SphereState::outside
                       : distance > -r ? SphereState::boundary
                                       : SphereState::inside);
      if (state == SphereState::outside) continue;
      const Plane<float>& cut = whole.planes[id];
      const Vec3d n_W = rotate(X_WT.rotation, to_double(cut.normal));
      EXPECT_NEAR(norm(n_W - wall.normal), 0, 1e-4);
      EXPECT_NEAR(
          dot(to_double(cut.normal), to_double(ball.center)) - static_cast<double>(cut.offset),
          distance, 1e-5 + (distance < -1.3 * r ? -0.35 * distance : 0));
    }
    EXPECT_EQ(num_inside, got.num_inside_spheres);
    EXPECT_EQ(num_boundary, got.num_boundary_spheres);
  }
}

// To the bit: numbers that are sums of powers of two.
TEST(FieldContact, WhatTouchesInOnePointIsOutside) {
  const FrozenField scene = plane({{0, 0, -1}, -0.5});
  SpherePacking one;
  one.spheres = {{{}, 0.015625f}};
  const Tool tool = Tool::build(make_box({0.03, 0.03, 0.03}), std::move(one)).value();
  SphereState state;
  for (const Isa isa : isas()) {
    const auto query =
        make_contact_query(Place::cpu(), tool, FieldMethod{SphereVolumes::own}, {isa}).value();
    for (const double deeper : {0.0, 0.0009765625}) {
      const Pose X_WT{{0, 0, 0.5 - 0.015625 + deeper}, {}};
      const Penetration got =
          query->measure({{}, scene.field.view()}, X_WT, {.states = {&state, 1}}).penetration;
      EXPECT_EQ(state, deeper > 0 ? SphereState::boundary : SphereState::outside);
      EXPECT_EQ(got.num_boundary_spheres, deeper > 0 ? 1 : 0);
    }
  }
}

// All elements together have the moments of the solid, whatever its spheres leave free.
TEST(FieldElements, AreWhereTheVolumeIs) {
  const Tool tool = test::random_tool(400, 0.05, 24);
  const Vec3d C_T = tool.sphere_mass().center_of_mass;
  for (const SphereVolumes volumes : {SphereVolumes::own, SphereVolumes::represented}) {
    for (const LargeSpheres large : {LargeSpheres::in_thirty, LargeSpheres::evenly}) {
      const FieldElements elements(tool, volumes, large);
      double sum = 0, counted = 0, second = 0;
      Vec3d first;
      for (std::size_t i = 0; i < elements.radius.size(); ++i) {
        const double r = elements.radius[i];
        const double volume = static_cast<double>(elements.factor[i]) * sphere_volume(r);
        const SphereClusters& at = elements.clusters;
        const Vec3d p = to_double(Vec3f{at.x[i], at.y[i], at.z[i]});
        sum += volume;
        first += volume * p;
        second += volume * (dot(p, p) + 0.6 * r * r);
        counted += static_cast<double>(elements.counted[i]);
      }
      const double all = full_volume(tool, volumes);
      EXPECT_NEAR(sum, all, 1e-6 * all);
      EXPECT_EQ(counted, 400);
      // Torques are about the center of mass of the spheres.
      const MassProperties& mass =
          volumes == SphereVolumes::own ? tool.sphere_mass() : tool.mesh_mass();
      const Vec3d lever = mass.center_of_mass - C_T;
      EXPECT_LE(norm(first - all * lever), 2e-5 * all) << "meters";
      // Half the trace of the inertia about the center of mass is the second moment.
      const double want =
          0.5 * (mass.inertia.m[0][0] + mass.inertia.m[1][1] + mass.inertia.m[2][2]) +
          all * dot(lever, lever);
      EXPECT_NEAR(second, want, 0.003 * want);
    }
  }
}

/// Each of them is as large as the tool: in parts as fine as those of a packing they would be a
/// million.
TEST(FieldElements, CoincidentSpheresHaveFewParts) {
  constexpr std::size_t kNum = 500;
  SpherePacking packing;
  packing.spheres.assign(kNum, {{0, 0, 0}, 0.01f});
  const Tool tool = Tool::build(make_icosphere(0.011, 2), std::move(packing)).value();
  for (const LargeSpheres large : {LargeSpheres::in_thirty, LargeSpheres::evenly}) {
    const FieldElements elements(tool, SphereVolumes::own, large);
    EXPECT_LT(elements.radius.size(), 60 * kNum);
    double sum = 0;
    for (std::size_t i = 0; i < elements.radius.size(); ++i) {
      sum += static_cast<double>(elements.factor[i]) *
             sphere_volume(static_cast<double>(elements.radius[i]));
    }
    const double all = full_volume(tool, SphereVolumes::own);
    EXPECT_NEAR(sum, all, 1e-5 * all);
  }
}

TEST(FieldContact, BadPosesAndNoFieldGiveNothing) {
  const Tool tool = test::random_tool(50, 0.05, 18);
  const FrozenField scene = rough_wall(19);
  const auto query = make_query(tool, SphereVolumes::own);
  const Penetration bad = query->measure(scene.surface(), {{0, 0, NAN}, {}}).penetration;
  EXPECT_EQ(bad.volume, 0);
  EXPECT_EQ(bad.status, StepStatus::non_finite_pose);
  // Far away, behind the camera, and large numbers.
  for (const Vec3d& p : {Vec3d{0, 0, -3}, {1e9, 0, 1}, {0, 0, 0}, {0, 1e30, 1e30}}) {
    const Penetration far = query->measure(scene.surface(), {p, {}}).penetration;
    EXPECT_EQ(far.volume, 0) << p.x << " " << p.z;
    EXPECT_TRUE(std::isfinite(norm(far.measure_W.force)));
  }
  EXPECT_EQ(query->measure(SurfaceView{}, {{0, 0, 0.6}, {}}).penetration.volume, 0);
}

}  // namespace
}  // namespace palpate
