// The shadow that a structured-light camera's projector leaves beside a hand is not felt.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/field/depth_field.h"
#include "scenes/scene.h"
#include "src/field/internal/field_point.h"

namespace palpate {
inline namespace v0 {
namespace scenes {
namespace {

std::vector<DepthField> fields_of(const Scene& scene, const NoiseModel& noise, int num,
                                  int frames_apart) {
  SimulatedCameraOptions options;
  options.noise = noise;
  options.unit = 0.0001;
  auto camera = open_simulated_camera(scene, options).value();
  auto estimator =
      SurfaceEstimator::create(scene.width, scene.height, scene.intrinsics, {}).value();
  ThreadPool pool(2);
  std::vector<DepthField> fields;
  DepthFrame frame;
  for (int i = 0; static_cast<int>(fields.size()) < num && camera->next(frame).value(); ++i) {
    if (i % frames_apart != 0) continue;
    estimator.update(frame, pool);
    fields.push_back(DepthField::create(scene.width, scene.height).value());
    fields.back().update(estimator.cloud(), pool);
  }
  return fields;
}

constexpr double kStep = 1e-4;  // m, of distances

/// Distance outward from an edge of the hand a ball that is as deep as the hand is felt, m.
double felt_beside(const DepthFieldView& field, const Vec3d& at_edge, double outward) {
  constexpr double kRadius = 0.004, kFarthest = 0.03;
  double felt = 0;
  for (double x = 0; x < kFarthest; x += kStep) {
    const Vec3d p = at_edge + Vec3d{outward * x, 0, 0};
    if (sample_field(field, p, kRadius).phi < kRadius) felt = x;
  }
  return felt;
}

// In every row, on both sides: as far as without noise.
TEST(Shadows, BesideAHandAreNotFelt) {
  constexpr int kNum = 3, kFramesApart = 25;
  const Scene scene = make_scene("hand").value();
  NoiseModel exact;
  exact.enabled = false;
  const std::vector<DepthField> clean = fields_of(scene, exact, kNum, kFramesApart);
  const std::vector<DepthField> noisy = fields_of(scene, {}, kNum, kFramesApart);
  ASSERT_EQ(clean.size(), kNum);
  std::vector<double> all;
  for (int i = 0; i < kNum; ++i) {
    const std::vector<float> depth = render_depth(scene, i * kFramesApart / scene.rate);
    for (int v = 0; v < scene.height; ++v) {
      const auto is_hand = [&](int u) {
        return depth[static_cast<std::size_t>(v * scene.width + u)] < 0.8f;
      };
      for (const int outward : {-1, 1}) {
        // The first pixel of the hand from outside, and how deep the hand is a little further in.
        int u = outward < 0 ? 0 : scene.width - 1;
        while (u >= 0 && u < scene.width && !is_hand(u)) u -= outward;
        const int in = u - 6 * outward;
        if (u < 0 || u >= scene.width || !is_hand(in)) continue;
        const double z =
            static_cast<double>(depth[static_cast<std::size_t>(v * scene.width + in)]) + 0.006;
        const Vec3d at_edge{(u - scene.intrinsics.cx) * z / scene.intrinsics.fx,
                            (v - scene.intrinsics.cy) * z / scene.intrinsics.fy, z};
        const double extra =
            felt_beside(noisy[static_cast<std::size_t>(i)].view(), at_edge, outward) -
            felt_beside(clean[static_cast<std::size_t>(i)].view(), at_edge, outward);
        all.push_back(extra);
      }
    }
  }
  std::sort(all.begin(), all.end());
  const auto quantile = [&](double share) {
    return all[static_cast<std::size_t>(share * static_cast<double>(all.size()))];
  };
  EXPECT_GT(all.size(), 2000u);
  EXPECT_LT(std::abs(std::accumulate(all.begin(), all.end(), 0.0)), 3e-4 * double(all.size()));
  EXPECT_LT(quantile(0.95), 4e-4);
  // Ten steps, in any row.
  EXPECT_LT(all.back(), 1e-3 + kStep / 2);
  EXPECT_GT(all.front(), -1e-3 - kStep / 2);
}

}  // namespace
}  // namespace scenes
}  // namespace v0
}  // namespace palpate
