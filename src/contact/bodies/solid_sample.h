// The distance field of a body at a point, and the choice of the grid that a sphere samples. Shared
// code for host and device, for single numbers and vectors of them.
#pragma once

#include <type_traits>

#include "palpate/packing/packing.h"
#include "src/contact/field/field_element.h"
#include "src/contact/index/sphere_clusters.h"

namespace palpate { inline namespace v0 {

/// The field and its gradient; lengths in m.
template <class Real>
struct SolidGradient {
  Real phi;
  Gradient3<Real> n;
};
/// Includes the second derivatives.
template <class Real>
struct SolidCurvature {
  SolidGradient<Real> first;
  Symmetric<Real> h;
};

template <class Real>
PALPATE_FORMULA SolidGradient<Real>& first_of(SolidGradient<Real>& sample) {
  return sample;
}
template <class Real>
PALPATE_FORMULA SolidGradient<Real>& first_of(SolidCurvature<Real>& sample) {
  return sample.first;
}

/// The quadratic B-spline over three by three by three nodes at (s, t, w) in [-1/2, 1/2] spacings
/// from the middle one; `read(j, k, nodes)` gives those of a row along x.
template <class Real, class Read, class Sample>
PALPATE_FORMULA void sample_spline(Real s, Real t, Real w, Real per_spacing, const Read& read,
                                   Sample& to) {
  constexpr bool kIsCurved = std::is_same_v<Sample, SolidCurvature<Real>>;
  Curved<Real> by_y[3], by_x[3];
  [[maybe_unused]] Real by_xx[3];
  for (int k = 0; k < 3; ++k) {
    Curved<Real> row[3];
    for (int j = 0; j < 3; ++j) {
      Real nodes[3];
      read(j, k, nodes);
      row[j] = spline(nodes[0], nodes[1], nodes[2], s);
    }
    by_y[k] = spline(row[0].value, row[1].value, row[2].value, t);
    by_x[k] = spline(row[0].slope, row[1].slope, row[2].slope, t);
    if constexpr (kIsCurved) by_xx[k] = spline(row[0].bend, row[1].bend, row[2].bend, t).value;
  }
  const Curved<Real> z = spline(by_y[0].value, by_y[1].value, by_y[2].value, w);
  const Curved<Real> y = spline(by_y[0].slope, by_y[1].slope, by_y[2].slope, w);
  const Curved<Real> x = spline(by_x[0].value, by_x[1].value, by_x[2].value, w);
  first_of(to) = {z.value, {x.value * per_spacing, y.value * per_spacing, z.slope * per_spacing}};
  if constexpr (kIsCurved) {
    const Real squared = per_spacing * per_spacing;
    to.h.xx = spline(by_xx[0], by_xx[1], by_xx[2], w).value * squared;
    to.h.xy = spline(by_x[0].slope, by_x[1].slope, by_x[2].slope, w).value * squared;
    to.h.xz = x.slope * squared;
    to.h.yy = spline(by_y[0].bend, by_y[1].bend, by_y[2].bend, w).value * squared;
    to.h.yz = y.slope * squared;
    to.h.zz = z.bend * squared;
  }
}

/// A SolidField in the memory of a query's device.
struct SolidFieldView {
  const float* values = nullptr;
  std::int32_t num_levels = 0;
  float spacing = 0;  ///< of level 0, m
  float box[3] = {};  ///< upper corner of the solid's box, from its lower one, m
  std::int32_t first[SolidField::kMaxLevels] = {};  ///< node (0, 0, 0) of each level
  std::int32_t num_nodes[3][SolidField::kMaxLevels] = {};
};

/// Pose of a body's elements relative to the field of another one.
struct SolidFrame {
  float R_FE[3][3] = {};  ///< from the axes of the elements' body to those of the field's
  float p_FC[3] = {};     ///< of the center that elements are relative to, from the box's corner
  float R_WE[3][3] = {}, R_WF[3][3] = {};
};

/// The second moment of a B-spline of spacing d is d^2 / 4 along each axis, that of a ball r^2 / 5.
inline constexpr float kSpacingPerRadius = 0.8944272f;
/// Largest amount by which a B-spline of spacing 1 over distances is below the distance itself.
inline constexpr float kMaxRounding = 0.8660255f;

/// True if everything in a ball lies off the solid. `rounding`: of the widest sampled grid.
PALPATE_FORMULA bool is_clear(const SolidFieldView& field, const SolidFrame& frame,
                              const Cluster& ball, float rounding) {
  constexpr int kMargin = SolidField::kMargin;
  float p[3], outside2 = 0;
  for (int row = 0; row < 3; ++row) {
    const float(&r)[3] = frame.R_FE[row];
    p[row] = r[0] * ball.center.x + r[1] * ball.center.y + r[2] * ball.center.z + frame.p_FC[row];
    const float below = -p[row], above = p[row] - field.box[row];
    const float outside = below > above ? below : above;
    if (outside > 0) outside2 += outside * outside;
  }
  const float reach = ball.reach * 1.0001f;
  // The mean of the distance to the box, a convex function, is no less than the distance itself.
  if (!(outside2 <= reach * reach)) return true;
  // Distance from a node near the middle.
  float from_node2 = 0;
  std::int32_t at = 0;
  for (int axis = 2; axis >= 0; --axis) {
    const float place = p[axis] / field.spacing + (kMargin + 0.5f);
    const std::int32_t num = field.num_nodes[axis][0];
    if (!(place >= 0) || !(place < static_cast<float>(num))) return false;
    const auto node = static_cast<std::int32_t>(place);
    const float off = p[axis] - static_cast<float>(node - kMargin) * field.spacing;
    from_node2 += off * off;
    at = at * num + node;
  }
  const float left = field.values[at] - reach - rounding;
  return left > 0 && left * left > 1.0001f * from_node2;
}

}}  // namespace palpate::v0
