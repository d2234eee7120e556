// Closed forms against quadrature and against each other (thesis Alg. 3.1, eq. 3.1).
#include <cmath>

#include <gtest/gtest.h>

#include "palpate/math/geometry.h"

namespace palpate {
namespace {

TEST(CapVolume, EqualsQuadratureOfDiscs) {
  for (double d : {-0.99, -0.5, 0.0, 0.3, 0.9}) {
    const double r = 0.7, distance = d * r;
    double sum = 0;
    const int num = 20000;
    for (int i = 0; i < num; ++i) {
      // Discs of height x along the normal, from the far side up to the plane at -distance.
      const double x = -r + (r - distance) * (i + 0.5) / num;
      sum += kPi * (r * r - x * x) * (r - distance) / num;
    }
    EXPECT_NEAR(cap_volume(r, distance), sum, 1e-8);
  }
}

TEST(CapVolume, WholeHalfAndNothing) {
  EXPECT_DOUBLE_EQ(cap_volume(2.0, -2.0), sphere_volume(2.0));
  EXPECT_DOUBLE_EQ(cap_volume(2.0, -5.0), sphere_volume(2.0));
  EXPECT_DOUBLE_EQ(cap_volume(2.0, 0.0), sphere_volume(2.0) / 2);
  EXPECT_EQ(cap_volume(2.0, 2.0), 0.0);
  EXPECT_EQ(cap_volume(2.0, 9.0), 0.0);
}

TEST(CapVolume, ThesisExampleOfFigure45) {
  // S = (3,1,2), r = 3, O = (1.14,1.1,1.8), n = (-0.52,0.77,-0.36), which is not unit.
  const Vec3d n = normalized(Vec3d{-0.52, 0.77, -0.36});
  const double d = dot(n, Vec3d{3, 1, 2} - Vec3d{1.14, 1.1, 1.8});
  EXPECT_NEAR(d, -1.12018, 1e-5);
  EXPECT_NEAR(cap_volume(3.0, d), 86.7492, 1e-3);
}

TEST(LensVolume, ConcentricTouchingAndMonteCarlo) {
  EXPECT_DOUBLE_EQ(lens_volume(1.0, 2.0, 0.5), sphere_volume(1.0));
  EXPECT_EQ(lens_volume(1.0, 2.0, 3.0), 0.0);
  // Equal balls: two caps cut by the plane in the middle.
  EXPECT_NEAR(lens_volume(1.0, 1.0, 0.8), 2 * cap_volume(1.0, 0.4), 1e-12);
  // Unequal balls: the cutting plane is where the spheres meet.
  const double a = 1.0, b = 0.6, d = 1.1, x = (d * d + a * a - b * b) / (2 * d);
  EXPECT_NEAR(lens_volume(a, b, d), cap_volume(a, x) + cap_volume(b, d - x), 1e-12);
}

}  // namespace
}  // namespace palpate
