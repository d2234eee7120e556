// The depth field with its second derivatives, as the Python module queries it, against the field
// and its gradient.
#include "src/field/internal/field_point.h"

#include <cmath>
#include <utility>

#include <gtest/gtest.h>

#include "palpate/cloud/surface_estimator.h"
#include "tests/field/rough_images.h"

namespace palpate {
namespace {

/// A wall with a block before it, noise and holes.
DepthField rough_field() {
  const test::RoughImages images(161, 120, 1, 12);
  DepthFrame frame{images.camera.width, images.camera.height, 0.001, images.counts, 0};
  SurfaceEstimator estimator = SurfaceEstimator::create(161, 120, images.camera.intrinsics).value();
  ThreadPool pool(1);
  estimator.update(frame, pool);
  DepthField field = std::move(DepthField::create(161, 120)).value();
  field.update(estimator.cloud(), pool);
  return field;
}

/// Points before, in and deep behind both surfaces, and radii of all sizes.
template <class Visit>
void for_each_point(const DepthFieldView& field, const Visit& visit) {
  test::Random random(3);
  for (int i = 0; i < 3000; ++i) {
    const double radius = 0.001 * std::pow(40.0, random.uniform());
    const double z = random.uniform(0.3, 2);
    const Intrinsics& k = field.intrinsics;
    visit(Vec3d{(random.uniform(-5, 165) - k.cx) * z / k.fx,
                (random.uniform(-5, 125) - k.cy) * z / k.fy, z},
          radius);
  }
}

TEST(FieldCurvature, KnowsTheFieldAndItsGradient) {
  const DepthField field = rough_field();
  int num_deep = 0;
  for_each_point(field.view(), [&](const Vec3d& p, double radius) {
    const FieldSample<double> want = sample_field(field.view(), p, radius);
    const CurvedFieldSample got = sample_field_curvature(field.view(), p, radius);
    ASSERT_NEAR(got.phi, want.phi, 1e-12 * (1 + std::abs(want.phi)));
    ASSERT_LT(norm(got.gradient - want.gradient), 1e-9 * (1 + norm(want.gradient)));
    num_deep += want.phi < -10 * radius;
  });
  EXPECT_GT(num_deep, 300);
  const CurvedFieldSample before = sample_field_curvature(field.view(), {0, 0, 0.019}, 0.01);
  EXPECT_EQ(before.phi, 0.02) << "nothing is nearer to the camera than that";
}

TEST(FieldCurvature, IsNowhereWhereNoPointIs) {
  const DepthField field = rough_field();
  for (const double none : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    for (int axis = 0; axis < 3; ++axis) {
      Vec3d p{0.01, 0.02, 1.2};
      p[axis] = none;
      const FieldSample<double> at = sample_field(field.view(), p, 0.01);
      const CurvedFieldSample curved = sample_field_curvature(field.view(), p, 0.01);
      const auto in_single =
          sample_field(field.view(), Vec3<float>{float(p.x), float(p.y), float(p.z)}, 0.01f);
      EXPECT_TRUE(std::isnan(at.phi) && std::isnan(curved.phi) && std::isnan(in_single.phi))
          << none << " " << axis;
      for (int k = 0; k < 3; ++k) {
        EXPECT_TRUE(std::isnan(at.gradient[k]) && std::isnan(curved.gradient[k]));
      }
    }
  }
}

TEST(FieldCurvature, IsTheSlopeOfTheGradient) {
  const DepthField field = rough_field();
  int num = 0, num_off = 0;
  for_each_point(field.view(), [&](const Vec3d& p, double radius) {
    const CurvedFieldSample at = sample_field_curvature(field.view(), p, radius);
    double largest = 0, off = 0, odd = 0;
    for (int axis = 0; axis < 3; ++axis) {
      constexpr double kStep = 1e-7;
      Vec3d low = p, high = p;
      low[axis] -= kStep;
      high[axis] += kStep;
      const Vec3d slope = (sample_field(field.view(), high, radius).gradient -
                           sample_field(field.view(), low, radius).gradient) /
                          (2 * kStep);
      for (int row = 0; row < 3; ++row) {
        largest = std::max(largest, std::abs(at.hessian.m[row][axis]));
        off = std::max(off, std::abs(at.hessian.m[row][axis] - slope[row]));
        odd = std::max(odd, std::abs(at.hessian.m[row][axis] - at.hessian.m[axis][row]));
      }
    }
    ASSERT_EQ(odd, 0);
    ++num;
    num_off += off > 1e-3 * (1 + largest);  // the step meets a border of two pixels, where it jumps
  });
  EXPECT_LT(num_off, 0.01 * num);
}

}  // namespace
}  // namespace palpate
