#include "palpate/packing/packing.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <string>

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "src/packing/power_neighbors.h"
#include "src/packing/solid/ray_patches.h"
#include "src/packing/solid/triangle_bvh.h"
#include "tests/test_util/random.h"
#include "tests/test_util/scan_mesh.h"

namespace palpate {
namespace {

std::vector<Sphere> pack(const TriangleMesh& mesh, int num) {
  PackOptions options;
  options.max_spheres = num;
  return pack_spheres(mesh, options).value().spheres;
}

double sum(const std::vector<float>& volumes) {
  return std::accumulate(volumes.begin(), volumes.end(), 0.0);
}

TriangleMesh rotated(TriangleMesh mesh) {
  const Quaternion q = axis_angle({1, -2, 0.5}, 0.8);
  for (Vec3d& p : mesh.vertices) p = rotate(q, p) + Vec3d{0.3, -0.2, 0.1};
  return mesh;
}

// A bar of the section of an L, between -size/2 and size/2 but where x, y > 0.
TriangleMesh make_corner(double size) {
  TriangleMesh mesh;
  const double outline[6][2] = {{-1, -1}, {1, -1}, {1, 0}, {0, 0}, {0, 1}, {-1, 1}};
  for (const double z : {-1.0, 1.0}) {
    for (const auto& [x, y] : outline) mesh.vertices.push_back(Vec3d{x, y, z} * (size / 2));
  }
  for (std::uint32_t i = 0; i < 6; ++i) {
    const std::uint32_t j = (i + 1) % 6;
    mesh.triangles.push_back({i, j, j + 6});
    mesh.triangles.push_back({i, j + 6, i + 6});
    if (i == 3 || j == 3) continue;
    mesh.triangles.push_back({3, j, i});
    mesh.triangles.push_back({9, i + 6, j + 6});
  }
  return mesh;
}

std::size_t nearest_by_power(const std::vector<Sphere>& spheres, const Vec3d& p) {
  std::size_t best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < spheres.size(); ++k) {
    const Vec3d d = p - to_double(spheres[k].center);
    const double r = spheres[k].radius, power = dot(d, d) - r * r;
    if (power < least) least = power, best = k;
  }
  return best;
}

/// Moments about the origin.
struct SampledPart {
  double volume = 0, second = 0;
  Vec3d first;
};

// The truth: points on a jittered grid over a cube about the origin, each looked up among all
// spheres. Whether one is inside is known by the closed form of the solid, not by its triangles.
template <class Inside>
std::vector<SampledPart> sampled_parts(double size, Inside&& inside,
                                       const std::vector<Sphere>& spheres) {
  constexpr int kSide = 200;
  test::Random random(1);
  const double h = size / kSide;
  std::vector<SampledPart> parts(spheres.size());
  for (int i = 0; i < kSide * kSide * kSide; ++i) {
    const Vec3d cell{double(i % kSide), double(i / kSide % kSide), double(i / kSide / kSide)};
    const Vec3d p =
        (cell + Vec3d{0.5, 0.5, 0.5} + random.in_box(0.5)) * h - Vec3d{size, size, size} * 0.5;
    if (!inside(p)) continue;
    SampledPart& part = parts[nearest_by_power(spheres, p)];
    part.volume += h * h * h;
    part.first += p * (h * h * h);
    part.second += dot(p, p) * h * h * h;
  }
  return parts;
}

bool in_corner(const Vec3d& p) { return !(p.x > 0 && p.y > 0); }

TEST(RepresentedVolumes, OneSphereStandsForAll) {
  ThreadPool pool;
  const std::vector<Sphere> one{{{0, 0, 0}, 0.04f}};
  const auto volumes = represented_parts(make_box({0.1, 0.1, 0.1}), one, pool).value().volumes;
  EXPECT_NEAR(volumes[0], 1e-3, 1e-10);
}

// The ball of a cube about its center: a second moment of side^2 / 4 in all, which is 3/5 R^2.
TEST(RepresentedVolumes, ABallHasTheSecondMomentOfItsPart) {
  ThreadPool pool;
  const std::vector<Sphere> one{{{0, 0, 0}, 0.04f}};
  const RepresentedParts parts = represented_parts(make_box({0.1, 0.1, 0.1}), one, pool).value();
  EXPECT_NEAR(norm(to_double(parts.balls[0].center)), 0, 1e-6);
  EXPECT_NEAR(parts.balls[0].radius, std::sqrt(5.0 / 12) * 0.1, 1e-5);
  // A needle's ball is not as long as the needle.
  const RepresentedParts needle =
      represented_parts(make_box({0.1, 0.01, 0.01}), {{{{0, 0, 0}, 0.005f}}}, pool).value();
  EXPECT_NEAR(needle.balls[0].radius, 1.5 * std::cbrt(1e-5 / sphere_volume(1.0)), 1e-6);
}

// Two spheres share a box at the plane of equal power: closed form.
TEST(RepresentedVolumes, TwoSpheresShareABox) {
  ThreadPool pool;
  const TriangleMesh box = make_box({2, 1, 1});
  const double r = 0.45, s = 0.2, a = -0.5, b = 0.7;
  const std::vector<Sphere> spheres{{{static_cast<float>(a), 0, 0}, static_cast<float>(r)},
                                    {{static_cast<float>(b), 0.05f, 0}, static_cast<float>(s)}};
  const auto volumes = represented_parts(box, spheres, pool).value().volumes;
  // |x-a|^2 - r^2 = |x-b|^2 - s^2 on average over y, z (both symmetric about 0).
  const double face = (b * b + 0.05 * 0.05 - s * s - a * a + r * r) / (2 * (b - a));
  EXPECT_NEAR(volumes[0], face + 1, 2e-4);
  EXPECT_NEAR(sum(volumes), 2, 1e-6);
}

// A part of the first cell lies round the corner, out of sight of its sphere.
TEST(RepresentedVolumes, CellsReachRoundACorner) {
  ThreadPool pool;
  const std::vector<Sphere> spheres{{{0.03f, -0.012f, 0}, 0.01f}, {{-0.045f, 0.045f, 0}, 0.003f}};
  const auto volumes = represented_parts(make_corner(0.1), spheres, pool).value().volumes;
  const auto truth = sampled_parts(0.1, in_corner, spheres);
  for (std::size_t k = 0; k < 2; ++k)
    EXPECT_NEAR(static_cast<double>(volumes[k]), truth[k].volume, 0.003 * truth[k].volume);
}

TEST(RepresentedVolumes, SumToTheMeshAndHoldTheirSpheres) {
  ThreadPool pool(2);
  for (const std::string& name : shape_names()) {
    SCOPED_TRACE(name);
    const TriangleMesh mesh = rotated(make_shape(name, 0.1).value());
    const auto spheres = pack(mesh, 500);
    const auto volumes = represented_parts(mesh, spheres, pool).value().volumes;
    ASSERT_EQ(volumes.size(), spheres.size());
    const double mesh_volume = mass_properties(mesh).volume;
    EXPECT_NEAR(sum(volumes), mesh_volume, 6.1e-8 * mesh_volume);  // half a unit each
    for (std::size_t i = 0; i < spheres.size(); ++i) {
      const double own = sphere_volume(static_cast<double>(spheres[i].radius));
      EXPECT_GE(static_cast<double>(volumes[i]), own * (1 - 1e-6));
    }
  }
}

// Volumes, measured: .1 to .45 % rms, most of it noise of the points: .04 to .16 % with four times
// as many.
TEST(RepresentedVolumes, AgreeWithAFineSampling) {
  ThreadPool pool(2);
  const double size = 0.1;
  struct Solid {
    TriangleMesh mesh;
    bool (*inside)(const Vec3d&);
  };
  const Solid solids[] = {
      {make_box({size, size, size}), [](const Vec3d&) { return true; }},
      {make_octahedron(size),
       [](const Vec3d& p) { return std::abs(p.x) + std::abs(p.y) + std::abs(p.z) < 0.05; }},
      {make_corner(size), in_corner}};
  for (const Solid& solid : solids) {
    const auto spheres = pack(solid.mesh, 100);
    const auto parts = represented_parts(solid.mesh, spheres, pool).value();
    const auto truth = sampled_parts(size, solid.inside, spheres);
    double error2 = 0, worst = 0, shift2 = 0, radius2 = 0;
    Vec3d first;
    for (std::size_t k = 0; k < spheres.size(); ++k) {
      const double volume = truth[k].volume;
      const double error = volume / static_cast<double>(parts.volumes[k]) - 1;
      error2 += error * error;
      worst = std::max(worst, std::abs(error));
      // The ball has the centroid of the part, and its second moment about that.
      const Vec3d c = truth[k].first / volume, got = to_double(parts.balls[k].center);
      const double r = parts.balls[k].radius;
      const double want = std::sqrt(5.0 / 3 * (truth[k].second / volume - dot(c, c)));
      const double most = 1.5 * std::cbrt(volume / sphere_volume(1.0));
      shift2 += dot(got - c, got - c) / (r * r);
      radius2 += std::pow(r / std::min(want, most) - 1, 2);
      first += got * static_cast<double>(parts.volumes[k]);
    }
    const auto num = static_cast<double>(spheres.size());
    EXPECT_LT(std::sqrt(error2 / num), 0.006);
    EXPECT_LT(worst, 0.02);
    EXPECT_LT(std::sqrt(shift2 / num), 0.01);
    EXPECT_LT(std::sqrt(radius2 / num), 0.01);
    const MassProperties mass = mass_properties(solid.mesh);
    EXPECT_LT(norm(first / mass.volume - mass.center_of_mass), 2e-5 * size);
  }
}

PALPATE_ON_SCANS(RepresentedVolumesOfScans);

// Random points in a scanned surface: were the volumes right, chi squared per sphere would be 1.
TEST_P(RepresentedVolumesOfScans, AgreeWithRandomPoints) {
  PALPATE_SCAN_OR_SKIP(mesh);
  ThreadPool pool(2);
  const auto spheres = pack(mesh, 1000);
  const auto volumes = represented_parts(mesh, spheres, pool).value().volumes;
  const TriangleBvh bvh(mesh);
  const Bounds box = bounds(mesh);
  test::Random random(7);
  std::vector<double> counts(spheres.size());
  constexpr double kNumPoints = 200000;
  for (int i = 0; i < int(kNumPoints);) {
    Vec3d p;
    for (int k = 0; k < 3; ++k) p[k] = random.uniform(box.low[k], box.high[k]);
    if (!bvh.inside(p)) continue;
    ++counts[nearest_by_power(spheres, p)];
    ++i;
  }
  double chi2 = 0;
  for (std::size_t k = 0; k < spheres.size(); ++k) {
    const double expected = kNumPoints * static_cast<double>(volumes[k]) / sum(volumes);
    chi2 += (counts[k] - expected) * (counts[k] - expected) / expected;
  }
  EXPECT_NEAR(chi2 / static_cast<double>(spheres.size()), 1, 0.15);
}

// Cells much longer than their spheres, and facets without number.
TEST(RepresentedVolumes, ThinSolidsAndManyFacetsEndWell) {
  ThreadPool pool(2);
  for (const TriangleMesh& mesh :
       {make_box({1, 1, 0.001}), make_box({0.001, 1, 0.001}), make_cylinder(0.02, 0.1, 8192)}) {
    const auto all = pack(mesh, 100);
    for (const std::size_t num : {1u, 10u, 100u}) {
      const std::vector<Sphere> spheres(all.begin(), all.begin() + static_cast<long>(num));
      const auto volumes = represented_parts(mesh, spheres, pool).value().volumes;
      const double mesh_volume = mass_properties(mesh).volume;
      EXPECT_NEAR(sum(volumes), mesh_volume, 6.1e-8 * mesh_volume);
    }
  }
}

TEST(RepresentedVolumes, SameBitsForAnyThreadCount) {
  const TriangleMesh mesh = make_shape("spiral", 0.1).value();
  const auto spheres = pack(mesh, 400);
  ThreadPool one(1), three(3);
  const auto expected = represented_parts(mesh, spheres, one).value().volumes;
  EXPECT_EQ(represented_parts(mesh, spheres, three).value().volumes, expected);
}

TEST(RepresentedVolumes, OddInputEndsWell) {
  ThreadPool pool;
  const TriangleMesh box = make_box({1, 1, 1});
  EXPECT_EQ(represented_parts(box, {}, pool).error().code, Errc::invalid_argument);
  const std::vector<Sphere> one{{{0, 0, 0}, 0.1f}};
  EXPECT_EQ(represented_parts({}, one, pool).error().code, Errc::bad_input);
  TriangleMesh inside_out = box;
  for (auto& t : inside_out.triangles) std::swap(t[0], t[1]);
  EXPECT_EQ(represented_parts(inside_out, one, pool).error().code, Errc::bad_input);

  // Spheres that are none of this mesh: too large, far away, all the same, extremely small.
  const std::vector<std::vector<Sphere>> strange{
      {{{0, 0, 0}, 3}, {{1, 0, 0}, 2}},
      {{{1e30f, 0, 0}, 1}, {{0, 0, 0}, 0.1f}},
      std::vector<Sphere>(20, one[0]),
      {{{0.3f, 0, 0}, 1e-38f}, {{-0.3f, 0, 0}, 1e-38f}, {{0, 0.3f, 0}, 1e-38f}}};
  for (const auto& spheres : strange) {
    const auto volumes = represented_parts(box, spheres, pool).value().volumes;
    EXPECT_NEAR(sum(volumes), 1, 1e-6);
    for (const float volume : volumes) EXPECT_GE(volume, 0);
  }
}

// Every plane of equal power that is within reach, and what it is.
TEST(PowerNeighbors, FindsThePlanesOfAllPairs) {
  const auto spheres = pack(make_box({0.1, 0.1, 0.1}), 600);
  const PowerNeighbors neighbors(spheres);
  ASSERT_EQ(neighbors.size(), spheres.size());
  std::vector<Pull> planes;
  std::size_t num_found = 0;
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    const Vec3d center = to_double(neighbors.sphere(i).center);
    EXPECT_EQ(center, to_double(spheres[neighbors.original(i)].center));
    const double radius = neighbors.sphere(i).radius, reach = radius + 0.004;
    planes.clear();
    ASSERT_TRUE(neighbors.gather(i, reach, planes));
    std::size_t num_expected = 0;
    for (const Sphere& other : spheres) {
      const Vec3d apart = to_double(other.center) - center;
      const double d = norm(apart), s = other.radius;
      if (d == 0) continue;
      const double distance = (d * d + radius * radius - s * s) / (2 * d);
      if (distance > reach * (1 - 1e-9)) continue;
      ++num_expected;
      const Vec3d expected = apart * (reach / (d * distance));
      EXPECT_TRUE(std::any_of(planes.begin(), planes.end(), [&](const Pull& plane) {
        return norm(to_double(plane.pull) - expected) < 1e-5 * norm(expected) &&
               std::abs(static_cast<double>(plane.strength) - norm(expected)) <
                   1e-5 * norm(expected);
      }));
    }
    EXPECT_LE(planes.size(), num_expected + 1);
    num_found += planes.size();
  }
  EXPECT_GT(num_found, 10 * spheres.size());
}

TEST(PowerNeighbors, SaysWhenACenterIsOutsideItsCell) {
  const std::vector<Sphere> spheres{{{0, 0, 0}, 3}, {{1, 0, 0}, 1}, {{1, 0, 0}, 0.5f}};
  const PowerNeighbors neighbors(spheres);
  std::vector<Pull> planes;
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(neighbors.gather(i, 10, planes), neighbors.original(i) == 0);
}

TEST(RayPatches, AreUnitEvenAndWithinTheirSpread) {
  for (const std::size_t num : {1u, 2u, 7u, 32u, 1000u}) {
    const auto patches = make_ray_patches(num);
    ASSERT_EQ(patches.size(), num);
    Vec3d sum, squares;
    for (const RayPatch& patch : patches) {
      for (std::size_t k = 0; k < RayPatch::kSize; ++k) {
        const Vec3f u{patch.x[k / 4][k % 4], patch.y[k / 4][k % 4], patch.z[k / 4][k % 4]};
        EXPECT_NEAR(norm(u), 1, 1e-6);
        EXPECT_LE(norm(u - patch.axis), patch.spread);
        EXPECT_EQ(patch.along({1, 2, 3}, k / 4)[k % 4], u.x + u.y * 2 + u.z * 3);
        EXPECT_LE(dot(u, Vec3f{1, 2, 3}), patch.bound({1, 2, 3}, std::sqrt(14.0f)));
        sum += to_double(u);
        squares += Vec3d{u.x * u.x, u.y * u.y, u.z * u.z};
      }
    }
    const double num_rays = static_cast<double>(num * RayPatch::kSize);
    EXPECT_LT(norm(sum / num_rays), 0.3 / num_rays);
    EXPECT_LT(norm(squares / num_rays - Vec3d{1, 1, 1} / 3.0), 0.6 / num_rays);
    // A belt has room for its patches side by side.
    EXPECT_LT(patches[num / 2].spread, 4 / std::sqrt(static_cast<float>(num)));
  }
}

}  // namespace
}  // namespace palpate
