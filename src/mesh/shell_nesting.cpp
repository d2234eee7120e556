#include "src/mesh/shell_nesting.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "palpate/math/geometry.h"
#include "src/mesh/mesh_topology.h"
#include "src/mesh/self_intersection.h"
#include "src/mesh/triangle_tree.h"

namespace palpate { inline namespace v0 {
namespace {

__extension__ typedef __int128 Int128;

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

int sign(Int128 x) { return (x > 0) - (x < 0); }

/// A ray along x, moved by a step so small along y, and by its square along z, that it meets no
/// edge and no corner.
class Ray {
 public:
  explicit Ray(const GridPoint& from) : from_(from) {}

  struct Hit {
    double x = 0;
    bool from_behind = false;  ///< the triangle looks along the ray
  };
  std::optional<Hit> meet(const GridTriangle& t) const {
    const int turn = turn_beside(t.p[0], t.p[1]);
    if (turn == 0 || turn_beside(t.p[1], t.p[2]) != turn || turn_beside(t.p[2], t.p[0]) != turn) {
      return std::nullopt;
    }
    const GridPoint d = from_ - t.p[0];
    const auto wide = [](const GridPoint& p) { return Vec3<Int128>{p.x, p.y, p.z}; };
    const Vec3<Int128> n = cross(wide(t.p[1] - t.p[0]), wide(t.p[2] - t.p[0]));
    const double back = static_cast<double>(n.y * d.y + n.z * d.z) / static_cast<double>(n.x);
    return Hit{static_cast<double>(t.p[0].x) - back, turn > 0};
  }

  /// The part of it before x.
  Segment before(double x) const {
    const Vec3d from = exact(from_);
    return {from, {x, from.y, from.z}};
  }

 private:
  /// On which side of ab, seen against x, is the ray? 0 if ab lies along x.
  int turn_beside(const GridPoint& a, const GridPoint& b) const {
    const std::int64_t y = b.y - a.y, z = b.z - a.z;
    if (const int turn = sign(Int128(y) * (from_.z - a.z) - Int128(z) * (from_.y - a.y)))
      return turn;
    return z != 0 ? -sign(z) : sign(y);
  }

  GridPoint from_;
};

/// Casts rays from where each shell ends along x: the first shell met is the one around it, or one
/// beside it in the same shell.
class NestingSearch {
 public:
  NestingSearch(const TriangleTree& tree, const std::vector<Shell>& shells)
      : tree_(tree),
        shells_(shells),
        shell_of_(tree.triangles().size()),
        ends_(shells.size()),
        rank_(shells.size()),
        num_visits_left_(kVisitsOfAny + kVisitsPerFace * tree.triangles().size()) {
    for (std::uint32_t shell = 0; shell < shells.size(); ++shell) {
      ends_[shell] = tree.triangles()[shells[shell].faces[0]].p[0];
      for (const std::uint32_t face : shells[shell].faces) {
        shell_of_[face] = shell;
        for (const GridPoint& p : tree.triangles()[face].p) {
          if (p.x > ends_[shell].x) ends_[shell] = p;
        }
      }
    }
  }

  Result<std::vector<Nesting>> find() {
    // The shell that a ray meets ends farther along x: its own nesting is known by then.
    std::vector<std::uint32_t> farthest_first(shells_.size());
    std::iota(farthest_first.begin(), farthest_first.end(), 0u);
    std::sort(farthest_first.begin(), farthest_first.end(), [&](std::uint32_t a, std::uint32_t b) {
      return std::pair(ends_[b].x, a) < std::pair(ends_[a].x, b);
    });
    for (std::uint32_t i = 0; i < farthest_first.size(); ++i) rank_[farthest_first[i]] = i;

    std::vector<Nesting> nesting(shells_.size());
    std::vector<std::uint32_t> around(shells_.size(), kNone);
    for (const std::uint32_t shell : farthest_first) {
      nesting[shell].outermost = shell;
      const First first = find_first(shell);
      if (num_visits_left_ == 0) {
        return Error{Errc::bad_input,
                     "the mesh has too many faces side by side to find which of its parts are "
                     "inside others; remesh it with fewer long thin faces"};
      }
      if (first.face == kNone) continue;
      const std::uint32_t met = shell_of_[first.face];
      const bool is_inside = first.hit.from_behind == (shells_[met].signed_volume > 0);
      around[shell] = is_inside ? met : around[met];
      if (around[shell] == kNone) continue;
      nesting[shell] = nesting[around[shell]];
      ++nesting[shell].num_around;
    }
    return nesting;
  }

 private:
  // Nodes of the tree; ordinary shells take about 100 each.
  static constexpr std::uint64_t kVisitsOfAny = 2'000'000, kVisitsPerFace = 500;

  struct First {
    std::uint32_t face = kNone;
    Ray::Hit hit;
  };

  /// A short way first: on a long one it may meet all shells around this one.
  First find_first(std::uint32_t shell) {
    const Ray ray(ends_[shell]);
    First first;
    for (int bits = 11; bits <= kGridBits + 1 && first.face == kNone; bits += 6) {
      first.hit.x = static_cast<double>(ends_[shell].x) + std::ldexp(1.0, bits);
      look(0, shell, ray, first);
    }
    return first;
  }

  void look(std::uint32_t node_index, std::uint32_t shell, const Ray& ray, First& first) {
    if (num_visits_left_ == 0) return;
    --num_visits_left_;
    const TriangleTree::Node& node = tree_.nodes()[node_index];
    const Segment ahead = along(node.axes, ray.before(first.hit.x));
    if (!may_meet({ahead.from, ahead.to, ahead.to}, node.whole) || !may_meet(ahead, node.boxes)) {
      return;
    }
    if (node.right != 0) {
      look(node_index + 1, shell, ray, first);
      look(node.right, shell, ray, first);
      return;
    }
    for (std::uint32_t i = node.begin; i < node.end; ++i) {
      const std::uint32_t face = tree_.order()[i];
      if (rank_[shell_of_[face]] >= rank_[shell]) continue;
      const auto hit = ray.meet(tree_.triangles()[face]);
      if (!hit || hit->x < static_cast<double>(ends_[shell].x) || hit->x > first.hit.x) continue;
      first = {face, *hit};
    }
  }

  const TriangleTree& tree_;
  const std::vector<Shell>& shells_;
  std::vector<std::uint32_t> shell_of_;  // of each face
  std::vector<GridPoint> ends_;          // of each shell, along x
  std::vector<std::uint32_t> rank_;      // of each shell; the farthest end has 0
  std::uint64_t num_visits_left_;
};

}  // namespace

std::vector<Shell> find_shells(const TriangleMesh& mesh) {
  std::vector<Shell> shells;
  const std::vector<std::uint32_t> shell_of = shell_of_faces(mesh.triangles);
  for (std::uint32_t face = 0; face < shell_of.size(); ++face) {
    const Triangle& t = mesh.triangles[face];
    const Vec3d &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    if (shell_of[face] == shells.size()) {
      shells.push_back({{}, 0, 0, a + ((b - a) + (c - a)) / 3});
    }
    Shell& shell = shells[shell_of[face]];
    shell.faces.push_back(face);
    const Vec3d& origin = shell.sample;  // Close by, so that far meshes lose no digits.
    shell.signed_volume += dot(a - origin, cross(b - origin, c - origin)) / 6;
    shell.area += norm(cross(b - a, c - a)) / 2;
  }
  return shells;
}

Result<std::vector<Nesting>> find_nesting(const TriangleMesh& mesh,
                                          const std::vector<Shell>& shells) {
  if (shells.size() == 1) return std::vector<Nesting>(1);
  const TriangleTree tree(mesh);
  return NestingSearch(tree, shells).find();
}

}}  // namespace palpate::v0
