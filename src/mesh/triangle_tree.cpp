#include "src/mesh/triangle_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace palpate { inline namespace v0 {
namespace {

constexpr std::uint32_t kLeafSize = 4;
// Number of triangles of a node from which its axes are found.
constexpr std::uint32_t kMaxSamples = 16;
// A node of at least kMinFan triangles is divided by a corner that 1 / kMinFanShare of them share.
constexpr std::uint32_t kMinFan = 64, kMinFanShare = 8;

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

bool has_corner(const GridTriangle& t, std::uint32_t vertex) {
  return t.vertex[0] == vertex || t.vertex[1] == vertex || t.vertex[2] == vertex;
}

Bounds nothing() {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  return {{kInfinity, kInfinity, kInfinity}, {-kInfinity, -kInfinity, -kInfinity}};
}

void extend(Bounds& box, const Vec3d& p) {
  for (int axis = 0; axis < 3; ++axis) {
    box.low[axis] = std::min(box.low[axis], p[axis]);
    box.high[axis] = std::max(box.high[axis], p[axis]);
  }
}

/// Coordinates are below 2^42, so rounding moves them by less than 2^-8: boxes are larger by 1.
TriangleTree::Box around(const Bounds& bounds) {
  return {(bounds.low + bounds.high) * 0.5, (bounds.high - bounds.low) * 0.5 + Vec3d{1, 1, 1}};
}

/// Brings corners into the order of those of another triangle; the first stays if `keeps_first`.
void arrange(Corners& corners, const Corners& like, bool keeps_first) {
  const auto square = [&](int i, int k) {
    const Vec3d d = corners[i] - like[k];
    return dot(d, d);
  };
  if (!keeps_first) {
    int nearest = 0;
    for (int k = 1; k < 3; ++k) {
      if (square(k, 0) < square(nearest, 0)) nearest = k;
    }
    std::swap(corners[0], corners[nearest]);
  }
  if (square(1, 2) + square(2, 1) < square(1, 1) + square(2, 2)) std::swap(corners[1], corners[2]);
}

/// Are all corners on one side of all boxes along this direction?
bool parts(const Vec3d& direction, const Corners& corners,
           std::span<const TriangleTree::Box> boxes) {
  const Vec3d size{std::abs(direction.x), std::abs(direction.y), std::abs(direction.z)};
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const TriangleTree::Box& box : boxes) {
    const double middle = dot(direction, box.middle), reach = dot(size, box.half);
    low = std::min(low, middle - reach);
    high = std::max(high, middle + reach);
  }
  const double a = dot(direction, corners[0]), b = dot(direction, corners[1]),
               c = dot(direction, corners[2]);
  return std::min({a, b, c}) > high || std::max({a, b, c}) < low;
}

/// Along one of the directions across both this side and an edge of the boxes?
bool is_passed(const Vec3d& side, const Corners& corners,
               std::span<const TriangleTree::Box> boxes) {
  return parts({0, -side.z, side.y}, corners, boxes) ||
         parts({side.z, 0, -side.x}, corners, boxes) || parts({-side.y, side.x, 0}, corners, boxes);
}

}  // namespace

bool may_meet(const Corners& p, const TriangleTree::Box& box) {
  for (int k = 0; k < 3; ++k) {
    if (std::min({p[0][k], p[1][k], p[2][k]}) > box.middle[k] + box.half[k] ||
        std::max({p[0][k], p[1][k], p[2][k]}) < box.middle[k] - box.half[k])
      return false;
  }
  return true;
}

// The directions are those that part a triangle from one box (Akenine-Moeller 2001), and below a
// segment from a box and from a triangle.
bool may_meet(const Corners& p, std::span<const TriangleTree::Box> boxes) {
  if (parts(cross(p[1] - p[0], p[2] - p[0]), p, boxes)) return false;
  for (int k = 0; k < 3; ++k) {
    if (is_passed(p[(k + 1) % 3] - p[k], p, boxes)) return false;
  }
  return true;
}

bool may_meet(const Segment& s, std::span<const TriangleTree::Box> boxes) {
  const Vec3d side = s.to - s.from;
  const Corners ends{s.from, s.to, s.to};
  if (is_passed(side, ends, boxes)) return false;
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const Vec3d edge = boxes[(k + 1) % boxes.size()].middle - boxes[k].middle;
    if (parts(cross(side, edge), ends, boxes)) return false;
  }
  return true;
}

TriangleTree::TriangleTree(const TriangleMesh& mesh)
    : triangles_(round_to_grid(mesh)), order_(triangles_.size()) {
  centers_.reserve(triangles_.size());
  for (const GridTriangle& t : triangles_) centers_.push_back(exact(t.p[0] + t.p[1] + t.p[2]));
  std::iota(order_.begin(), order_.end(), 0u);
  if (!order_.empty()) build(0, static_cast<std::uint32_t>(order_.size()));
}

std::uint32_t TriangleTree::build(std::uint32_t begin, std::uint32_t end) {
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  Node& node = nodes_.emplace_back();
  node.begin = begin;
  node.end = end;
  set_axes(node);
  const Vec3d axis = node.axes[set_boxes(node)];
  if (end - begin <= kLeafSize) return index;

  std::uint32_t middle = node.hub == kNoHub ? end_of_fan(begin, end) : begin;
  if (middle == begin) {
    middle = begin + (end - begin) / 2;
    std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                     [&](std::uint32_t a, std::uint32_t b) {
                       const auto key = [&](std::uint32_t i) {
                         return std::pair(dot(axis, centers_[i]), i);
                       };
                       return key(a) < key(b);
                     });
  }
  build(begin, middle);
  const std::uint32_t right = build(middle, end);
  nodes_[index].right = right;
  return index;
}

/// Puts the triangles around one corner first if they are a good part of a large node, and says
/// where they end: no hub would be found among others. `begin` if there are none.
std::uint32_t TriangleTree::end_of_fan(std::uint32_t begin, std::uint32_t end) {
  const std::uint32_t num = end - begin, step = num / kMaxSamples;
  if (num < kMinFan) return begin;
  std::vector<std::uint32_t> corners;
  for (std::uint32_t i = begin; i < end; i += step) {
    const GridTriangle& t = triangles_[order_[i]];
    corners.insert(corners.end(), std::begin(t.vertex), std::end(t.vertex));
  }
  std::sort(corners.begin(), corners.end());
  std::uint32_t hub = kNoHub;
  std::ptrdiff_t most = 1;
  for (auto at = corners.begin(), next = at; at != corners.end(); at = next) {
    next = std::upper_bound(at, corners.end(), *at);
    if (next - at > most) most = next - at, hub = *at;
  }
  if (hub == kNoHub) return begin;
  const auto first_other =
      std::partition(order_.begin() + begin, order_.begin() + end,
                     [&](std::uint32_t i) { return has_corner(triangles_[i], hub); });
  const auto middle = static_cast<std::uint32_t>(first_other - order_.begin());
  return middle - begin < num / kMinFanShare ? begin : middle;
}

/// From corner to farthest corner, then the same across: their box is at most so many times larger
/// than the smallest one (Barequet and Har-Peled 2001), whatever the number of triangles.
void TriangleTree::set_axes(Node& node) const {
  const std::span<const std::uint32_t> all = run(node);
  const std::size_t step = (all.size() - 1) / kMaxSamples + 1;
  const auto across = [](const Vec3d& d, const Vec3d& axis) { return d - axis * dot(axis, d); };
  const auto farthest = [&](const Vec3d& from, const Vec3d& axis) {
    Vec3d found = from;
    double distance = 0;
    for (std::size_t i = 0; i < all.size(); i += step) {
      for (const Vec3d& p : corners_of(triangles_[all[i]])) {
        const Vec3d d = across(p - from, axis);
        if (dot(d, d) > distance) distance = dot(d, d), found = p;
      }
    }
    return found;
  };
  const Vec3d a = farthest(exact(triangles_[all[0]].p[0]), {}), b = farthest(a, {});
  node.axes[0] = normalized(b - a);
  const Vec3d c = farthest(a, node.axes[0]), d = farthest(c, node.axes[0]);
  node.axes[1] = normalized(across(d - c, node.axes[0]));
  node.axes[2] = cross(node.axes[0], node.axes[1]);
}

/// The boxes of all triangles around one corner overlap there. But triangles that share a corner
/// meet elsewhere only if the side of one that lies opposite to it meets the other: hence the box
/// of these sides, and a fan of thousands of triangles is not compared pair by pair. Returns the
/// number of the axis along which to divide.
int TriangleTree::set_boxes(Node& node) const {
  const std::span<const std::uint32_t> all = run(node);
  for (const std::uint32_t vertex : triangles_[all[0]].vertex) {
    const auto has_it = [&](std::uint32_t i) { return has_corner(triangles_[i], vertex); };
    if (!std::all_of(all.begin(), all.end(), has_it)) continue;
    node.hub = vertex;
    break;
  }
  Bounds whole = nothing(), centers = nothing();
  std::array<Bounds, 3> boxes{nothing(), nothing(), nothing()};
  Corners first;
  for (const std::uint32_t i : all) {
    Corners corners = along(node.axes, corners_of(triangles_[i]));
    extend(centers, corners[0] + corners[1] + corners[2]);
    for (int k = 0; k < 3; ++k) {
      if (triangles_[i].vertex[k] == node.hub) std::swap(corners[0], corners[k]);
    }
    if (i == all[0]) first = corners;
    arrange(corners, first, node.hub != kNoHub);
    for (int k = 0; k < 3; ++k) {
      extend(boxes[k], corners[k]);
      extend(whole, corners[k]);
    }
  }
  node.whole = around(whole);
  for (int k = 0; k < 3; ++k) node.boxes[k] = around(boxes[k]);
  const Vec3d size = centers.high - centers.low;
  return size.x >= size.y && size.x >= size.z ? 0 : (size.y >= size.z ? 1 : 2);
}

}}  // namespace palpate::v0
