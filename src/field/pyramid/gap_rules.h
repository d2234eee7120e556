// Rules for surfaces that go on where nothing was measured: between two separate surfaces, and
// beyond the border of the image. Shared by host and device.
#pragma once

#include "src/field/pyramid/silhouette_rules.h"

namespace palpate { inline namespace v0 {

/// Longest run of missing pixels that is filled from its two ends: along rows first, then, for the
/// pixels that are left, along columns.
inline constexpr int kMaxRun = 64;

/// True if a surface ends between two surfaces that are `width` apart, over the depth: the rule of
/// silhouettes from pixel to pixel, by which a smooth surface at the slant of both could not join
/// them.
PALPATE_HOSTDEV inline bool are_apart(const TangentPlane& a, const TangentPlane& b, float width) {
  return one_lane::is_edge({a.offset, a.slope}, {b.offset, b.slope}, width);
}

/// Returns what fills a run of missing pixels between two surfaces whose pixels are `width` apart:
/// the farther one, if they are not one surface; else a plane without surface.
PALPATE_HOSTDEV inline TangentPlane filling_of_run(const TangentPlane& a, const TangentPlane& b,
                                                   float width) {
  if (!are_apart(a, b, width)) return {};
  return one_lane::is_nearer({a.offset, a.slope}, {b.offset, b.slope}) ? b : a;
}

/// The surface of the last pixel of a row or column, going on beyond the image: its distance from
/// the eye stays, its inverse depth goes on as it changes over the last pixels, if those are evenly
/// of one surface; else that stays, too.
class GoingOn {
 public:
  static constexpr int kNum = 4;

  /// Pixels of a level, from the last one inwards.
  PALPATE_HOSTDEV GoingOn(const TangentPlane (&line)[kNum], int level) : last_(line[0]) {
    float at[kNum];
    bool are_even = true;
    for (int i = 0; i < kNum; ++i) {
      at[i] = line[i].slope / line[i].offset;
      are_even = are_even && line[i].is_surface();
    }
    const float step = (at[0] - at[kNum - 1]) * (1.0f / (kNum - 1));
    for (int i = 1; i < kNum - 1; ++i) {
      const float even = at[0] - static_cast<float>(i) * step;
      are_even = are_even && is_same_surface(at[i], even, tolerance_of(level));
    }
    step_ = are_even ? last_.offset * step : 0.0f;
  }

  /// The plane `num` pixels beyond the last one; at most twice as far away or near as that.
  PALPATE_HOSTDEV TangentPlane at(int num) const {
    const float slope = last_.slope + static_cast<float>(num) * step_;
    const float least = 0.5f * last_.slope, most = 2.0f * last_.slope;
    return {last_.offset, slope < least ? least : (slope > most ? most : slope)};
  }

 private:
  TangentPlane last_;
  float step_ = 0;  // of the slope
};

}}  // namespace palpate::v0
