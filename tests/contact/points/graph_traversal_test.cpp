#include "src/contact/points/graph/graph_traversal.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

// Five unit spheres in a row along z; the surface cuts sphere 2 with its normal along -z.
std::vector<Sphere> row_of_spheres() {
  std::vector<Sphere> spheres;
  for (int i = 0; i < 5; ++i) spheres.push_back({{0, 0, static_cast<float>(2 * i)}, 0.999f});
  return spheres;
}

// The order of the spheres must not matter.
std::vector<std::int32_t> backwards(std::size_t num) {
  std::vector<std::int32_t> order(num);
  for (std::size_t i = 0; i < num; ++i) order[i] = static_cast<std::int32_t>(num - 1 - i);
  return order;
}

TEST(GraphTraversal, WalksAwayFromTheNormalOnly) {
  const std::vector<Sphere> spheres = row_of_spheres();
  const LeafGraph graph(spheres, GapRule::relative);
  ASSERT_EQ(graph.num_edges(), 4);
  const SortedGraph sorted(graph, backwards(spheres.size()));
  GraphTraversal traversal(spheres, sorted);
  const GraphTraversal::Seed seed{2, {0, 0, -1}};
  const auto reached = traversal.run({&seed, 1});
  ASSERT_EQ(reached.size(), 2u);
  EXPECT_EQ(reached[0].sphere_id, 3);
  EXPECT_EQ(reached[1].sphere_id, 4);
  EXPECT_EQ(reached[1].seed, 0);
  EXPECT_NEAR(reached[1].path_length, 4.0, 1e-12);
  // Queried again with the normal turned: nothing is left of the first search.
  const GraphTraversal::Seed turned{2, {0, 0, 1}};
  const auto other = traversal.run({&turned, 1});
  ASSERT_EQ(other.size(), 2u);
  EXPECT_EQ(other[0].sphere_id, 1);
  EXPECT_EQ(other[1].sphere_id, 0);
}

TEST(GraphTraversal, ZeroNormalAndBoundarySpheresStopIt) {
  const std::vector<Sphere> spheres = row_of_spheres();
  const LeafGraph graph(spheres, GapRule::relative);
  const SortedGraph sorted(graph, backwards(spheres.size()));
  GraphTraversal traversal(spheres, sorted);
  const GraphTraversal::Seed silent{2, {}};
  EXPECT_TRUE(traversal.run({&silent, 1}).empty());
  const GraphTraversal::Seed two[] = {{1, {0, 0, -1}}, {3, {}}};
  const auto reached = traversal.run(two);
  ASSERT_EQ(reached.size(), 1u);
  EXPECT_EQ(reached[0].sphere_id, 2);
}

TEST(GraphTraversal, SameRoundGoesToTheShorterPath) {
  // Sphere 2 can be reached in one round from 0 (far) and from 1 (near).
  const std::vector<Sphere> spheres = {{{-3, 0, 0}, 1}, {{2.5f, 0, 0}, 1}, {{0, 0, 1}, 1}};
  const std::pair<int, int> edges[] = {{0, 2}, {1, 2}};
  const LeafGraph graph(spheres.size(), edges, 0, 1);
  const SortedGraph sorted(graph, backwards(spheres.size()));
  GraphTraversal traversal(spheres, sorted);
  const GraphTraversal::Seed seeds[] = {{0, {0, 0, -1}}, {1, {0, 0, -1}}};
  const auto reached = traversal.run(seeds);
  ASSERT_EQ(reached.size(), 1u);
  EXPECT_EQ(reached[0].sphere_id, 2);
  EXPECT_EQ(reached[0].seed, 1);
}

}  // namespace
}  // namespace palpate
