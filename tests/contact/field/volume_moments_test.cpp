// Moments of the contact volume: against brute force in double, on all instruction sets and
// between two surfaces.
#include <gtest/gtest.h>

#include "src/contact/field/field_contact.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/field_truth.h"
#include "tests/test_util/frozen_field.h"

namespace palpate {
namespace {

using test::FrozenField;

/// Computes the moments by definition, element by element; a cut ball in slices.
VolumeMoments brute_force(const Tool& tool, const FrozenField& scene, const Pose& X_WT,
                          SphereVolumes volumes) {
  const FieldElements elements(tool, volumes);
  VolumeMoments sum;
  for (const test::ElementTruth& at :
       test::elements_truth(tool, elements, X_WT, test::sampling(scene.field.view()))) {
    const Vec3d& lever = at.lever;
    const double r = at.radius, factor = at.factor;
    const Vec3d n = at.gradient / std::max(norm(at.gradient) / test::kLongest, 1.0);
    const double volume = at.push;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        sum.first[row][column] += lever[row] * volume * n[column];
      }
    }
    const Vec3d arm = cross(lever, n);
    sum.polar += volume * dot(arm, arm);
    constexpr int kSlices = 200;
    const double h = std::clamp(r - at.phi, 0.0, 2 * r) / kSlices;
    for (int k = 0; k < kSlices; ++k) {
      const double z = r - (k + 0.5) * h, squared = r * r - z * z;
      sum.polar += factor * kPi / 2 * squared * squared * h;
    }
  }
  return sum;
}

void expect_near(const VolumeMoments& got, const VolumeMoments& want, double volume, double size) {
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      EXPECT_NEAR(got.first[row][column], want.first[row][column], 2e-4 * volume * size);
    }
  }
  EXPECT_NEAR(got.polar, want.polar, 2e-4 * volume * size * size);
}

TEST(VolumeMoments, EqualBruteForce) {
  const FrozenField scene(test::noisy_wall(160, 120, 140, 0.6, 0.002, 4));
  test::Random random(2);
  for (const int num_spheres : {1, 33, 700}) {
    const Tool tool = test::random_tool(num_spheres, 0.06, 3);
    const auto index = ToolIndex::create(tool);
    for (const SphereVolumes volumes : {SphereVolumes::own, SphereVolumes::represented}) {
      std::vector<VolumeMoments> of_first_isa;
      for (const Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
        if (isa > best_isa()) continue;
        const auto query =
            make_contact_query(Place::cpu(), index, FieldMethod{volumes}, {.isa = isa}).value();
        test::Random poses(7);
        for (std::size_t i = 0; i < 40; ++i) {
          const double x = poses.uniform(-0.1, 0.1), y = poses.uniform(-0.1, 0.1);
          const Pose X_WT{{x, y, poses.uniform(0.52, 0.7)}, poses.rotation(3)};
          const SurfaceView surface{{}, scene.field.view()};
          const ContactResult result = query->measure(surface, X_WT, {.stiffness = true});
          expect_near(result.moments, brute_force(tool, scene, X_WT, volumes),
                      full_volume(tool, volumes), 0.06);
          const VolumeMoments none = query->measure(surface, X_WT).moments;
          EXPECT_EQ(none.polar, 0);
          if (isa == Isa::baseline) of_first_isa.push_back(result.moments);
          EXPECT_EQ(result.moments.polar, of_first_isa[i].polar);
          EXPECT_EQ(result.moments.first[2][1], of_first_isa[i].first[2][1]);
        }
      }
    }
  }
}

TEST(VolumeMoments, BetweenTwoSurfacesAreMixedAsTheMeasureIs) {
  const FrozenField a(test::noisy_wall(160, 120, 140, 0.6, 0.002, 4)),
      b(test::noisy_wall(160, 120, 140, 0.58, 0.002, 5));
  const SurfaceView from{{}, a.field.view()}, to{{}, b.field.view()};
  const Tool tool = test::random_tool(300, 0.06, 3);
  const auto query = make_contact_query(Place::cpu(), tool, FieldMethod{}).value();
  const Pose X_WT{{0.01, 0, 0.57}, {}};
  const ContactWants wants{.stiffness = true};
  const VolumeMoments m = query->measure(from, X_WT, wants).moments,
                      n = query->measure(to, X_WT, wants).moments,
                      both = query->measure(from, to, 0.3, X_WT, wants).moments;
  EXPECT_GT(m.polar, 0);
  EXPECT_NE(m.polar, n.polar);
  EXPECT_NEAR(both.polar, 0.7 * m.polar + 0.3 * n.polar, 1e-9 * m.polar);
  for (int i = 0; i < 9; ++i) {
    EXPECT_NEAR(both.first[i / 3][i % 3], 0.7 * m.first[i / 3][i % 3] + 0.3 * n.first[i / 3][i % 3],
                1e-15);
  }
}

}  // namespace
}  // namespace palpate
