#include "src/session/internal/packing_report.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numeric>

#include "palpate/io/formats.h"
#include "palpate/mesh/mesh.h"
#include "src/mesh/internal/surface_points.h"
#include "tests/test_util/report_data.h"
#include "tests/test_util/scan_mesh.h"
#include "tests/test_util/standoff_truth.h"

namespace palpate {
namespace {

Tool packed_tool(const TriangleMesh& mesh, int num_spheres, const std::string& name = "tool") {
  return Tool::pack(check_solid(mesh).value().mesh, {.max_spheres = num_spheres}, {.source = name})
      .value();
}

/// A cube of 2 cm with these spheres inside.
Tool cube_with(std::vector<Sphere> spheres) {
  SpherePacking packing{std::move(spheres), 8e-6, PackStop::count};
  return Tool::build(make_box({0.02, 0.02, 0.02}), std::move(packing), {.source = "cube"}).value();
}

TEST(PackingStatistics, OneBallInACube) {
  const double r = 0.01;
  const Tool tool = cube_with({{{0, 0, 0}, static_cast<float>(r)}});
  const PackingStatistics s = packing_statistics(tool);
  ASSERT_EQ(s.fill.size(), 1u);
  EXPECT_NEAR(s.fill[0], kPi / 6, 1e-7);
  EXPECT_FALSE(s.void_law);
  EXPECT_EQ(s.smallest_radius, s.largest_radius);
  EXPECT_EQ(s.degrees, std::vector<int>{0});
  EXPECT_NEAR(s.represented_volume, 8e-6, 1e-12);
  // Over a face of side 2: mean of sqrt(1 + x^2 + y^2) - 1, by quadrature.
  double mean = 0;
  constexpr int kCells = 400;
  for (int i = 0; i < kCells; ++i) {
    for (int j = 0; j < kCells; ++j) {
      const double x = (i + 0.5) / kCells, y = (j + 0.5) / kCells;
      mean += (std::sqrt(1 + x * x + y * y) - 1) / (kCells * kCells);
    }
  }
  EXPECT_NEAR(s.standoff.mean, r * mean, r * 1e-3);
  EXPECT_GE(s.standoff.samples.front(), -1e-9);
  EXPECT_NEAR(s.standoff.max, r * (std::sqrt(3.0) - 1), 1e-9);  // a corner
  EXPECT_NEAR(norm(s.standoff.worst), r * std::sqrt(3.0), 1e-12);
}

TEST(PackingStatistics, EightEqualBalls) {
  std::vector<Sphere> spheres;
  for (int k = 0; k < 8; ++k) {
    const auto at = [k](int bit) { return (k >> bit & 1) != 0 ? 0.005f : -0.005f; };
    spheres.push_back({{at(0), at(1), at(2)}, 0.0049f});
  }
  const PackingStatistics s = packing_statistics(cube_with(spheres));
  EXPECT_EQ(s.degrees, std::vector<int>(8, 3));
  EXPECT_EQ(s.mean_degree, 3);
  EXPECT_EQ(s.median_degree, 3);
  EXPECT_EQ(s.max_degree, 3);
  for (std::size_t n = 1; n <= 8; ++n) {
    EXPECT_NEAR(s.fill[n - 1], static_cast<double>(n) * sphere_volume(0.0049) / 8e-6, 1e-7);
  }
}

TEST(PackingStatistics, AgreeWithBruteForce) {
  const Tool tool = packed_tool(make_torus(0.04, 0.015, 40, 20), 1500);
  const PackingStatistics s = packing_statistics(tool);

  std::vector<int> degrees(tool.spheres().size());
  for (const auto& [a, b] : tool.graph().edges()) {
    ++degrees[static_cast<std::size_t>(a)];
    ++degrees[static_cast<std::size_t>(b)];
  }
  EXPECT_EQ(s.degrees, degrees);
  std::sort(degrees.begin(), degrees.end());
  EXPECT_EQ(s.median_degree, degrees[749]);
  EXPECT_EQ(s.p90_degree, degrees[1349]);
  EXPECT_EQ(s.p99_degree, degrees[1484]);
  EXPECT_EQ(s.max_degree, degrees.back());
  EXPECT_DOUBLE_EQ(s.mean_degree, std::accumulate(degrees.begin(), degrees.end(), 0.0) / 1500);

  EXPECT_NEAR(s.fill.back(), tool.sphere_mass().volume / tool.mesh_mass().volume, 1e-12);
  EXPECT_NEAR(s.represented_volume / tool.mesh_mass().volume, 1, 1e-6);
  ASSERT_TRUE(s.void_law);
  EXPECT_NEAR(s.void_law->exponent, kApollonianExponent, 0.03);
  EXPECT_NEAR((*s.void_law)(1500), 1 - s.fill.back(), 0.02 * (1 - s.fill.back()));
}

TEST(Standoff, IsTheNearestOfAllSpheres) {
  const Tool tool = packed_tool(make_stylus(0.005, 0.12, 0.03, 24), 700);
  const auto brute_force = [&](const Vec3d& p) {
    double least = INFINITY;
    for (const Sphere& sphere : tool.spheres()) {
      least =
          std::min(least, norm(p - to_double(sphere.center)) - static_cast<double>(sphere.radius));
    }
    return least;
  };
  std::vector<Vec3d> points = surface_points(tool.mesh(), 3000);
  std::vector<double> expected;
  for (const Vec3d& p : points) expected.push_back(brute_force(p));
  std::sort(expected.begin(), expected.end());
  const Standoff measured = standoff(tool, 3000);
  EXPECT_EQ(measured.samples, expected);
  // The worst place is a corner here: the tip.
  points.insert(points.end(), tool.mesh().vertices.begin(), tool.mesh().vertices.end());
  const auto worst = std::max_element(points.begin(), points.end(), [&](auto& a, auto& b) {
    return brute_force(a) < brute_force(b);
  });
  EXPECT_EQ(measured.worst, *worst);
  EXPECT_EQ(measured.worst.z, bounds(tool.mesh()).low.z);
  EXPECT_EQ(measured.max, brute_force(*worst));
  EXPECT_GT(measured.max, expected.back());
  EXPECT_EQ(measured.p95, expected[2849]);
  EXPECT_NEAR(measured.mean, std::accumulate(expected.begin(), expected.end(), 0.0) / 3000, 1e-15);
  EXPECT_EQ(standoff(tool, 3000).samples, measured.samples);
}

/// Brute force over points of its own.
void expect_within_bound(TriangleMesh raw) {
  const double scale = 0.2 / test::longest_side(raw);  // their units differ
  for (Vec3d& p : raw.vertices) p *= scale;
  const auto solid = check_solid(raw);
  ASSERT_TRUE(solid) << solid.error().message;
  const auto spheres = pack_spheres(solid->mesh, PackOptions{})->spheres;
  ASSERT_EQ(spheres.size(), 5000u);
  test::StandoffMeter meter(solid->mesh, 1000, 3);
  for (std::size_t n = 1; n <= spheres.size(); ++n) {
    meter.add(spheres[n - 1]);
    if (n != 1000 && n != 2000 && n != 5000) continue;
    const test::StandoffTruth truth = meter.measure();
    EXPECT_LE(truth.max, standoff_bound(truth.p95, 0.2)) << n;
  }
}

TEST(Standoff, OfRealToolsIsWithinItsBound) {
  PALPATE_DATA_OR_SKIP(folder, "meshes_good");
  int num_meshes = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    SCOPED_TRACE(entry.path().filename().string());
    const auto raw = load_mesh(entry.path(), 1);
    ASSERT_TRUE(raw);
    expect_within_bound(*raw);
    ++num_meshes;
  }
  EXPECT_GE(num_meshes, 10);
}

TEST(Standoff, OfMadeToolsIsWithinItsBound) {
  expect_within_bound(test::made_scan());
  for (const char* name : {"stylus", "spiral", "torus", "finger", "blade"}) {
    SCOPED_TRACE(name);
    expect_within_bound(make_shape(name, 0.2).value());
  }
}

TEST(Standoff, EmptyPartsAreTold) {
  // 300 spheres: too few to reach for the tip.
  const Tool few = packed_tool(make_shape("finger", 0.196).value(), 300);
  const Standoff far = standoff(few);
  const auto reported = empty_part(few, far);
  ASSERT_TRUE(reported);
  char place[32];
  std::snprintf(place, sizeof place, " %.4g mm the nearest", far.worst.z * 1000);
  EXPECT_NE(reported->find(place), std::string::npos) << *reported;
  EXPECT_NE(reported->find("1000 spheres"), std::string::npos) << *reported;
  const Tool many = packed_tool(make_shape("finger", 0.196).value(), 1000);
  EXPECT_FALSE(empty_part(many, standoff(many)));
  // The edge of a blade is so much of its surface that p95 alone does not tell.
  const Tool blade = packed_tool(make_shape("blade", 0.196).value(), 1000);
  const Standoff edge = standoff(blade);
  EXPECT_LT(edge.max, 4 * edge.p95);
  EXPECT_TRUE(empty_part(blade, edge));
  for (const char* name : {"box", "tetrahedron", "sphere", "cylinder", "torus", "spiral"}) {
    for (const int num : {100, 1000}) {
      const Tool full = packed_tool(make_shape(name, 0.1).value(), num);
      EXPECT_FALSE(empty_part(full, standoff(full))) << name << num;
    }
  }
  // One ball in a cube leaves its corners, as far as the rest.
  const Tool ball = cube_with({{{0, 0, 0}, 0.01f}});
  EXPECT_FALSE(empty_part(ball, standoff(ball)));
}

TEST(Standoff, PointsLieOnTheSurfaceAndEvenly) {
  const TriangleMesh box = make_box({0.01, 0.02, 0.04});
  const int num = 20000;
  double on_large_faces = 0;  // across x: 2 * 8 of 28
  Vec3d mean;
  for (const Vec3d& p : surface_points(box, num)) {
    const double out[] = {std::abs(p.x) - 0.005, std::abs(p.y) - 0.01, std::abs(p.z) - 0.02};
    EXPECT_NEAR(*std::max_element(out, out + 3), 0, 1e-15);
    on_large_faces += std::abs(out[0]) < 1e-12 ? 1.0 / num : 0;
    mean += p / num;
  }
  EXPECT_NEAR(on_large_faces, 16.0 / 28, 1e-3);
  EXPECT_LT(norm(mean), 2e-4);
}

TEST(PowerLaw, IsFoundAgain) {
  std::vector<double> values;
  for (int n = 1; n <= 20000; ++n) {
    values.push_back(n < 100 ? 0.9 : 0.7 * std::pow(n, -0.21));
  }
  auto law = fit_power_law(values);
  ASSERT_TRUE(law);
  EXPECT_NEAR(law->factor, 0.7, 1e-10);
  EXPECT_NEAR(law->exponent, 0.21, 1e-12);
  EXPECT_LT(law->rms, 1e-12);
  EXPECT_EQ(law->first, 100);
  // Every decade counts the same: noise of one sign in 1000 ... 2000 cannot move it much.
  for (int n = 1000; n < 2000; ++n) values[static_cast<std::size_t>(n) - 1] *= 1.01;
  law = fit_power_law(values);
  EXPECT_NEAR(law->exponent, 0.21, 3e-3);
  EXPECT_GT(law->rms, 1e-3);

  EXPECT_FALSE(fit_power_law(std::vector<double>(199, 0.5)));
  EXPECT_TRUE(fit_power_law(std::vector<double>(200, 0.5)));
  values[5000] = 0;
  values.resize(5001);
  EXPECT_FALSE(fit_power_law(values)) << "nothing left: no logarithm";
}

nlohmann::json page_data(const Tool& tool, const PackingNotes& notes = {}) {
  return test::report_data(packing_page(tool, packing_statistics(tool), notes).value());
}

TEST(PackingPage, HasTheToolAndItsNumbers) {
  PALPATE_PAGES_OR_SKIP();
  const Tool tool = packed_tool(make_octahedron(0.08), 400, "<probe>.stl");
  PackingNotes notes;
  notes.stopped = "the requested number was reached";
  notes.options = {{"--spheres", "400"}};
  notes.step_seconds = {{"packing", 0.25}};
  const PackingStatistics statistics = packing_statistics(tool);
  const std::string page = packing_page(tool, statistics, notes).value();
  for (const char* bad : {"<probe>", "http:", "https:", "{{"}) {
    EXPECT_EQ(page.find(bad), std::string::npos) << bad;
  }
  EXPECT_NE(page.find("&lt;probe&gt;.stl</title>"), std::string::npos);
  EXPECT_EQ(page, packing_page(tool, statistics, notes).value());

  const auto data = test::report_data(page);
  EXPECT_EQ(data.at("source"), "<probe>.stl");
  const auto spheres = test::from_packed<float>(data.at("solid").at("spheres"));
  ASSERT_EQ(spheres.size(), 1600u);
  double volume = 0;
  for (std::size_t i = 0; i < 400; ++i) {
    EXPECT_EQ(spheres[4 * i], tool.spheres()[i].center.x);
    volume += sphere_volume(static_cast<double>(spheres[4 * i + 3]));
  }
  // An octahedron with corners 4 cm from its middle holds 4/3 a^3.
  const double solid = 4.0 / 3 * std::pow(0.04, 3);
  EXPECT_NEAR(data.at("mass").at("mesh").at("volume_m3"), solid, 1e-6 * solid);
  EXPECT_EQ(data.at("fill").back().at(0), 400);
  EXPECT_NEAR(data.at("fill").back().at(1), volume / solid, 1e-4);
  EXPECT_EQ(data.at("num_triangles"), 8);
  EXPECT_EQ(test::from_packed<std::uint32_t>(data.at("solid").at("mesh").at("triangles")).size(),
            24u);
  EXPECT_EQ(test::from_packed<float>(data.at("solid").at("mesh").at("positions")).size(), 18u);
  int num = 0, ends = 0;
  for (const auto& pair : data.at("degrees")) {
    num += pair.at(1).get<int>();
    ends += pair.at(0).get<int>() * pair.at(1).get<int>();
  }
  EXPECT_EQ(num, 400);
  EXPECT_EQ(ends, 2 * data.at("graph").at("edges").get<int>());
  EXPECT_EQ(data.at("steps").at(0).at(1), 0.25);
  EXPECT_EQ(data.at("stopped"), "the requested number was reached");
  EXPECT_EQ(data.at("warning"), "");
}

TEST(PackingPage, WorksForTheSmallestTools) {
  PALPATE_PAGES_OR_SKIP();
  const auto data = page_data(cube_with({{{0, 0, 0}, 0.01f}}));
  EXPECT_EQ(data.at("fill").size(), 1u);
  EXPECT_TRUE(data.at("void_law").is_null());
  EXPECT_EQ(data.at("radii_m"), std::vector<double>{0.01});
}

TEST(PackingPage, SaysWhatStaysEmpty) {
  PALPATE_PAGES_OR_SKIP();
  const Tool few = packed_tool(make_shape("finger", 0.196).value(), 300);
  EXPECT_EQ(page_data(few).at("warning"), empty_part(few, standoff(few)));
}

}  // namespace
}  // namespace palpate
