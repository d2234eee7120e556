#include "palpate/packing/packing.h"

#include <algorithm>
#include <cstring>
#include <set>

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "tests/test_util/random.h"
#include "tests/test_util/scan_mesh.h"

namespace palpate {
namespace {

TriangleMesh moved(TriangleMesh mesh, double scale, const Vec3d& shift) {
  const Quaternion q = axis_angle({1, -2, 0.5}, 0.8);
  for (Vec3d& p : mesh.vertices) p = rotate(q, p) * scale + shift;
  return mesh;
}

SpherePacking pack(const TriangleMesh& mesh, int num, int num_threads = 0) {
  PackOptions options;
  options.max_spheres = num;
  options.num_threads = num_threads;
  return pack_spheres(mesh, options).value();
}

double fill(const SpherePacking& packing) {
  double volume = 0;
  for (const Sphere& s : packing.spheres) volume += sphere_volume(static_cast<double>(s.radius));
  return volume / packing.mesh_volume;
}

bool same_bits(const std::vector<Sphere>& a, const std::vector<Sphere>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(Sphere)) == 0;
}

double distance_to_triangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& p) {
  const Vec3d n = cross(b - a, c - a);
  const auto left = [&](const Vec3d& u, const Vec3d& v) {
    return dot(cross(v - u, p - u), n) >= 0;
  };
  if (left(a, b) && left(b, c) && left(c, a)) return std::abs(dot(n, p - a)) / norm(n);
  const auto to_edge = [&](const Vec3d& u, const Vec3d& v) {
    const double s = std::clamp(dot(p - u, v - u) / dot(v - u, v - u), 0.0, 1.0);
    return norm(p - (u + (v - u) * s));
  };
  return std::min({to_edge(a, b), to_edge(b, c), to_edge(c, a)});
}

// Winding number: the sum of the solid angles of all triangles (van Oosterom and Strackee).
double winding_number(const TriangleMesh& mesh, const Vec3d& p) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3d a = mesh.vertices[t[0]] - p, b = mesh.vertices[t[1]] - p,
                c = mesh.vertices[t[2]] - p;
    const double la = norm(a), lb = norm(b), lc = norm(c);
    sum += std::atan2(dot(a, cross(b, c)),
                      la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
  }
  return sum / (2 * kPi);
}

// Every pair of spheres, every sphere against every triangle, in double.
void expect_exact(const TriangleMesh& mesh, const std::vector<Sphere>& spheres) {
  int num_overlaps = 0, num_protrusions = 0, num_outside = 0;
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    const Vec3d c = to_double(spheres[i].center);
    const double r = spheres[i].radius;
    ASSERT_GT(r, 0);
    for (std::size_t j = 0; j < i; ++j) {
      const double reach = r + static_cast<double>(spheres[j].radius);
      if (norm(c - to_double(spheres[j].center)) < reach) ++num_overlaps;
    }
    for (const auto& t : mesh.triangles) {
      const double distance =
          distance_to_triangle(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]], c);
      if (!(distance > r)) ++num_protrusions;
    }
    if (std::abs(winding_number(mesh, c) - 1) > 1e-6) ++num_outside;
  }
  EXPECT_EQ(num_overlaps, 0);
  EXPECT_EQ(num_protrusions, 0);
  EXPECT_EQ(num_outside, 0);
}

TEST(Packer, SpheresAreDisjointAndInside) {
  for (const std::string& name : shape_names()) {
    SCOPED_TRACE(name);
    const TriangleMesh mesh = make_shape(name, 0.1).value();
    const SpherePacking packing = pack(mesh, 1500);
    expect_exact(mesh, packing.spheres);
    EXPECT_NEAR(packing.mesh_volume, mass_properties(mesh).volume, 1e-12 * packing.mesh_volume);
  }
}

TEST(Packer, AnySizeAndPlace) {
  for (const auto& [scale, shift] :
       {std::pair{0.01, Vec3d{}}, std::pair{0.01, Vec3d{0.7, -0.9, 0.4}},
        std::pair{20.0, Vec3d{-3, 1, 2}}}) {
    const TriangleMesh mesh = moved(make_octahedron(0.1), scale, shift);
    const SpherePacking packing = pack(mesh, 1000);
    expect_exact(mesh, packing.spheres);
    EXPECT_EQ(packing.spheres.size(), 1000u);
    EXPECT_GT(fill(packing), 0.85);
  }
}

TEST(Packer, ThinAndLong) {
  for (const Vec3d& size : {Vec3d{0.1, 0.1, 1e-4}, Vec3d{1, 1e-3, 1e-3}, Vec3d{1, 1e-3, 2e-5}}) {
    for (const TriangleMesh& mesh : {make_box(size), moved(make_box(size), 1, {0.1, 0, 0})}) {
      const SpherePacking packing = pack(mesh, 2000);
      EXPECT_EQ(packing.spheres.size(), 2000u);
      expect_exact(mesh, packing.spheres);
    }
  }
}

TEST(Packer, TwoShells) {
  TriangleMesh mesh = make_box({0.1, 0.1, 0.1});
  const TriangleMesh other = moved(make_box({0.01, 0.01, 0.01}), 1, {0.2, 0, 0});
  for (const auto& t : other.triangles) {
    mesh.triangles.push_back({t[0] + 8, t[1] + 8, t[2] + 8});
  }
  mesh.vertices.insert(mesh.vertices.end(), other.vertices.begin(), other.vertices.end());
  const SpherePacking packing = pack(mesh, 5000);
  expect_exact(mesh, packing.spheres);
  EXPECT_TRUE(std::any_of(packing.spheres.begin(), packing.spheres.end(),
                          [](const Sphere& s) { return s.center.x > 0.15f; }));
}

// Measured: cube .8377, tetrahedron .8000, octahedron .8590.
TEST(Packer, FillsWell) {
  EXPECT_GT(fill(pack(make_box({0.1, 0.1, 0.1}), 1000)), 0.835);
  EXPECT_GT(fill(pack(make_tetrahedron(0.1), 1000)), 0.795);
  EXPECT_GT(fill(pack(make_octahedron(0.1), 1000)), 0.855);
}

PALPATE_ON_SCANS(PackerOfScans);

// Measured: the rabbit .8022 at 1000, .8779 at 10000.
TEST_P(PackerOfScans, FillsThem) {
  PALPATE_SCAN_OR_SKIP(scan);
  const SpherePacking packing = pack(scan, 10000);
  EXPECT_GT(fill(packing), 0.875);
  SpherePacking first = packing;
  first.spheres.resize(1000);
  EXPECT_GT(fill(first), 0.798);
  expect_exact(scan, first.spheres);
  // Approximately largest first.
  int num_late = 0;
  float least = 1;
  for (const Sphere& s : packing.spheres) {
    least = std::min(least, s.radius);
    if (s.radius > 1.05f * least) ++num_late;
  }
  EXPECT_LT(num_late, 100);
}

TEST(Packer, EveryPrefixIsThePackingForThatNumber) {
  const TriangleMesh mesh = make_shape("stylus", 0.15).value();
  const std::vector<Sphere> all = pack(mesh, 3000).spheres;
  for (std::size_t num : {1u, 7u, 300u, 2999u}) {
    const std::vector<Sphere> prefix(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(num));
    EXPECT_TRUE(same_bits(pack(mesh, static_cast<int>(num)).spheres, prefix));
  }
}

TEST(Packer, SameBitsForAnyThreadCountAndRun) {
  for (const char* name : {"box", "torus", "spiral"}) {
    const TriangleMesh mesh = make_shape(name, 0.1).value();
    const std::vector<Sphere> expected = pack(mesh, 3000, 1).spheres;
    for (int num_threads : {1, 2, 3}) {
      EXPECT_TRUE(same_bits(pack(mesh, 3000, num_threads).spheres, expected));
    }
  }
}

TEST(Packer, SeedChangesTheStart) {
  const TriangleMesh mesh = make_shape("torus", 0.1).value();
  PackOptions options;
  options.max_spheres = 500;
  const auto plain = pack_spheres(mesh, options).value();
  options.seed = 7;
  const auto jittered = pack_spheres(mesh, options).value();
  EXPECT_FALSE(same_bits(plain.spheres, jittered.spheres));
  EXPECT_TRUE(same_bits(jittered.spheres, pack_spheres(mesh, options).value().spheres));
  EXPECT_NEAR(fill(plain), fill(jittered), 0.03);
  expect_exact(mesh, jittered.spheres);
}

TEST(Packer, StopsAtEachLimit) {
  const TriangleMesh mesh = make_box({0.1, 0.1, 0.1});
  PackOptions options;
  options.max_spheres = 40;
  EXPECT_EQ(pack_spheres(mesh, options)->stop, PackStop::count);

  options = {};
  options.max_fill = 0.8;
  const auto filled = pack_spheres(mesh, options).value();
  EXPECT_EQ(filled.stop, PackStop::fill);
  EXPECT_GE(fill(filled), 0.8);
  EXPECT_LT(fill(filled), 0.801);

  options = {};
  options.min_radius = 0.003;
  const auto coarse = pack_spheres(mesh, options).value();
  EXPECT_EQ(coarse.stop, PackStop::radius);
  EXPECT_GT(coarse.spheres.size(), 100u);
  for (const Sphere& s : coarse.spheres) EXPECT_GE(static_cast<double>(s.radius), 0.003);

  options = {};
  options.max_spheres = 2'000'000;
  options.max_seconds = 0.05;
  EXPECT_EQ(pack_spheres(mesh, options)->stop, PackStop::time);

  // A millimeter ten meters away: single precision ends it before the count does.
  options = {};
  options.max_spheres = 2'000'000;
  const TriangleMesh far = moved(make_box({1e-3, 1e-3, 1e-3}), 1, {10, 0, 0});
  const auto exhausted = pack_spheres(far, options).value();
  EXPECT_EQ(exhausted.stop, PackStop::exhausted);
  EXPECT_GT(exhausted.spheres.size(), 1000u);
  expect_exact(far, exhausted.spheres);
}

TEST(Packer, CapsTheRadius) {
  const TriangleMesh mesh = make_box({0.1, 0.1, 0.1});
  PackOptions options;
  options.max_spheres = 2000;
  options.max_radius = 0.005;
  const auto packing = pack_spheres(mesh, options).value();
  expect_exact(mesh, packing.spheres);
  for (const Sphere& s : packing.spheres) EXPECT_LE(static_cast<double>(s.radius), 0.005);
  EXPECT_GT(fill(packing), 0.55);
}

TEST(Packer, Cancels) {
  PackOptions options;
  int num_calls = 0;
  options.progress = [&](const PackProgress&) { return ++num_calls < 1; };
  const auto result = pack_spheres(make_box({0.1, 0.1, 0.1}), options);
  ASSERT_FALSE(result.has_value());
  EXPECT_EQ(result.error().code, Errc::cancelled);
  EXPECT_EQ(num_calls, 1);
}

TEST(Packer, ReportsProgress) {
  PackOptions options;
  options.max_spheres = 60000;
  std::vector<PackProgress> reports;
  options.progress = [&](const PackProgress& progress) {
    return reports.push_back(progress), true;
  };
  const auto packing = pack_spheres(make_box({0.1, 0.1, 0.1}), options).value();
  ASSERT_GE(reports.size(), 1u);
  for (std::size_t i = 1; i < reports.size(); ++i) {
    EXPECT_GE(reports[i].num_spheres, reports[i - 1].num_spheres);
    EXPECT_GE(reports[i].fill, reports[i - 1].fill);
    // A busy machine also reports before the first sphere.
    EXPECT_EQ(reports[i].last_radius > 0, reports[i].num_spheres > 0);
  }
  EXPECT_LE(reports.back().fill, fill(packing) * (1 + 1e-12));
}

TEST(Packer, RefusesNonsense) {
  const TriangleMesh box = make_box({1, 1, 1});
  const auto code = [&](auto change) {
    PackOptions options;
    change(options);
    return pack_spheres(box, options).error().code;
  };
  EXPECT_EQ(code([](PackOptions& o) { o.max_spheres = 0; }), Errc::invalid_argument);
  EXPECT_EQ(code([](PackOptions& o) { o.max_radius = 0; }), Errc::invalid_argument);
  EXPECT_EQ(code([](PackOptions& o) { o.max_radius = NAN; }), Errc::invalid_argument);
  EXPECT_EQ(code([](PackOptions& o) { o.min_radius = -1; }), Errc::invalid_argument);
  EXPECT_EQ(code([](PackOptions& o) { o.min_radius = 0.2, o.max_radius = 0.1; }),
            Errc::invalid_argument);
  EXPECT_EQ(code([](PackOptions& o) { o.max_fill = 0; }), Errc::invalid_argument);
  EXPECT_EQ(code([](PackOptions& o) { o.max_seconds = NAN; }), Errc::invalid_argument);
  EXPECT_EQ(code([](PackOptions& o) { o.num_threads = -1; }), Errc::invalid_argument);
  // No sphere of half a meter and more fits.
  EXPECT_EQ(code([](PackOptions& o) { o.min_radius = 0.51; }), Errc::bad_input);

  EXPECT_EQ(pack_spheres(TriangleMesh{}, {}).error().code, Errc::bad_input);
  TriangleMesh broken = box;
  broken.triangles[3][1] = 99;
  EXPECT_EQ(pack_spheres(broken, {}).error().code, Errc::bad_input);
  broken = box;
  broken.vertices[2].y = NAN;
  EXPECT_EQ(pack_spheres(broken, {}).error().code, Errc::bad_input);
  broken = box;
  for (auto& t : broken.triangles) std::swap(t[0], t[1]);
  EXPECT_EQ(pack_spheres(broken, {}).error().code, Errc::bad_input);
}

// In round tools all facets are equally far from the middle: the first ball leaves only slivers.
TEST(Packer, SurvivesFineRoundTools) {
  const SpherePacking ball = pack(make_icosphere(0.05, 5), 300);
  EXPECT_GT(fill(ball), 0.998);
  const TriangleMesh cylinder = moved(make_cylinder(0.02, 0.1, 8192), 1, {});
  const SpherePacking packing = pack(cylinder, 300);
  EXPECT_EQ(packing.spheres.size(), 300u);
  EXPECT_GT(fill(packing), 0.75);
  expect_exact(cylinder, {packing.spheres.begin(), packing.spheres.begin() + 100});
}

// A plate with rows x columns square holes, made of square cells of side `cell`: genus = holes.
TriangleMesh holed_plate(int rows, int columns, double cell, double thickness) {
  const int nx = 2 * columns + 1, ny = 2 * rows + 1;
  const auto solid = [&](int x, int y) {
    return x >= 0 && y >= 0 && x < nx && y < ny && (x % 2 == 0 || y % 2 == 0);
  };
  TriangleMesh mesh;
  for (int z = 0; z < 2; ++z) {
    for (int y = 0; y <= ny; ++y) {
      for (int x = 0; x <= nx; ++x) mesh.vertices.push_back({x * cell, y * cell, z * thickness});
    }
  }
  const auto at = [&](int x, int y, int z) {
    return static_cast<std::uint32_t>((z * (ny + 1) + y) * (nx + 1) + x);
  };
  const auto quad = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    mesh.triangles.push_back({a, b, c});
    mesh.triangles.push_back({a, c, d});
  };
  for (int y = 0; y < ny; ++y) {
    for (int x = 0; x < nx; ++x) {
      if (!solid(x, y)) continue;
      quad(at(x, y, 1), at(x + 1, y, 1), at(x + 1, y + 1, 1), at(x, y + 1, 1));
      quad(at(x, y, 0), at(x, y + 1, 0), at(x + 1, y + 1, 0), at(x + 1, y, 0));
      const auto wall = [&](int x0, int y0, int x1, int y1) {
        quad(at(x0, y0, 0), at(x1, y1, 0), at(x1, y1, 1), at(x0, y0, 1));
      };
      if (!solid(x, y - 1)) wall(x, y, x + 1, y);
      if (!solid(x + 1, y)) wall(x + 1, y, x + 1, y + 1);
      if (!solid(x, y + 1)) wall(x + 1, y + 1, x, y + 1);
      if (!solid(x - 1, y)) wall(x, y + 1, x, y);
    }
  }
  return mesh;
}

TriangleMesh stretched(TriangleMesh mesh, const Vec3d& factor) {
  for (Vec3d& p : mesh.vertices) p = {p.x * factor.x, p.y * factor.y, p.z * factor.z};
  return mesh;
}

// As many triangles as a laser scan, and as bumpy.
TriangleMesh scan() {
  TriangleMesh mesh = make_torus(0.05, 0.02, 320, 160);
  for (Vec3d& p : mesh.vertices) {
    p = p * (1 + 0.02 * std::sin(400 * p.x) * std::sin(300 * p.y) + 0.01 * std::cos(500 * p.z));
  }
  return mesh;
}

TEST(Packer, PacksEveryKindOfTool) {
  const TriangleMesh plate = holed_plate(4, 6, 0.01, 0.004);
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
  std::set<std::uint32_t> used;
  for (const auto& t : plate.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      used.insert(t[k]);
      edges.insert(std::minmax(t[k], t[(k + 1) % 3]));
    }
  }
  const auto euler =
      static_cast<int>(used.size() + plate.triangles.size()) - static_cast<int>(edges.size());
  ASSERT_EQ((2 - euler) / 2, 24);
  ASSERT_EQ(scan().triangles.size(), 102400u);

  struct Kind {
    const char* name;
    TriangleMesh mesh;
    int num_spheres;
    double fill;  ///< a little less than measured
  };
  const Kind kinds[] = {
      {"box of 12 triangles", moved(make_box({0.08, 0.05, 0.03}), 1, {}), 1000, 0.785},
      {"plate of genus 24", moved(plate, 1, {}), 2000, 0.565},
      {"needle", moved(stretched(make_octahedron(0.1), {1, 0.002, 0.002}), 1, {}), 1000, 0.515},
      {"thin sheet", moved(make_box({0.2, 0.1, 5e-5}), 1, {}), 3000, 1e-4},
      {"scan", scan(), 1000, 0.75}};
  for (const Kind& kind : kinds) {
    SCOPED_TRACE(kind.name);
    const SpherePacking packing = pack(kind.mesh, kind.num_spheres);
    EXPECT_EQ(packing.spheres.size(), static_cast<std::size_t>(kind.num_spheres));
    EXPECT_EQ(packing.stop, PackStop::count);
    EXPECT_GT(fill(packing), kind.fill);
    const auto num_checked = std::min<std::ptrdiff_t>(kind.num_spheres, 200);
    expect_exact(kind.mesh, {packing.spheres.begin(), packing.spheres.begin() + num_checked});
  }
}

TEST(Packer, GivesWhatFitsAndSaysSo) {
  PackOptions options;
  options.max_spheres = 100000;
  options.min_radius = 2.4e-4;
  const auto packing = pack_spheres(make_box({0.02, 0.02, 5e-4}), options).value();
  EXPECT_EQ(packing.stop, PackStop::radius);
  EXPECT_GT(packing.spheres.size(), 500u);
  EXPECT_LT(packing.spheres.size(), 1600u);  // a square lattice of the largest has 1600
  options.min_radius = 2.6e-4;
  EXPECT_EQ(pack_spheres(make_box({0.02, 0.02, 5e-4}), options).error().code, Errc::bad_input);
}

}  // namespace
}  // namespace palpate
