// The value and gradient of a depth field at a point: the formulas, shared by host and device, for
// single numbers and for vectors of numbers. Their steps: field_sampler.h.
//
// Each pixel has a value at depth z: near one smooth surface the distance from its ray at that
// depth to its tangent plane. The field at p = (x, y, z) in the camera frame is a quadratic
// B-spline over the image, at the pixel (u, v) where p is seen, of these values:
//
//   phi(p) = sum_ij B(u - i) B(v - j) value_ij(z),   value_ij(z) = offset_ij - z slope_ij
//
// It is exact for a plane: 1 / depth is linear over the image, and so is the slope.
//
// Near a silhouette, where one surface ends in front of another, a pixel's value is the distance to
// free space: out of the front of the near surface, or sideways out of its shadow, or, where the
// far surface is less deep, out of that one. With the signed distance to the side wall of the
// shadow,
//
//   value = clamp(side, near, far),
//
// rounded at both corners. Every weight in it is between 0 and 1, so its gradient is never longer
// than those of its parts.
//
// A sphere of radius r covers r f / z pixels and samples a level whose pixels are about as wide as
// itself (a B-spline then weighs the surface as a disc of radius r would); between two levels both
// are blended, and the blend is part of the gradient. Deep spheres also sample wider pixels, which
// see exits that are farther away and smooth out noise: the field there is the maximum of the
// values for spheres of radius r, 4 r, 16 r, ... phi is once continuously differentiable in p, so
// forces are continuous.
#pragma once

#include "src/field/internal/field_values.h"

namespace palpate { inline namespace v0 {

/// The quadratic B-spline over three neighbors, at t in [-1/2, 1/2] from the middle one.
template <class Value, class Real>
PALPATE_FORMULA Curved<Value> spline(const Value& left, const Value& middle, const Value& right,
                                     Real t) {
  const Value from_left = left - middle, from_right = right - middle;
  const Real a = 0.5f - t, b = 0.5f + t;
  const Real half_aa = 0.5f * a * a, half_bb = 0.5f * b * b;
  return {fused(from_right, half_bb, fused(from_left, half_aa, middle)),
          fused(from_right, b, -(from_left * a)), from_left + from_right};
}

/// Width of the sampled pixel over the radius of the sphere. With 0.87 the B-spline has the second
/// moment of a disc of that radius; less follows creases better and still averages noise.
inline constexpr float kFootprint = 0.7f;
/// A footprint between 1 and kBlendEnd pixels of a level is answered from it and the next one.
inline constexpr float kBlendEnd = 1.25f;
/// Depth in front of which nothing counts as behind a surface, m.
inline constexpr float kMinDepth = 0.02f;

/// In footprints: depth from which on wider pixels are sampled too, and the rounding of that limit.
inline constexpr float kDeep = 2.0f, kDeepCorner = 0.4f;
/// Share by which finer pixels overstate a depth beyond kDeep, so that wider ones decide where both
/// know the same exit.
inline constexpr float kSteepening = 0.05f;
/// The spheres that sample what lies deep: growth of their radii, and how many at most.
inline constexpr float kDeepGrowth = 4.0f;
inline constexpr int kMaxDeepSteps = 5;

/// 0 for x <= 0, 1 for x >= 1, a cubic between, and its derivative.
template <class Real>
PALPATE_FORMULA Sloped<Real> smooth_step(Real x) {
  x = x < Real{} ? Real{} : x;
  x = x > Real{} + 1.0f ? Real{} + 1.0f : x;
  return {x * x * (3.0f - 2.0f * x), 6.0f * x * (1.0f - x)};
}

/// phi by image coordinates (pixels of level 0) and depth.
template <class Real>
struct ImageGradient {
  Real phi, by_u, by_v, by_z;
};

/// The gradient in space of a function of (u, v, z), u = fx x / z + cx, v = fy y / z + cy.
template <class Real>
struct Gradient3 {
  Real x, y, z;
};
template <class Real>
PALPATE_FORMULA Gradient3<Real> to_space(const ImageGradient<Real>& g, Real from_center_u,
                                         Real from_center_v, Real inverse_z, float fx, float fy) {
  return {g.by_u * fx * inverse_z, g.by_v * fy * inverse_z,
          g.by_z - (g.by_u * from_center_u + g.by_v * from_center_v) * inverse_z};
}

/// The B-spline of the values of nine pixels.
template <class Real>
PALPATE_FORMULA ImageGradient<Real> gradient_of(const Curved<Real> (&values)[3][3], Real s, Real t,
                                                Real scale) {
  Curved<Real> rows[3], row_slopes[3];
  for (int q = 0; q < 3; ++q) {
    const Curved<Real>(&row)[3] = values[q];
    rows[q] = spline(row[0].value, row[1].value, row[2].value, s);
    row_slopes[q] = spline(row[0].slope, row[1].slope, row[2].slope, s);
  }
  const Curved<Real> phi = spline(rows[0].value, rows[1].value, rows[2].value, t);
  return {phi.value, spline(rows[0].slope, rows[1].slope, rows[2].slope, t).value * scale,
          phi.slope * scale,
          spline(row_slopes[0].value, row_slopes[1].value, row_slopes[2].value, t).value};
}

/// f(g) for a function f of one number.
template <class Real>
PALPATE_FORMULA ImageGradient<Real> composed(const Curved<Real>& f, const ImageGradient<Real>& g) {
  return {f.value, f.slope * g.by_u, f.slope * g.by_v, f.slope * g.by_z};
}
template <class Real>
PALPATE_FORMULA ImageGradient<Real> difference(const ImageGradient<Real>& a,
                                               const ImageGradient<Real>& b) {
  return {a.phi - b.phi, a.by_u - b.by_u, a.by_v - b.by_v, a.by_z - b.by_z};
}
template <class Real>
PALPATE_FORMULA ImageGradient<Real> sum(const ImageGradient<Real>& a,
                                        const ImageGradient<Real>& b) {
  return {a.phi + b.phi, a.by_u + b.by_u, a.by_v + b.by_v, a.by_z + b.by_z};
}

template <class Real>
PALPATE_FORMULA ImageGradient<Real> chosen(const auto& condition, const ImageGradient<Real>& a,
                                           const ImageGradient<Real>& b) {
  return {condition ? a.phi : b.phi, condition ? a.by_u : b.by_u, condition ? a.by_v : b.by_v,
          condition ? a.by_z : b.by_z};
}

/// Depth from which on a sphere also samples wider pixels.
template <class Real>
PALPATE_FORMULA Real deep_limit(Real radius) {
  return (kDeep - kDeepCorner) * kFootprint * radius;
}

/// Depth of the maximum of `deepened` beyond -depth where fine and wide pixels agree on `depth`:
/// the gain by steepening less the corner of the maximum, with derivatives by the depth of the
/// maximum; a cubic, off by less than a thousandth of the depth.
template <class Real>
PALPATE_FORMULA Curved<Real> deep_excess(Real depth, Real footprint, Real per_footprint) {
  constexpr float kEnd = 2.0f * kDeepCorner / kSteepening + kDeepCorner;  // from there on constant
  constexpr float kGrowth = kSteepening / (1.0f + kSteepening);           // at the beginning
  constexpr float kBulge = 6.0f * kDeepCorner / (kGrowth * kEnd) - 3.0f;
  const Real zero{}, one = zero + 1.0f, per_end = per_footprint * (1.0f / kEnd);
  const Curved<Real> e = even_corner(depth - kDeep * footprint, 0.5f * kDeep * footprint,
                                     per_footprint * (2.0f / kDeep));
  const Real y = e.value * per_end, s = y > one ? one : y;
  const Real left = one - s, bulge = one + kBulge * s, growth = kGrowth * left * bulge;
  const Real bend = e.slope * e.slope * per_end * kGrowth * (kBulge * left - bulge);
  const auto is_bent = s == y;
  return {kGrowth * kEnd * footprint * s * (one - 0.5f * s + kBulge * s * (0.5f - (1.0f / 3) * s)),
          growth * e.slope, growth * e.bend + (is_bent ? bend : zero)};
}

/// Value for a sphere of this radius, and for the next wider one: the maximum of both, where the
/// wider one only counts deeper than kDeep footprints, stretched to return the common value where
/// they agree. `AnySample` is an ImageGradient or an ImageCurvature.
template <class AnySample, class Real>
PALPATE_FORMULA AnySample deepened(const AnySample& fine, const AnySample& wide, Real fine_phi,
                                   Real wide_phi, Real radius) {
  const Real zero{}, one = zero + 1.0f, footprint = kFootprint * radius;
  const Real depth = kDeep * footprint, k = kDeepCorner * footprint;
  const Real per_footprint = one / footprint;
  // Finer pixels: fine - kSteepening corner(-fine - depth)
  const Curved<Real> e =
      even_corner(-fine_phi - depth, 0.5f * depth, per_footprint * (2.0f / kDeep));
  const Real per_k = per_footprint * (1.0f / kDeepCorner);
  const Real steep_phi = fine_phi - kSteepening * e.value;
  const AnySample steep =
      composed<Real>({steep_phi, one + kSteepening * e.slope, -kSteepening * e.bend}, fine);
  // Wider ones: min(wide, -depth), rounded above -depth
  const Curved<Real> c = even_corner(-wide_phi - depth + 2.0f * k, k, per_k);
  const Real capped_phi = k - depth - c.value;
  const AnySample capped = composed<Real>({capped_phi, c.slope, -c.bend}, wide);
  const Curved<Real> m = even_corner(capped_phi - steep_phi, k, per_k);
  const AnySample most = sum(steep, composed<Real>(m, difference(capped, steep)));
  const Real depth_of_max = -steep_phi - m.value;
  const Curved<Real> excess = deep_excess(depth_of_max, footprint, per_footprint);
  return composed<Real>({excess.value - depth_of_max, one - excess.slope, excess.bend}, most);
}

/// `blend` of the next wider level; it changes with z by `by_z`.
template <class Real>
PALPATE_FORMULA ImageGradient<Real> mixed(const ImageGradient<Real>& g,
                                          const ImageGradient<Real>& next, Real blend, Real by_z) {
  const Real change = next.phi - g.phi;
  return {fused(blend, change, g.phi), fused(blend, next.by_u - g.by_u, g.by_u),
          fused(blend, next.by_v - g.by_v, g.by_v),
          fused(change, by_z, fused(blend, next.by_z - g.by_z, g.by_z))};
}

}}  // namespace palpate::v0
