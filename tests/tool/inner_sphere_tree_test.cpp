#include "palpate/tool/tool.h"

#include <limits>
#include <set>

#include <gtest/gtest.h>

#include "tests/test_util/allocation_counter.h"
#include "tests/tool/random_packing.h"

namespace palpate {
namespace {

using test::lattice;
using test::random_packing;

/// Every leaf lies in all its ancestors, exactly, in double on the stored numbers.
void expect_wrapped(const InnerSphereTree& tree, const std::vector<Sphere>& spheres) {
  const std::span<const IstNode> nodes = tree.nodes();
  ASSERT_FALSE(nodes.empty());
  EXPECT_EQ(nodes[0].parent, -1);
  std::set<int> seen;
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const IstNode& node = nodes[k];
    if (node.num_children > 0) {
      ASSERT_GE(node.num_children, 2);
      ASSERT_LE(node.num_children, InnerSphereTree::kBranching);
      EXPECT_EQ(node.sphere_id, -1);
      for (int c = 0; c < node.num_children; ++c)
        EXPECT_EQ(nodes[node.first_child + c].parent, static_cast<int>(k));
      continue;
    }
    const Sphere& sphere = spheres[node.sphere_id];
    EXPECT_TRUE(seen.insert(node.sphere_id).second);
    EXPECT_EQ(node.bound.center, sphere.center);
    EXPECT_EQ(node.bound.radius, sphere.radius);
    for (int up = node.parent; up >= 0; up = nodes[up].parent) {
      const Sphere& ball = nodes[up].bound;
      ASSERT_LE(norm(to_double(sphere.center) - to_double(ball.center)) + double(sphere.radius),
                double(ball.radius));
    }
  }
  EXPECT_EQ(seen.size(), spheres.size());
}

bool contains(const Sphere& sphere, const Vec3d& p) {
  const Vec3d offset = p - to_double(sphere.center);
  return dot(offset, offset) <= double(sphere.radius) * double(sphere.radius);
}

TEST(InnerSphereTree, EmptyTreeFindsNothing) {
  const InnerSphereTree tree{std::span<const Sphere>{}};
  EXPECT_TRUE(tree.nodes().empty());
  EXPECT_EQ(tree.find_leaf({0, 0, 0}), -1);
  EXPECT_EQ(InnerSphereTree().find_leaf({0, 0, 0}), -1);
}

TEST(InnerSphereTree, OneSphereIsRootAndLeaf) {
  const std::vector<Sphere> one{{{1, 2, 3}, 0.5f}};
  const InnerSphereTree tree(one);
  ASSERT_EQ(tree.nodes().size(), 1u);
  expect_wrapped(tree, one);
  EXPECT_EQ(tree.find_leaf({1.5, 2, 3}), 0);
  EXPECT_EQ(tree.find_leaf({1.5000001, 2, 3}), -1);
}

TEST(InnerSphereTree, WrapsAllLeaves) {
  for (const int count : {2, 3, 4, 5, 6, 7, 8, 9, 15, 16, 17, 64, 100, 1000, 3000}) {
    const std::vector<Sphere> spheres = random_packing(count, 7 + count);
    expect_wrapped(InnerSphereTree(spheres), spheres);
  }
  const std::vector<Sphere> far_off = random_packing(500, 3, {10, -20, 30});
  expect_wrapped(InnerSphereTree(far_off), far_off);
  const std::vector<Sphere> regular = lattice(8, 0.01f, 0.005f);
  expect_wrapped(InnerSphereTree(regular), regular);
  const std::vector<Sphere> coincident(100, Sphere{{1, 1, 1}, 0.1f});
  expect_wrapped(InnerSphereTree(coincident), coincident);
}

TEST(InnerSphereTree, BallsAreNotMuchLargerThanNeeded) {
  const std::vector<Sphere> spheres = random_packing(1000, 1);
  // The unit of comparison is half the diagonal of the 10 cm box.
  EXPECT_LT(InnerSphereTree(spheres).nodes()[0].bound.radius, 0.1 * std::sqrt(3.0) / 2 * 1.1);
}

TEST(InnerSphereTree, FindsTheSameLeafAsBruteForce) {
  const std::vector<Sphere> spheres = random_packing(150, 42);
  const InnerSphereTree tree(spheres);
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> along(-0.02, 0.12);
  int num_hits = 0;
  test::AllocationCounter counter;
  for (int k = 0; k < 1'000'000; ++k) {
    const Vec3d p{along(random), along(random), along(random)};
    int expected = -1;
    for (int i = 0; i < static_cast<int>(spheres.size()); ++i) {
      if (contains(spheres[i], p)) expected = i;
    }
    num_hits += expected >= 0;
    if (tree.find_leaf(p) != expected) {
      ADD_FAILURE() << "point " << p.x << " " << p.y << " " << p.z;
      break;
    }
  }
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_GT(num_hits, 1000);
}

TEST(InnerSphereTree, PointsOnTheRimAreFoundExactlyWhenTheirSphereSaysSo) {
  const std::vector<Sphere> spheres = random_packing(400, 11);
  const InnerSphereTree tree(spheres);
  std::mt19937_64 random(6);
  std::normal_distribution<double> normal;
  int num_in = 0, num_out = 0;
  for (int k = 0; k < 100'000; ++k) {
    const Sphere& sphere = spheres[k % spheres.size()];
    const Vec3d direction = normalized(Vec3d{normal(random), normal(random), normal(random)});
    Vec3d p = to_double(sphere.center) + direction * double(sphere.radius);
    if (k % 3 == 0) p = to_double(sphere.center) + Vec3d{k % 2 ? 1.0 : -1.0, 0, 0} * sphere.radius;
    const int found = tree.find_leaf(p);
    bool any = false;
    for (const Sphere& other : spheres) any = any || contains(other, p);
    ASSERT_EQ(found >= 0, any);
    ASSERT_TRUE(found < 0 || contains(spheres[found], p));
    ++(any ? num_in : num_out);
  }
  EXPECT_GT(num_in, 1000);
  EXPECT_GT(num_out, 1000);
}

TEST(InnerSphereTree, NotANumberIsNowhere) {
  const InnerSphereTree tree(random_packing(20, 1));
  EXPECT_EQ(tree.find_leaf({std::nan(""), 0, 0}), -1);
}

TEST(InnerSphereTree, IsTheSameOnEveryRun) {
  const std::vector<Sphere> spheres = random_packing(500, 9);
  const InnerSphereTree a(spheres), b(spheres);
  ASSERT_EQ(a.nodes().size(), b.nodes().size());
  for (std::size_t k = 0; k < a.nodes().size(); ++k) {
    EXPECT_EQ(a.nodes()[k].sphere_id, b.nodes()[k].sphere_id);
    EXPECT_EQ(a.nodes()[k].bound.center, b.nodes()[k].bound.center);
    EXPECT_EQ(a.nodes()[k].bound.radius, b.nodes()[k].bound.radius);
  }
}

std::vector<IstNode> nodes_of(const std::vector<Sphere>& spheres) {
  const InnerSphereTree tree(spheres);
  return {tree.nodes().begin(), tree.nodes().end()};
}

TEST(InnerSphereTree, RestoresWhatItBuilt) {
  for (const int count : {0, 1, 2, 3, 4, 5, 17, 1000}) {
    const std::vector<Sphere> spheres = random_packing(count, count);
    const auto restored = InnerSphereTree::restore(nodes_of(spheres), spheres);
    ASSERT_TRUE(restored.has_value()) << restored.error().message;
    EXPECT_EQ(restored->nodes().size(), nodes_of(spheres).size());
    for (int i = 0; i < count; ++i) EXPECT_EQ(restored->find_leaf(to_double(spheres[i].center)), i);
  }
}

// Any single change of any number in any node is noticed, except for a ball that is still large
// enough.
TEST(InnerSphereTree, RestoreRefusesEveryHostileNode) {
  const std::vector<Sphere> spheres = random_packing(60, 8);
  const std::vector<IstNode> good = nodes_of(spheres);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  const auto expect_refused = [&](std::size_t k, auto change) {
    std::vector<IstNode> nodes = good;
    change(nodes[k]);
    EXPECT_FALSE(InnerSphereTree::restore(nodes, spheres).has_value()) << "node " << k;
  };
  for (std::size_t k = 0; k < good.size(); ++k) {
    for (std::int32_t IstNode::*number :
         {&IstNode::first_child, &IstNode::num_children, &IstNode::sphere_id, &IstNode::parent}) {
      for (const std::int32_t value : {-2147483647 - 1, -2, -1, 0, 1, 2, 3, 4, 5, 59, 60, 61, 70,
                                       2147483647, int(k), int(k) + 1}) {
        if (good[k].*number != value) expect_refused(k, [&](IstNode& n) { n.*number = value; });
      }
    }
    for (const float value : {nan, infinity, -infinity, 1e30f}) {
      for (int axis = 0; axis < 3; ++axis)
        expect_refused(k, [&](IstNode& n) { n.bound.center[axis] = value; });
    }
    for (const float value : {nan, -infinity, 0.0f, -good[k].bound.radius})
      expect_refused(k, [&](IstNode& n) { n.bound.radius = value; });
    expect_refused(k, [&](IstNode& n) { n.bound.radius *= 0.9f; });
  }
  std::vector<IstNode> nodes = good;
  nodes.pop_back();
  EXPECT_FALSE(InnerSphereTree::restore(nodes, spheres).has_value());
  nodes = good;
  nodes.push_back(good.back());
  EXPECT_FALSE(InnerSphereTree::restore(nodes, spheres).has_value());
  EXPECT_FALSE(InnerSphereTree::restore({}, spheres).has_value());
  const std::vector<Sphere> fewer(spheres.begin(), spheres.end() - 1);
  EXPECT_FALSE(InnerSphereTree::restore(good, fewer).has_value());
  EXPECT_FALSE(InnerSphereTree::restore(good, {}).has_value());
}

// A chain would overflow the stack of a traversal.
TEST(InnerSphereTree, RestoreRefusesDeepTrees) {
  for (const int depth : {15, 16, 5000}) {
    const std::vector<Sphere> spheres = lattice(20, 0.01f, 0.005f);
    const std::vector<Sphere> used(spheres.begin(), spheres.begin() + depth + 1);
    std::vector<IstNode> nodes{{{{0, 0, 0}, 10}, -1, 0, -1, -1}};
    for (int i = 0; i < depth; ++i) {  // each inner node has one leaf and one inner node
      const int parent = i == 0 ? 0 : 2 * i;
      nodes[parent].first_child = static_cast<int>(nodes.size());
      nodes[parent].num_children = 2;
      nodes.push_back({used[i], -1, 0, i, parent});
      nodes.push_back({{{0, 0, 0}, 10}, -1, 0, -1, parent});
    }
    nodes.back().sphere_id = depth;
    nodes.back().bound = used[depth];
    EXPECT_EQ(InnerSphereTree::restore(nodes, used).has_value(), depth == 15) << depth;
  }
}

}  // namespace
}  // namespace palpate
