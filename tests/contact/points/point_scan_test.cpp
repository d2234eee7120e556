// The points in each sphere and their sums, against a look at every point and every sphere in
// double.
#include "src/contact/points/scan/point_scan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

constexpr ScanPoints kScans[] = PALPATE_BY_ISA(scan_points);

/// Results of a scan.
struct Found {
  std::vector<PointSums> sums;
  std::vector<std::uint8_t> touched;

  explicit Found(std::size_t num_spheres) : sums(num_spheres), touched(num_spheres) {}
  friend bool operator==(const Found& a, const Found& b) {
    return a.touched == b.touched &&
           std::memcmp(a.sums.data(), b.sums.data(), a.sums.size() * sizeof(PointSums)) == 0;
  }
};

/// Points all over a tool of spheres, one row of them, with holes.
struct Scene {
  std::vector<Sphere> spheres = test::random_spheres(200, 0.05, 3);
  SphereGrid grid{spheres};
  PointCloud cloud{1501, 1};
  PointScan scan;

  explicit Scene(PointWeights weights) {
    test::Random random(5);
    const Pose X_WT{{0.31, -0.22, 0.63}, random.rotation(3)};
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vec3d p_W = X_WT * random.in_box(0.06);
      if (random.uniform() > 0.05) cloud.set(i, to_float(p_W), to_float(random.direction()));
    }
    scan.cloud = cloud.view();
    scan.grid = grid.view();
    scan.spheres = spheres.data();
    scan.R_TW = rotation_matrix(conjugate(X_WT.rotation));
    scan.translation_W = X_WT.translation;
    scan.weights = weights;
  }
  void look(Isa isa, int begin, int end, Found& found) const {
    select_isa(kScans, isa)(scan, 0, 1, begin, end, found.sums.data(), found.touched.data());
  }
};

TEST(PointScan, FindsTheSphereOfEveryPoint) {
  for (const PointWeights weights :
       {PointWeights::none, PointWeights::beside, PointWeights::in_sums}) {
    const Scene scene(weights);
    const PointScan& scan = scene.scan;
    Found found(scene.spheres.size());
    scene.look(best_isa(), 0, scene.cloud.width(), found);
    int num_found = 0;
    for (std::size_t id = 0; id < scene.spheres.size(); ++id) {
      const double r = scene.spheres[id].radius;
      Vec3d offset, normal;
      double num = 0, weight = 0;
      for (std::size_t i = 0; i < scene.cloud.size(); ++i) {
        const Vec3d offset_W = to_double(scene.cloud.point(i)) - scan.translation_W;
        const double distance = norm(scan.R_TW * offset_W - to_double(scene.spheres[id].center));
        if (!(distance <= r)) continue;
        const double w = std::pow(1 - distance * distance / (r * r), 2);
        const double factor = weights == PointWeights::in_sums ? w : 1;
        num += 1;
        weight += w;
        offset += factor * offset_W;
        normal += factor * to_double(scene.cloud.normal(i));
      }
      const PointSums& sums = found.sums[id];
      EXPECT_EQ(sums.has_points(), num > 0);
      EXPECT_EQ(found.touched[id], num > 0);
      EXPECT_EQ(sums.num_points(scan.sum_scale), num);
      EXPECT_NEAR(sums.weight(scan.sum_scale), weights == PointWeights::none ? 0 : weight, 1e-9);
      EXPECT_LT(norm(sums.offset(scan.sum_scale) - offset), 1e-9);
      EXPECT_LT(norm(sums.normal(scan.sum_scale) - normal), 1e-9);
      num_found += static_cast<int>(num);
    }
    EXPECT_GT(num_found, 200);
  }
}

// Threads take a row in pieces that end anywhere.
TEST(PointScan, PiecesOfARowAddUpToTheWhole) {
  for (const Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
    for (const PointWeights weights : {PointWeights::none, PointWeights::in_sums}) {
      const Scene scene(weights);
      const int num = scene.cloud.width();
      Found whole(scene.spheres.size()), pieces(scene.spheres.size());
      scene.look(isa, 0, num, whole);
      for (int begin = 0, length = 1; begin < num; begin += length, length = length % 37 + 5) {
        scene.look(isa, begin, std::min(begin + length, num), pieces);
      }
      EXPECT_TRUE(whole == pieces) << isa_name(isa);
      // A scan of three points counts no other ones.
      Found part(scene.spheres.size());
      scene.look(isa, 700, 703, part);
      std::int64_t num_points = 0;
      for (const PointSums& sums : part.sums) num_points += sums.offset_W[3];
      EXPECT_LE(static_cast<double>(num_points), 3 * scene.scan.sum_scale);
    }
  }
}

TEST(PointScan, SumsAddUp) {
  PointSums sum, other;
  for (int i = 0; i < 4; ++i) {
    sum.offset_W[i] = 100 + i, sum.normal_W[i] = -50 + i;
    other.offset_W[i] = 7 * i + 1, other.normal_W[i] = 9 * i + 2;
  }
  sum.add(other);
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(sum.offset_W[i], 101 + 8 * i);
    EXPECT_EQ(sum.normal_W[i], -48 + 10 * i);
  }
}

// The finest power of two with which nothing runs over: twice as fine would, or 2^40.
TEST(PointScan, SumsAreAsFineAsTheyFit) {
  constexpr double kMaxSum = 9e18, kFinest = PointSums::kFinestScale;
  EXPECT_EQ(finest_sum_scale(1, 0.1), kFinest);
  EXPECT_EQ(finest_sum_scale(8'000'000, 1), kFinest);
  EXPECT_EQ(finest_sum_scale(8'000'000, 1e-3), kFinest) << "counts need room, too";
  EXPECT_EQ(finest_sum_scale(1, kMaxSum / kFinest), kFinest) << "just fits";
  test::Random random(3);
  for (int i = 0; i < 1000; ++i) {
    const auto num = static_cast<std::size_t>(std::exp(random.uniform(0, 20)));
    const double reach = std::exp(random.uniform(-5, 10));
    const double scale = finest_sum_scale(num, reach);
    const double most = static_cast<double>(num) * std::max(reach, 1.0);
    EXPECT_LE(most * scale, kMaxSum);
    EXPECT_TRUE(scale == kFinest || most * scale * 2 > kMaxSum) << num << " " << reach;
    EXPECT_EQ(std::exp2(std::round(std::log2(scale))), scale);
  }
}

TEST(PointScan, WhatWasTouchedIsToldOnceInOrder) {
  std::vector<std::uint8_t> touched(64);
  const std::vector<std::size_t> want{0, 7, 8, 30, 63};
  for (const std::size_t id : want) touched[id] = 1;
  std::vector<std::size_t> got;
  take_touched(touched, [&](std::size_t id) { got.push_back(id); });
  EXPECT_EQ(got, want);
  take_touched(touched, [&](std::size_t id) { got.push_back(id); });
  EXPECT_EQ(got, want);
}

}  // namespace
}  // namespace palpate
