#include "src/contact/index/sphere_grid.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

// Cells are tested as if they were this much larger on every side (in cells), so that a point which
// rounding put into the neighboring cell still finds its sphere.
constexpr double kInflation = 1e-3;

// About 1.5 cells per sphere along an axis: finer grids fall out of the L2 cache, coarser ones have
// longer lists (bench/contact_bench.cpp).
int cells_along_longest_side(std::size_t num_spheres) {
  return std::clamp(static_cast<int>(1.5 * std::cbrt(static_cast<double>(num_spheres))), 12, 128);
}

double squared(double v) { return v * v; }

// Squared distance from 0 to the nearest and farthest point of the interval [low, high].
double nearest_squared(double low, double high) {
  return low > 0 ? squared(low) : (high < 0 ? squared(high) : 0);
}
double farthest_squared(double low, double high) { return std::max(squared(low), squared(high)); }

}  // namespace

SphereGrid::SphereGrid(std::span<const Sphere> spheres) {
  Vec3d low{1e300, 1e300, 1e300}, high = -low;
  for (const Sphere& s : spheres) {
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], static_cast<double>(s.center[axis]) - s.radius);
      high[axis] = std::max(high[axis], static_cast<double>(s.center[axis]) + s.radius);
    }
  }
  const Vec3d size = high - low;
  cells_per_meter_ = cells_along_longest_side(spheres.size()) / std::max({size.x, size.y, size.z});
  const double margin = 2 * kInflation / cells_per_meter_;
  origin_ = low - Vec3d{margin, margin, margin};
  for (int axis = 0; axis < 3; ++axis) {
    num_[axis] = static_cast<int>((size[axis] + 2 * margin) * cells_per_meter_) + 1;
  }

  // Every (cell, sphere) pair that overlaps, and the cells that lie wholly inside one sphere.
  struct Overlap {
    std::int32_t cell, sphere_id;
  };
  std::vector<Overlap> overlaps;
  tags_.assign(static_cast<std::size_t>(num_[0]) * num_[1] * num_[2], 0);
  for (std::size_t id = 0; id < spheres.size(); ++id) {
    const Vec3d c = (to_double(spheres[id].center) - origin_) * cells_per_meter_;
    const double r = spheres[id].radius * cells_per_meter_;
    int first[3], last[3];
    for (int axis = 0; axis < 3; ++axis) {
      first[axis] = std::max(0, static_cast<int>(std::floor(c[axis] - r - kInflation)));
      last[axis] = std::min(num_[axis] - 1, static_cast<int>(std::floor(c[axis] + r + kInflation)));
    }
    for (int k = first[2]; k <= last[2]; ++k) {
      for (int j = first[1]; j <= last[1]; ++j) {
        for (int i = first[0]; i <= last[0]; ++i) {
          const int index[3] = {i, j, k};
          double nearest = 0, farthest = 0;
          for (int axis = 0; axis < 3; ++axis) {
            const double from = index[axis] - kInflation - c[axis];
            const double to = index[axis] + 1 + kInflation - c[axis];
            nearest += nearest_squared(from, to);
            farthest += farthest_squared(from, to);
          }
          const std::int32_t cell = (k * num_[1] + j) * num_[0] + i;
          if (farthest < squared(r) * (1 - 1e-6)) {
            tags_[cell] = static_cast<std::int32_t>(id) + 1;
          } else if (nearest <= squared(r) * (1 + 1e-6)) {
            overlaps.push_back({cell, static_cast<std::int32_t>(id)});
          }
        }
      }
    }
  }

  // Cells with candidates get a list, packed in blocks of eight; a full cell needs none.
  std::sort(overlaps.begin(), overlaps.end(), [](const Overlap& a, const Overlap& b) {
    return a.cell != b.cell ? a.cell < b.cell : a.sphere_id < b.sphere_id;
  });
  for (std::size_t begin = 0; begin < overlaps.size();) {
    std::size_t end = begin;
    while (end < overlaps.size() && overlaps[end].cell == overlaps[begin].cell) ++end;
    const std::int32_t cell = overlaps[begin].cell;
    if (tags_[cell] == 0) {
      tags_[cell] = -static_cast<std::int32_t>(blocks_.size()) - 1;
      for (std::size_t i = begin; i < end; ++i) {
        const std::size_t slot = (i - begin) % CandidateBlock::kSize;
        if (slot == 0) {
          if (i > begin)
            blocks_.back().sphere_id[CandidateBlock::kSize - 1] |= CandidateBlock::kGoesOn;
          blocks_.push_back(CandidateBlock{});
          std::fill_n(blocks_.back().surely_inside, CandidateBlock::kSize, -1.0f);
          std::fill_n(blocks_.back().maybe_inside, CandidateBlock::kSize, -1.0f);
        }
        const Sphere& s = spheres[static_cast<std::size_t>(overlaps[i].sphere_id)];
        const Vec3f c = to_float((to_double(s.center) - origin_) * cells_per_meter_);
        const double r = s.radius * cells_per_meter_;
        CandidateBlock& block = blocks_.back();
        block.x[slot] = c.x;
        block.y[slot] = c.y;
        block.z[slot] = c.z;
        block.surely_inside[slot] =
            r > kRounding ? static_cast<float>(squared(r - kRounding)) : -1.0f;
        block.maybe_inside[slot] = static_cast<float>(squared(r + kRounding));
        block.sphere_id[slot] = overlaps[i].sphere_id;
      }
    }
    begin = end;
  }
}

SphereGridView SphereGrid::view() const {
  return {origin_, cells_per_meter_, num_[0], num_[1], num_[2], tags_.data(), blocks_.data()};
}

}}  // namespace palpate::v0
