#include "palpate/packing/represented_volumes.h"

#include <algorithm>
#include <numeric>

#include <gtest/gtest.h>

#include "palpate/mesh/mass_properties.h"
#include "palpate/mesh/shapes.h"
#include "palpate/packing/packer.h"
#include "src/packing/cut_cube.h"
#include "tests/test_util/random.h"

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

TriangleMesh turned(TriangleMesh mesh) {
  const Quaternion q = axis_angle({1, -2, 0.5}, 0.8);
  for (Vec3d& p : mesh.vertices) p = rotate(q, p) + Vec3d{0.3, -0.2, 0.1};
  return mesh;
}

TEST(RepresentedVolumes, OneSphereStandsForAll) {
  ThreadPool pool;
  const std::vector<Sphere> one{{{0, 0, 0}, 0.04f}};
  const auto volumes = represented_volumes(make_box({0.1, 0.1, 0.1}), one, pool).value();
  EXPECT_NEAR(volumes[0], 1e-3, 1e-10);
}

// Two spheres share a box at the plane of equal power: closed form.
TEST(RepresentedVolumes, TwoSpheresShareABox) {
  ThreadPool pool;
  const TriangleMesh box = make_box({2, 1, 1});
  const double r = 0.45, s = 0.2, a = -0.5, b = 0.7;
  const std::vector<Sphere> spheres{{{static_cast<float>(a), 0, 0}, static_cast<float>(r)},
                                    {{static_cast<float>(b), 0.05f, 0}, static_cast<float>(s)}};
  const auto volumes = represented_volumes(box, spheres, pool).value();
  // |x-a|^2 - r^2 = |x-b|^2 - s^2 on average over y, z (both symmetric about 0).
  const double face = (b * b + 0.05 * 0.05 - s * s - a * a + r * r) / (2 * (b - a));
  EXPECT_NEAR(volumes[0], face + 1, 0.004);
  EXPECT_NEAR(sum(volumes), 2, 1e-6);
}

TEST(RepresentedVolumes, SumToTheMeshAndHoldTheirSpheres) {
  ThreadPool pool(2);
  for (const std::string& name : shape_names()) {
    SCOPED_TRACE(name);
    const TriangleMesh mesh = turned(make_shape(name, 0.1).value());
    const auto spheres = pack(mesh, 500);
    const auto volumes = represented_volumes(mesh, spheres, pool).value();
    ASSERT_EQ(volumes.size(), spheres.size());
    const double mesh_volume = mass_properties(mesh).volume;
    EXPECT_NEAR(sum(volumes), mesh_volume, 1e-6 * mesh_volume);
    for (std::size_t i = 0; i < spheres.size(); ++i) {
      const double own = sphere_volume(static_cast<double>(spheres[i].radius));
      EXPECT_GE(static_cast<double>(volumes[i]), own * (1 - 1e-6));
    }
  }
}

// Against points on a fine grid, each looked up among all spheres; the volume inside is known by
// the closed form of the solid, not by its triangles. Measured: .6 and .9 % rms, noise of the grid
// included.
TEST(RepresentedVolumes, AgreeWithAFineSampling) {
  ThreadPool pool(2);
  const double size = 0.1;
  struct Solid {
    TriangleMesh mesh;
    bool (*inside)(const Vec3d&);
  };
  const Solid solids[] = {{make_box({size, size, size}), [](const Vec3d&) { return true; }},
                          {make_octahedron(size), [](const Vec3d& p) {
                             return std::abs(p.x) + std::abs(p.y) + std::abs(p.z) < 0.05;
                           }}};
  for (const Solid& solid : solids) {
    const auto spheres = pack(solid.mesh, 100);
    const auto volumes = represented_volumes(solid.mesh, spheres, pool).value();
    constexpr int kSide = 160;
    test::Random random(1);
    const double h = size / kSide;
    std::vector<int> counts(spheres.size());
    for (int i = 0; i < kSide * kSide * kSide; ++i) {
      const Vec3d cell =
          Vec3d{double(i % kSide), double(i / kSide % kSide), double(i / kSide / kSide)} +
          Vec3d{0.5, 0.5, 0.5} + random.in_box(0.5);
      const Vec3d p = cell * h - Vec3d{size, size, size} * 0.5;
      if (!solid.inside(p)) continue;
      std::size_t best = 0;
      double least = 1;
      for (std::size_t k = 0; k < spheres.size(); ++k) {
        const Vec3d d = p - to_double(spheres[k].centre);
        const double r = spheres[k].radius, power = dot(d, d) - r * r;
        if (power < least) least = power, best = k;
      }
      ++counts[best];
    }
    double error2 = 0, worst = 0;
    for (std::size_t k = 0; k < spheres.size(); ++k) {
      const double error = counts[k] * h * h * h / static_cast<double>(volumes[k]) - 1;
      error2 += error * error;
      worst = std::max(worst, std::abs(error));
    }
    EXPECT_LT(std::sqrt(error2 / static_cast<double>(spheres.size())), 0.012);
    EXPECT_LT(worst, 0.05);
  }
}

TEST(RepresentedVolumes, SameBitsForAnyThreadCount) {
  const TriangleMesh mesh = make_shape("spiral", 0.1).value();
  const auto spheres = pack(mesh, 400);
  ThreadPool one(1), three(3);
  const auto expected = represented_volumes(mesh, spheres, one).value();
  EXPECT_EQ(represented_volumes(mesh, spheres, three).value(), expected);
}

TEST(RepresentedVolumes, OddInputEndsWell) {
  ThreadPool pool;
  const TriangleMesh box = make_box({1, 1, 1});
  EXPECT_EQ(represented_volumes(box, {}, pool).error().code, Errc::invalid_argument);
  const std::vector<Sphere> one{{{0, 0, 0}, 0.1f}};
  EXPECT_EQ(represented_volumes({}, one, pool).error().code, Errc::bad_input);
  TriangleMesh inside_out = box;
  for (auto& t : inside_out.triangles) std::swap(t[0], t[1]);
  EXPECT_EQ(represented_volumes(inside_out, one, pool).error().code, Errc::bad_input);

  // Spheres that are none of this mesh: too large, far away, all the same, extremely small.
  const std::vector<std::vector<Sphere>> strange{
      {{{0, 0, 0}, 3}, {{1, 0, 0}, 2}},
      {{{1e30f, 0, 0}, 1}, {{0, 0, 0}, 0.1f}},
      std::vector<Sphere>(20, one[0]),
      {{{0.3f, 0, 0}, 1e-38f}, {{-0.3f, 0, 0}, 1e-38f}, {{0, 0.3f, 0}, 1e-38f}}};
  for (const auto& spheres : strange) {
    const auto volumes = represented_volumes(box, spheres, pool).value();
    EXPECT_NEAR(sum(volumes), 1, 1e-6);
    for (const float volume : volumes) EXPECT_GE(volume, 0);
  }
}

TEST(CutCube, FractionBehindAPlane) {
  test::Random random(3);
  for (int trial = 0; trial < 40; ++trial) {
    const Cube cube{random.in_box(1), 0.3};
    const Vec3d n = trial < 3
                        ? Vec3d{trial == 0 ? 2.0 : 0, trial == 1 ? -2.0 : 0, trial == 2 ? 2.0 : 0}
                        : random.direction() * 5;
    const double offset = random.uniform(-1, 1);
    constexpr int kSide = 60;
    int count = 0;
    for (int i = 0; i < kSide * kSide * kSide; ++i) {
      const Vec3d cell{i % kSide + 0.5, i / kSide % kSide + 0.5, i / kSide / kSide + 0.5};
      if (dot(n, (cell * (2.0 / kSide) - Vec3d{1, 1, 1}) * cube.half) <= offset) ++count;
    }
    EXPECT_NEAR(fraction_behind(cube, n, offset), double(count) / (kSide * kSide * kSide), 0.012);
    EXPECT_NEAR(fraction_behind(cube, n, offset) + fraction_behind(cube, -n, -offset), 1, 1e-9);
  }
  EXPECT_EQ(fraction_behind({{}, 1}, {}, 0), 1);
  EXPECT_EQ(fraction_behind({{}, 1}, {}, -1), 0);
}

// A triangle overlaps a cube if one of many points on it lies inside.
TEST(CutCube, OverlapsAsPointsSay) {
  test::Random random(5);
  int num_overlaps = 0, num_disagree = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    const Cube cube{random.in_box(0.3), 0.3};
    const Triangle t{random.in_box(1), random.in_box(1), random.in_box(1)};
    bool found = false;
    for (int i = 0; i <= 60 && !found; ++i) {
      for (int j = 0; i + j <= 60 && !found; ++j) {
        const Vec3d d = t.a + (t.b - t.a) * (i / 60.0) + (t.c - t.a) * (j / 60.0) - cube.centre;
        found = std::max({std::abs(d.x), std::abs(d.y), std::abs(d.z)}) <= cube.half;
      }
    }
    const bool overlap = overlaps(cube, t);
    if (found) {
      EXPECT_TRUE(overlap);
    }
    num_overlaps += overlap;
    num_disagree += overlap != found;
  }
  EXPECT_GT(num_overlaps, 500);
  EXPECT_LT(num_disagree, 60);  // grazed corners, between the points
}

}  // namespace
}  // namespace palpate
