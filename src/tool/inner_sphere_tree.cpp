#include "palpate/tool/tool.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

struct Leaf {
  Sphere sphere;
  std::int32_t id = -1;
};

struct Box {
  Vec3f low, high;
};

Box box_of_balls(std::span<const Leaf> leaves) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  Box box{{kInfinity, kInfinity, kInfinity}, {-kInfinity, -kInfinity, -kInfinity}};
  for (const Leaf& leaf : leaves) {
    for (int axis = 0; axis < 3; ++axis) {
      box.low[axis] = std::min(box.low[axis], leaf.sphere.center[axis] - leaf.sphere.radius);
      box.high[axis] = std::max(box.high[axis], leaf.sphere.center[axis] + leaf.sphere.radius);
    }
  }
  return box;
}

/// Balls are this much larger than their leaves need, relatively: a stored ball contains every
/// leaf, and every point that the leaf's own test accepts, in double precision.
constexpr double kRoundingSlack = 1e-9;

/// A ball around all leaves of a node, about the middle of their box: stepping on towards the
/// smallest ball made it 1.5 % smaller for half as much time again. The radius is rounded up.
Sphere wrap(std::span<const Leaf> leaves, const Box& box) {
  const Vec3f center = to_float((to_double(box.low) + to_double(box.high)) * 0.5);
  double radius = 0;
  for (const Leaf& leaf : leaves) {
    const double reach =
        norm(to_double(leaf.sphere.center) - to_double(center)) + double(leaf.sphere.radius);
    radius = std::max(radius, reach);
  }
  return {center, std::nextafter(static_cast<float>(radius * (1 + kRoundingSlack)),
                                 std::numeric_limits<float>::infinity())};
}

/// Does the ball contain the leaf with at least half of the slack? What `wrap` made does, in spite
/// of all rounding here.
bool wraps(const Sphere& ball, const Sphere& leaf) {
  const double room = double(ball.radius) * (1 - 0.5 * kRoundingSlack) - double(leaf.radius);
  const Vec3d offset = to_double(leaf.center) - to_double(ball.center);
  return std::isfinite(room) && room >= 0 && dot(offset, offset) <= room * room;
}

/// Splits leaves into two halves at the median center along the box' longest axis.
std::size_t split(std::span<Leaf> leaves, const Box& box) {
  const Vec3f extent = box.high - box.low;
  int axis = extent.x >= extent.y ? 0 : 1;
  if (extent.z > extent[axis]) axis = 2;
  const std::size_t half = leaves.size() / 2;
  std::nth_element(leaves.begin(), leaves.begin() + static_cast<std::ptrdiff_t>(half), leaves.end(),
                   [axis](const Leaf& a, const Leaf& b) {
                     const float ca = a.sphere.center[axis], cb = b.sphere.center[axis];
                     return ca < cb || (ca == cb && a.id < b.id);
                   });
  return half;
}

/// Breadth first, siblings side by side, no deeper than a traversal's stack allows, and every
/// sphere is one leaf.
bool is_well_formed(std::span<const IstNode> nodes, std::span<const Sphere> spheres) {
  if (nodes.empty() || nodes[0].parent != -1) return nodes.empty() && spheres.empty();
  std::vector<char> is_leaf(spheres.size(), 0);
  std::size_t num_leaves = 0, num_claimed = 1;  // by their parents; the root by us
  std::size_t level_end = 1;
  int num_levels = 1;
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    if (k == num_claimed) return false;
    if (k == level_end) {
      level_end = num_claimed;
      if (++num_levels > InnerSphereTree::kMaxLevels) return false;
    }
    const IstNode& node = nodes[k];
    if (node.num_children == 0) {
      const auto id = static_cast<std::uint32_t>(node.sphere_id);
      if (node.first_child != -1 || id >= spheres.size() || is_leaf[id]) return false;
      is_leaf[id] = 1;
      ++num_leaves;
      continue;
    }
    if (node.sphere_id != -1 || node.num_children < 2 ||
        node.num_children > InnerSphereTree::kBranching ||
        node.first_child != static_cast<std::int32_t>(num_claimed) ||
        num_claimed + node.num_children > nodes.size())
      return false;
    for (const IstNode& child : nodes.subspan(num_claimed, node.num_children)) {
      if (child.parent != static_cast<std::int32_t>(k)) return false;
    }
    num_claimed += node.num_children;
  }
  return num_leaves == spheres.size();
}

/// Are the leaves the spheres, each inside all nodes above it?
bool is_wrapped(std::span<const IstNode> nodes, std::span<const Sphere> spheres) {
  for (const IstNode& node : nodes) {
    if (node.num_children > 0) continue;
    const Sphere& leaf = spheres[node.sphere_id];
    if (node.bound.center != leaf.center || node.bound.radius != leaf.radius) return false;
    for (std::int32_t up = node.parent; up >= 0; up = nodes[up].parent) {
      if (!wraps(nodes[up].bound, leaf)) return false;
    }
  }
  return true;
}

}  // namespace

InnerSphereTree::InnerSphereTree(std::span<const Sphere> spheres) {
  if (spheres.empty()) return;
  std::vector<Leaf> leaves(spheres.size());
  for (std::size_t i = 0; i < spheres.size(); ++i)
    leaves[i] = {spheres[i], static_cast<std::int32_t>(i)};

  // Breadth first, so that siblings lie next to each other: nodes_[k] owns ranges[k].
  std::vector<std::span<Leaf>> ranges{leaves};
  nodes_.reserve(spheres.size() * 2);
  ranges.reserve(spheres.size() * 2);
  nodes_.emplace_back();
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    const std::span<Leaf> range = ranges[k];
    if (range.size() == 1) {
      nodes_[k].bound = range[0].sphere;
      nodes_[k].sphere_id = range[0].id;
      continue;
    }
    const Box box = box_of_balls(range);
    nodes_[k].bound = wrap(range, box);
    nodes_[k].first_child = static_cast<std::int32_t>(nodes_.size());
    const auto add_child = [&](std::span<Leaf> part) {
      nodes_.push_back({{}, -1, 0, -1, static_cast<std::int32_t>(k)});
      ranges.push_back(part);
      ++nodes_[k].num_children;
    };
    if (range.size() <= kBranching) {
      for (std::size_t i = 0; i < range.size(); ++i) add_child(range.subspan(i, 1));
      continue;
    }
    // Two median splits in a row make four quarters.
    const std::size_t half = split(range, box);
    for (const std::span<Leaf> side : {range.first(half), range.subspan(half)}) {
      const std::size_t quarter = split(side, box_of_balls(side));
      add_child(side.first(quarter));
      add_child(side.subspan(quarter));
    }
  }
}

Result<InnerSphereTree> InnerSphereTree::restore(std::vector<IstNode> nodes,
                                                 std::span<const Sphere> spheres) {
  if (!is_well_formed(nodes, spheres) || !is_wrapped(nodes, spheres))
    return Error{Errc::bad_input,
                 "the inner sphere tree does not wrap the tool's spheres; build the tool again"};
  InnerSphereTree tree;
  tree.nodes_ = std::move(nodes);
  return tree;
}

int InnerSphereTree::find_leaf(const Vec3d& p) const {
  std::array<std::int32_t, kMaxWaiting> waiting;
  int num_waiting = 0;
  if (!nodes_.empty()) waiting[num_waiting++] = 0;
  while (num_waiting > 0) {
    const IstNode& node = nodes_[waiting[--num_waiting]];
    const Vec3d offset = p - to_double(node.bound.center);
    const double radius = node.bound.radius;
    if (!(dot(offset, offset) <= radius * radius)) continue;
    if (node.num_children == 0) return node.sphere_id;
    for (int i = 0; i < node.num_children; ++i) waiting[num_waiting++] = node.first_child + i;
  }
  return -1;
}

}}  // namespace palpate::v0
