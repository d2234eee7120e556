#include "src/mesh/self_intersection.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "src/mesh/exact_intersection.h"

namespace palpate {
namespace {

struct GridBox {
  GridPoint low, high;
};

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
class BoxTree {
 public:
  explicit BoxTree(const std::vector<GridTriangle>& triangles)
      : triangles_(triangles), order_(triangles.size()) {
    for (const GridTriangle& t : triangles_) boxes_.push_back(box_of(t));
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

  struct Node {
    GridBox box;
    std::uint32_t begin, end;  ///< positions in order_
    std::uint32_t right;       ///< the left child follows its parent; 0 in leaves
  };

  std::uint32_t build(std::uint32_t begin, std::uint32_t end) {
    const auto index = static_cast<std::uint32_t>(nodes_.size());
    GridBox box = boxes_[order_[begin]];
    for (std::uint32_t i = begin; i < end; ++i) extend(box, boxes_[order_[i]]);
    nodes_.push_back({box, begin, end, 0});
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

  /// A face later in the order that meets the face at `position`.
  std::optional<std::uint32_t> find_partner(std::uint32_t node_index,
                                            std::uint32_t position) const {
    const Node& node = nodes_[node_index];
    const std::uint32_t face = order_[position];
    if (node.end <= position + 1 || !overlap(node.box, boxes_[face])) return std::nullopt;
    if (node.right != 0) {
      if (const auto found = find_partner(node_index + 1, position)) return found;
      return find_partner(node.right, position);
    }
    for (std::uint32_t i = std::max(node.begin, position + 1); i < node.end; ++i) {
      const std::uint32_t other = order_[i];
      if (overlap(boxes_[face], boxes_[other]) &&
          triangles_meet(triangles_[face], triangles_[other])) {
        return other;
      }
    }
    return std::nullopt;
  }

  const std::vector<GridTriangle>& triangles_;
  std::vector<GridBox> boxes_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace

std::optional<std::pair<std::uint32_t, std::uint32_t>> find_self_intersection(
    const TriangleMesh& mesh) {
  const std::vector<GridTriangle> triangles = round_to_grid(mesh);
  return BoxTree(triangles).find_meeting_pair();
}

}  // namespace palpate
