#include "src/packing/sphere_levels.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

// In units of 2^exponent, for radii in [1, 2).
constexpr double kCellSize = 4;
constexpr double kMargin = 4;
constexpr double kWidestSearch = 2;  // cells to each side; a wider one looks at the whole level

std::int64_t cell_index(double x, double cell_size) {
  return static_cast<std::int64_t>(std::floor(x / cell_size));
}

// 21 bits per axis. Far apart cells may share a key: harmless, every sphere found is measured.
std::uint64_t cell_key(std::int64_t x, std::int64_t y, std::int64_t z) {
  constexpr std::uint64_t kMask = (1u << 21) - 1;
  return (static_cast<std::uint64_t>(x) & kMask) | (static_cast<std::uint64_t>(y) & kMask) << 21 |
         (static_cast<std::uint64_t>(z) & kMask) << 42;
}

std::size_t scatter(std::uint64_t key) {
  key *= 0x9e3779b97f4a7c15u;
  return static_cast<std::size_t>(key ^ key >> 32);
}

}  // namespace

std::int32_t SphereLevels::Level::find(std::uint64_t key) const {
  const std::size_t mask = cells.size() - 1;
  for (std::size_t slot = scatter(key) & mask; cells[slot].head >= 0; slot = (slot + 1) & mask) {
    if (cells[slot].key == key) return cells[slot].head;
  }
  return -1;
}

std::int32_t* SphereLevels::Level::find_or_add(std::uint64_t key) {
  if (2 * (num_cells + 1) > cells.size()) grow();
  const std::size_t mask = cells.size() - 1;
  std::size_t slot = scatter(key) & mask;
  while (cells[slot].head >= 0 && cells[slot].key != key) slot = (slot + 1) & mask;
  if (cells[slot].head < 0) {
    cells[slot].key = key;
    ++num_cells;
  }
  return &cells[slot].head;
}

void SphereLevels::Level::grow() {
  std::vector<Cell> old(std::max<std::size_t>(64, 2 * cells.size()), Cell{0, -1});
  old.swap(cells);
  const std::size_t mask = cells.size() - 1;
  for (const Cell& cell : old) {
    if (cell.head < 0) continue;
    std::size_t slot = scatter(cell.key) & mask;
    while (cells[slot].head >= 0) slot = (slot + 1) & mask;
    cells[slot] = cell;
  }
}

void SphereLevels::insert(const Sphere& sphere) {
  const double radius = sphere.radius;
  const int exponent = std::ilogb(radius);
  auto at = std::find_if(levels_.begin(), levels_.end(),
                         [&](const Level& level) { return level.exponent <= exponent; });
  if (at == levels_.end() || at->exponent != exponent) {
    at = levels_.insert(at, Level{});
    at->exponent = exponent;
    at->cell_size = std::ldexp(kCellSize, exponent);
    at->margin = std::ldexp(kMargin, exponent);
  }
  Level& level = *at;
  level.spheres.push_back(sphere);
  const Vec3d c = to_double(sphere.center);
  const double h = level.cell_size, reach = (radius + level.margin) * (1 + 1e-9);
  std::int64_t low[3], high[3];
  for (int k = 0; k < 3; ++k) {
    low[k] = cell_index(c[k] - reach, h);
    high[k] = cell_index(c[k] + reach, h);
  }
  // Distance to the slab of cells i along one axis.
  const auto apart = [&](int axis, std::int64_t i) {
    const double begin = static_cast<double>(i) * h;
    return std::max({0.0, begin - c[axis], c[axis] - begin - h});
  };
  for (std::int64_t z = low[2]; z <= high[2]; ++z) {
    const double dz = apart(2, z);
    for (std::int64_t y = low[1]; y <= high[1]; ++y) {
      const double dy = apart(1, y);
      for (std::int64_t x = low[0]; x <= high[0]; ++x) {
        const double dx = apart(0, x);
        if (dx * dx + dy * dy + dz * dz > reach * reach) continue;
        std::int32_t* head = level.find_or_add(cell_key(x, y, z));
        if (*head < 0 || blocks_[static_cast<std::size_t>(*head)].num == kBlockSize) {
          blocks_.push_back({{}, 0, *head});
          *head = static_cast<std::int32_t>(blocks_.size()) - 1;
        }
        Block& block = blocks_[static_cast<std::size_t>(*head)];
        block.spheres[block.num++] = sphere;
      }
    }
  }
}

// Calls visit(sphere) for a superset of the spheres within `reach` (re-read per level through the
// visitor's return value, which may only shrink it).
template <class Visit>
void SphereLevels::visit(const Vec3d& p, double reach, Visit&& visit) const {
  for (const Level& level : levels_) {
    const double h = level.cell_size, extra = std::max(0.0, reach - level.margin) * (1 + 1e-9);
    if (extra > kWidestSearch * h) {
      for (const Sphere& sphere : level.spheres) reach = visit(sphere);
      continue;
    }
    const std::int64_t low[3] = {cell_index(p.x - extra, h), cell_index(p.y - extra, h),
                                 cell_index(p.z - extra, h)};
    const std::int64_t high[3] = {cell_index(p.x + extra, h), cell_index(p.y + extra, h),
                                  cell_index(p.z + extra, h)};
    for (std::int64_t z = low[2]; z <= high[2]; ++z) {
      for (std::int64_t y = low[1]; y <= high[1]; ++y) {
        for (std::int64_t x = low[0]; x <= high[0]; ++x) {
          for (std::int32_t b = level.find(cell_key(x, y, z)); b >= 0;) {
            const Block& block = blocks_[static_cast<std::size_t>(b)];
            for (int i = 0; i < block.num; ++i) reach = visit(block.spheres[i]);
            b = block.next;
          }
        }
      }
    }
  }
}

double SphereLevels::clearance(const Vec3d& p, double reach) const {
  Sphere ignored;
  return nearest(p, reach, ignored);
}

double SphereLevels::nearest(const Vec3d& p, double reach, Sphere& found) const {
  double best = reach;
  visit(p, reach, [&](const Sphere& sphere) {
    const Vec3d d = p - to_double(sphere.center);
    const double d2 = dot(d, d), radius = sphere.radius, limit = radius + best;
    if (limit > 0 && d2 < limit * limit) {
      best = std::sqrt(d2) - radius;
      found = sphere;
    }
    return std::max(best, 0.0);
  });
  return best;
}

bool SphereLevels::gather(const Vec3d& p, double reach, std::size_t limit,
                          std::vector<Sphere>& out) const {
  const std::size_t start = out.size();
  bool complete = true;
  visit(p, reach, [&](const Sphere& sphere) {
    const Vec3d d = p - to_double(sphere.center);
    const double far = static_cast<double>(sphere.radius) + reach;
    if (dot(d, d) <= far * far) {
      if (out.size() - start < limit) {
        out.push_back(sphere);
      } else {
        complete = false;
      }
    }
    return reach;
  });
  return complete;
}

}}  // namespace palpate::v0
