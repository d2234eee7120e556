#include "src/mesh/self_intersection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <vector>

#include "src/mesh/exact_intersection.h"

namespace palpate::inline v0 {
namespace {

struct GridBox {
  GridPoint low, high;
};

Vec3d exact(const GridPoint& p) {
  return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
}

bool overlap(const GridBox& a, const GridBox& b) {
  return a.low.x <= b.high.x && b.low.x <= a.high.x && a.low.y <= b.high.y && b.low.y <= a.high.y &&
         a.low.z <= b.high.z && b.low.z <= a.high.z;
}

void extend(GridBox& box, const GridBox& other) {
  for (int axis = 0; axis < 3; ++axis) {
    box.low[axis] = std::min(box.low[axis], other.low[axis]);
    box.high[axis] = std::max(box.high[axis], other.high[axis]);
  }
}

GridBox box_of(const GridTriangle& t) {
  GridBox box{t.p[0], t.p[0]};
  extend(box, {t.p[1], t.p[1]});
  extend(box, {t.p[2], t.p[2]});
  return box;
}

/// The side opposite to the corner with this name; the whole triangle if it has no such corner.
GridBox box_beyond(const GridTriangle& t, std::uint32_t vertex) {
  for (int k = 0; k < 3; ++k) {
    if (t.vertex[k] != vertex) continue;
    GridBox box{t.p[(k + 1) % 3], t.p[(k + 1) % 3]};
    extend(box, {t.p[(k + 2) % 3], t.p[(k + 2) % 3]});
    return box;
  }
  return box_of(t);
}

bool has_corner(const GridTriangle& t, std::uint32_t vertex) {
  return t.vertex[0] == vertex || t.vertex[1] == vertex || t.vertex[2] == vertex;
}

std::vector<GridTriangle> round_to_grid(const TriangleMesh& mesh) {
  const Bounds box = bounds(mesh);
  const Vec3d size = box.high - box.low;
  const double side = std::max({size.x, size.y, size.z});
  const double scale = side > 0 ? std::ldexp(1.0, kGridBits) / side : 0;
  std::vector<GridTriangle> triangles;
  triangles.reserve(mesh.triangles.size());
  for (const auto& triangle : mesh.triangles) {
    GridTriangle t;
    for (int k = 0; k < 3; ++k) {
      const Vec3d q = (mesh.vertices[triangle[k]] - box.low) * scale;
      t.p[k] = {std::llround(q.x), std::llround(q.y), std::llround(q.z)};
      t.vertex[k] = triangle[k];
    }
    triangles.push_back(t);
  }
  return triangles;
}

/// A binary tree of boxes over the triangles. Every node covers a run of `order_`.
///
/// The boxes of all triangles around one vertex overlap there. But triangles that share a corner
/// meet elsewhere only if the side of one that lies opposite to it meets the other: a node whose
/// triangles have a corner in common knows the box of these sides, and a fan of thousands of
/// triangles is not compared pair by pair.
class BoxTree {
 public:
  explicit BoxTree(const std::vector<GridTriangle>& triangles)
      : triangles_(triangles), order_(triangles.size()) {
    for (const GridTriangle& t : triangles_) {
      boxes_.push_back(box_of(t));
      normals_.push_back(cross(exact(t.p[1] - t.p[0]), exact(t.p[2] - t.p[0])));
    }
    std::iota(order_.begin(), order_.end(), 0u);
    if (!order_.empty()) build(0, static_cast<std::uint32_t>(order_.size()));
  }

  std::optional<std::pair<std::uint32_t, std::uint32_t>> find_meeting_pair() const {
    for (std::uint32_t position = 0; position < order_.size(); ++position) {
      const std::uint32_t face = order_[position];
      if (const auto other = find_partner(0, position)) return std::minmax(face, *other);
    }
    return std::nullopt;
  }

 private:
  static constexpr std::uint32_t kLeafSize = 4;
  static constexpr std::uint32_t kNoHub = std::numeric_limits<std::uint32_t>::max();

  struct Node {
    GridBox box;
    std::uint32_t begin, end;  ///< positions in order_
    std::uint32_t right;       ///< the left child follows its parent; 0 in leaves
    std::uint32_t hub;         ///< a corner of all triangles, or kNoHub
    GridBox beyond_hub;        ///< of the sides opposite to the hub
  };

  std::uint32_t build(std::uint32_t begin, std::uint32_t end) {
    const auto index = static_cast<std::uint32_t>(nodes_.size());
    GridBox box = boxes_[order_[begin]];
    for (std::uint32_t i = begin; i < end; ++i) extend(box, boxes_[order_[i]]);
    nodes_.push_back({box, begin, end, 0, kNoHub, box});
    find_hub(nodes_.back());
    if (end - begin <= kLeafSize) return index;

    int axis = 0;
    for (int k = 1; k < 3; ++k) {
      if (box.high[k] - box.low[k] > box.high[axis] - box.low[axis]) axis = k;
    }
    const std::uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                     [&](std::uint32_t a, std::uint32_t b) {
                       const auto key = [&](std::uint32_t i) {
                         return std::pair(boxes_[i].low[axis] + boxes_[i].high[axis], i);
                       };
                       return key(a) < key(b);
                     });
    build(begin, middle);
    const std::uint32_t right = build(middle, end);
    nodes_[index].right = right;
    return index;
  }

  void find_hub(Node& node) const {
    const std::span run = std::span(order_).subspan(node.begin, node.end - node.begin);
    for (const std::uint32_t vertex : triangles_[run[0]].vertex) {
      if (!std::all_of(run.begin(), run.end(),
                       [&](std::uint32_t i) { return has_corner(triangles_[i], vertex); }))
        continue;
      node.hub = vertex;
      node.beyond_hub = box_beyond(triangles_[run[0]], vertex);
      for (const std::uint32_t i : run) extend(node.beyond_hub, box_beyond(triangles_[i], vertex));
      return;
    }
  }

  /// Can the face meet a triangle of the node, shared corners and sides aside?
  bool may_meet(std::uint32_t face, const Node& node) const {
    if (!overlap(node.box, boxes_[face])) return false;
    const GridTriangle& t = triangles_[face];
    return !has_corner(t, node.hub) || overlap(node.beyond_hub, boxes_[face]) ||
           overlap(node.box, box_beyond(t, node.hub));
  }

  /// Is all of b surely on one side of the plane of a? Long thin triangles have large boxes: this
  /// spares most of them the exact test. Coordinates are below 2^41, so rounding moves the
  /// determinants by less than 2^75.
  bool parts(std::uint32_t a, std::uint32_t b) const {
    constexpr double kDoubt = 0x1p80;
    double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
    for (const GridPoint& p : triangles_[b].p) {
      const double side = dot(normals_[a], exact(p - triangles_[a].p[0]));
      lowest = std::min(lowest, side);
      highest = std::max(highest, side);
    }
    return lowest > kDoubt || highest < -kDoubt;
  }

  /// A face later in the order that meets the face at `position`.
  std::optional<std::uint32_t> find_partner(std::uint32_t node_index,
                                            std::uint32_t position) const {
    const Node& node = nodes_[node_index];
    const std::uint32_t face = order_[position];
    if (node.end <= position + 1 || !may_meet(face, node)) return std::nullopt;
    if (node.right != 0) {
      if (const auto found = find_partner(node_index + 1, position)) return found;
      return find_partner(node.right, position);
    }
    for (std::uint32_t i = std::max(node.begin, position + 1); i < node.end; ++i) {
      const std::uint32_t other = order_[i];
      if (overlap(boxes_[face], boxes_[other]) && !parts(face, other) && !parts(other, face) &&
          triangles_meet(triangles_[face], triangles_[other])) {
        return other;
      }
    }
    return std::nullopt;
  }

  const std::vector<GridTriangle>& triangles_;
  std::vector<GridBox> boxes_;
  std::vector<Vec3d> normals_;  ///< not unit
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace

std::optional<std::pair<std::uint32_t, std::uint32_t>> find_self_intersection(
    const TriangleMesh& mesh) {
  const std::vector<GridTriangle> triangles = round_to_grid(mesh);
  return BoxTree(triangles).find_meeting_pair();
}

}  // namespace palpate::inline v0
