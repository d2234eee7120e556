// The arithmetic of a depth field's pixels: shared code for CPU and GPU, whose loops differ, and
// for single pixels and vectors of them. A plane is anything with `offset` and `slope`, of numbers
// (TangentPlane) or of vectors of numbers.
#pragma once

#include "palpate/core/core.h"
#include "palpate/field/depth_field.h"
#include "src/cloud/internal/tangent_plane.h"

namespace palpate { inline namespace v0 {

/// Completes a pixel that is still unknown when all holes are filled. With UnknownSpace::blocked it
/// is a surface right in front of the camera, which faces it.
PALPATE_FORMULA TangentPlane completed(const TangentPlane& plane, UnknownSpace unknown) {
  return unknown == UnknownSpace::blocked && !plane.is_surface() ? TangentPlane{0.02f, 1} : plane;
}

/// Pixels of level k belong to one surface if their depths differ by less than this share: a wider
/// pixel reaches farther along a slanted surface.
PALPATE_FORMULA float tolerance_of(int level) {
  const float share = 0.012f * static_cast<float>(1 << level);
  return share < 0.05f ? share : 0.05f;
}

/// Choice of the surface that a wider pixel shows, among those of a few pixels.
enum class Choice {
  /// The surface, or absence of one, that most of their area shows; the nearest if undecided.
  majority,
  nearest,   ///< any surface, the nearest one
  farthest,  ///< any surface, the farthest one: what goes on behind an edge
};

/// True if pixels of these inverse depths (0: no surface) show one surface.
template <class Real>
PALPATE_FORMULA auto is_same_surface(Real a, Real b, float tolerance) {
  const Real apart = a < b ? b - a : a - b, least = a < b ? a : b;
  return (apart <= tolerance * least) & ((a > Real{}) == (b > Real{}));
}

/// A pixel of some level and the share of its area that shows the surface of its plane; the rest
/// shows another one. It tells where inside of a wide pixel a surface ends.
template <class Plane>
struct SharedPixel {
  Plane plane;
  decltype(Plane::offset) share;
};

/// Mean of the planes of one surface among four pixels with positive weights, and its share of
/// them.
template <class Plane>
PALPATE_FORMULA SharedPixel<Plane> merge(const SharedPixel<Plane> (&pixels)[4],
                                         const float (&weights)[4], float tolerance,
                                         Choice choice) {
  using Real = decltype(Plane::offset);
  const Real zero{}, one = zero + 1.0f;
  Real w[4];
  for (int i = 0; i < 4; ++i) w[i] = pixels[i].plane.slope / pixels[i].plane.offset;
  Real best = -one, best_votes = zero;  // the chosen pixel's w, and four times its share
  for (int i = 0; i < 4; ++i) {
    Real votes = zero;
    if (choice == Choice::majority) {
      for (int j = 0; j < 4; ++j) {
        votes += is_same_surface(w[i], w[j], tolerance) ? pixels[j].share : one - pixels[j].share;
      }
    }
    const auto is_nearer = choice == Choice::farthest ? w[i] < best : w[i] > best;
    auto is_better = (best < zero) | (votes > best_votes) | ((votes == best_votes) & is_nearer);
    if (choice != Choice::majority) is_better = is_better & (w[i] > zero);
    best = is_better ? w[i] : best;
    best_votes = is_better ? votes : best_votes;
  }
  Real offset = zero, slope = zero, total = zero;
  for (int i = 0; i < 4; ++i) {
    const auto is_of_it = is_same_surface(w[i], best, tolerance);
    offset += is_of_it ? weights[i] * pixels[i].plane.offset : zero;
    slope += is_of_it ? weights[i] * pixels[i].plane.slope : zero;
    total += is_of_it ? zero + weights[i] : zero;
  }
  return {{best > zero ? offset / total : zero + kFreeOffset, best > zero ? slope / total : zero},
          0.25f * best_votes};
}

/// One pixel of two by two; at an odd end the last one counts twice. Shares only matter to, and are
/// only known from, Choice::majority.
template <class Plane>
PALPATE_FORMULA SharedPixel<Plane> widened(const SharedPixel<Plane> (&pixels)[4], int level,
                                           Choice choice) {
  constexpr float kEqual[4] = {1, 1, 1, 1};
  return merge(pixels, kEqual, tolerance_of(level), choice);
}

/// Interpolates the next wider level, `level`, where a pixel has no surface. Of its four pixels
/// around the center of that one, the nearest comes first and the farthest last.
template <class Plane>
PALPATE_FORMULA Plane interpolated(const Plane (&planes)[4], int level) {
  constexpr float kBilinear[4] = {9, 3, 3, 1};
  const SharedPixel<Plane> pixels[4] = {
      {planes[0], {}}, {planes[1], {}}, {planes[2], {}}, {planes[3], {}}};
  return merge(pixels, kBilinear, tolerance_of(level), Choice::farthest).plane;
}
/// The second nearest of `num` wider columns to column u >= 0 (or rows); the nearest is u / 2.
template <class Int>
PALPATE_FORMULA Int second_nearest(Int u, int num) {
  const Int beside = (u >> 1) + 2 * (u & 1) - 1;
  const Int at = beside < 0 ? Int{} : beside;
  return at >= num ? Int{} + (num - 1) : at;
}

/// Returns a tile without any surface.
template <class Tile>
PALPATE_FORMULA Tile empty_tile() {
  using Real = decltype(Tile::nearest);
  return {Real{} + 1e30f, Real{} + 1.0f};
}
/// Returns a tile of unknown content: anything may be near.
template <class Tile>
PALPATE_FORMULA Tile unknown_tile() {
  using Real = decltype(Tile::nearest);
  return {Real{} - 1e30f, Real{} + 1.0f};
}
template <class Tile>
PALPATE_FORMULA Tile join(const Tile& a, const Tile& b) {
  return {b.nearest < a.nearest ? b.nearest : a.nearest,
          b.min_slope < a.min_slope ? b.min_slope : a.min_slope};
}
/// Returns the tile of pixels of level 0.
template <class Tile, class Plane>
PALPATE_FORMULA Tile tile_of(const Plane& plane) {
  const Tile empty = empty_tile<Tile>();
  const auto is_surface = plane.slope > 0.0f;
  return {is_surface ? plane.offset / plane.slope : empty.nearest,
          is_surface ? plane.slope : empty.min_slope};
}

}}  // namespace palpate::v0
