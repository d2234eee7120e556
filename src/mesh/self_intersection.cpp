#include "src/mesh/self_intersection.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "src/mesh/triangle_tree.h"

namespace palpate { inline namespace v0 {
namespace {

struct GridBox {
  GridPoint low, high;
};

bool overlap(const GridBox& a, const GridBox& b) {
  return a.low.x <= b.high.x && b.low.x <= a.high.x && a.low.y <= b.high.y && b.low.y <= a.high.y &&
         a.low.z <= b.high.z && b.low.z <= a.high.z;
}

GridBox box_of(const GridTriangle& t) {
  GridBox box{t.p[0], t.p[0]};
  for (const GridPoint& p : t.p) {
    for (int axis = 0; axis < 3; ++axis) {
      box.low[axis] = std::min(box.low[axis], p[axis]);
      box.high[axis] = std::max(box.high[axis], p[axis]);
    }
  }
  return box;
}

/// Every face against those later in the order of the tree.
class Search {
 public:
  explicit Search(const TriangleTree& tree)
      : tree_(tree), num_visits_left_(kVisitsOfAny + kVisitsPerFace * tree.triangles().size()) {
    boxes_.reserve(tree.triangles().size());
    normals_.reserve(tree.triangles().size());
    for (const GridTriangle& t : tree.triangles()) {
      boxes_.push_back(box_of(t));
      normals_.push_back(cross(exact(t.p[1] - t.p[0]), exact(t.p[2] - t.p[0])));
    }
  }

  Result<std::optional<FacePair>> find_meeting_pair() {
    for (std::uint32_t position = 0; position < tree_.order().size(); ++position) {
      const std::uint32_t face = tree_.order()[position];
      const auto other = find_partner(0, position, corners_of(tree_.triangles()[face]));
      if (other) return std::optional<FacePair>(std::minmax(face, *other));
      if (num_visits_left_ == 0) {
        return Error{Errc::bad_input,
                     "the mesh has too many faces side by side to be checked for "
                     "self-intersections; remesh it with fewer long thin faces"};
      }
    }
    return std::optional<FacePair>();
  }

 private:
  // Nodes of the tree; surfaces take 40 to 100 for a face.
  static constexpr std::uint64_t kVisitsOfAny = 2'000'000, kVisitsPerFace = 500;

  /// Can the face meet a triangle of the node, shared corners and sides aside?
  bool may_meet_any(const GridTriangle& t, const Corners& corners,
                    const TriangleTree::Node& node) const {
    const Corners c = along(node.axes, corners);
    if (!may_meet(c, node.whole) || !may_meet(c, node.boxes)) return false;
    for (int k = 0; k < 3; ++k) {
      if (t.vertex[k] != node.hub) continue;
      return may_meet(c, std::span(node.boxes).subspan(1)) ||
             may_meet(Segment{c[(k + 1) % 3], c[(k + 2) % 3]}, node.boxes);
    }
    return true;
  }

  /// Is all of b surely on one side of the plane of a? This spares most the exact test. Coordinates
  /// are below 2^41, so rounding moves the determinants by less than 2^75.
  bool parts(std::uint32_t a, std::uint32_t b) const {
    constexpr double kDoubt = 0x1p80;
    double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
    for (const GridPoint& p : tree_.triangles()[b].p) {
      const double side = dot(normals_[a], exact(p - tree_.triangles()[a].p[0]));
      lowest = std::min(lowest, side);
      highest = std::max(highest, side);
    }
    return lowest > kDoubt || highest < -kDoubt;
  }

  /// A face later in the order that meets the face at `position`.
  std::optional<std::uint32_t> find_partner(std::uint32_t node_index, std::uint32_t position,
                                            const Corners& corners) {
    const TriangleTree::Node& node = tree_.nodes()[node_index];
    const std::uint32_t face = tree_.order()[position];
    const std::vector<GridTriangle>& triangles = tree_.triangles();
    if (node.end <= position + 1 || num_visits_left_ == 0) return std::nullopt;
    --num_visits_left_;
    const bool is_in_node = node.begin <= position;
    if (!is_in_node && !may_meet_any(triangles[face], corners, node)) return std::nullopt;
    if (node.right != 0) {
      if (const auto found = find_partner(node_index + 1, position, corners)) return found;
      return find_partner(node.right, position, corners);
    }
    for (std::uint32_t i = std::max(node.begin, position + 1); i < node.end; ++i) {
      const std::uint32_t other = tree_.order()[i];
      if (overlap(boxes_[face], boxes_[other]) && !parts(face, other) && !parts(other, face) &&
          triangles_meet(triangles[face], triangles[other])) {
        return other;
      }
    }
    return std::nullopt;
  }

  const TriangleTree& tree_;
  std::uint64_t num_visits_left_;
  std::vector<GridBox> boxes_;
  std::vector<Vec3d> normals_;  ///< not unit
};

}  // namespace

Result<std::optional<FacePair>> find_self_intersection(const TriangleMesh& mesh) {
  const TriangleTree tree(mesh);
  return Search(tree).find_meeting_pair();
}

}}  // namespace palpate::v0
