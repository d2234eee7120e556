// Each stage against its definition in double (surface_truth.h).
#include <algorithm>
#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "palpate/cloud/surface_estimator.h"
#include "tests/cloud/depth_scenes.h"
#include "tests/cloud/surface_truth.h"

namespace palpate {
namespace {

constexpr PlaneFit kFits[] = {PlaneFit::along_ray, PlaneFit::principal};

using test::DepthScene;
using test::TrueDepth;
using test::TrueNormal;

SurfaceEstimator estimate(const DepthScene& scene, const SurfaceOptions& options) {
  SurfaceEstimator estimator =
      SurfaceEstimator::create(scene.width, scene.height, scene.intrinsics, options).value();
  ThreadPool pool(1);
  estimator.update(scene.depth, pool);
  return estimator;
}

/// Returns the number of flying pixels.
int check_filter(const DepthScene& scene, const SurfaceOptions& options) {
  const SurfaceEstimator estimator = estimate(scene, options);
  const TrueDepth raw{scene.depth, scene.width, scene.height};
  const TrueDepth filtered{estimator.depth(), scene.width, scene.height};
  int num_flying = 0;
  for (int v = 0; v < scene.height; ++v) {
    for (int u = 0; u < scene.width; ++u) {
      bool valid = raw(u, v) >= options.min_depth && raw(u, v) <= options.max_depth;
      if (valid && options.flying_pixel_gap > 0 &&
          true_flying(raw, options.flying_pixel_gap, u, v)) {
        valid = false;
        ++num_flying;
      }
      EXPECT_EQ(std::isfinite(filtered(u, v)), valid) << u << " " << v;
      if (!valid) continue;
      const double expected =
          options.filter.enabled ? true_filtered(raw, options.filter, u, v) : raw(u, v);
      EXPECT_NEAR(filtered(u, v), expected, 3e-7 * expected) << u << " " << v;
    }
  }
  return num_flying;
}

// Returns the number of normals whose direction was compared.
int check_normals(const DepthScene& scene, const SurfaceOptions& options) {
  const SurfaceEstimator estimator = estimate(scene, options);
  const TrueDepth depth{estimator.depth(), scene.width, scene.height};
  const PointCloudView cloud = estimator.cloud();
  const Intrinsics& k = scene.intrinsics;
  int num_compared = 0;
  for (int v = 0; v < scene.height; ++v) {
    for (int u = 0; u < scene.width; ++u) {
      const auto i = static_cast<std::size_t>(v * scene.width + u);
      const TrueNormal expected = true_normal(depth, k, options.normals, u, v);
      const std::string where = std::to_string(u) + " " + std::to_string(v);
      // Weights may leave no more than a line of a window: then there may or may not be a normal.
      if (!options.normals.weighting || expected.well_conditioned) {
        EXPECT_EQ(std::isfinite(cloud.nx[i]), expected.exists) << where;
      }
      for (const float* channel : {cloud.x, cloud.y, cloud.z, cloud.ny, cloud.nz}) {
        EXPECT_EQ(std::isfinite(channel[i]), std::isfinite(cloud.nx[i])) << where;
      }
      if (!expected.exists || !std::isfinite(cloud.nx[i])) continue;
      const double z = depth(u, v);
      const Vec3d p{(u - k.cx) * z / k.fx, (v - k.cy) * z / k.fy, z};
      EXPECT_EQ(cloud.z[i], static_cast<float>(z));
      EXPECT_NEAR(static_cast<double>(cloud.x[i]), p.x, 2e-7 * std::abs(p.x)) << where;
      EXPECT_NEAR(static_cast<double>(cloud.y[i]), p.y, 2e-7 * std::abs(p.y)) << where;
      const Vec3d n{cloud.nx[i], cloud.ny[i], cloud.nz[i]};
      EXPECT_NEAR(norm(n), 1, 1e-6);
      EXPECT_LE(dot(n, p) / norm(p), 1e-6);
      if (!expected.well_conditioned) continue;
      // Edge-on planes may flip by rounding.
      const double angle =
          std::min(test::angle_between(n, expected.n), test::angle_between(-n, expected.n));
      EXPECT_LE(angle, 0.05) << where;
      ++num_compared;
      if (testing::Test::HasFailure()) return num_compared;
    }
  }
  return num_compared;
}

void check_depth_change(const DepthScene& scene, const SurfaceOptions& options) {
  const SurfaceEstimator estimator = estimate(scene, options);
  const TrueDepth depth{estimator.depth(), scene.width, scene.height};
  int num_edges = 0;
  for (int v = 0; v < scene.height; ++v) {
    for (int u = 0; u < scene.width; ++u) {
      const auto i = static_cast<std::size_t>(v * scene.width + u);
      const Vec3d expected =
          test::true_depth_change(depth, scene.intrinsics, options.depth_change.min_step, u, v);
      for (int axis = 0; axis < 3; ++axis) {
        ASSERT_NEAR(static_cast<double>(estimator.depth_change(axis)[i]), expected[axis],
                    3e-6 * (norm(expected) + 0.1))
            << u << " " << v;
      }
      num_edges += norm(expected) > 0;
    }
  }
  EXPECT_GT(num_edges, scene.height);
}

TEST(SurfaceStages, FilterFollowsItsDefinition) {
  for (int radius : {1, 2, 3, 7}) {
    for (double sigma_depth : {0.001, 0.01, 0.5}) {
      SurfaceOptions options;
      options.filter.smoothing = Smoothing::bilateral;
      options.filter.radius = radius;
      options.filter.sigma_depth = sigma_depth;
      options.filter.sigma_space = 0.75 * radius;
      check_filter(test::cluttered_scene(61, 47, 60, 1.3, 3), options);
    }
  }
  SurfaceOptions unfiltered;
  unfiltered.filter.enabled = false;
  check_filter(test::cluttered_scene(61, 47, 60, 1.3, 3), unfiltered);
}

TEST(SurfaceStages, FlyingPixelsFollowTheirDefinition) {
  for (const double gap : {0.004, 0.015, 0.04}) {
    for (const int radius : {0, 1, 2, 3}) {
      SurfaceOptions options;
      options.filter.enabled = radius > 0;
      options.filter.smoothing = Smoothing::bilateral;
      options.filter.radius = std::max(radius, 1);
      options.flying_pixel_gap = gap;
      SCOPED_TRACE("gap " + std::to_string(gap) + " radius " + std::to_string(radius));
      EXPECT_GT(check_filter(test::cluttered_scene(61, 47, 60, 1.3, 3), options), 5);
    }
  }
}

// Seen by a camera of time of flight: where a pixel sees both sides, it tells a depth between.
TEST(SurfaceStages, WhatFliesBetweenTwoSurfacesIsRemovedAndNothingElse) {
  SurfaceOptions options;
  options.flying_pixel_gap = 0.015;
  DepthScene scene = test::empty_scene(48, 32, 50);
  const auto is_mixed = [](int u, int v) { return u == 20 + v / 4; };
  for (int v = 0; v < scene.height; ++v) {
    for (int u = 0; u < scene.width; ++u) {
      const double share = 0.1 + 0.8 * v / 31;  // of the near surface
      scene.at(u, v) = is_mixed(u, v)   ? static_cast<float>(share * 0.8 + (1 - share) * 1.1)
                       : u < 20 + v / 4 ? 0.8f
                                        : 1.1f;
    }
  }
  const SurfaceEstimator estimator = estimate(scene, options);
  const TrueDepth depth{estimator.depth(), scene.width, scene.height};
  for (int v = 0; v < scene.height; ++v) {
    for (int u = 0; u < scene.width; ++u) {
      EXPECT_EQ(std::isnan(depth(u, v)), is_mixed(u, v)) << u << " " << v;
    }
  }
}

/// As the documentation of OpenCV's calib3d writes it, term by term; (-1, -1) where the ray is not
/// seen.
std::pair<int, int> raw_pixel(const Distortion& d, const DepthScene& scene, int u, int v) {
  const Intrinsics& k = scene.intrinsics;
  const double x = (u - k.cx) / k.fx, y = (v - k.cy) / k.fy;
  const double r2 = x * x + y * y, r4 = r2 * r2, r6 = r2 * r2 * r2;
  const double radial =
      (1 + d.k1 * r2 + d.k2 * r4 + d.k3 * r6) / (1 + d.k4 * r2 + d.k5 * r4 + d.k6 * r6);
  const double u_raw = k.fx * (x * radial + 2 * d.p1 * x * y + d.p2 * (r2 + 2 * x * x)) + k.cx;
  const double v_raw = k.fy * (y * radial + d.p1 * (r2 + 2 * y * y) + 2 * d.p2 * x * y) + k.cy;
  const bool is_inside =
      u_raw > -0.5 && v_raw > -0.5 && u_raw < scene.width - 0.5 && v_raw < scene.height - 0.5;
  return is_inside ? std::pair(static_cast<int>(std::floor(u_raw + 0.5)),
                               static_cast<int>(std::floor(v_raw + 0.5)))
                   : std::pair(-1, -1);
}

TEST(SurfaceStages, BentImagesAreStraightened) {
  SurfaceOptions options;
  options.filter.enabled = false;
  const DepthScene scene = test::cluttered_scene(70, 51, 60, 1.3, 4);
  const DepthFrame frame = test::as_frame(scene);
  ThreadPool pool(1);
  for (const Distortion& bent : {Distortion{-0.28, 0.09, 0.001, -0.002, -0.01, 0, 0, 0},
                                 Distortion{5.9, 3.4, 1e-5, 3e-5, 0.17, 6.2, 5.1, 0.9}}) {
    SurfaceEstimator of_meters =
        SurfaceEstimator::create(70, 51, scene.intrinsics, options, best_isa(), bent).value();
    SurfaceEstimator of_counts =
        SurfaceEstimator::create(70, 51, scene.intrinsics, options, best_isa(), bent).value();
    of_meters.update(scene.depth, pool);
    of_counts.update(frame, pool);
    int num_moved = 0, num_unseen = 0;
    for (int v = 0; v < 51; ++v) {
      for (int u = 0; u < 70; ++u) {
        const auto [u_raw, v_raw] = raw_pixel(bent, scene, u, v);
        const auto i = static_cast<std::size_t>(v * 70 + u),
                   raw = static_cast<std::size_t>(v_raw * 70 + u_raw);
        const float want = u_raw < 0 ? NAN : scene.depth[raw];
        EXPECT_TRUE(of_meters.depth()[i] == want ||
                    (std::isnan(of_meters.depth()[i]) && std::isnan(want)))
            << u << " " << v;
        if (u_raw >= 0 && frame.pixels[raw] != 0) {
          EXPECT_EQ(of_counts.depth()[i], static_cast<float>(frame.pixels[raw] * frame.unit));
        }
        num_moved += u_raw >= 0 && (u_raw != u || v_raw != v);
        num_unseen += u_raw < 0;
      }
    }
    EXPECT_GT(num_moved, 500);
    if (bent.k1 > 0) continue;
    EXPECT_EQ(num_unseen, 0);
  }
  // A lens that sees less than the pinhole image shows.
  const Distortion wide{0.4, 0, 0, 0, 0, 0, 0, 0};
  SurfaceEstimator cut =
      SurfaceEstimator::create(70, 51, scene.intrinsics, options, best_isa(), wide).value();
  cut.update(scene.depth, pool);
  EXPECT_EQ(raw_pixel(wide, scene, 0, 0).first, -1);
  EXPECT_TRUE(std::isnan(cut.depth()[0]));
}

TEST(SurfaceStages, SteepSurfacesStayAsFarAsTheGapSays) {
  constexpr double kFocal = 50;
  SurfaceOptions options;
  options.flying_pixel_gap = 0.05;
  // On the axis a pixel's neighbors are z tan(angle) / f deeper and nearer.
  const double limit = std::atan(options.flying_pixel_gap * kFocal);
  for (const bool is_steeper : {false, true}) {
    const double angle = limit + (is_steeper ? 0.05 : -0.05);
    const Vec3d n{std::sin(angle), 0, -std::cos(angle)};
    const DepthScene scene = test::plane_scene(9, 9, kFocal, n, {0, 0, 1});
    const SurfaceEstimator estimator = estimate(scene, options);
    EXPECT_EQ(std::isnan(estimator.depth()[4 * 9 + 4]), is_steeper);
  }
}

TEST(SurfaceStages, NormalsFollowTheirDefinitionWithEveryOption) {
  int seed = 0;
  for (int flags = 0; flags < 32; ++flags) {
    for (int radius : {1, 2, 3, 5, 7}) {
      SurfaceOptions options;
      options.filter.enabled = (flags & 8) != 0;
      options.normals.fit = kFits[flags / 16];
      options.normals.radius = radius;
      options.normals.anchoring = (flags & 1) != 0;
      options.normals.weighting = (flags & 2) != 0;
      options.normals.normalization = (flags & 4) != 0;
      SCOPED_TRACE("flags " + std::to_string(flags) + " radius " + std::to_string(radius));
      const DepthScene scene =
          test::cluttered_scene(75, 53, 80, 1.5, static_cast<std::uint64_t>(++seed));
      EXPECT_GT(check_normals(scene, options), 500);
    }
  }
}

TEST(SurfaceStages, NormalsArePreciseAtAnyDistanceFocalLengthAndPrincipalPoint) {
  for (double distance : {0.3, 1.0, 3.0, 6.5}) {
    for (double f : {120.0, 525.0, 1400.0}) {
      for (double shift : {0.0, -300.0, 900.0}) {
        for (PlaneFit fit : kFits) {
          for (bool filter : {false, true}) {
            SCOPED_TRACE(std::to_string(distance) + " m, f " + std::to_string(f) + ", shift " +
                         std::to_string(shift));
            SurfaceOptions options;
            options.filter.enabled = filter;
            options.normals.fit = fit;
            DepthScene scene = test::cluttered_scene(131, 70, f, distance, 9);
            scene.intrinsics.cx += shift;
            scene.intrinsics.cy -= shift / 2;
            scene.intrinsics.fy *= 1.3;
            check_normals(scene, options);
          }
        }
      }
    }
  }
}

// A window that may reach across edges sees surfaces edge-on, n.r nearly zero.
TEST(SurfaceStages, NormalsFollowTheirDefinitionAcrossEdges) {
  for (PlaneFit fit : kFits) {
    for (int radius : {1, 3}) {
      SurfaceOptions options;
      options.filter.enabled = false;
      options.normals.fit = fit;
      options.normals.radius = radius;
      options.normals.max_depth_change = 10;
      EXPECT_GT(check_normals(test::cluttered_scene(75, 53, 525, 2, 11), options), 500);
    }
  }
}

TEST(SurfaceStages, SlantedPlanesHaveExactNormals) {
  for (const Vec3d& slope :
       {Vec3d{0, 0, -1}, Vec3d{1, 0, -1}, Vec3d{-0.5, 1.5, -1}, Vec3d{2, 2, -1}}) {
    for (double distance : {0.3, 1.0, 2.0, 4.0}) {
      const Vec3d n = normalized(slope);
      const DepthScene scene = test::plane_scene(67, 50, 525, n, {0, 0, distance});
      for (PlaneFit fit : kFits) {
        SurfaceOptions options;
        options.filter.enabled = false;
        options.normals.fit = fit;
        const SurfaceEstimator estimator = estimate(scene, options);
        const PointCloudView cloud = estimator.cloud();
        for (std::size_t i = 0; i < cloud.size(); ++i) {
          const Vec3d found{cloud.nx[i], cloud.ny[i], cloud.nz[i]};
          ASSERT_LE(test::angle_between(found, n), 0.01) << i << ", " << distance << " m";
          for (int axis = 0; axis < 3; ++axis) ASSERT_EQ(estimator.depth_change(axis)[i], 0.0f);
        }
      }
    }
  }
}

// Degrees between the mean of all normals of a noisy plane and the truth, and the mean of their own
// angles.
struct NormalError {
  double bias, mean;
};

NormalError noisy_plane_error(PlaneFit fit, const Vec3d& n, double noise) {
  DepthScene scene = test::plane_scene(320, 240, 525, n, {0, 0, 1});
  test::Random random(21);
  for (float& z : scene.depth) z += static_cast<float>(noise * random.normal());
  SurfaceOptions options;
  options.filter.enabled = false;
  options.normals.fit = fit;
  options.normals.max_depth_change = 0.2;
  const SurfaceEstimator estimator = estimate(scene, options);
  const PointCloudView cloud = estimator.cloud();
  Vec3d sum;
  double sum_angles = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3d found{cloud.nx[i], cloud.ny[i], cloud.nz[i]};
    // n / n.r, whose lateral part depends linearly on the depths; unit vectors would be biased by
    // their curved sphere alone.
    sum += found / found.z;
    sum_angles += test::angle_between(found, n);
  }
  return {test::angle_between(-sum, n), sum_angles / static_cast<double>(cloud.size())};
}

// Noise lies along the rays. The plane fit that knows it has no bias, principal components have.
TEST(SurfaceStages, NormalsAlongTheRayAreUnbiasedOnSlantedNoisyPlanes) {
  for (const Vec3d& slope : {Vec3d{0.6, 0, -1}, Vec3d{-0.5, 0.8, -1}, Vec3d{1.2, 0.4, -1}}) {
    const Vec3d n = normalized(slope);
    const NormalError along_ray = noisy_plane_error(PlaneFit::along_ray, n, 0.0015);
    const NormalError principal = noisy_plane_error(PlaneFit::principal, n, 0.0015);
    EXPECT_LT(along_ray.bias, 0.1);
    EXPECT_GT(principal.bias, 1);
    EXPECT_LT(along_ray.mean, 0.8 * principal.mean);
  }
}

TEST(SurfaceStages, PointsOnOneLineOfTheImageHaveNoNormal) {
  for (int direction = 0; direction < 4; ++direction) {
    DepthScene scene = test::empty_scene(40, 40, 60);
    for (int i = 0; i < 40; ++i) {
      const int u[] = {i, 20, i, i}, v[] = {20, i, i, i / 2};  // the last is more than a line
      scene.at(u[direction], v[direction]) = 1.0f + 0.01f * static_cast<float>(i % 3);
    }
    for (int flags = 0; flags < 16; ++flags) {
      SurfaceOptions options;
      options.normals.fit = kFits[flags / 8];
      options.normals.min_neighbors = 3;
      options.normals.anchoring = (flags & 1) != 0;
      options.normals.weighting = (flags & 2) != 0;
      options.normals.normalization = (flags & 4) != 0;
      const SurfaceEstimator estimator = estimate(scene, options);
      int num_normals = 0;
      for (std::size_t i = 0; i < scene.depth.size(); ++i) {
        num_normals += std::isfinite(estimator.cloud().nz[i]);
      }
      EXPECT_EQ(num_normals, direction == 3 ? 40 : 0) << direction << " flags " << flags;
    }
  }
}

TEST(SurfaceStages, DepthChangeFollowsItsDefinition) {
  for (double min_step : {0.0, 0.05, 0.2}) {
    SurfaceOptions options;
    options.depth_change.min_step = min_step;
    check_depth_change(test::cluttered_scene(61, 47, 60, 1.3, 4), options);
  }
}

// A pillar before a wall: vectors on the pillar's border only, pointing away from it, orthogonal to
// the viewing ray.
TEST(SurfaceStages, EdgesPointOutwardsFromTheForeground) {
  DepthScene scene = test::empty_scene(50, 40, 60);
  scene.intrinsics.cx = -20;  // far off the axis
  for (int v = 0; v < scene.height; ++v) {
    for (int u = 0; u < scene.width; ++u) scene.at(u, v) = u >= 20 && u < 30 ? 1.0f : 2.0f;
  }
  const SurfaceEstimator estimator = estimate(scene, {});
  for (int v = 0; v < scene.height; ++v) {
    for (int u = 0; u < scene.width; ++u) {
      const auto i = static_cast<std::size_t>(v * scene.width + u);
      const Vec3d l{estimator.depth_change(0)[i], estimator.depth_change(1)[i],
                    estimator.depth_change(2)[i]};
      if (u != 20 && u != 29) {
        EXPECT_EQ(norm(l), 0) << u << " " << v;
        continue;
      }
      EXPECT_GT(norm(l), 0.5);
      EXPECT_GT(u == 29 ? l.x : -l.x, 0);
      const Vec3d p{(u - scene.intrinsics.cx) / 60, (v - scene.intrinsics.cy) / 60, 1};
      EXPECT_NEAR(dot(l, p), 0, 1e-5 * norm(l));
    }
  }
}

// The printed equation 3.12 divides by the number of pixels and would shrink it.
TEST(SurfaceStages, FilterKeepsAFlatPatch) {
  DepthScene scene = test::empty_scene(21, 21, 100);
  for (int v = 8; v < 13; ++v) {
    for (int u = 8; u < 13; ++u) scene.at(u, v) = 1.234f;
  }
  for (double sigma_space : {1.0, 1.5, 3.0}) {
    SurfaceOptions options;
    options.filter.smoothing = Smoothing::bilateral;
    options.filter.sigma_space = sigma_space;
    const SurfaceEstimator estimator = estimate(scene, options);
    for (std::size_t i = 0; i < scene.depth.size(); ++i) {
      if (std::isfinite(scene.depth[i])) {
        EXPECT_EQ(estimator.depth()[i], 1.234f);
      } else {
        EXPECT_TRUE(std::isnan(estimator.depth()[i]));
      }
    }
  }
}

}  // namespace
}  // namespace palpate
