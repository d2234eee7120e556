// A packed cube before planes: volume, torque and steps of its elements against the cube itself.
// This is the floor under every scene; that kernels add elements up rightly is tested elsewhere.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "tests/test_util/field_truth.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr double kSide = 0.1, kWhole = kSide * kSide * kSide;

/// Volume of the cube about the origin where n . x <= d: sums over its corners.
double volume_below(const Vec3d& n, double d) {
  double volume = 0, product = 1;
  int num = 0;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(n[axis]) < 1e-6) continue;
    product *= std::abs(n[axis]);
    ++num;
  }
  for (int corner = 0; corner < 8; ++corner) {
    double left = d, sign = 1;
    bool is_same = false;
    for (int axis = 0; axis < 3; ++axis) {
      const bool is_high = (corner >> axis & 1) != 0;
      if (std::abs(n[axis]) < 1e-6) {
        is_same |= is_high;
        continue;
      }
      left -= (is_high ? 0.5 : -0.5) * kSide * std::abs(n[axis]);
      if (is_high) sign = -sign;
    }
    if (!is_same) volume += sign * std::pow(std::max(left, 0.0), num);
  }
  for (int k = 2; k <= num; ++k) product *= k;
  return volume / product * std::pow(kSide, 3 - num);
}

/// The tool's answer to the solid n . x <= d, whose surface has the normal n.
Penetration cut(const Tool& tool, const FieldElements& elements, const Vec3d& n, double d) {
  const auto plane = [&](test::ElementTruth& e, const Vec3d& p, double) {
    e.phi = dot(n, p) - d;
    e.gradient = n;
  };
  return test::sum_of(test::elements_truth(tool, elements, {}, plane), test::kLongest);
}

class RepresentedCube : public testing::Test {
 protected:
  static const Tool& tool() {
    static const Tool made =
        Tool::pack(make_box({kSide, kSide, kSide}), {.max_spheres = 1000}).value();
    return made;
  }

  /// Error of the volume over all depths, rms, of the cube.
  static double volume_error(const Vec3d& n, int num_steps) {
    const FieldElements elements(tool(), SphereVolumes::represented);
    const double most = 0.5 * kSide * (std::abs(n.x) + std::abs(n.y) + std::abs(n.z));
    double squares = 0;
    for (int i = 0; i < num_steps; ++i) {
      const double d = most * (2.0 * i / (num_steps - 1) - 1);
      const double off = cut(tool(), elements, n, d).volume - volume_below(n, d);
      squares += off * off / (num_steps * kWhole * kWhole);
    }
    return std::sqrt(squares);
  }
};

TEST_F(RepresentedCube, HasTheVolumeOfTheCubeBehindPlanes) {
  const double face_on = volume_error({0, 0, 1}, 201);
  const Vec3d tilted = rotate(axis_angle({1, 2, 0.5}, 0.35), Vec3d{0, 0, 1});
  const double turned = volume_error(tilted, 81);
  test::Random random(4);
  double squares = 0;
  for (int i = 0; i < 150; ++i) {
    const double off = volume_error(rotate(random.rotation(kPi), Vec3d{0, 0, 1}), 21);
    squares += off * off / 150;
  }
  const double everywhere = std::sqrt(squares);
  std::printf("volume: face-on %.3f %%, turned %.3f %%, 150 directions %.3f %%\n", 100 * face_on,
              100 * turned, 100 * everywhere);
  EXPECT_LT(face_on, 0.0008);
  EXPECT_LT(turned, 0.0003);
  EXPECT_LT(everywhere, 0.0003);
}

TEST_F(RepresentedCube, HasItsTorqueAndSteps) {
  const FieldElements elements(tool(), SphereVolumes::represented);
  const Vec3d C = tool().sphere_mass().center_of_mass;
  test::Random random(5);
  double squares = 0;
  constexpr int kNum = 60, kPoints = 90;
  for (int i = 0; i < kNum; ++i) {
    const Vec3d n = rotate(random.rotation(kPi), Vec3d{0, 0, 1});
    const double most = 0.5 * kSide * (std::abs(n.x) + std::abs(n.y) + std::abs(n.z));
    const double d = random.uniform(-0.8, 0.2) * most;
    Vec3d first;
    for (int k = 0; k < kPoints * kPoints * kPoints; ++k) {
      const auto at = [&](int number) { return kSide * ((number + 0.5) / kPoints - 0.5); };
      const Vec3d p{at(k % kPoints), at(k / kPoints % kPoints), at(k / kPoints / kPoints)};
      // The cells that the plane cuts count by their depth.
      const double inside = std::clamp((d - dot(n, p)) * kPoints / kSide + 0.5, 0.0, 1.0);
      first += inside * (p - C) * (kWhole / (kPoints * kPoints * kPoints));
    }
    const VolumeWrench got = cut(tool(), elements, n, d).measure_W;
    const double off = norm(got.torque - cross(first, n)) / (volume_below(n, d) * 0.866 * kSide);
    squares += off * off / kNum;
  }
  double steepest = 0;
  for (double d = -0.499 * kSide; d < 0; d += 2e-5) {
    const double step = cut(tool(), elements, {0, 0, 1}, d + 2e-5).volume -
                        cut(tool(), elements, {0, 0, 1}, d).volume;
    steepest = std::max(steepest, step / (2e-5 * kSide * kSide));
  }
  std::printf("torque %.3f %%, largest step over the exact one %.3f\n", 100 * std::sqrt(squares),
              steepest);
  EXPECT_LT(std::sqrt(squares), 0.0006);
  EXPECT_LT(steepest, 1.15);
}

}  // namespace
}  // namespace palpate
