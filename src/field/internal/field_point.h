// A depth field at a single point, in single or double precision, on host and device.
#pragma once

#include <cmath>

#include "src/field/internal/deep_query.h"

namespace palpate { inline namespace v0 {

/// Image of a point.
template <class Real>
struct PixelPosition {
  Real u, v;                          ///< pixels of level 0
  Real from_center_u, from_center_v;  ///< from the principal point
};
template <class Real>
PALPATE_HOSTDEV inline PixelPosition<Real> project(const Intrinsics& k, const Vec3<Real>& p_C) {
  const Real from_u = Real(k.fx) * p_C.x / p_C.z, from_v = Real(k.fy) * p_C.y / p_C.z;
  return {from_u + Real(k.cx), from_v + Real(k.cy), from_u, from_v};
}
template <class Real>
PALPATE_HOSTDEV inline bool is_place(const Vec3<Real>& p) {
  return p.x * 0 + p.y * 0 + p.z * 0 == 0;  // of infinity it is NaN, too
}
template <class Sample, class Real>
PALPATE_HOSTDEV inline Sample sample_image(const DepthFieldView& field,
                                           const PixelPosition<Real>& at, Real z, Real radius) {
  return query_deep<OneLane<Real>, Sample>(grid_of(field), pixels_of(field), at.u, at.v, z,
                                           Real(1) / z, radius);
}

/// phi for a sphere of this radius (m) at p_C, and its gradient. In front of kMinDepth, and without
/// a field: 2 radii, gradient 0. NaN where p_C is not finite (poses that are not finite never come
/// to the kernels).
template <class Real>
struct FieldSample {
  Real phi;
  Vec3<Real> gradient;
};
template <class Real>
PALPATE_HOSTDEV inline FieldSample<Real> sample_field(const DepthFieldView& field,
                                                      const Vec3<Real>& p_C, Real radius) {
  const Real z = p_C.z, none = Real(NAN);
  if (!is_place(p_C)) return {none, {none, none, none}};
  if (field.num_levels == 0 || !(z > Real(kMinDepth))) return {2 * radius, {}};
  const PixelPosition<Real> at = project(field.intrinsics, p_C);
  const auto g = sample_image<ImageGradient<Real>>(field, at, z, radius);
  const Gradient3<Real> n =
      to_space(g, at.from_center_u, at.from_center_v, 1 / z,
               static_cast<float>(field.intrinsics.fx), static_cast<float>(field.intrinsics.fy));
  return {g.phi, {n.x, n.y, n.z}};
}

/// The same with the symmetric matrix of second derivatives in space, 1/m. The field is once
/// continuously differentiable, so these jump between pixels.
struct CurvedFieldSample {
  double phi = 0;
  Vec3d gradient;
  Mat3d hessian;
};
inline CurvedFieldSample sample_field_curvature(const DepthFieldView& field, const Vec3d& p_C,
                                                double radius) {
  const double z = p_C.z, none = NAN;
  if (!is_place(p_C)) {
    return {
        none, {none, none, none}, {{{none, none, none}, {none, none, none}, {none, none, none}}}};
  }
  if (field.num_levels == 0 || !(z > static_cast<double>(kMinDepth))) return {2 * radius, {}, {}};
  const PixelPosition<double> at = project(field.intrinsics, p_C);
  const auto c = sample_image<ImageCurvature<double>>(field, at, z, radius);
  const float fx = static_cast<float>(field.intrinsics.fx);
  const float fy = static_cast<float>(field.intrinsics.fy);
  const Gradient3<double> n = to_space(c.first, at.from_center_u, at.from_center_v, 1 / z, fx, fy);
  const Symmetric<double> h =
      hessian_in_space(c, at.from_center_u, at.from_center_v, 1 / z, fx, fy);
  return {
      c.first.phi, {n.x, n.y, n.z}, {{{h.xx, h.xy, h.xz}, {h.xy, h.yy, h.yz}, {h.xz, h.yz, h.zz}}}};
}

}}  // namespace palpate::v0
