// An octree over the solid. Every cell carries the spheres that can be the nearest one somewhere in
// it and the triangles that pass through it; both lists shrink on the way down. A cell that one
// sphere has for itself, that two spheres share, or that one triangle cuts is measured exactly.
// Only along edges, where more meet, are small cells sampled. What is counted are integers, so the
// order in which threads add them does not matter.
#include "palpate/packing/represented_volumes.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>

#include "palpate/mesh/mass_properties.h"
#include "src/packing/cut_cube.h"

namespace palpate {
namespace {

constexpr int kTaskLevel = 3;      // 512 tasks
constexpr int kDeepestLevel = 20;  // a cell of it counts 1; the root counts 8^20 = 2^60
constexpr int kSampledLevels = 2;  // a sampled cell counts at least 8^2

// Side of a sampled cell, as a fraction of the distance to the nearest centre or of the radius.
// Measured against one ten times finer: .7 % rms a sphere; the error falls with its square.
constexpr double kFineness = 0.3;

// The octree's cube is larger than the solid and off its centre, so that the planes of a CAD model
// do not fall on the planes of the octree.
constexpr double kRootSize = 1.0873;
constexpr Vec3d kRootShift{0.0131, 0.0217, 0.0173};

// Random bits for a cell (the finaliser of SplitMix64).
std::uint64_t scramble(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
  x = (x ^ x >> 27) * 0x94d049bb133111ebu;
  return x ^ x >> 31;
}

struct Cell {
  Cube cube;
  int level = 0;
  std::uint64_t path = 1;  ///< octants from the root, three bits each
  bool inside = false;     ///< its centre
  std::vector<std::int32_t> spheres, triangles;
  std::vector<double> powers;  ///< at the centre, of the parent's spheres

  std::uint64_t weight() const { return std::uint64_t(1) << 3 * (kDeepestLevel - level); }
};

class PowerCells {
 public:
  PowerCells(const TriangleMesh& solid, std::span<const Sphere> spheres)
      : box_(bounds(solid)), counts_(spheres.size()) {
    for (const auto& [a, b, c] : solid.triangles) {
      triangles_.push_back({solid.vertices[a], solid.vertices[b], solid.vertices[c]});
    }
    for (const Sphere& sphere : spheres) {
      const double radius = sphere.radius;
      balls_.push_back({to_double(sphere.centre), radius * radius});
    }
  }

  /// Volume of each cell in m3.
  std::vector<double> measure(ThreadPool& pool) {
    std::vector<Cell> cells{root()};
    const double unit = std::ldexp(8 * std::pow(cells[0].cube.half, 3), -3 * kDeepestLevel);
    for (int level = 0; level < kTaskLevel; ++level) {
      std::vector<Cell> children(8 * cells.size());
      pool.parallel_for(static_cast<int>(children.size()), [&](int i) {
        const auto child = static_cast<std::size_t>(i);
        make_child(cells[child / 8], i % 8, children[child]);
      });
      cells = std::move(children);
    }
    pool.parallel_for(static_cast<int>(cells.size()), [&](int i) {
      std::vector<Cell> path(kDeepestLevel + 1);
      std::swap(path[kTaskLevel], cells[static_cast<std::size_t>(i)]);
      descend(path, kTaskLevel);
    });
    std::vector<double> volumes;
    for (const auto& count : counts_) volumes.push_back(unit * static_cast<double>(count.load()));
    return volumes;
  }

 private:
  struct Ball {
    Vec3d centre;
    double radius2;

    double power(const Vec3d& p) const {
      const Vec3d d = p - centre;
      return dot(d, d) - radius2;
    }
  };
  const Ball& ball(std::int32_t i) const { return balls_[static_cast<std::size_t>(i)]; }

  void add(std::int32_t sphere, std::uint64_t count) {
    counts_[static_cast<std::size_t>(sphere)].fetch_add(count, std::memory_order_relaxed);
  }

  Cell root() const {
    const Vec3d size = box_.high - box_.low;
    const double extent = std::max({size.x, size.y, size.z});
    Cell cell;
    cell.cube = {(box_.low + box_.high) * 0.5 + kRootShift * extent, kRootSize * extent / 2};
    for (std::size_t i = 0; i < balls_.size(); ++i)
      cell.spheres.push_back(static_cast<std::int32_t>(i));
    for (std::size_t i = 0; i < triangles_.size(); ++i)
      cell.triangles.push_back(static_cast<std::int32_t>(i));
    const Vec3d corner = cell.cube.centre + Vec3d{1, 1, 1} * cell.cube.half;  // outside
    cell.inside = odd_crossings(cell, corner, cell.cube.centre);
    return cell;
  }

  /// The segment lies in the cell.
  bool odd_crossings(const Cell& cell, const Vec3d& p, const Vec3d& q) const {
    bool odd = false;
    for (const std::int32_t i : cell.triangles)
      odd ^= crosses(p, q, triangles_[static_cast<std::size_t>(i)]);
    return odd;
  }

  void make_child(const Cell& parent, int octant, Cell& child) const {
    const double half = parent.cube.half / 2;
    const auto shift = [&](int axis) { return octant >> axis & 1 ? half : -half; };
    child.cube = {parent.cube.centre + Vec3d{shift(0), shift(1), shift(2)}, half};
    child.level = parent.level + 1;
    child.path = parent.path << 3 | static_cast<std::uint64_t>(octant);
    child.inside = parent.inside != odd_crossings(parent, parent.cube.centre, child.cube.centre);
    child.triangles.clear();
    for (const std::int32_t i : parent.triangles) {
      if (overlaps(child.cube, triangles_[static_cast<std::size_t>(i)]))
        child.triangles.push_back(i);
    }
    child.spheres.clear();
    if (child.triangles.empty() && !child.inside) return;  // all outside
    const Vec3d m = child.cube.centre;
    child.powers.clear();
    double least = std::numeric_limits<double>::infinity();
    Vec3d nearest_centre;
    for (const std::int32_t i : parent.spheres) {
      child.powers.push_back(ball(i).power(m));
      if (child.powers.back() < least) least = child.powers.back(), nearest_centre = ball(i).centre;
    }
    // Two powers differ by an affine function: beaten here by more than it can change in the cell
    // is beaten all over it.
    for (std::size_t k = 0; k < parent.spheres.size(); ++k) {
      const std::int32_t i = parent.spheres[k];
      const Vec3d apart = ball(i).centre - nearest_centre;
      const double change = 2 * half * (std::abs(apart.x) + std::abs(apart.y) + std::abs(apart.z));
      if (child.powers[k] - least <= change) child.spheres.push_back(i);
    }
  }

  /// By power; the first of equals.
  std::int32_t nearest(const Cell& cell, const Vec3d& p) const {
    std::int32_t best = cell.spheres.front();
    double least = ball(best).power(p);
    for (const std::int32_t i : cell.spheres) {
      const double power = ball(i).power(p);
      if (power < least) least = power, best = i;
    }
    return best;
  }

  void descend(std::vector<Cell>& path, int level) {
    const Cell& cell = path[static_cast<std::size_t>(level)];
    if (settle(cell)) return;
    for (int octant = 0; octant < 8; ++octant) {
      make_child(cell, octant, path[static_cast<std::size_t>(level) + 1]);
      descend(path, level + 1);
    }
  }

  /// Counts the cell if it needs no finer look.
  bool settle(const Cell& cell) {
    const std::size_t num_spheres = cell.spheres.size(), num_triangles = cell.triangles.size();
    if (num_triangles == 0 && (!cell.inside || num_spheres == 1)) {
      if (cell.inside) add(cell.spheres[0], cell.weight());
      return true;
    }
    if (num_triangles == 0 && num_spheres == 2) {
      share(cell, cell.spheres[0], cell.spheres[1]);
      return true;
    }
    // One triangle alone cuts the cell in two: at its border there would be another.
    if (num_triangles == 1 && num_spheres == 1) {
      const Triangle& t = triangles_[static_cast<std::size_t>(cell.triangles[0])];
      const Vec3d normal = cross(t.b - t.a, t.c - t.a);
      count_fraction(cell, cell.spheres[0],
                     fraction_behind(cell.cube, normal, dot(normal, t.a - cell.cube.centre)));
      return true;
    }
    if (cell.level + kSampledLevels >= kDeepestLevel || is_fine(cell)) {
      sample(cell);
      return true;
    }
    return false;
  }

  /// The plane of equal power: power_a - power_b = difference - 2 (c_a - c_b) . (x - centre).
  void share(const Cell& cell, std::int32_t a, std::int32_t b) {
    const Vec3d m = cell.cube.centre;
    const Vec3d normal = (ball(b).centre - ball(a).centre) * 2;
    const double difference = ball(a).power(m) - ball(b).power(m);
    const double fraction = fraction_behind(cell.cube, normal, -difference);
    add(b, cell.weight() - count_fraction(cell, a, fraction));
  }

  std::uint64_t count_fraction(const Cell& cell, std::int32_t sphere, double fraction) {
    const auto count =
        static_cast<std::uint64_t>(std::llround(fraction * static_cast<double>(cell.weight())));
    add(sphere, count);
    return count;
  }

  bool is_fine(const Cell& cell) const {
    const double limit = 2 * cell.cube.half / kFineness;
    return std::all_of(cell.spheres.begin(), cell.spheres.end(), [&](std::int32_t i) {
      const Vec3d d = cell.cube.centre - ball(i).centre;
      return std::max(ball(i).radius2, dot(d, d)) >= limit * limit;
    });
  }

  /// One random point in each octant.
  void sample(const Cell& cell) {
    const double half = cell.cube.half;
    for (std::uint64_t octant = 0; octant < 8; ++octant) {
      const std::uint64_t bits = scramble(cell.path << 3 | octant);
      const auto along = [&](int axis) {
        const double unit = static_cast<double>(bits >> 21 * axis & 0x1fffff) * 0x1p-21;
        return half * (octant >> axis & 1 ? unit : unit - 1);
      };
      const Vec3d p = cell.cube.centre + Vec3d{along(0), along(1), along(2)};
      if (cell.inside != odd_crossings(cell, cell.cube.centre, p))
        add(nearest(cell, p), cell.weight() / 8);
    }
  }

  Bounds box_;
  std::vector<Triangle> triangles_;
  std::vector<Ball> balls_;
  std::vector<std::atomic<std::uint64_t>> counts_;
};

}  // namespace

Result<std::vector<float>> represented_volumes(const TriangleMesh& solid,
                                               std::span<const Sphere> spheres, ThreadPool& pool) {
  if (spheres.empty()) {
    return Error{Errc::invalid_argument,
                 "no spheres to share the volume of the mesh; pack the mesh first"};
  }
  const double mesh_volume = mass_properties(solid).volume;
  if (!(mesh_volume > 0) || !std::isfinite(mesh_volume)) {
    return Error{Errc::bad_input,
                 "the mesh encloses no volume to share among its spheres; pass what check_solid "
                 "returns"};
  }
  // A sphere is known exactly. Only what its cell holds besides is measured, and scaled so that the
  // sum is right.
  const std::vector<double> cells = PowerCells(solid, spheres).measure(pool);
  double sphere_sum = 0, excess_sum = 0;
  std::vector<double> own, excess;
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    own.push_back(sphere_volume(static_cast<double>(spheres[i].radius)));
    excess.push_back(std::max(0.0, cells[i] - own[i]));
    sphere_sum += own[i];
    excess_sum += excess[i];
  }
  const double rest = mesh_volume - sphere_sum;
  const bool fits = rest > 0 && excess_sum > 0;  // else the spheres are none of this mesh
  std::vector<float> volumes;
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    const double volume =
        fits ? own[i] + excess[i] * (rest / excess_sum) : own[i] * (mesh_volume / sphere_sum);
    volumes.push_back(static_cast<float>(volume));
  }
  return volumes;
}

}  // namespace palpate
