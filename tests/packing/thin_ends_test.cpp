// Spheres reach thin ends: the promise of packer.h, at every number of spheres.
#include <cstring>

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "src/mesh/internal/surface_points.h"
#include "src/packing/solid/surface_watch.h"
#include "tests/test_util/standoff_truth.h"

namespace palpate {
namespace {

std::vector<Sphere> pack(const TriangleMesh& mesh, int num) {
  PackOptions options;
  options.max_spheres = num;
  return pack_spheres(mesh, options).value().spheres;
}

bool is_prefix(const std::vector<Sphere>& a, const std::vector<Sphere>& all) {
  return a.size() <= all.size() &&
         std::memcmp(a.data(), all.data(), a.size() * sizeof(Sphere)) == 0;
}

// One packing holds those of all smaller numbers, so its prefixes are measured at every tenth
// number; that they are the packings of their number is tested for two of them.
TEST(ThinEnds, NoStandoffIsBeyondItsBoundAtAnyNumber) {
  for (const std::string& name : shape_names()) {
    SCOPED_TRACE(name);
    const TriangleMesh mesh = make_shape(name, 0.196).value();
    const double size = test::longest_side(mesh);
    // Round ones have no ends and many corners to measure.
    const bool is_round = name == "sphere" || name == "torus" || name == "spiral";
    const int most = is_round ? 2000 : 20000;
    const std::vector<Sphere> spheres = pack(mesh, most);
    ASSERT_EQ(spheres.size(), static_cast<std::size_t>(most));
    test::StandoffMeter meter(mesh, 1500, 11);
    int num_beyond = 0;
    for (int n = 1; n <= most; ++n) {
      meter.add(spheres[static_cast<std::size_t>(n) - 1]);
      if (n < kReachingSpheres || n % 10 != 0) continue;
      const test::StandoffTruth truth = meter.measure();
      if (truth.max > standoff_bound(truth.p95, size) && num_beyond++ == 0) {
        ADD_FAILURE() << n << " spheres: " << truth.max << " m, 95 %: " << truth.p95;
      }
    }
    EXPECT_EQ(num_beyond, 0);
    for (const int n : {1000, 2000}) EXPECT_TRUE(is_prefix(pack(mesh, n), spheres)) << n;
  }
}

// Greedy filling leaves 14 mm of the finger's tip empty at 5000 spheres.
TEST(ThinEnds, SpheresReachTheTipOfTheFinger) {
  const TriangleMesh mesh = make_shape("finger", 0.196).value();
  const double tip = bounds(mesh).high.z;
  for (const int num : {1000, 2000, 5000}) {
    float farthest = -1;
    for (const Sphere& s : pack(mesh, num)) farthest = std::max(farthest, s.center.z + s.radius);
    EXPECT_GT(static_cast<double>(farthest), tip - 0.004) << num;
  }
}

// Spheres for thin ends take the places of the smallest ones elsewhere. What these shapes were
// filled with by greedy filling alone, to be kept within 0.5 %.
TEST(ThinEnds, CostLittleFill) {
  struct Greedy {
    const char* shape;
    double of_1000, of_5000;
  };
  for (const Greedy& greedy : {Greedy{"box", 0.83777, 0.88259}, Greedy{"finger", 0.74891, 0.81846},
                               Greedy{"comb", 0.59398, 0.70726}, Greedy{"needle", 0.76133, 0.82172},
                               Greedy{"blade", 0.52496, 0.66120}}) {
    const TriangleMesh mesh = make_shape(greedy.shape, 0.196).value();
    PackOptions options;
    const SpherePacking packing = pack_spheres(mesh, options).value();
    double volume = 0, of_1000 = 0;
    for (std::size_t i = 0; i < packing.spheres.size(); ++i) {
      volume += sphere_volume(static_cast<double>(packing.spheres[i].radius));
      if (i == 999) of_1000 = volume / packing.mesh_volume;
    }
    EXPECT_NEAR(of_1000 / greedy.of_1000, 1, 0.005) << greedy.shape;
    EXPECT_NEAR(volume / packing.mesh_volume / greedy.of_5000, 1, 0.005) << greedy.shape;
  }
}

TEST(ThinEnds, LimitsKeepSpheresOut) {
  PackOptions options;
  options.min_radius = 5e-4;
  const TriangleMesh mesh = make_shape("finger", 0.196).value();
  const SpherePacking packing = pack_spheres(mesh, options).value();
  double farthest = -1;
  for (const Sphere& s : packing.spheres) {
    EXPECT_GE(static_cast<double>(s.radius), 5e-4);
    farthest = std::max(farthest, static_cast<double>(s.center.z));
  }
  EXPECT_LT(farthest, bounds(mesh).high.z - 0.004);  // thinner than a millimeter from there on
  options = {};
  options.max_radius = 4e-3;
  const SpherePacking fine = pack_spheres(mesh, options).value();
  for (const Sphere& s : fine.spheres) EXPECT_LE(static_cast<double>(s.radius), 4e-3);
}

TEST(ThinEnds, AsManySpheresAsAStandoffNeeds) {
  const TriangleMesh mesh = make_shape("tetrahedron", 0.1).value();
  PackOptions options;
  options.max_spheres = 50000;
  options.standoff = 1.2e-3;
  const SpherePacking packing = pack_spheres(mesh, options).value();
  EXPECT_EQ(packing.stop, PackStop::standoff);
  const auto p95_of = [&](std::size_t num) {
    test::StandoffMeter meter(mesh, 20000, 5);
    for (std::size_t i = 0; i < num; ++i) meter.add(packing.spheres[i]);
    return meter.measure().p95;
  };
  const std::size_t num = packing.spheres.size();
  EXPECT_GT(num, 1000u);
  EXPECT_LE(p95_of(num), 1.2e-3 * 1.02);    // points of its own: 2 % for their noise
  EXPECT_GT(p95_of(num * 9 / 10), 1.2e-3);  // and not many more than needed
  EXPECT_TRUE(is_prefix(packing.spheres, pack(mesh, static_cast<int>(num) + 200)));

  // Enough from the start: as few as it looks at.
  options.standoff = 0.05;
  const SpherePacking few = pack_spheres(mesh, options).value();
  EXPECT_EQ(few.stop, PackStop::standoff);
  EXPECT_GE(few.spheres.size(), 1000u);
  EXPECT_LE(few.spheres.size(), 1100u);

  options.max_spheres = 700;
  EXPECT_EQ(pack_spheres(mesh, options)->stop, PackStop::count);
  options.standoff = NAN;
  EXPECT_EQ(pack_spheres(mesh, options).error().code, Errc::invalid_argument);
}

TEST(SurfaceWatch, AgreesWithBruteForceWhileSpheresAreAdded) {
  const TriangleMesh mesh = make_shape("comb", 0.1).value();
  const std::vector<Sphere> spheres = pack(mesh, 600);
  const std::vector<Vec3d> points = surface_points(mesh, kStandoffSamples);
  SphereLevels levels;
  ThreadPool pool(2);
  SurfaceWatch watch(mesh, levels, pool);
  std::vector<double> expected(points.size(), INFINITY);
  std::size_t num = 0;
  for (const std::size_t step : {10u, 12u, 13u, 40u, 200u, 210u, 600u}) {
    for (; num < step; ++num) {
      levels.insert(spheres[num]);
      for (std::size_t i = 0; i < points.size(); ++i) {
        expected[i] = std::min(expected[i], norm(points[i] - to_double(spheres[num].center)) -
                                                static_cast<double>(spheres[num].radius));
      }
    }
    std::vector<double> sorted = expected;
    std::sort(sorted.begin(), sorted.end());
    const auto [p80, p95] = watch.quantiles();
    EXPECT_DOUBLE_EQ(p80, sorted[15999]) << num;
    EXPECT_DOUBLE_EQ(p95, sorted[18999]) << num;
    const auto places = watch.beyond(1.5 * p95);
    std::size_t num_even = 0;
    for (const auto& place : places) {
      if (place.id >= points.size()) continue;
      ++num_even;
      EXPECT_EQ(place.point, points[place.id]);
      EXPECT_NEAR(place.standoff, expected[place.id], 1e-12);
    }
    EXPECT_EQ(num_even,
              static_cast<std::size_t>(sorted.end() -
                                       std::upper_bound(sorted.begin(), sorted.end(), 1.5 * p95)));
    EXPECT_EQ(std::any_of(places.begin(), places.end(),
                          [&](const auto& place) { return place.id >= points.size(); }),
              watch.beyond(1.5 * p95).size() > num_even);
  }
}

}  // namespace
}  // namespace palpate
