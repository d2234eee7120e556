// A tree of tilted boxes over the triangles of a surface.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "palpate/mesh/mesh.h"
#include "src/mesh/self_intersection.h"

namespace palpate { inline namespace v0 {

inline Vec3d exact(const GridPoint& p) {
  return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
}

using Corners = std::array<Vec3d, 3>;
struct Segment {
  Vec3d from, to;
};

inline Corners corners_of(const GridTriangle& t) {
  return {exact(t.p[0]), exact(t.p[1]), exact(t.p[2])};
}

/// The triangles are rounded to a grid of 2^-40 of the longest side of the mesh. Boxes lie as their
/// triangles do, and corners that lie together share one: the hull of the three boxes of a node is
/// as thin and as pointed as its triangles are, however they are tilted.
class TriangleTree {
 public:
  static constexpr std::uint32_t kNoHub = std::numeric_limits<std::uint32_t>::max();

  struct Box {
    Vec3d middle, half;
  };
  struct Node {
    std::array<Vec3d, 3> axes;   ///< of its boxes; zero where its triangles have no extent
    Box whole;                   ///< around its triangles, along the axes
    std::array<Box, 3> boxes;    ///< each around one corner of each of its triangles
    std::uint32_t hub = kNoHub;  ///< a corner of all its triangles, which is in boxes[0], or kNoHub
    std::uint32_t begin, end;    ///< positions in order()
    std::uint32_t right = 0;     ///< the left child follows its parent; 0 in leaves
  };

  /// O(n log n).
  explicit TriangleTree(const TriangleMesh& mesh);

  const std::vector<GridTriangle>& triangles() const { return triangles_; }
  const std::vector<std::uint32_t>& order() const { return order_; }
  /// The root first; none without triangles.
  const std::vector<Node>& nodes() const { return nodes_; }

 private:
  std::uint32_t build(std::uint32_t begin, std::uint32_t end);
  std::span<const std::uint32_t> run(const Node& node) const {
    return std::span(order_).subspan(node.begin, node.end - node.begin);
  }
  std::uint32_t end_of_fan(std::uint32_t begin, std::uint32_t end);
  void set_axes(Node& node) const;
  int set_boxes(Node& node) const;

  std::vector<GridTriangle> triangles_;
  std::vector<Vec3d> centers_;  ///< three times the center of each
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

/// A point along the axes of a node.
inline Vec3d along(const std::array<Vec3d, 3>& axes, const Vec3d& p) {
  return {dot(axes[0], p), dot(axes[1], p), dot(axes[2], p)};
}
inline Corners along(const std::array<Vec3d, 3>& axes, const Corners& corners) {
  return {along(axes, corners[0]), along(axes, corners[1]), along(axes, corners[2])};
}

inline Segment along(const std::array<Vec3d, 3>& axes, const Segment& segment) {
  return {along(axes, segment.from), along(axes, segment.to)};
}

/// False: the triangle surely has no point in the box, or in the hull of the boxes, along whose
/// axes it is given; or the segment.
bool may_meet(const Corners& corners, const TriangleTree::Box& box);
bool may_meet(const Corners& corners, std::span<const TriangleTree::Box> boxes);
bool may_meet(const Segment& segment, std::span<const TriangleTree::Box> boxes);

}}  // namespace palpate::v0
