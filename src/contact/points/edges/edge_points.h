// Points at which the surface ends in the image, and the mean edge around each (see EdgeSums).
// Shared code for host and device.
#pragma once

#include <cmath>
#include <cstdint>

#include "src/contact/points/scan/point_lookup.h"

namespace palpate { inline namespace v0 {

/// Sums over the edge points around one, added in the order of their pixels.
struct EdgeMean {
  Vec3d p, change;
  double num = 0;

  PALPATE_FORMULA void add(const Vec3d& other_p, const Vec3d& other_change) {
    p += other_p;
    change += other_change;
    num += 1;
  }
  /// Side of the image towards which the edge faces: index in EdgeSums::towards.
  PALPATE_FORMULA int direction() const {
    const bool sideways = std::fabs(change.x) >= std::fabs(change.y);
    return sideways ? (change.x > 0 ? 0 : 1) : (change.y > 0 ? 2 : 3);
  }
  /// Terms of the sums: mean point as an offset from the translation, unit direction.
  PALPATE_FORMULA Vec3d offset(const Vec3d& translation_W) const { return p / num - translation_W; }
  PALPATE_FORMULA Vec3d unit_change() const { return change / std::sqrt(dot(change, change)); }
};

/// The edges of an organized cloud.
struct EdgePoints {
  const PointCloudView* cloud;

  PALPATE_FORMULA bool is_point(std::int32_t i) const { return cloud->z[i] == cloud->z[i]; }
  PALPATE_FORMULA Vec3d point(std::int32_t i) const {
    return {cloud->x[i], cloud->y[i], cloud->z[i]};
  }

  /// Returns the depth-change vector, across missing pixels where it is unknown beside the point.
  PALPATE_FORMULA Vec3d change(std::int32_t i, int row, int column) const {
    const Vec3d known = known_change(i);
    if (known.x != 0 || known.y != 0 || !is_point(i)) return known;
    const Beside sides[] = {right(column), left(column), below(row), above(row)};
    Vec3d l;
    for (int k = 0; k < EdgeSums::kDirections; ++k) {
      const auto [step, room] = sides[k];
      if (!is_hole(i, sides[k])) continue;
      const int end = room < EdgeSums::kMaxHole ? room : EdgeSums::kMaxHole;
      int n = 2;
      while (n <= end && !is_point(i + n * step)) ++n;
      if (n > end) continue;
      const double z = cloud->z[i], beyond = cloud->z[i + n * step];
      const double more = beyond - z - EdgeSums::kMinStep;
      if (more > 0) (k < 2 ? l.x : l.y) += k % 2 == 0 ? more : -more;
    }
    if (l.x == 0 && l.y == 0) return l;
    const Vec3d p = point(i);
    return l - dot(l, p) / dot(p, p) * p;
  }

  PALPATE_FORMULA static bool is_edge(const Vec3d& change) {
    return dot(change, change) > EdgeSums::kMinChange * EdgeSums::kMinChange;
  }

  /// False if the point is surely no edge; holes are not searched.
  PALPATE_FORMULA bool may_be_edge(std::int32_t i, int row, int column) const {
    const Vec3d known = known_change(i);
    if (known.x != 0 || known.y != 0) return is_edge(known);
    return is_hole(i, right(column)) || is_hole(i, left(column)) || is_hole(i, below(row)) ||
           is_hole(i, above(row));
  }

  /// True if the edge point `other` belongs to the edge of point i: same surface, about the same
  /// direction.
  PALPATE_FORMULA bool belong_together(std::int32_t i, const Vec3d& change, std::int32_t other,
                                       const Vec3d& other_change) const {
    if (!(dot(change, other_change) > 0)) return false;
    const float step = cloud->z[other] - cloud->z[i];
    constexpr float kSame = static_cast<float>(EdgeSums::kSameSurface);
    return step < kSame && step > -kSame;  // false if it is no point
  }

 private:
  PALPATE_FORMULA Vec3d known_change(std::int32_t i) const {
    return {cloud->edge_x[i], cloud->edge_y[i], cloud->edge_z[i]};
  }

  // The pixels on one side of a point: index step to the next one, and their number.
  struct Beside {
    int step, room;
  };
  PALPATE_FORMULA Beside right(int column) const { return {1, cloud->width - 1 - column}; }
  PALPATE_FORMULA Beside left(int column) const { return {-1, column}; }
  PALPATE_FORMULA Beside below(int row) const { return {cloud->width, cloud->height - 1 - row}; }
  PALPATE_FORMULA Beside above(int row) const { return {-cloud->width, row}; }
  PALPATE_FORMULA bool is_hole(std::int32_t i, Beside side) const {
    return side.room > 0 && !is_point(i + side.step);
  }
};

}}  // namespace palpate::v0
