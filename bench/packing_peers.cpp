#include "bench/packing_peers.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

#include "src/packing/ascent.h"

namespace palpate::bench {
namespace {

constexpr double kHalfDiagonal = 0.8660254037844386;  // of a cube of side 1

// A separate function: GCC 12 drops the rounding of double -> float -> double when it vectorizes
// the pair.
[[gnu::noinline]] Vec3f rounded(const Vec3d& p) { return to_float(p); }

/// Free space of the solid, the spheres inserted so far, and their times.
class Filling {
 public:
  Filling(const TriangleMesh& solid, const PeerLimits& limits) : limits_(limits), mesh_(solid) {}
  Filling(const Filling&) = delete;
  Filling& operator=(const Filling&) = delete;

  const FreeSpace& space() const { return space_; }

  bool out_of_time() {
    if (stopwatch_.elapsed().cpu >= limits_.max_seconds) packing_.out_of_time = true;
    return packing_.out_of_time;
  }
  bool full() const {
    return packing_.spheres.size() >= static_cast<std::size_t>(limits_.max_spheres);
  }

  /// Inserts the largest single-precision sphere of at most `radius` around p, rounded, unless it
  /// is smaller than `least`.
  bool insert(const Vec3d& p, double radius, double least) {
    const Vec3f center = rounded(p);
    // Far less than the rounding of a radius to float, so that the sphere stays in free space.
    constexpr double kInside = 1 - 2e-7;
    const double free = kInside * space_.clearance(to_double(center), radius);
    if (!(free >= least) || !(free > 0)) return false;
    packing_.spheres.push_back({center, static_cast<float>(free)});
    packing_.times.push_back(stopwatch_.elapsed());
    spheres_.insert(packing_.spheres.back());
    return true;
  }

  PeerPacking take() { return std::move(packing_); }

 private:
  const Stopwatch stopwatch_;
  const PeerLimits limits_;
  TriangleBvh mesh_;
  SphereLevels spheres_;
  FreeSpace space_{mesh_, spheres_, std::numeric_limits<double>::infinity()};
  PeerPacking packing_;
};

/// Cubic cells that cover a box, `cells` along its longest side.
struct Grid {
  Vec3d low;
  double side = 0;
  int num[3];

  Grid(const Bounds& box, int cells) : low(box.low) {
    const Vec3d extent = box.high - box.low;
    side = std::max({extent.x, extent.y, extent.z}) / cells;
    for (int k = 0; k < 3; ++k) {
      num[k] = std::clamp(static_cast<int>(std::ceil(extent[k] / side - 1e-9)), 1, cells);
      low[k] += (extent[k] - num[k] * side) / 2;
    }
  }
  std::size_t size() const {
    return static_cast<std::size_t>(num[0]) * static_cast<std::size_t>(num[1]) *
           static_cast<std::size_t>(num[2]);
  }
  Vec3d center(std::size_t i) const {
    const auto x = static_cast<std::size_t>(num[0]), y = static_cast<std::size_t>(num[1]);
    return low + Vec3d{static_cast<double>(i % x) + 0.5, static_cast<double>(i / x % y) + 0.5,
                       static_cast<double>(i / (x * y)) + 0.5} *
                     side;
  }
};

// ---- Prototype placement

constexpr int kFirstCells = 4, kLastCells = 64;  // along the longest side
constexpr int kFirstSplit = 6, kNextSplit = 30;  // rounds
constexpr int kSteps = 50;
constexpr double kFirstStep = 0.5, kCooling = 0.92;  // shares of the clearance

class PrototypePacker {
 public:
  PrototypePacker(const TriangleMesh& solid, double large, const PeerLimits& limits)
      : filling_(solid, limits), large_(large) {
    const Bounds box = bounds(solid);
    const Grid grid(box, kFirstCells);
    side_ = grid.side;
    for (std::size_t i = 0; i < grid.size(); ++i) {
      cells_.push_back({grid.center(i), norm(box.high - box.low), State::mixed});
    }
    drop_dead_cells();
  }

  PeerPacking run() {
    int split_at = kFirstSplit;
    for (int round = 0; !cells_.empty(); ++round) {
      if (round == split_at && 2 * num_cells_ <= kLastCells) {
        split();
        split_at += kNextSplit;
      }
      if (!place_prototypes(static_cast<std::uint64_t>(round))) break;
      insert_prototypes();
      if (filling_.full()) break;
    }
    return filling_.take();
  }

 private:
  enum class State { inside, mixed, dead };
  struct Cell {
    Vec3d center;
    double bound = 0;  ///< upper bound of the clearance at the center
    State state = State::mixed;
  };

  double half_diagonal() const { return kHalfDiagonal * side_; }

  void split() {
    std::vector<Cell> children;
    children.reserve(8 * cells_.size());
    num_cells_ *= 2;
    side_ /= 2;
    for (const Cell& cell : cells_) {
      for (int corner = 0; corner < 8; ++corner) {
        const Vec3d to_child =
            Vec3d{corner & 1 ? 0.5 : -0.5, corner & 2 ? 0.5 : -0.5, corner & 4 ? 0.5 : -0.5} *
            side_;
        children.push_back({cell.center + to_child, cell.bound + half_diagonal(), cell.state});
      }
    }
    cells_.swap(children);
    drop_dead_cells();
  }

  // Drops cells outside the solid or within one sphere.
  void drop_dead_cells() {
    const FreeSpace& space = filling_.space();
    for (Cell& cell : cells_) {
      if (space.spheres.clearance(cell.center, 0) <= -half_diagonal()) {
        cell.state = State::dead;
      } else if (cell.state == State::mixed &&
                 space.mesh.closest(cell.center, half_diagonal()).triangle < 0) {
        cell.state = space.mesh.inside(cell.center) ? State::inside : State::dead;
      }
    }
    std::erase_if(cells_, [](const Cell& cell) { return cell.state == State::dead; });
  }

  // Hash of round, cell and axis (SplitMix64, twice), in [0, 1).
  static double random(std::uint64_t round, std::uint64_t cell, std::uint64_t axis) {
    std::uint64_t z = ((round << 32) + cell) * 3 + axis;
    for (int i = 0; i < 2; ++i) {
      z += 0x9e3779b97f4a7c15u;
      z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
      z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
      z ^= z >> 31;
    }
    return static_cast<double>(z >> 11) * 0x1.0p-53;
  }

  // Returns false if out of time.
  bool place_prototypes(std::uint64_t round) {
    prototypes_.assign(cells_.size(), Ball{});
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      constexpr std::size_t kLookAtClock = 64;
      if (i % kLookAtClock == 0 && filling_.out_of_time()) return false;
      Cell& cell = cells_[i];
      const Vec3d offset =
          Vec3d{random(round, i, 0) - 0.5, random(round, i, 1) - 0.5, random(round, i, 2) - 0.5} *
          side_;
      const Vec3d p = cell.center + offset;
      if (cell.state == State::mixed && !filling_.space().mesh.inside(p)) continue;
      prototypes_[i] = converge(p, norm(offset), cell);
    }
    return true;
  }

  // Returns the largest ball on the way of a prototype away from its closest obstacle. The
  // clearance changes by at most the distance moved, which bounds each query.
  Ball converge(Vec3d p, double from_center, Cell& cell) const {
    Ball best;
    double reach = cell.bound + from_center, step = kFirstStep;
    for (int t = 0; t < kSteps; ++t, step *= kCooling) {
      const FreeSpace::Nearest found = filling_.space().nearest(p, reach);
      if (found.distance <= 0) break;  // started within a sphere
      if (t == 0) cell.bound = std::min(cell.bound, found.distance + from_center);
      if (found.distance > best.radius) best = {p, found.distance};
      const bool is_sphere = found.sphere.radius > 0;
      if (!is_sphere && found.triangle < 0) break;
      const Vec3d away = normalized(p - (is_sphere ? to_double(found.sphere.center) : found.point));
      p += away * (step * found.distance);
      reach = found.distance * (1.001 + step);
    }
    return best;
  }

  void insert_prototypes() {
    std::vector<std::size_t> order(prototypes_.size());
    std::iota(order.begin(), order.end(), 0u);
    const auto radius = [&](std::size_t i) { return prototypes_[i].radius; };
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return radius(a) > radius(b) || (radius(a) == radius(b) && a < b);
    });
    for (const std::size_t i : order) {
      if (radius(i) <= 0 || radius(i) < large_ * radius(order[0]) || filling_.full()) break;
      constexpr double kUntouched = 1 - 1e-3;  // otherwise it overlaps a sphere of this round
      filling_.insert(prototypes_[i].center, 1.01 * radius(i), kUntouched * radius(i));
    }
    const SphereLevels& spheres = filling_.space().spheres;
    std::erase_if(cells_, [&](const Cell& cell) {
      return spheres.clearance(cell.center, 0) <= -half_diagonal();
    });
  }

  Filling filling_;
  const double large_;
  double side_ = 0;  ///< of a cell
  int num_cells_ = kFirstCells;
  std::vector<Cell> cells_;
  std::vector<Ball> prototypes_;  ///< one per cell
};

}  // namespace

PeerPacking pack_prototypes(const TriangleMesh& solid, double large, const PeerLimits& limits) {
  return PrototypePacker(solid, large, limits).run();
}

// ---- Fixed grid

PeerPacking pack_fixed_grid(const TriangleMesh& solid, int cells, const PeerLimits& limits) {
  Filling filling(solid, limits);
  const FreeSpace& space = filling.space();
  const Grid grid(bounds(solid), cells);

  // The distance field, row by row: neighbors differ by at most a cell, so rays are cast only near
  // the surface, and empty space is crossed in large steps.
  const auto row_length = static_cast<std::size_t>(grid.num[0]);
  std::vector<float> field(grid.size(), 0.0f);
  for (std::size_t row = 0; row < grid.size(); row += row_length) {
    bool inside = false;
    double known = std::numeric_limits<double>::infinity(), safe = 0;
    for (std::size_t x = 0; x < row_length;) {
      const Vec3d p = grid.center(row + x);
      const double distance = space.mesh.closest(p, known * 1.001).distance;
      if (safe <= grid.side) inside = space.mesh.inside(p);
      if (inside) field[row + x] = static_cast<float>(distance);
      const std::size_t step =
          inside ? 1 : std::max<std::size_t>(1, static_cast<std::size_t>(distance / grid.side));
      safe = distance - grid.side * static_cast<double>(step - 1);
      known = distance + grid.side * static_cast<double>(step);
      x += step;
    }
  }

  struct Entry {
    float radius;
    std::uint32_t cell;
    bool operator<(const Entry& b) const {
      return radius < b.radius || (radius == b.radius && cell > b.cell);
    }
  };
  std::vector<Entry> heap;
  for (std::size_t i = 0; i < field.size(); ++i) {
    if (field[i] > 0) heap.push_back({field[i], static_cast<std::uint32_t>(i)});
  }
  std::make_heap(heap.begin(), heap.end());
  // Lazy: the clearance of a cell only shrinks, so only the top needs an update.
  while (!heap.empty() && !filling.full()) {
    std::pop_heap(heap.begin(), heap.end());
    const auto [radius, cell] = heap.back();
    heap.pop_back();
    const double known = radius;
    const Vec3d center = grid.center(cell);
    const double free = space.spheres.clearance(center, known);
    if (free <= 0) continue;
    if (free < known * (1 - 1e-6)) {
      heap.push_back({static_cast<float>(free), cell});
      std::push_heap(heap.begin(), heap.end());
    } else {
      filling.insert(center, known * 1.001, 0);
      if (filling.out_of_time()) break;
    }
  }
  return filling.take();
}

std::string find_fault(const TriangleMesh& solid, const std::vector<Sphere>& spheres) {
  const TriangleBvh mesh(solid);
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    const Vec3d c = to_double(spheres[i].center);
    const double radius = spheres[i].radius;
    if (!(radius > 0)) return "sphere " + std::to_string(i) + " has no volume";
    if (mesh.closest(c, radius).distance < radius || !mesh.inside(c)) {
      return "sphere " + std::to_string(i) + " leaves the solid";
    }
  }
  // Along x, each sphere meets only those that begin before it ends.
  const auto begin = [&](std::size_t i) {
    return static_cast<double>(spheres[i].center.x) - static_cast<double>(spheres[i].radius);
  };
  std::vector<std::size_t> order(spheres.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return begin(a) < begin(b); });
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Sphere& a = spheres[order[k]];
    const double end = static_cast<double>(a.center.x) + static_cast<double>(a.radius);
    for (std::size_t l = k + 1; l < order.size() && begin(order[l]) <= end; ++l) {
      const Sphere& b = spheres[order[l]];
      const double apart = norm(to_double(a.center) - to_double(b.center));
      if (apart < static_cast<double>(a.radius) + static_cast<double>(b.radius)) {
        return "spheres " + std::to_string(order[k]) + " and " + std::to_string(order[l]) +
               " overlap";
      }
    }
  }
  return {};
}

}  // namespace palpate::bench
