#include "palpate/tool/tool.h"

#include <algorithm>
#include <limits>

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "tests/tool/random_packing.h"

namespace palpate {
namespace {

TriangleMesh tetrahedron() {
  return {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
          {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};
}

SpherePacking packing_of(std::vector<Sphere> spheres) {
  return {std::move(spheres), 1.0 / 6, PackStop::count};
}

void expect_refused(TriangleMesh mesh, SpherePacking packing, const std::string& word) {
  const Result<Tool> tool = Tool::build(std::move(mesh), std::move(packing));
  ASSERT_FALSE(tool.has_value());
  EXPECT_EQ(tool.error().code, Errc::bad_input);
  EXPECT_NE(tool.error().message.find(word), std::string::npos) << tool.error().message;
}

TEST(Tool, BuildsEverythingFromMeshAndSpheres) {
  const std::vector<Sphere> spheres = test::random_packing(200, 4);
  const Result<Tool> built =
      Tool::build(tetrahedron(), packing_of(spheres), {.source = "a tetrahedron"});
  ASSERT_TRUE(built.has_value()) << built.error().message;
  const Tool& tool = *built;
  EXPECT_EQ(tool.spheres().size(), 200u);
  EXPECT_EQ(tool.mesh().triangles.size(), 4u);
  EXPECT_EQ(tool.source(), "a tetrahedron");
  EXPECT_EQ(tool.tree().find_leaf(to_double(spheres[17].center)), 17);
  EXPECT_EQ(tool.graph().row_starts().size(), 201u);
  EXPECT_GE(tool.graph().num_edges(), 199);

  double volume = 0;
  Vec3d moment;
  for (const Sphere& sphere : spheres) {
    volume += sphere_volume(double(sphere.radius));
    moment += to_double(sphere.center) * sphere_volume(double(sphere.radius));
  }
  EXPECT_NEAR(tool.sphere_mass().volume, volume, 1e-12 * volume);
  EXPECT_NEAR(norm(tool.sphere_mass().center_of_mass - moment / volume), 0, 1e-12);
  EXPECT_NEAR(tool.mesh_mass().volume, 1.0 / 6, 1e-12);
  EXPECT_NEAR(norm(tool.mesh_mass().center_of_mass - Vec3d{.25, .25, .25}), 0, 1e-12);
}

TEST(Tool, OneSphereIsEnough) {
  const Result<Tool> tool = Tool::build(tetrahedron(), packing_of({{{.2f, .2f, .2f}, .1f}}));
  ASSERT_TRUE(tool.has_value());
  EXPECT_EQ(tool->graph().num_edges(), 0);
}

TEST(Tool, RefusesBadSpheres) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  expect_refused(tetrahedron(), packing_of({}), "at least one sphere");
  for (const Sphere& bad :
       {Sphere{{nan, 0, 0}, 1}, Sphere{{0, -infinity, 0}, 1}, Sphere{{0, 0, 0}, 0},
        Sphere{{0, 0, 0}, -1}, Sphere{{0, 0, 0}, nan}, Sphere{{0, 0, 0}, infinity}}) {
    expect_refused(tetrahedron(), packing_of({{{0, 0, 0}, 1}, bad}), "sphere 1");
  }
  expect_refused(tetrahedron(), packing_of(std::vector<Sphere>(3000, {{.2f, .2f, .2f}, .1f})),
                 "1000 neighbors on average");
}

TEST(Tool, RefusesBadMeshes) {
  TriangleMesh mesh = tetrahedron();
  mesh.vertices[2].y = std::numeric_limits<double>::quiet_NaN();
  expect_refused(mesh, packing_of({{{0, 0, 0}, 1}}), "vertex 2");
  mesh = tetrahedron();
  mesh.triangles[3][1] = 4;
  expect_refused(mesh, packing_of({{{0, 0, 0}, 1}}), "triangle 3");
  SpherePacking packing = packing_of({{{0, 0, 0}, 1}});
  packing.mesh_volume = std::numeric_limits<double>::infinity();
  expect_refused(tetrahedron(), packing, "volume");
}

TEST(Tool, RestoreRefusesPartsOfOtherTools) {
  const std::vector<Sphere> spheres = test::random_packing(10, 1);
  const std::vector<std::pair<int, int>> one_edge{{0, 1}};
  const std::vector<Sphere> fewer(spheres.begin(), spheres.begin() + 5);
  const std::vector<float> volumes(10, 1.0f / 60);
  const LeafGraph graph(spheres, GapRule::relative);
  const InnerSphereTree tree(spheres), smaller_tree(fewer);
  const auto restored = [&](const LeafGraph& edges, const std::vector<float>& represented,
                            const InnerSphereTree& nodes) {
    return Tool::restore(tetrahedron(), packing_of(spheres),
                         {edges,
                          GapRule::relative,
                          {represented, spheres},
                          {nodes.nodes().begin(), nodes.nodes().end()}},
                         "")
        .has_value();
  };
  EXPECT_TRUE(restored(graph, volumes, tree));
  EXPECT_FALSE(restored(LeafGraph(10, one_edge, 0, 1), volumes, tree));
  EXPECT_FALSE(restored(LeafGraph(fewer, GapRule::relative), volumes, tree));
  EXPECT_FALSE(restored(graph, volumes, smaller_tree));
  std::vector<float> bad = volumes;
  bad.pop_back();
  EXPECT_FALSE(restored(graph, bad, tree));
  bad = volumes;
  bad[3] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(restored(graph, bad, tree));
  bad = volumes;
  bad[3] += 1e-5f;
  EXPECT_FALSE(restored(graph, bad, tree));
}

TEST(Tool, IsPackedAndBuiltInOneCall) {
  const TriangleMesh mesh = make_box({0.1, 0.1, 0.1});
  const PackOptions few{.max_spheres = 50};
  const Result<Tool> packed =
      Tool::pack(mesh, few, {.gap_rule = GapRule::absolute, .source = "a box"});
  ASSERT_TRUE(packed.has_value()) << packed.error().message;
  const Tool built =
      Tool::build(mesh, pack_spheres(mesh, few).value(), {.gap_rule = GapRule::absolute}).value();
  EXPECT_EQ(packed->source(), "a box");
  EXPECT_EQ(packed->gap_rule(), GapRule::absolute);
  EXPECT_EQ(packed->spheres().size(), 50u);
  EXPECT_EQ(packed->graph().edges(), built.graph().edges());
  EXPECT_TRUE(std::ranges::equal(packed->represented_volumes(), built.represented_volumes()));
  EXPECT_EQ(Tool::pack(mesh, {.max_spheres = 0}).error().code, Errc::invalid_argument);
}

TEST(Tool, PrefixIsTheToolOfFewerSpheres) {
  PackOptions options;
  options.max_spheres = 300;
  const auto build = [&] { return Tool::pack(make_box({0.1, 0.1, 0.1}), options).value(); };
  const Tool whole = build();
  options.max_spheres = 120;
  const Tool coarse = build();
  const auto prefix = whole.prefix(120, 1);
  ASSERT_TRUE(prefix.has_value());
  EXPECT_EQ(prefix->spheres().size(), 120u);
  EXPECT_EQ(prefix->graph().edges(), coarse.graph().edges());
  EXPECT_TRUE(std::ranges::equal(prefix->represented_volumes(), coarse.represented_volumes()));
  EXPECT_EQ(prefix->sphere_mass().volume, coarse.sphere_mass().volume);
  EXPECT_EQ(prefix->gap_rule(), GapRule::relative);
  EXPECT_EQ(prefix->packing().stop, PackStop::count);
  EXPECT_EQ(whole.prefix(0).error().code, Errc::invalid_argument);
  EXPECT_EQ(whole.prefix(301).error().code, Errc::invalid_argument);
  EXPECT_NE(whole.prefix(301).error().message.find("300"), std::string::npos);
}

}  // namespace
}  // namespace palpate
