// Rules for the silhouettes of a pixel of a depth field: the nearest places around it where a
// surface ends in front of another one. Shared by the CPU's vector kernels and CUDA (lanes.h).
#pragma once

#include <cstdint>

#include "src/core/internal/lanes.h"
#include "src/field/pyramid/field_pyramid.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

inline constexpr int kReach = DepthFieldLevel::kSilhouetteReach;
// Smallest step at which a surface ends between two pixels, in widths of a pixel: depth of the
// farther one beyond a smooth surface at the slant of both.
inline constexpr float kMinStep = 1.0f;
// Depth behind the near edge down to which a far surface is considered, m.
inline constexpr float kFarEnough = 0.5f;
// Smallest slope of a surface: steeper ones count as this.
inline constexpr float kMinSlope = 0.02f;

/// The planes of pixels of a level.
struct RulePlane {
  VecF offset, slope;
};

/// Constants of one level: widths are of a pixel at a depth of 1 m.
struct RuleLevel {
  float width_u, width_v;  ///< over the focal lengths
  float first_u, first_v;  ///< direction x / z and y / z of pixel (0, 0)
};

inline RuleLevel rule_level(const Intrinsics& k, int level) {
  const auto size = static_cast<float>(1 << level);
  const auto fx = static_cast<float>(k.fx), fy = static_cast<float>(k.fy);
  const float middle = 0.5f * size - 0.5f;  // of pixel (0, 0), in pixels of the image
  return {size / fx, size / fy, (middle - static_cast<float>(k.cx)) / fx,
          (middle - static_cast<float>(k.cy)) / fy};
}

/// Depth of a surface in the middle of its pixel; far away where there is none.
PALPATE_FORMULA VecF surface_depth(const RulePlane& plane) {
  return plane.offset / max(plane.slope, splat(1e-6f));
}

PALPATE_FORMULA Mask is_nearer(const RulePlane& a, const RulePlane& b) {
  return a.slope * b.offset >= b.slope * a.offset;
}

PALPATE_FORMULA RulePlane chosen(Mask mask, const RulePlane& a, const RulePlane& b) {
  return {select(mask, a.offset, b.offset), select(mask, a.slope, b.slope)};
}

/// True if `far` is farther than a smooth surface through `near` could be at depth z, by the
/// squared share `reach` of a pixel's width. Both are real surfaces or `far` is none.
PALPATE_FORMULA Mask is_apart(const RulePlane& near, const RulePlane& far, VecF gap, VecF span,
                              VecF reach) {
  const VecF miss = gap - kMinStep * span;
  const VecF cosine = select(far.slope > splat(0.0f), min(near.slope, far.slope), near.slope);
  const VecF squared_sine = 1.0f - cosine * cosine;
  return (miss > splat(0.0f)) & (miss * miss > span * span * squared_sine * reach);
}

/// True if a surface ends between two pixels side by side, the near one of which comes first.
PALPATE_FORMULA Mask ends_between(const RulePlane& near, VecF near_depth, const RulePlane& far,
                                  float width) {
  const VecF gap = far.offset - near_depth * far.slope;
  return (near.slope > splat(0.0f)) & is_apart(near, far, gap, width * near_depth, splat(1.0f));
}

/// Columns (or rows) from the middle between two pixels side by side to where one surface ends, by
/// how much of both each covers: 0 in level 0. At least an eighth away from the middle of a pixel,
/// where corners would be sharp.
PALPATE_FORMULA VecF edge_shift(VecF share, VecF next_share) {
  constexpr float kMaxShift = 0.375f;
  return max(min(share - next_share, splat(kMaxShift)), splat(-kMaxShift));
}

/// The nearest silhouette found so far.
struct NearestSilhouette {
  VecF du = splat(0.0f), dv = splat(0.0f);  ///< pixels
  VecF squared = splat(1e9f);               ///< of the distance
  RulePlane other = {splat(0.0f), splat(0.0f)};
};

PALPATE_FORMULA Mask is_any(const NearestSilhouette& nearest) {
  return nearest.squared < splat(1e8f);
}

PALPATE_FORMULA void take(NearestSilhouette& nearest, Mask fits, VecF du, VecF dv,
                          const RulePlane& other) {
  const VecF squared = du * du + dv * dv;
  const Mask is_better = fits & (squared < nearest.squared);
  nearest.du = select(is_better, du, nearest.du);
  nearest.dv = select(is_better, dv, nearest.dv);
  nearest.squared = select(is_better, squared, nearest.squared);
  nearest.other = chosen(is_better, other, nearest.other);
}

/// Nearest silhouettes around a pixel: one where its own surface ends, with the surface beyond, and
/// one of a surface that stands in front of it.
struct PixelSilhouettes {
  NearestSilhouette exit, occluder;
};

/// Limits of a surface beyond a silhouette that is an exit, with pixels so wide.
struct ExitLimits {
  VecF behind;  ///< depth kReach pixels behind the pixel
  VecF least;   ///< least distance of that point in front of the far surface
};
PALPATE_FORMULA ExitLimits exit_limits(const RulePlane& own, VecF depth, float width) {
  return {depth * (1.0f + kReach * width / max(own.slope, splat(kMinSlope))),
          (kMinStep - kReach) * width * depth};
}

/// True if a silhouette is an exit for points kReach pixels behind `own`: the far surface is less
/// deep there.
PALPATE_FORMULA Mask is_exit(const RulePlane& own, const ExitLimits& limits, const RulePlane& far) {
  const VecF out = far.offset - limits.behind * far.slope;
  return (own.slope > splat(0.0f)) & (out > limits.least);
}

/// True if a silhouette, at a distance in pixels, stands in front of `own`: its near surface is a
/// different one.
PALPATE_FORMULA Mask is_occluder(const RulePlane& own, VecF own_depth, const RulePlane& near,
                                 VecF near_depth, VecF squared_distance, float width) {
  const VecF depth = min(own_depth, near_depth + kFarEnough);
  const VecF gap = own.offset - depth * own.slope - (near.offset - depth * near.slope);
  const VecF reach = 2.0f * squared_distance + 0.5f;
  return (own_depth > near_depth) & is_apart(near, own, gap, width * near_depth, reach);
}

PALPATE_FORMULA void take_exit(const RulePlane& own, const RulePlane& far, Mask is_any, VecF du,
                               VecF dv, float width, NearestSilhouette& exit) {
  take(exit, is_any & is_exit(own, exit_limits(own, surface_depth(own), width), far), du, dv, far);
}

PALPATE_FORMULA void take_occluder(const RulePlane& own, const RulePlane& near, Mask is_any,
                                   VecF du, VecF dv, float width, NearestSilhouette& occluder) {
  const VecF squared = du * du + dv * dv;
  take(occluder,
       is_any & is_occluder(own, surface_depth(own), near, surface_depth(near), squared, width), du,
       dv, near);
}

/// True if a surface ends between two pixels side by side.
PALPATE_FORMULA Mask is_edge(const RulePlane& a, const RulePlane& b, float width) {
  const Mask a_is_near = is_nearer(a, b);
  const RulePlane near = chosen(a_is_near, a, b);
  return ends_between(near, surface_depth(near), chosen(a_is_near, b, a), width);
}

/// Takes the edge between two pixels side by side, where there is one.
PALPATE_FORMULA void take_edge(const RulePlane& own, const RulePlane& a, const RulePlane& b,
                               Mask is_any, VecF du, VecF dv, float width,
                               PixelSilhouettes& found) {
  const Mask a_is_near = is_nearer(a, b);
  const RulePlane near = chosen(a_is_near, a, b), far = chosen(a_is_near, b, a);
  take_exit(own, far, is_any, du, dv, width, found.exit);
  take_occluder(own, near, is_any, du, dv, width, found.occluder);
}

/// Takes the silhouettes found at another pixel of the same column.
PALPATE_FORMULA void take_found(const RulePlane& own, const PixelSilhouettes& there, VecF dv,
                                float width, PixelSilhouettes& found) {
  const Mask has_exit = is_any(there.exit), has_occluder = is_any(there.occluder);
  if (is_any_set(has_exit)) {
    take_exit(own, there.exit.other, has_exit, there.exit.du, dv, width, found.exit);
  }
  if (is_any_set(has_occluder)) {
    take_occluder(own, there.occluder.other, has_occluder, there.occluder.du, dv, width,
                  found.occluder);
  }
}

/// Silhouette::side without its sign, of a pixel seen in the direction (x, y) from (x / z, y / z):
/// the distance to the plane through the eye and the edge, over the depth.
PALPATE_FORMULA VecF side_of(const NearestSilhouette& nearest, VecF x, VecF y,
                             const RuleLevel& level) {
  const VecF dx = nearest.du * level.width_u, dy = nearest.dv * level.width_v;
  const VecF squared = dx * dx + dy * dy;
  const VecF along = dx * (x + dx) + dy * (y + dy);
  return squared / max(sqrt(squared + along * along), splat(1e-12f));
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
