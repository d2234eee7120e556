#include "src/mesh/mesh_repair.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <unordered_map>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

/// Kept vertices in cubic cells, for a search around a point. They are farther apart than the
/// tolerance: a cell has few of them, however close together they lie. Without a tolerance, equal
/// vertices alone share a cell.
class VertexGrid {
 public:
  VertexGrid(const Bounds& box, double tolerance) : tolerance_(tolerance) {
    if (tolerance == 0) return;
    constexpr double kTolerancesPerCell = 4, kMaxCellsPerSide = 0x1p40;
    low_ = box.low;
    cell_ = std::max(kTolerancesPerCell * tolerance, norm(box.high - box.low) / kMaxCellsPerSide);
  }

  /// The lowest kept vertex within the tolerance of p, or kNone.
  std::uint32_t find(const std::vector<Vec3d>& kept, const Vec3d& p) const {
    std::uint32_t found = kNone;
    const auto [x0, x1] = range(p.x - low_.x);
    const auto [y0, y1] = range(p.y - low_.y);
    const auto [z0, z1] = range(p.z - low_.z);
    for (std::int64_t z = z0; z <= z1; ++z) {
      for (std::int64_t y = y0; y <= y1; ++y) {
        for (std::int64_t x = x0; x <= x1; ++x) {
          const auto cell = first_in_cell_.find(key(x, y, z));
          if (cell == first_in_cell_.end()) continue;
          for (std::uint32_t i = cell->second; i != kNone; i = next_in_cell_[i]) {
            if (norm(kept[i] - p) <= tolerance_) found = std::min(found, i);
          }
        }
      }
    }
    return found;
  }

  /// Adds the next kept vertex; they are numbered from zero.
  void add(const Vec3d& p) {
    const auto index = static_cast<std::uint32_t>(next_in_cell_.size());
    std::uint32_t& first =
        first_in_cell_
            .try_emplace(key(cell(p.x - low_.x), cell(p.y - low_.y), cell(p.z - low_.z)), kNone)
            .first->second;
    next_in_cell_.push_back(std::exchange(first, index));
  }

 private:
  std::int64_t cell(double x) const {
    if (tolerance_ == 0) return std::bit_cast<std::int64_t>(x + 0.0);  // -0 is 0
    return static_cast<std::int64_t>(std::floor(x / cell_));
  }
  std::pair<std::int64_t, std::int64_t> range(double x) const {
    return {cell(x - tolerance_), cell(x + tolerance_)};
  }
  /// Cells of the same key share a list. Mixed as by SplitMix64.
  static std::uint64_t key(std::int64_t x, std::int64_t y, std::int64_t z) {
    std::uint64_t mixed = 0;
    for (const std::int64_t part : {x, y, z}) {
      mixed += static_cast<std::uint64_t>(part) + 0x9e3779b97f4a7c15;
      mixed = (mixed ^ (mixed >> 30)) * 0xbf58476d1ce4e5b9;
      mixed = (mixed ^ (mixed >> 27)) * 0x94d049bb133111eb;
      mixed ^= mixed >> 31;
    }
    return mixed;
  }

  Vec3d low_;
  double tolerance_, cell_ = 0;
  std::unordered_map<std::uint64_t, std::uint32_t> first_in_cell_;
  std::vector<std::uint32_t> next_in_cell_;
};

/// The faces of a closed mesh by their directed edges.
class EdgeMap {
 public:
  explicit EdgeMap(const std::vector<Triangle>& triangles) {
    face_.reserve(3 * triangles.size());
    for (std::uint32_t face = 0; face < triangles.size(); ++face) set(triangles[face], face);
  }
  void set(const Triangle& t, std::uint32_t face) {
    for (int k = 0; k < 3; ++k) face_[key(t[k], t[(k + 1) % 3])] = face;
  }
  void erase(std::uint32_t from, std::uint32_t to) { face_.erase(key(from, to)); }
  std::uint32_t find(std::uint32_t from, std::uint32_t to) const {
    const auto entry = face_.find(key(from, to));
    return entry == face_.end() ? kNone : entry->second;
  }

 private:
  static std::uint64_t key(std::uint32_t from, std::uint32_t to) {
    return (static_cast<std::uint64_t>(from) << 32) | to;
  }
  std::unordered_map<std::uint64_t, std::uint32_t> face_;
};

/// The position k of the longest edge t[k], t[k + 1].
int longest_edge(const TriangleMesh& mesh, const Triangle& t) {
  int longest = 0;
  double length = -1;
  for (int k = 0; k < 3; ++k) {
    const double candidate = norm(mesh.vertices[t[(k + 1) % 3]] - mesh.vertices[t[k]]);
    if (candidate > length) length = candidate, longest = k;
  }
  return longest;
}

}  // namespace

void drop_unused_vertices(TriangleMesh& mesh) {
  std::vector<std::uint32_t> new_index(mesh.vertices.size(), kNone);
  for (const Triangle& triangle : mesh.triangles) {
    for (const std::uint32_t vertex : triangle) new_index[vertex] = 0;
  }
  std::uint32_t num_used = 0;
  for (std::size_t i = 0; i < new_index.size(); ++i) {
    if (new_index[i] == kNone) continue;
    mesh.vertices[num_used] = mesh.vertices[i];
    new_index[i] = num_used++;
  }
  mesh.vertices.resize(num_used);
  for (Triangle& triangle : mesh.triangles) {
    for (std::uint32_t& vertex : triangle) vertex = new_index[vertex];
  }
}

std::size_t weld_vertices(TriangleMesh& mesh, double tolerance) {
  VertexGrid grid(bounds(mesh), tolerance);
  std::vector<Vec3d> kept;
  std::vector<std::uint32_t> new_index;
  for (const Vec3d& p : mesh.vertices) {
    std::uint32_t index = grid.find(kept, p);
    if (index == kNone) {
      index = static_cast<std::uint32_t>(kept.size());
      grid.add(p);
      kept.push_back(p);
    }
    new_index.push_back(index);
  }
  mesh.vertices = std::move(kept);
  for (Triangle& triangle : mesh.triangles) {
    for (std::uint32_t& vertex : triangle) vertex = new_index[vertex];
  }
  return std::erase_if(mesh.triangles, [](const Triangle& t) {
    return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
  });
}

bool is_needle(const TriangleMesh& mesh, const Triangle& t, double tolerance) {
  const int k = longest_edge(mesh, t);
  const Vec3d& a = mesh.vertices[t[k]];
  const Vec3d base = mesh.vertices[t[(k + 1) % 3]] - a;
  const Vec3d side = mesh.vertices[t[(k + 2) % 3]] - a;
  return norm(cross(base, side)) <= tolerance * norm(base);
}

std::size_t remove_needles(TriangleMesh& mesh, double tolerance) {
  std::vector<std::uint32_t> queue;
  for (std::uint32_t face = 0; face < mesh.triangles.size(); ++face) {
    if (is_needle(mesh, mesh.triangles[face], tolerance)) queue.push_back(face);
  }
  if (queue.empty()) return 0;

  EdgeMap edges(mesh.triangles);
  const std::size_t num_before = queue.size();
  // A flip can make a needle of the neighbor, hence the queue; needles that only pass each other
  // on and on end with the budget.
  std::size_t budget = 100 * queue.size();
  for (std::size_t next = 0; next < queue.size() && budget-- > 0; ++next) {
    const std::uint32_t face = queue[next];
    const Triangle t = mesh.triangles[face];
    if (!is_needle(mesh, t, tolerance)) continue;
    const int k = longest_edge(mesh, t);
    const std::uint32_t a = t[k], b = t[(k + 1) % 3], c = t[(k + 2) % 3];
    const std::uint32_t beyond = edges.find(b, a);
    const Triangle& u = mesh.triangles[beyond];
    const std::uint32_t d = u[0] != a && u[0] != b ? u[0] : (u[1] != a && u[1] != b ? u[1] : u[2]);
    if (d == c || edges.find(c, d) != kNone || edges.find(d, c) != kNone) continue;
    edges.erase(a, b);
    edges.erase(b, a);
    mesh.triangles[face] = {c, a, d};
    mesh.triangles[beyond] = {d, b, c};
    for (const std::uint32_t changed : {face, beyond}) {
      edges.set(mesh.triangles[changed], changed);
      queue.push_back(changed);
    }
  }
  const auto num_left = static_cast<std::size_t>(
      std::count_if(mesh.triangles.begin(), mesh.triangles.end(),
                    [&](const Triangle& t) { return is_needle(mesh, t, tolerance); }));
  return num_before - std::min(num_before, num_left);
}

}}  // namespace palpate::v0
