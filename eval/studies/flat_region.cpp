#include "eval/studies/flat_region.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace palpate::eval {
namespace {

constexpr double kFlat = 0.008;     // of the depth: mean distance of a cell's pixels
constexpr double kMinShare = 0.01;  // of the image
constexpr int kSeedEvery = 3;       // cells

/// Inverse depth over the image: a x + b y + c, x and y being tangents.
struct InversePlane {
  double a = 0, b = 0, c = 0;
  double at(double x, double y) const { return a * x + b * y + c; }
};

/// Sums of its least-squares fit.
struct Moments {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0, w = 0, xw = 0, yw = 0;

  void add(const Moments& m) {
    n += m.n, x += m.x, y += m.y, xx += m.xx, xy += m.xy, yy += m.yy;
    w += m.w, xw += m.xw, yw += m.yw;
  }
  InversePlane fit() const {
    // About the means, so that two unknowns remain.
    const double mx = x / n, my = y / n, mw = w / n;
    const double sxx = xx - n * mx * mx, sxy = xy - n * mx * my, syy = yy - n * my * my;
    const double sxw = xw - n * mx * mw, syw = yw - n * my * mw;
    const double det = sxx * syy - sxy * sxy;
    const double a = (sxw * syy - syw * sxy) / det, b = (syw * sxx - sxw * sxy) / det;
    return {a, b, mw - a * mx - b * my};
  }
};

class Cells {
 public:
  const int columns, rows;

  Cells(const DepthStreamInfo& stream, const DepthFrame& frame)
      : columns(frame.width / FlatRegion::kCell),
        rows(frame.height / FlatRegion::kCell),
        stream_(stream),
        frame_(frame),
        moments_(static_cast<std::size_t>(columns * rows)) {
    for (int cell = 0; cell < columns * rows; ++cell) {
      Moments& m = moments_[static_cast<std::size_t>(cell)];
      for_each_pixel(cell, [&](std::size_t, double x, double y, double z) {
        const double w = 1 / z;
        m.add({1, x, y, x * x, x * y, y * y, w, x * w, y * w});
      });
    }
  }

  /// Visits the pixels with depth: visit(pixel, x, y, depth).
  template <class Visit>
  void for_each_pixel(int cell, Visit visit) const {
    constexpr int kCell = FlatRegion::kCell;
    const Intrinsics& k = stream_.intrinsics;
    for (int v = cell / columns * kCell; v < (cell / columns + 1) * kCell; ++v) {
      for (int u = cell % columns * kCell; u < (cell % columns + 1) * kCell; ++u) {
        const std::size_t pixel =
            static_cast<std::size_t>(v) * static_cast<std::size_t>(frame_.width) +
            static_cast<std::size_t>(u);
        if (frame_.pixels[pixel] == 0 || frame_.pixels[pixel] == 65535) continue;
        visit(pixel, (u - k.cx) / k.fx, (v - k.cy) / k.fy, frame_.pixels[pixel] * frame_.unit);
      }
    }
  }

  bool is_on(int cell, const InversePlane& plane) const {
    constexpr int kAll = FlatRegion::kCell * FlatRegion::kCell;
    if (moments_[static_cast<std::size_t>(cell)].n < kAll) return false;
    double sum = 0;
    for_each_pixel(cell, [&](std::size_t, double x, double y, double z) {
      sum += std::abs(z * plane.at(x, y) - 1);
    });
    return sum / kAll < kFlat;
  }

  /// Returns the cells connected to `seed` that lie on the plane of its surroundings, refined with
  /// the region's own plane.
  std::vector<int> grown(int seed) const {
    Moments near;
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) near.add(moment(seed + dy * columns + dx));
    }
    std::vector<int> region;
    if (near.n < 9 * FlatRegion::kCell * FlatRegion::kCell) return region;
    InversePlane plane = near.fit();
    for (int round = 0; round < 3; ++round) {
      region = connected(seed, plane);
      if (region.empty()) return region;
      Moments sum;
      for (const int cell : region) sum.add(moment(cell));
      plane = sum.fit();
    }
    return region;
  }

  InversePlane plane_of(const std::vector<int>& region) const {
    Moments sum;
    for (const int cell : region) sum.add(moment(cell));
    return sum.fit();
  }

 private:
  const Moments& moment(int cell) const { return moments_[static_cast<std::size_t>(cell)]; }

  std::vector<int> connected(int seed, const InversePlane& plane) const {
    std::vector<char> seen(moments_.size(), 0);
    std::vector<int> region;
    const auto visit = [&](int cell) {
      char& is_seen = seen[static_cast<std::size_t>(cell)];
      if (is_seen) return;
      is_seen = 1;
      if (is_on(cell, plane)) region.push_back(cell);
    };
    visit(seed);
    for (std::size_t i = 0; i < region.size(); ++i) {
      const int cell = region[i], column = cell % columns, row = cell / columns;
      if (column > 0) visit(cell - 1);
      if (column + 1 < columns) visit(cell + 1);
      if (row > 0) visit(cell - columns);
      if (row + 1 < rows) visit(cell + columns);
    }
    return region;
  }

  const DepthStreamInfo& stream_;
  const DepthFrame& frame_;
  std::vector<Moments> moments_;
};

/// Returns the distance of each cell from the outside of the region in cells; 0: outside.
std::vector<int> steps_within(const std::vector<int>& region, int columns, int rows) {
  std::vector<int> within(static_cast<std::size_t>(columns * rows), 0);
  for (const int cell : region) within[static_cast<std::size_t>(cell)] = 1;
  for (bool changed = true; changed;) {
    changed = false;
    const std::vector<int> old = within;
    for (int row = 1; row + 1 < rows; ++row) {
      for (int column = 1; column + 1 < columns; ++column) {
        const auto at = [&](int r, int c) {
          return old[static_cast<std::size_t>(r * columns + c)];
        };
        const int own = at(row, column);
        if (own == 0) continue;
        const int least = std::min(
            {at(row - 1, column), at(row + 1, column), at(row, column - 1), at(row, column + 1)});
        if (least < own) continue;
        within[static_cast<std::size_t>(row * columns + column)] = own + 1;
        changed = true;
      }
    }
  }
  return within;
}

}  // namespace

std::vector<Vec3d> FlatRegion::places(const DepthStreamInfo& stream, int from_border) const {
  std::vector<Vec3d> places;
  const Intrinsics& k = stream.intrinsics;
  for (std::size_t cell = 0; cell < within.size(); ++cell) {
    if (within[cell] < from_border) continue;
    const auto column = static_cast<double>(cell % static_cast<std::size_t>(columns));
    const auto row = static_cast<double>(cell / static_cast<std::size_t>(columns));
    const Vec3d ray{((column + 0.5) * kCell - 0.5 - k.cx) / k.fx,
                    ((row + 0.5) * kCell - 0.5 - k.cy) / k.fy, 1};
    places.push_back(plane_C.offset / dot(plane_C.normal, ray) * ray);
  }
  return places;
}

int FlatRegion::max_within() const {
  return within.empty() ? 0 : *std::max_element(within.begin(), within.end());
}

std::optional<FlatRegion> largest_flat_region(const DepthStreamInfo& stream,
                                              const DepthFrame& frame) {
  const Cells cells(stream, frame);
  std::vector<char> is_taken(static_cast<std::size_t>(cells.columns * cells.rows), 0);
  std::vector<int> best;
  for (int row = 1; row + 1 < cells.rows; row += kSeedEvery) {
    for (int column = 1; column + 1 < cells.columns; column += kSeedEvery) {
      const int seed = row * cells.columns + column;
      if (is_taken[static_cast<std::size_t>(seed)]) continue;
      std::vector<int> region = cells.grown(seed);
      for (const int cell : region) is_taken[static_cast<std::size_t>(cell)] = 1;
      if (region.size() > best.size()) best = std::move(region);
    }
  }
  if (static_cast<double>(best.size()) < kMinShare * cells.columns * cells.rows) {
    return std::nullopt;
  }
  const InversePlane fit = cells.plane_of(best);
  const Vec3d n{fit.a, fit.b, fit.c};  // n . p = 1
  FlatRegion region;
  region.plane_C = {-1 / norm(n) * n, -1 / norm(n)};
  region.columns = cells.columns, region.rows = cells.rows;
  region.within = steps_within(best, cells.columns, cells.rows);
  for (const int cell : best) {
    cells.for_each_pixel(
        cell, [&](std::size_t pixel, double, double, double) { region.pixels.push_back(pixel); });
  }
  return region;
}

}  // namespace palpate::eval
