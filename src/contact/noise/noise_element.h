// Numbers that an element tells of its noise (noise_rows.h), from its place in the camera that
// decides it and its cut. Shared by host and device, for single numbers and vectors of them.
#pragma once

#include "src/contact/field/field_bound.h"
#include "src/contact/internal/ball_cut.h"
#include "src/contact/noise/noise_rows.h"

namespace palpate { inline namespace v0 {

/// Distance from the principal point, in pixels, at which elements count that are farther off.
inline constexpr float kFarOff = 1e6f;

/// Places of elements in the camera that decides them.
template <class Real>
struct NoisePlaceOf {
  Real u, v, inverse_depth, footprint;
  Real ray[3];  ///< from the eye, with a depth of 1, in W
  Real camera;
};

/// Returns them in a camera whose frame has the rotation R_WC; `from_u`, `from_v`: pixels from the
/// principal point.
template <class Real>
PALPATE_FORMULA NoisePlaceOf<Real> noise_place(const FieldFrame& frame, Real from_u, Real from_v,
                                               Real inverse_depth, Real radius,
                                               const float (&R_WC)[3][3], int camera) {
  const auto limited = [](Real pixels) {
    const Real most = Real{} + kFarOff;
    pixels = pixels > -most ? pixels : -most;  // NaN: far off
    return pixels < most ? pixels : most;
  };
  NoisePlaceOf<Real> at;
  at.u = limited(from_u) + frame.cx;
  at.v = limited(from_v) + frame.cy;
  at.inverse_depth = inverse_depth;
  at.footprint = kFootprint * radius * frame.fx * inverse_depth;
  const Real x = from_u * (1.0f / frame.fx), y = from_v * (1.0f / frame.fy);
  for (int axis = 0; axis < 3; ++axis) {
    at.ray[axis] = R_WC[axis][0] * x + R_WC[axis][1] * y + R_WC[axis][2];
  }
  at.camera = Real{} + static_cast<float>(camera);
  return at;
}

/// Writes what a unit of volume at a lever does: to the volume, the force and the torque.
template <class Real>
PALPATE_FORMULA void set_changes(const Gradient3<Real>& l, const Gradient3<Real>& n,
                                 Real (&change)[kNumChanges]) {
  const Real changes[kNumChanges] = {
      Real{} + 1.0f,        n.x, n.y, n.z, l.y * n.z - l.z * n.y, l.z * n.x - l.x * n.z,
      l.x * n.y - l.y * n.x};
  for (int k = 0; k < kNumChanges; ++k) change[k] = changes[k];
}

/// Calls put(row, number) for all numbers of elements, in the order of their rows; `by_field`: what
/// the field takes off volume, force and torque.
template <class Real, class Put>
PALPATE_FORMULA void put_numbers(const NoisePlaceOf<Real>& at, const Gradient3<Real>& l,
                                 const Gradient3<Real>& n, Real volume,
                                 const Real (&by_field)[kNumChanges], const Put& put) {
  // Change of the field by the depth of the surface.
  const Real slope = -(n.x * at.ray[0] + n.y * at.ray[1] + n.z * at.ray[2]);
  put(0, at.u);
  put(1, at.v);
  put(2, at.inverse_depth);
  put(3, at.footprint);
  put(4, volume * slope);
  put(5, n.x);
  put(6, n.y);
  put(7, n.z);
  put(8, l.x);
  put(9, l.y);
  put(10, l.z);
  put(11, at.camera);
  constexpr int kFirst = static_cast<int>(NoiseRow::change);
  static_assert(kFirst == 12);
  for (int k = 0; k < kNumChanges; ++k) put(kFirst + k, -slope * by_field[k]);
}

/// Writes what the values of a ball's parts take off its volume, force and torque: each cuts its
/// own disc, and by the plane of all of them those of the others. `changes`: of force and torque by
/// a unit of volume; `scale`: what the ball counts, times its radius squared.
template <class Row, class Real, class Sum>
PALPATE_FORMULA void set_ball_changes(const BallPlane<Row, Real>& plane, Real scale,
                                      const Row (&weights)[5], const Row& is_part,
                                      const Row (&changes)[6], const Row& discs, const Sum& sum,
                                      Row (&by_field)[kNumChanges]) {
  for (int k = 0; k < kNumChanges; ++k) {
    by_field[k] = k == 0 ? discs : discs * changes[k - 1];
    if (!plane.is_plane) continue;
    Real X[5];
    for (int i = 0; i < 5; ++i) {
      X[i] = scale * sum(weights[i] * (k == 0 ? is_part : changes[k - 1]));
    }
    for (int i = 0; i < 5; ++i) {
      Real moment{};
      for (int j = 0; j < 5; ++j) moment += plane.form[i][j] * X[j];
      by_field[k] = by_field[k] + weights[i] * moment;
    }
  }
}

}}  // namespace palpate::v0
