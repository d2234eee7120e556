// Rays without a library see what Embree's see: the same surfaces at the same depth, but for single
// pixels at silhouettes.
#define BodyRays PlainBodyRays
#include "scenes/body_rays_plain.cpp"
#undef BodyRays

#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "scenes/scene.h"

namespace palpate {
namespace {

class BodyRaysIn : public testing::TestWithParam<const char*> {};

TEST_P(BodyRaysIn, PlainOnesSeeTheDepthOfEmbree) {
  scenes::Scene scene = scenes::make_scene(GetParam()).value();
  scenes::set_image_size(scene, 160, 120);
  ASSERT_FALSE(scene.environment || scene.X_WC);
  const std::vector<float> expected = scenes::render_depth(scene, 0);
  std::vector<float> image(expected.size(), std::numeric_limits<float>::quiet_NaN());
  for (const scenes::Body& body : scene.bodies) {
    scenes::PlainBodyRays(body.mesh).draw({scene.intrinsics, scene.width, scene.height},
                                          body.motion ? body.motion(0) : body.X_WB, image);
  }
  std::size_t num_seen = 0, num_other = 0;
  for (std::size_t i = 0; i < image.size(); ++i) {
    num_seen += !std::isnan(expected[i]);
    const bool is_same =
        std::isnan(expected[i]) ? std::isnan(image[i]) : std::abs(image[i] - expected[i]) < 1e-6f;
    num_other += !is_same;
  }
  EXPECT_GT(num_seen, image.size() / 4);
  EXPECT_LE(num_other, image.size() / 2000);
}

INSTANTIATE_TEST_SUITE_P(Scenes, BodyRaysIn,
                         testing::Values("hand", "mannequin", "pillar", "moving-box"));

}  // namespace
}  // namespace palpate
