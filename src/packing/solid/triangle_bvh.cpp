#include "src/packing/solid/triangle_bvh.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace palpate { inline namespace v0 {
namespace {

constexpr int kLeafSize = 4;
constexpr int kBins = 16;
constexpr int kBalancedDepth = 40;  // from here on split in halves: bounds the depth
constexpr int kLongSearch = 64;     // nodes
constexpr int kStackSize = 256;     // > 3 * (kBalancedDepth + 32)

// Float rounding of a point, of a box and of their distance, as fraction of the extent and of the
// distance: what makes a box distance a true lower bound.
constexpr double kBoxPadding = 1e-6;
constexpr float kDistanceSlack = 1 - 1e-5f;

struct Box {
  Vec3d low{1e300, 1e300, 1e300}, high{-1e300, -1e300, -1e300};

  void add(const Vec3d& p) {
    for (int k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], p[k]);
      high[k] = std::max(high[k], p[k]);
    }
  }
  void add(const Box& box) {
    add(box.low);
    add(box.high);
  }
  double half_area() const {
    const Vec3d d = high - low;
    return d.x < 0 ? 0 : d.x * d.y + d.y * d.z + d.z * d.x;
  }
};

}  // namespace

// Ericson, Real-Time Collision Detection, section 5.1.5: which of vertex, edge and face regions
// holds p.
Vec3d closest_point(const Triangle& t, const Vec3d& p) {
  const Vec3d ab = t.b - t.a, ac = t.c - t.a, ap = p - t.a;
  const double d1 = dot(ab, ap), d2 = dot(ac, ap);
  if (d1 <= 0 && d2 <= 0) return t.a;
  const Vec3d bp = p - t.b;
  const double d3 = dot(ab, bp), d4 = dot(ac, bp);
  if (d3 >= 0 && d4 <= d3) return t.b;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return t.a + ab * (d1 / (d1 - d3));
  const Vec3d cp = p - t.c;
  const double d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d6 >= 0 && d5 <= d6) return t.c;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return t.a + ac * (d2 / (d2 - d6));
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    return t.b + (t.c - t.b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
  }
  const Vec3d n = cross(ab, ac);  // not by barycentric coordinates: needles would spoil them
  return p - n * (dot(n, ap) / dot(n, n));
}

// Top-down build: a range of triangles is cut in two by the surface area heuristic on binned
// centroids, each half once more, and the four parts become the children of a node.
struct TriangleBvh::Builder {
  struct Range {
    int begin, end, depth;
    int size() const { return end - begin; }
  };

  TriangleBvh& bvh;
  std::vector<Box> boxes;
  std::vector<Vec3d> centroids;
  std::vector<int> order;
  std::vector<Triangle> triangles;
  double padding = 0;

  Box box_of(const Range& range) const {
    Box box;
    for (int i = range.begin; i < range.end; ++i) box.add(boxes[index(i)]);
    return box;
  }
  std::size_t index(int i) const {
    return static_cast<std::size_t>(order[static_cast<std::size_t>(i)]);
  }

  int split(const Range& range) {
    Box box;
    for (int i = range.begin; i < range.end; ++i) box.add(centroids[index(i)]);
    int axis = 0;
    const Vec3d size = box.high - box.low;
    for (int k = 1; k < 3; ++k) {
      if (size[k] > size[axis]) axis = k;
    }
    const auto first = order.begin() + range.begin, last = order.begin() + range.end;
    const double low = box.low[axis];
    if (size[axis] > 0 && range.depth < kBalancedDepth) {
      const double scale = kBins * (1 - 1e-12) / size[axis];
      const auto bin_of = [&](int i) {
        return static_cast<int>((centroids[static_cast<std::size_t>(i)][axis] - low) * scale);
      };
      Box bin_box[kBins];
      int bin_count[kBins] = {};
      for (auto i = first; i != last; ++i) {
        const int bin = bin_of(*i);
        bin_box[bin].add(boxes[static_cast<std::size_t>(*i)]);
        ++bin_count[bin];
      }
      double right_cost[kBins];
      Box right;
      for (int b = kBins - 1, count = 0; b > 0; --b) {
        if (bin_count[b] > 0) right.add(bin_box[b]);
        count += bin_count[b];
        right_cost[b] = count * right.half_area();
      }
      double best = 1e300;
      int best_bin = -1;
      Box left;
      for (int b = 0, count = 0; b + 1 < kBins; ++b) {
        if (bin_count[b] > 0) left.add(bin_box[b]);
        count += bin_count[b];
        const double cost = count * left.half_area() + right_cost[b + 1];
        if (count > 0 && count < range.size() && cost < best) best = cost, best_bin = b;
      }
      if (best_bin >= 0) {
        const auto middle =
            std::partition(first, last, [&](int i) { return bin_of(i) <= best_bin; });
        return static_cast<int>(middle - order.begin());
      }
    }
    const auto middle = first + range.size() / 2;
    std::nth_element(first, middle, last, [&](int i, int j) {
      const double x = centroids[static_cast<std::size_t>(i)][axis];
      const double y = centroids[static_cast<std::size_t>(j)][axis];
      return x < y || (x == y && i < j);
    });
    return static_cast<int>(middle - order.begin());
  }

  void fit_slab(const Range& range, Node& node, std::size_t k) const {
    Vec3d sum;
    for (int i = range.begin; i < range.end; ++i) {
      const Triangle& t = triangles[index(i)];
      sum += cross(t.b - t.a, t.c - t.a);
    }
    const Vec3d n = normalized(sum);
    double low = 1e300, high = -1e300;
    for (int i = range.begin; i < range.end; ++i) {
      const Triangle& t = triangles[index(i)];
      for (const Vec3d& v : {t.a, t.b, t.c}) {
        low = std::min(low, dot(n, v - bvh.origin_));
        high = std::max(high, dot(n, v - bvh.origin_));
      }
    }
    for (int axis = 0; axis < 3; ++axis) node.normal[axis][k] = static_cast<float>(n[axis]);
    node.slab_low[k] = static_cast<float>(low - padding);
    node.slab_high[k] = static_cast<float>(high + padding);
  }

  std::int32_t build(const Range& range) {
    Range parts[4] = {range};
    int num_parts = 1;
    while (num_parts < 4) {
      int widest = 0;
      for (int k = 1; k < num_parts; ++k) {
        if (parts[k].size() > parts[widest].size()) widest = k;
      }
      if (parts[widest].size() <= kLeafSize) break;
      const int middle = split(parts[widest]);
      parts[num_parts++] = {middle, parts[widest].end, range.depth + 1};
      parts[widest] = {parts[widest].begin, middle, range.depth + 1};
    }
    const std::size_t id = bvh.nodes_.size();
    bvh.nodes_.emplace_back();
    for (std::size_t k = 0; k < 4; ++k) {
      const bool used = static_cast<int>(k) < num_parts;
      const Box box = used ? box_of(parts[k]) : Box{};
      const bool leaf = used && parts[k].size() <= kLeafSize;
      const std::int32_t child = !used ? 0 : leaf ? -1 - parts[k].begin : build(parts[k]);
      Node& node = bvh.nodes_[id];
      for (int axis = 0; axis < 3; ++axis) {
        const double origin = bvh.origin_[axis];
        node.low[axis][k] = used ? static_cast<float>(box.low[axis] - origin - padding) : 1e18f;
        node.high[axis][k] = used ? static_cast<float>(box.high[axis] - origin + padding) : 1e18f;
      }
      if (used) fit_slab(parts[k], node, k);
      node.child[k] = child;
      node.count[k] = !used ? -1 : leaf ? parts[k].size() : 0;
    }
    return static_cast<std::int32_t>(id);
  }
};

TriangleBvh::TriangleBvh(const TriangleMesh& mesh) {
  Builder builder{*this, {}, {}, {}, {}};
  const Bounds extent = bounds(mesh);
  origin_ = (extent.low + extent.high) * 0.5;
  const Vec3d size = extent.high - extent.low;
  builder.padding = kBoxPadding * std::max({size.x, size.y, size.z});
  for (const auto& [a, b, c] : mesh.triangles) {
    builder.triangles.push_back({mesh.vertices[a], mesh.vertices[b], mesh.vertices[c]});
    Box box;
    box.add(mesh.vertices[a]);
    box.add(mesh.vertices[b]);
    box.add(mesh.vertices[c]);
    builder.boxes.push_back(box);
    builder.centroids.push_back((box.low + box.high) * 0.5);
  }
  builder.order.resize(mesh.triangles.size());
  std::iota(builder.order.begin(), builder.order.end(), 0);
  builder.build({0, static_cast<int>(mesh.triangles.size()), 0});
  triangles_.reserve(mesh.triangles.size());
  for (int i : builder.order) triangles_.push_back(builder.triangles[static_cast<std::size_t>(i)]);
}

// Squared lower bounds of the distances to what the four children hold.
inline TriangleBvh::Float4 TriangleBvh::distances2(const Node& node, const Vec3f& p) {
  const Float4 zero{};
  const auto outside = [&](Float4 low, Float4 high, Float4 x) {
    const Float4 below = low - x, above = x - high;
    const Float4 d = below > above ? below : above;
    return d > zero ? d : zero;
  };
  const Float4 dx = outside(node.low[0], node.high[0], zero + p.x);
  const Float4 dy = outside(node.low[1], node.high[1], zero + p.y);
  const Float4 dz = outside(node.low[2], node.high[2], zero + p.z);
  const Float4 along = node.normal[0] * p.x + node.normal[1] * p.y + node.normal[2] * p.z;
  const Float4 slab = outside(node.slab_low, node.slab_high, along);
  const Float4 box2 = dx * dx + dy * dy + dz * dz, slab2 = slab * slab;
  return (box2 > slab2 ? box2 : slab2) * kDistanceSlack;
}

TriangleBvh::Closest TriangleBvh::closest(const Vec3d& p, double max_distance,
                                          double tolerance) const {
  struct Entry {
    float distance2;
    std::int32_t node;
  };
  const Vec3f q = to_float(p - origin_);
  const double tired = 1 / ((1 + tolerance) * (1 + tolerance));
  Closest best;
  double best2 = max_distance * max_distance;
  Entry stack[kStackSize];
  int top = 0;
  stack[top++] = {0, 0};
  for (int num_visited = 0; top > 0; ++num_visited) {
    const double prune = num_visited < kLongSearch ? 1 : tired;
    const Entry entry = stack[--top];
    if (static_cast<double>(entry.distance2) > best2 * prune) continue;
    const Node& node = nodes_[static_cast<std::size_t>(entry.node)];
    const Float4 distance2 = distances2(node, q);
    const int first_pushed = top;
    for (int k = 0; k < 4; ++k) {
      if (node.count[k] < 0 || static_cast<double>(distance2[k]) > best2 * prune) continue;
      if (node.child[k] < 0) {
        const int begin = -1 - node.child[k];
        for (int i = begin; i < begin + node.count[k]; ++i) {
          const Vec3d point = closest_point(triangle(i), p), d = p - point;
          const double d2 = dot(d, d);
          if (d2 < best2 || (d2 == best2 && best.triangle < 0)) {
            best2 = d2;
            best.point = point;
            best.triangle = i;
          }
        }
      } else {  // insertion sort: the nearest child on top of the stack
        int slot = top++;
        while (slot > first_pushed && stack[slot - 1].distance2 < distance2[k]) {
          stack[slot] = stack[slot - 1];
          --slot;
        }
        stack[slot] = {distance2[k], node.child[k]};
      }
    }
  }
  if (best.triangle >= 0) best.distance = std::sqrt(best2);
  return best;
}

bool TriangleBvh::gather(const Vec3d& p, double distance, std::size_t limit,
                         std::vector<int>& out) const {
  const Vec3f q = to_float(p - origin_);
  const double distance2 = distance * distance;
  const std::size_t start = out.size();
  std::int32_t stack[kStackSize];
  int top = 0;
  stack[top++] = 0;
  while (top > 0) {
    const Node& node = nodes_[static_cast<std::size_t>(stack[--top])];
    const Float4 bound2 = distances2(node, q);
    for (int k = 0; k < 4; ++k) {
      if (node.count[k] < 0 || static_cast<double>(bound2[k]) > distance2) continue;
      if (node.child[k] >= 0) {
        stack[top++] = node.child[k];
        continue;
      }
      const int begin = -1 - node.child[k];
      for (int i = begin; i < begin + node.count[k]; ++i) {
        const Vec3d d = p - closest_point(triangle(i), p);
        if (dot(d, d) > distance2) continue;
        if (out.size() - start >= limit) return false;
        out.push_back(i);
      }
    }
  }
  return true;
}

// Möller-Trumbore against every triangle whose box and slab the ray meets.
int TriangleBvh::count_crossings(const Vec3d& p, const Vec3d& direction) const {
  const Vec3d from = p - origin_;
  int crossings = 0;
  std::int32_t stack[kStackSize];
  int top = 0;
  stack[top++] = 0;
  while (top > 0) {
    const Node& node = nodes_[static_cast<std::size_t>(stack[--top])];
    for (int k = 0; k < 4; ++k) {
      if (node.count[k] < 0) continue;
      double enter = 0, leave = 1e300;
      const auto clip = [&](float low, float high, double position, double speed) {
        const double t0 = (static_cast<double>(low) - position) / speed;
        const double t1 = (static_cast<double>(high) - position) / speed;
        enter = std::max(enter, std::min(t0, t1));
        leave = std::min(leave, std::max(t0, t1));
      };
      for (int axis = 0; axis < 3; ++axis) {
        clip(node.low[axis][k], node.high[axis][k], from[axis], direction[axis]);
      }
      const Vec3d normal =
          to_double(Vec3f{node.normal[0][k], node.normal[1][k], node.normal[2][k]});
      clip(node.slab_low[k], node.slab_high[k], dot(normal, from), dot(normal, direction));
      if (enter > leave) continue;
      if (node.child[k] >= 0) {
        stack[top++] = node.child[k];
        continue;
      }
      const int begin = -1 - node.child[k];
      for (int i = begin; i < begin + node.count[k]; ++i) {
        const Triangle& t = triangle(i);
        const Vec3d e1 = t.b - t.a, e2 = t.c - t.a, h = cross(direction, e2);
        const double det = dot(e1, h);
        if (det == 0) continue;
        const Vec3d s = p - t.a, g = cross(s, e1);
        const double u = dot(s, h) / det, v = dot(direction, g) / det;
        if (u >= 0 && v >= 0 && u + v <= 1 && dot(e2, g) / det > 0) ++crossings;
      }
    }
  }
  return crossings;
}

bool TriangleBvh::inside(const Vec3d& p) const {
  // Directions no CAD model has an edge in.
  static constexpr Vec3d kDirections[3] = {{0.530943, 0.271819, 0.802653},
                                           {-0.351447, 0.870017, -0.345774},
                                           {0.716531, -0.483119, -0.503218}};
  const auto vote = [&](int i) { return count_crossings(p, kDirections[i]) % 2 == 1; };
  const bool first = vote(0);
  return vote(1) == first ? first : vote(2);
}

}}  // namespace palpate::v0
