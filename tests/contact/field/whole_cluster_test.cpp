// Clusters that lie deep count as one ball each: the rule against differences, the measure against
// its definition in double while clusters are between, and both against all elements by themselves.
#include "src/contact/internal/whole_cluster.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "palpate/contact/contact.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/field_truth.h"
#include "tests/test_util/frozen_field.h"
#include "tests/test_util/hull_scenes.h"
#include "tests/test_util/hull_truth.h"

namespace palpate {
namespace {

using test::ElementTruth;
using test::FrozenField;
using test::grid_tool;
using test::Random;

FrozenField wall(UnseenSpace unseen = UnseenSpace::solid) {
  return FrozenField(test::noisy_wall(160, 120, 140, 0.6, 0.00005, 20), {.unseen = unseen});
}
FrozenField block() {
  return FrozenField(test::stepped_wall(160, 120, 140, 0.6, 0.12, 0.0005, 4, [](int u, int v) {
                       return u > 50 && u < 100 && v > 40 && v < 85;
                     }).cloud);
}

Pose random_pose(Random& random) {
  const double x = random.uniform(-0.06, 0.06), y = random.uniform(-0.04, 0.04);
  return {{x, y, random.uniform(0.6, 0.66)}, random.rotation(3.0)};
}

Pose moved(const Tool& tool, const Pose& X_WT, const Vec3d& shift, const Vec3d& turn) {
  const Vec3d C_T = tool.sphere_mass().center_of_mass;
  Pose pose{{}, normalized(Quaternion{turn.x / 2, turn.y / 2, turn.z / 2, 1}) * X_WT.rotation};
  pose.translation = X_WT * C_T + shift - rotate(pose.rotation, C_T);
  return pose;
}

struct Truth {
  Penetration sum, of_elements;  ///< the latter with all elements by themselves
  int num_wholes = 0, num_between = 0;
};
Truth truth_of(const Tool& tool, const FieldElements& elements, const FrozenField& scene,
               const Pose& X_WT, double longest = test::kLongest) {
  const auto sample = test::sampling(scene.field.view());
  const auto all = test::elements_truth(tool, elements, X_WT, sample);
  const auto apart = test::elements_truth(tool, elements, X_WT, sample, false);
  Truth truth{test::sum_of(all, longest), test::sum_of(apart, longest)};
  for (std::size_t i = apart.size(); i < all.size(); ++i) {
    ++truth.num_wholes;
    const ElementTruth& first = *std::ranges::find(all, all[i].cluster, &ElementTruth::cluster);
    truth.num_between += first.factor > 0;
  }
  return truth;
}

TEST(WholeCluster, DerivativesAreThoseOfTheShare) {
  constexpr double kDepth = 0.01, kStep = 1e-7;
  for (double phi = -0.0251; phi < 0; phi += 0.00037) {
    const Curved<double> low = whole_share(phi - kStep, kDepth), at = whole_share(phi, kDepth),
                         high = whole_share(phi + kStep, kDepth);
    EXPECT_NEAR(at.slope, (high.value - low.value) / (2 * kStep), 1e-3) << phi;
    EXPECT_NEAR(at.bend, (high.slope - low.slope) / (2 * kStep), 1e-1) << phi;
    const double x = std::clamp((-phi - kDepth) / kDepth, 0.0, 1.0);
    EXPECT_NEAR(at.value, x * x * (3 - 2 * x), 1e-6);
    if (x == 0 || x == 1) {
      EXPECT_EQ(at.value, x);
    }
  }
}

TEST(WholeCluster, HasWhatItsElementsHave) {
  const Tool tool = grid_tool();
  const FieldElements elements(tool, SphereVolumes::represented);
  double volume = 0, counted = 0, squares = 0, all_squares = 0;
  Vec3d first;
  for (std::size_t i = 0; i < elements.wholes.x.size(); ++i) {
    const WholeClusters& w = elements.wholes;
    const double its = w.factor[i] * sphere_volume(static_cast<double>(w.radius[i]));
    volume += its;
    counted += w.counted[i];
    const Vec3d at = to_double(Vec3f{w.x[i], w.y[i], w.z[i]});
    first += its * at;
    // Second moments about an axis are those about the centroid, and two thirds of its distance.
    squares += static_cast<double>(w.polar[i]) + 2.0 / 3 * its * dot(at, at);
  }
  for (std::size_t slot = 0; slot < elements.radius.size(); ++slot) {
    const double radius = elements.radius[slot];
    const SphereClusters& c = elements.clusters;
    const Vec3d at = to_double(Vec3f{c.x[slot], c.y[slot], c.z[slot]});
    all_squares += static_cast<double>(elements.factor[slot]) * sphere_volume(radius) *
                   (0.4 * radius * radius + 2.0 / 3 * dot(at, at));
  }
  EXPECT_NEAR(squares, all_squares, 1e-5 * all_squares);
  const double full = full_volume(tool, SphereVolumes::represented);
  EXPECT_NEAR(volume, full, 1e-5 * full);
  EXPECT_EQ(counted, static_cast<double>(tool.spheres().size()));
  EXPECT_NEAR(norm(first / full - (mass_properties(tool.mesh()).center_of_mass -
                                   tool.sphere_mass().center_of_mass)),
              0, 1e-5);
}

TEST(WholeCluster, EqualsItsDefinitionAndIsCloseToItsElements) {
  const Tool tool = grid_tool();
  const FieldElements elements(tool, SphereVolumes::represented);
  const double full = full_volume(tool, SphereVolumes::represented);
  Random random(2);
  int num_wholes = 0, num_between = 0;
  for (const FrozenField& scene : {wall(), wall(UnseenSpace::fade), block()}) {
    const auto query = make_contact_query(Place::cpu(), tool, FieldMethod{}).value();
    std::vector<double> off;
    for (int i = 0; i < 30; ++i) {
      const Pose X_WT = random_pose(random);
      const Penetration got = query->measure(scene.surface(), X_WT).penetration;
      const Truth want = truth_of(tool, elements, scene, X_WT);
      num_wholes += want.num_wholes;
      num_between += want.num_between;
      EXPECT_NEAR(got.volume, want.sum.volume, 2e-5 * full);
      EXPECT_NEAR(got.potential, want.sum.potential, 2e-6 * full);
      EXPECT_NEAR(norm(got.measure_W.force - want.sum.measure_W.force), 0, 1e-4 * full);
      EXPECT_NEAR(norm(got.measure_W.torque - want.sum.measure_W.torque), 0, 1e-5 * full);
      EXPECT_NEAR(got.num_inside_spheres, want.of_elements.num_inside_spheres, 1);
      EXPECT_NEAR(got.volume, want.of_elements.volume, 1e-3 * full);
      off.push_back(norm(got.measure_W.force - want.of_elements.measure_W.force) / full);
    }
    // Measured: 0.3 to 0.5 % of the tool in the median.
    std::ranges::sort(off);
    EXPECT_LT(off[off.size() / 2], 0.01);
    EXPECT_LT(off.back(), 0.02);
  }
  EXPECT_GT(num_between, 100);
  EXPECT_GT(num_wholes, 2 * num_between);
}

TEST(WholeCluster, OfSeveralCamerasEqualsItsDefinition) {
  const Tool tool = grid_tool();
  const double full = full_volume(tool, SphereVolumes::represented);
  const test::HullScene scene = test::smooth_scene(2);
  const auto query = make_contact_query(Place::cpu(), tool, FieldMethod{}).value();
  Random random(7);
  int num_deep = 0;
  for (int i = 0; i < 12; ++i) {
    const Pose X_WT{random.in_box(0.05) + Vec3d{0, 0, 0.8}, random.rotation(3.0)};
    const Penetration want = test::hull_truth(tool, scene.views, X_WT, SphereVolumes::represented);
    const Penetration got = query->measure(scene.views, X_WT).penetration;
    num_deep += want.volume > 0.8 * full;
    EXPECT_NEAR(got.volume, want.volume, 3e-5 * full);
    EXPECT_NEAR(got.potential, want.potential, 4e-6 * full);
    EXPECT_NEAR(norm(got.measure_W.force - want.measure_W.force), 0, 2e-4 * full);
    EXPECT_NEAR(norm(got.measure_W.torque - want.measure_W.torque), 0, 2e-5 * full);
    EXPECT_NEAR(got.unseen_volume, want.unseen_volume, 0.02 * full);
  }
  EXPECT_GT(num_deep, 2);
}

// The definition is in double, and no gradient in it is shortened.
TEST(WholeCluster, WrenchIsMinusTheDerivativeOfThePotential) {
  const Tool tool = grid_tool();
  const FieldElements elements(tool, SphereVolumes::represented);
  Random random(3);
  int num_between = 0;
  for (const FrozenField& scene : {wall(), block()}) {
    for (int i = 0; i < 5; ++i) {
      const Pose X_WT = random_pose(random);
      const Truth at = truth_of(tool, elements, scene, X_WT, 1e9);
      num_between += at.num_between;
      const auto potential = [&](const Vec3d& shift, const Vec3d& turn) {
        return truth_of(tool, elements, scene, moved(tool, X_WT, shift, turn)).sum.potential;
      };
      for (int axis = 0; axis < 3; ++axis) {
        constexpr double kStep = 1e-6;
        Vec3d step;
        step[axis] = kStep;
        const double force = -(potential(step, {}) - potential(-step, {})) / (2 * kStep);
        const double torque = -(potential({}, step) - potential({}, -step)) / (2 * kStep);
        EXPECT_NEAR(at.sum.measure_W.force[axis], force, 2e-4 * at.sum.volume + 1e-12);
        EXPECT_NEAR(at.sum.measure_W.torque[axis], torque, 1e-5 * at.sum.volume + 1e-13);
      }
    }
  }
  EXPECT_GT(num_between, 20);
}

// Second derivatives jump between pixels, so the few worst of all entries are left out.
TEST(WholeCluster, StiffnessIsMinusTheDerivativeOfTheWrench) {
  const Tool tool = grid_tool();
  const FieldElements elements(tool, SphereVolumes::represented);
  const FrozenField scene = wall();
  const auto query = make_contact_query(Place::cpu(), tool, FieldMethod{}).value();
  Random random(5);
  int num_between = 0;
  std::vector<double> errors;
  for (int i = 0; i < 10; ++i) {
    const Pose X_WT = random_pose(random);
    const Truth at = truth_of(tool, elements, scene, X_WT);
    const double longer = truth_of(tool, elements, scene, X_WT, 1e9).sum.measure_W.force.z;
    if (at.num_between == 0 || longer != at.sum.measure_W.force.z) continue;
    num_between += at.num_between;
    const Stiffness got = *query->measure(scene.surface(), X_WT, {.stiffness = true}).stiffness;
    for (int column = 0; column < 6; ++column) {
      constexpr double kStep = 1e-7;
      const auto wrench = [&](double step) {
        Vec3d shift, turn;
        (column < 3 ? shift : turn)[column % 3] = step;
        return truth_of(tool, elements, scene, moved(tool, X_WT, shift, turn)).sum.measure_W;
      };
      const VolumeWrench low = wrench(-kStep), high = wrench(kStep);
      for (int axis = 0; axis < 3; ++axis) {
        const double force = -(high.force[axis] - low.force[axis]) / (2 * kStep);
        const double torque = -(high.torque[axis] - low.torque[axis]) / (2 * kStep);
        errors.push_back(std::abs(got.m[axis][column] - force) / at.sum.volume);
        errors.push_back(std::abs(got.m[axis + 3][column] - torque) / at.sum.volume / 0.03);
      }
    }
  }
  EXPECT_GT(num_between, 20);
  ASSERT_GT(errors.size(), 100u);
  std::ranges::sort(errors);
  // Entries are up to about 50 1/m.
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.05);
}

}  // namespace
}  // namespace palpate
