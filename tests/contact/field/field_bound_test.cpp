// Bounds by which spheres are left out of a query: they are never too near, not even for pixels
// beyond the image and pixels that are not square.
#include "src/contact/field/field_bound.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "palpate/contact/contact.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/field_truth.h"
#include "tests/test_util/frozen_field.h"

namespace palpate {
namespace {

using test::FrozenField;
using test::Random;

// A sphere's value is a mean over three pixels of a level in each direction, and these are up to
// two footprints wide, by the focal length of the columns; a silhouette counts within its radius.
TEST(BallWindow, HoldsAllPixelsThatItsSpheresAskAbout) {
  Random random(71);
  for (int n = 0; n < 20000; ++n) {
    FieldFrame frame;
    frame.fx = static_cast<float>(random.uniform(50, 900));
    frame.fy = static_cast<float>(random.uniform(50, 900));
    frame.cx = static_cast<float>(random.uniform(0, 600));
    frame.cy = static_cast<float>(random.uniform(0, 400));
    const double largest = random.uniform(1e-3, 0.02), spread = random.uniform(0, 0.03);
    const Pose X_CT{{random.uniform(-0.6, 0.6), random.uniform(-0.6, 0.6), random.uniform(0.1, 4)},
                    random.rotation(3)};
    place_tool(X_CT, {}, frame);
    const Vec3d middle = random.in_box(0.1);
    const Cluster ball{to_float(middle), {}, static_cast<float>(spread + largest)};
    const int wide = 40, high = 30;
    const BallWindow at = window_of(frame, ball, static_cast<float>(largest), wide, high);
    if (!at.is_before_camera()) continue;
    const double nearest = (X_CT * middle).z - spread - largest;
    EXPECT_NEAR(double{at.nearest}, nearest, 1e-4);
    double least[2] = {1e9, 1e9}, most[2] = {-1e9, -1e9};
    for (int i = 0; i < 20; ++i) {
      const double r = largest * random.uniform();
      const Vec3d p_C = X_CT * (middle + spread * random.direction());
      const double pixels = 3 * 0.7 * r * double{frame.fx} / p_C.z;
      const double u = double{frame.fx} * p_C.x / p_C.z + double{frame.cx};
      const double v = double{frame.fy} * p_C.y / p_C.z + double{frame.cy};
      const double aside_u = pixels + double{frame.fx} * r / p_C.z;
      const double aside_v = pixels + double{frame.fy} * r / p_C.z;
      least[0] = std::min(least[0], u - aside_u), most[0] = std::max(most[0], u + aside_u);
      least[1] = std::min(least[1], v - aside_v), most[1] = std::max(most[1], v + aside_v);
    }
    ASSERT_LE(double{at.first_u}, least[0]);
    ASSERT_GE(double{at.last_u}, most[0]);
    ASSERT_LE(double{at.first_v}, least[1]);
    ASSERT_GE(double{at.last_v}, most[1]);
    const auto tile = [](double pixel, int num) {
      return static_cast<int>(std::clamp(std::floor(pixel / 16), 0.0, num - 1.0));
    };
    ASSERT_LE(at.left, tile(least[0], wide));
    ASSERT_GE(at.right, tile(most[0], wide));
    ASSERT_LE(at.top, tile(least[1], high));
    ASSERT_GE(at.bottom, tile(most[1], high));
  }
}

/// A rough wall and a block before it, as a camera with these pixels sees them.
FrozenField block_before_wall(int width, int height, double fx, double fy, UnknownSpace unknown,
                              Random& random) {
  const Intrinsics k{fx, fy, 0.5 * width - 0.5, 0.5 * height - 0.5};
  PointCloud cloud(width, height, k);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const bool is_block = u > width / 3 && u < 2 * width / 3 && v > height / 3 && v < height / 2;
      const double z = (is_block ? 0.55 : 0.7) + 0.002 * random.normal();
      cloud.set(static_cast<std::size_t>(v * width + u),
                to_float({(u - k.cx) * z / fx, (v - k.cy) * z / fy, z}),
                to_float(Vec3d{0, 0, -1} + 0.2 * random.direction()));
    }
  }
  return FrozenField(std::move(cloud), {.unknown = unknown});
}

// With any number of pixels in the last tiles; where the outermost surface goes on, for ever or for
// a footprint, so does contact.
TEST(FieldBound, LeavesOutNothingInAndBeyondAnyImage) {
  Random random(72);
  SpherePacking large;
  large.spheres = {{{}, 0.04f}};
  const Tool tools[] = {test::random_tool(40, 0.02, 3),
                        Tool::build(make_box({0.08, 0.08, 0.08}), std::move(large)).value()};
  for (const auto& [width, height] : {std::pair{160, 120}, {128, 96}, {111, 112}, {112, 79}}) {
    for (const auto& [fx, fy] : {std::pair{140.0, 140.0}, {420.0, 105.0}, {105.0, 420.0}}) {
      for (int run = 0; run < 4; ++run) {
        const bool is_endless = run < 2;
        const Tool& tool = tools[run % 2];
        const FrozenField scene = block_before_wall(
            width, height, fx, fy, is_endless ? UnknownSpace::solid : UnknownSpace::free, random);
        const double scale = tool.sphere_mass().volume;
        const auto query =
            make_contact_query(Place::cpu(), tool, FieldMethod{SphereVolumes::own}).value();
        int num_inside = 0, num_beyond = 0;
        for (int i = 0; i < 400; ++i) {
          const double z = random.uniform(0.5, 0.75);
          const double share = i % 2 == 0 ? 1 : (is_endless ? 3 : 1.3);
          const double u = share * (random.uniform() - 0.5) * width,
                       v = share * (random.uniform() - 0.5) * height;
          const Pose X_WT{{u * z / fx, v * z / fy, z}, random.rotation(3)};
          const Penetration got = query->measure({{}, scene.field.view()}, X_WT).penetration;
          const Penetration want =
              test::field_truth(tool, scene.field.view(), X_WT, SphereVolumes::own);
          const bool is_beyond = std::abs(u) > 0.5 * width + 40 || std::abs(v) > 0.5 * height + 40;
          if (want.volume > 0.01 * scale) ++(is_beyond ? num_beyond : num_inside);
          EXPECT_NEAR(got.volume, want.volume, 2e-5 * scale) << u << " " << v << " " << z;
          EXPECT_NEAR(norm(got.measure_W.force - want.measure_W.force), 0, 1e-4 * scale);
        }
        EXPECT_GT(num_inside, 20);
        EXPECT_GT(num_beyond, is_endless ? 20 : -1);
      }
    }
  }
}

}  // namespace
}  // namespace palpate
