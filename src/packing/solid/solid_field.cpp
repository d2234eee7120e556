#include "palpate/packing/packing.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "src/packing/solid/triangle_bvh.h"

namespace palpate { inline namespace v0 {
namespace {

// A level with no more cells than this along the longest side of the box is the last.
constexpr int kFewCells = 4;
// No box needs a finer grid; also keeps plates and needles within the levels that there are.
constexpr int kMaxCells = kFewCells << (SolidField::kMaxLevels - 1);
// Factor by which the spacing grows until the nodes are few enough.
constexpr double kWiden = 1.01;
// Relative tolerance of distances: long searches may stop so near to the nearest triangle.
constexpr double kTolerance = 1e-4;

std::array<std::int32_t, 3> cells_of(const Vec3d& size, double spacing) {
  std::array<std::int32_t, 3> cells{};
  for (int axis = 0; axis < 3; ++axis) {
    cells[static_cast<std::size_t>(axis)] =
        std::max(1, static_cast<std::int32_t>(std::ceil(size[axis] / spacing)));
  }
  return cells;
}

std::size_t num_nodes_of(const std::array<std::int32_t, 3>& cells) {
  std::size_t num = 1;
  for (const std::int32_t n : cells) {
    num *= static_cast<std::size_t>(n) + 1 + 2 * SolidField::kMargin;
  }
  return num;
}

SolidField::Layout layout_of(const TriangleMesh& solid) {
  const Bounds box = bounds(solid);
  const Vec3d size = box.high - box.low;
  SolidField::Layout layout{box.low, std::max({size.x, size.y, size.z}) / kMaxCells, {}};
  // Rounding may not give the longest side one cell more.
  layout.spacing *= 1 + 1e-9;
  while (num_nodes_of(layout.num_cells = cells_of(size, layout.spacing)) > SolidField::kMaxNodes) {
    layout.spacing *= kWiden;
  }
  return layout;
}

/// The signed distances at the nodes of a row along x.
void fill_row(const TriangleBvh& mesh, const Vec3d& first, double step, std::span<float> row) {
  double before = 0;
  bool is_inside = false;
  for (std::size_t i = 0; i < row.size(); ++i) {
    const Vec3d p = first + Vec3d{static_cast<double>(i) * step, 0, 0};
    const double reach = i == 0 ? 1e300 : (before + step) * (1 + 1e-6);
    double distance = mesh.closest(p, reach, kTolerance).distance;
    if (!std::isfinite(distance)) distance = reach;
    // With the surface nearer to neither end than a half of the step, none is between them.
    const bool may_cross = i == 0 || (distance + before) * (1 - 2 * kTolerance) <= step;
    if (may_cross) is_inside = mesh.inside(p);
    row[i] = static_cast<float>(is_inside ? -distance : distance);
    before = distance;
  }
}

}  // namespace

SolidField::SolidField(const Layout& layout) : layout_(layout) {
  std::size_t num_values = 0;
  Level level{layout.spacing, {}, 0};
  for (std::array<std::int32_t, 3> cells = layout.num_cells; levels_.size() < kMaxLevels;) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      level.num_nodes[axis] = cells[axis] + 1 + 2 * kMargin;
    }
    level.first = num_values;
    levels_.push_back(level);
    num_values += num_nodes_of(cells);
    if (*std::max_element(cells.begin(), cells.end()) <= kFewCells) break;
    for (std::int32_t& n : cells) n = (n + 1) / 2;
    level.spacing *= 2;
  }
  values_.resize(num_values + kSpareValues);
}

SolidField SolidField::of(const TriangleMesh& solid, ThreadPool& pool) {
  const TriangleBvh mesh(solid);
  SolidField field(layout_of(solid));
  for (const Level& level : field.levels_) {
    const auto [nx, ny, nz] = level.num_nodes;
    pool.parallel_for(ny * nz, [&, nx = nx, ny = ny](int row) {
      const int y = row % ny, z = row / ny;
      const Vec3d node{-double(kMargin), static_cast<double>(y - kMargin),
                       static_cast<double>(z - kMargin)};
      const auto num = static_cast<std::size_t>(nx);
      fill_row(
          mesh, field.layout_.origin + level.spacing * node, level.spacing,
          std::span(field.values_).subspan(level.first + static_cast<std::size_t>(row) * num, num));
    });
  }
  return field;
}

Result<SolidField> SolidField::restore(const Layout& layout, std::span<const float> values) {
  const auto bad = [](const char* what) {
    return Error{Errc::bad_input,
                 std::string("the distance field of the tool ") + what + "; pack the mesh again"};
  };
  bool fits = std::isfinite(layout.origin.x + layout.origin.y + layout.origin.z) &&
              layout.spacing > 0 && std::isfinite(layout.spacing);
  for (const std::int32_t n : layout.num_cells) fits = fits && n >= 1 && n <= kMaxCells;
  if (!fits || num_nodes_of(layout.num_cells) > kMaxNodes) return bad("has no grid");
  SolidField field(layout);
  if (values.size() != field.values().size()) return bad("is not of its grid");
  // The diagonal of the widest grid, which reaches farthest, bounds the distance of its nodes from
  // the surface.
  const Level& widest = field.levels_.back();
  const Vec3d nodes{static_cast<double>(widest.num_nodes[0]),
                    static_cast<double>(widest.num_nodes[1]),
                    static_cast<double>(widest.num_nodes[2])};
  const auto farthest = static_cast<float>(widest.spacing * norm(nodes));
  for (const float value : values) {
    if (!(std::abs(value) <= farthest)) return bad("has a number that is not a distance");
  }
  std::copy(values.begin(), values.end(), field.values_.begin());
  return field;
}

std::span<const float> SolidField::values(int level) const {
  const Level& of = levels_[static_cast<std::size_t>(level)];
  return std::span(values_).subspan(of.first, static_cast<std::size_t>(of.num_nodes[0]) *
                                                  static_cast<std::size_t>(of.num_nodes[1]) *
                                                  static_cast<std::size_t>(of.num_nodes[2]));
}

bool operator==(const SolidField& a, const SolidField& b) {
  return a.layout_.origin == b.layout_.origin && a.layout_.spacing == b.layout_.spacing &&
         a.layout_.num_cells == b.layout_.num_cells && a.values_ == b.values_;
}

}}  // namespace palpate::v0
