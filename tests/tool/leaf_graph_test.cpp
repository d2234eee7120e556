#include "palpate/tool/tool.h"

#include <algorithm>
#include <numeric>
#include <tuple>

#include <gtest/gtest.h>

#include "tests/tool/random_packing.h"

namespace palpate {
namespace {

using test::lattice;
using test::random_packing;
using Edge = std::pair<int, int>;

struct Truth {
  std::vector<Edge> edges;  ///< sorted, bridges included
  int num_bridges = 0, num_components = 0;
};

/// The obvious O(n^2 log n) twin: all pairs by the rule, then Kruskal over all other pairs.
Truth brute_force(const std::vector<Sphere>& spheres, GapRule rule) {
  const int n = static_cast<int>(spheres.size());
  double smallest = 1e30;
  for (const Sphere& sphere : spheres) smallest = std::min(smallest, double(sphere.radius));
  std::vector<int> component(n);
  std::iota(component.begin(), component.end(), 0);
  Truth truth;
  truth.num_components = n;
  const auto join = [&](int a, int b) {
    const int from = component[a], to = component[b];
    if (from == to) return false;
    for (int& c : component) c = c == from ? to : c;
    return true;
  };
  std::vector<std::tuple<double, int, int>> candidates;
  for (int i = 0; i < n; ++i) {
    for (int j = i + 1; j < n; ++j) {
      const double gap = norm(to_double(spheres[j].center) - to_double(spheres[i].center)) -
                         double(spheres[i].radius) - double(spheres[j].radius);
      const double smaller = std::min(spheres[i].radius, spheres[j].radius);
      if (rule == GapRule::absolute ? gap < 2 * smallest : gap <= 0.5 * smaller) {
        truth.edges.emplace_back(i, j);
        truth.num_components -= join(i, j);
      } else {
        candidates.emplace_back(gap, i, j);
      }
    }
  }
  std::sort(candidates.begin(), candidates.end());
  for (const auto& [gap, i, j] : candidates) {
    if (!join(i, j)) continue;
    truth.edges.emplace_back(i, j);
    ++truth.num_bridges;
  }
  std::sort(truth.edges.begin(), truth.edges.end());
  return truth;
}

void expect_equals_truth(const std::vector<Sphere>& spheres, GapRule rule) {
  const Truth truth = brute_force(spheres, rule);
  const LeafGraph graph(spheres, rule);
  EXPECT_EQ(graph.edges(), truth.edges);
  EXPECT_EQ(graph.num_edges(), static_cast<int>(truth.edges.size()));
  EXPECT_EQ(graph.num_bridges(), truth.num_bridges);
  EXPECT_EQ(graph.num_components_before_bridging(), truth.num_components);
  ASSERT_EQ(graph.row_starts().size(), spheres.size() + 1);
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    for (int k = graph.row_starts()[i]; k < graph.row_starts()[i + 1]; ++k) {
      if (k > graph.row_starts()[i]) {
        EXPECT_LT(graph.neighbors()[k - 1], graph.neighbors()[k]);
      }
    }
  }
}

TEST(LeafGraph, EqualsBruteForceOnRandomPackings) {
  for (const GapRule rule : {GapRule::absolute, GapRule::relative}) {
    for (const int count : {1, 2, 3, 5, 20, 100, 700, 1500}) {
      for (int seed = 0; seed < 3; ++seed) {
        SCOPED_TRACE(count);
        expect_equals_truth(random_packing(count, 100 * count + seed), rule);
      }
    }
  }
}

TEST(LeafGraph, BridgesFarClustersAsKruskalDoes) {
  std::vector<Sphere> spheres;
  for (int cluster = 0; cluster < 9; ++cluster) {
    const Vec3d origin{1.3 * (cluster % 3), 0.7 * (cluster / 3), 0.4 * (cluster % 2)};
    for (const Sphere& sphere : random_packing(10 + 30 * cluster, cluster, origin))
      spheres.push_back(sphere);
  }
  for (const GapRule rule : {GapRule::absolute, GapRule::relative}) {
    expect_equals_truth(spheres, rule);
    EXPECT_GE(LeafGraph(spheres, rule).num_bridges(), 8);
  }
}

TEST(LeafGraph, BreaksTiesByLowerIndices) {
  for (const GapRule rule : {GapRule::absolute, GapRule::relative}) {
    expect_equals_truth(lattice(6, 0.01f, 0.005f), rule);   // touching: one component
    expect_equals_truth(lattice(6, 0.01f, 0.0005f), rule);  // far apart: all equal bridges
  }
}

TEST(LeafGraph, RulesAreStrictOrNotAsDocumented) {
  // Gap exactly 0.5: equal to 0.5 * smaller radius, and to 2 * smallest radius with a third sphere.
  const std::vector<Sphere> two{{{0, 0, 0}, 1}, {{2.5f, 0, 0}, 1}};
  EXPECT_EQ(LeafGraph(two, GapRule::relative).num_bridges(), 0);
  const std::vector<Sphere> three{{{0, 0, 0}, 1}, {{2.5f, 0, 0}, 1}, {{0, 1.5f, 0}, 0.25f}};
  const LeafGraph graph(three, GapRule::absolute);
  EXPECT_EQ(graph.num_components_before_bridging(), 2);
  EXPECT_EQ(graph.num_bridges(), 1);
}

TEST(LeafGraph, HubsAreFoundFromTheirSmallNeighbors) {
  std::vector<Sphere> spheres{{{0, 0, 0}, 1}};
  for (int i = 0; i < 1000; ++i) {  // a Fibonacci sphere of beads around one ball
    const double z = 1 - (2 * i + 1) / 1000.0, angle = 2.399963229728653 * i;
    const double rho = std::sqrt(1 - z * z) * 1.011;
    spheres.push_back(
        {to_float(Vec3d{rho * std::cos(angle), rho * std::sin(angle), 1.011 * z}), 0.01f});
  }
  expect_equals_truth(spheres, GapRule::relative);
  expect_equals_truth(spheres, GapRule::absolute);
  EXPECT_EQ(LeafGraph(spheres, GapRule::relative).row_starts()[1], 1000);
}

TEST(LeafGraph, SpheresThatAllOverlapHaveNone) {
  const std::vector<Sphere> few(1000, {{0, 0, 0}, 0.01f}), many(20'000, {{0, 0, 0}, 0.01f});
  for (const GapRule rule : {GapRule::absolute, GapRule::relative}) {
    EXPECT_EQ(LeafGraph(few, rule).num_edges(), 1000 * 999 / 2);
    EXPECT_TRUE(LeafGraph(many, rule).row_starts().empty());
  }
}

TEST(LeafGraph, RestoredGraphIsTheSame) {
  const std::vector<Sphere> spheres = random_packing(300, 77);
  const LeafGraph built(spheres, GapRule::relative);
  std::vector<Edge> edges = built.edges();
  for (const bool reversed : {false, true}) {
    if (reversed) std::reverse(edges.begin(), edges.end());
    const LeafGraph restored(spheres.size(), edges, built.num_bridges(),
                             built.num_components_before_bridging());
    EXPECT_EQ(restored.edges(), built.edges());
    EXPECT_TRUE(std::ranges::equal(restored.row_starts(), built.row_starts()));
    EXPECT_TRUE(std::ranges::equal(restored.neighbors(), built.neighbors()));
    EXPECT_EQ(restored.num_bridges(), built.num_bridges());
    EXPECT_EQ(restored.num_components_before_bridging(), built.num_components_before_bridging());
  }
}

TEST(LeafGraph, EmptyAndSingle) {
  EXPECT_EQ(LeafGraph().num_edges(), 0);
  EXPECT_TRUE(LeafGraph().edges().empty());
  const std::vector<Sphere> one{{{0, 0, 0}, 1}};
  const LeafGraph graph(one, GapRule::absolute);
  EXPECT_EQ(graph.num_edges(), 0);
  EXPECT_EQ(graph.num_components_before_bridging(), 1);
}

}  // namespace
}  // namespace palpate
