// The value of a depth field's pixel at some depth: the distance to its tangent plane, or near a
// silhouette to free space. For single numbers and vectors, on host and device. What spheres
// sample: field_sample.h.
#pragma once

#include <type_traits>

#include "palpate/field/depth_field.h"

namespace palpate { inline namespace v0 {

/// a b + c, rounded once on a GPU, for what is small beside the depths of surfaces: so its answers
/// stay those of processors to a billionth of a meter.
template <class A, class B, class C>
PALPATE_FORMULA auto fused(const A& a, const B& b, const C& c) {
#ifdef __CUDA_ARCH__
  if constexpr (std::is_same_v<A, float> && std::is_same_v<B, float>) return fmaf(a, b, c);
#endif
  return a * b + c;
}

/// A number and its derivative.
template <class Real>
struct Sloped {
  Real value, slope;
};

/// A number with its first and second derivative.
template <class Real>
struct Curved {
  Real value, slope, bend;
};

/// Corners are rounded over this share of a pixel to each side, or over the distance of the
/// silhouette if that is less: so a pixel's value is smooth where its silhouette changes.
inline constexpr float kCorner = 0.35f;
/// max(0, x) with a parabola from 0 to 2 k, flattened by k from there on; by some variable of which
/// k is a linear function of slope `k_by`.
template <class Real>
PALPATE_FORMULA Curved<Real> corner(const Curved<Real>& x, const Real& k, const Real& k_by) {
  const Real zero{};
  const Real y = x.value / k, y_by = (x.slope - y * k_by) / k;
  const Curved<Real> bent{0.25f * k * y * y, 0.5f * y * x.slope - 0.25f * y * y * k_by,
                          0.5f * (k * y_by * y_by + y * x.bend)};
  const auto is_above = y > zero, is_beyond = y > zero + 2.0f;
  return {is_beyond ? x.value - k : (is_above ? bent.value : zero),
          is_beyond ? x.slope - k_by : (is_above ? bent.slope : zero),
          is_beyond ? x.bend : (is_above ? bent.bend : zero)};
}

/// corner(x) by x, for a width k that does not change; `per_k` is 1 / k.
template <class Real>
PALPATE_FORMULA Curved<Real> even_corner(Real x, Real k, Real per_k) {
  const Real zero{}, two = zero + 2.0f, y = x * per_k;
  const Real above = y < zero ? zero : y;
  const Real bent = above > two ? two : above;
  const auto is_bent = bent == y;
  return {k * (0.25f * bent * bent + (above - bent)), 0.5f * bent, is_bent ? 0.5f * per_k : zero};
}

/// Sums and differences.
template <class Real>
PALPATE_FORMULA Curved<Real> plus(const Curved<Real>& a, const Curved<Real>& b) {
  return {a.value + b.value, a.slope + b.slope, a.bend + b.bend};
}
template <class Real>
PALPATE_FORMULA Curved<Real> minus(const Curved<Real>& a, const Curved<Real>& b) {
  return {a.value - b.value, a.slope - b.slope, a.bend - b.bend};
}
template <class Real>
PALPATE_FORMULA Curved<Real> chosen(const auto& condition, const Curved<Real>& a,
                                    const Curved<Real>& b) {
  return {condition ? a.value : b.value, condition ? a.slope : b.slope,
          condition ? a.bend : b.bend};
}

/// The distance to a tangent plane at depth z, by z.
template <class Real>
PALPATE_FORMULA Curved<Real> plane_value(Real offset, Real slope, Real z) {
  return {offset - z * slope, -slope, Real{}};
}

/// Returns the depth below the values that with_back keeps; with_back adds 0 where it is 0 or less.
template <class Real>
PALPATE_FORMULA Real below_unbent(Real value, Real thickness) {
  const Real zero{}, most = thickness < zero ? -thickness : thickness;
  return (-most - value) + 0.25f * most;
}

/// Depth that grows down to -thickness and shrinks from there on towards the back: |x + thickness|
/// - thickness, rounded. A negative thickness limits it: max(x, thickness).
template <class Real>
PALPATE_FORMULA Curved<Real> with_back(const Curved<Real>& x, Real thickness) {
  const Real zero{}, one = zero + 1.0f;
  const auto is_fading = thickness < zero;
  const Real most = is_fading ? -thickness : thickness, share = is_fading ? one : one + one;
  const Curved<Real> behind =
      corner<Real>({below_unbent(x.value, thickness), -x.slope, -x.bend}, 0.25f * most, Real{});
  return {x.value + share * behind.value, x.slope + share * behind.slope,
          x.bend + share * behind.bend};
}

/// A pixel's value next to a silhouette: `own` is that of its own surface, `other` of the other
/// one, at depth z where corners are rounded over z widest_by at most.
template <class Real>
PALPATE_FORMULA Curved<Real> clamped_at_silhouette(const Curved<Real>& own,
                                                   const Curved<Real>& other, Real side, Real z,
                                                   Real widest_by) {
  const Real zero{};
  const auto is_near = side < zero;
  const auto has_any = is_near | (side > zero);
  const Real away = is_near ? -side : side;
  const auto is_close = has_any & (away < widest_by);
  const Real k_by = is_close ? away : widest_by, k = z * k_by;
  // The other one counts as far as it lies on the right side of the own one.
  const Curved<Real> apart = minus(other, own);
  const Curved<Real> gap = corner(
      chosen(is_near, apart, Curved<Real>{-apart.value, -apart.slope, -apart.bend}), k, k_by);
  const Curved<Real> near = chosen(is_near, own, minus(own, gap)), far = plus(near, gap);
  const Curved<Real> wall{side * z + k, side + k_by, zero};
  const Curved<Real> value =
      minus(plus(near, corner(minus(wall, near), k, k_by)), corner(minus(wall, far), k, k_by));
  return chosen(has_any, value, own);
}

}}  // namespace palpate::v0
