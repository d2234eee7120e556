// Second derivatives of a depth field, for contact stiffness. The field itself: field_sample.h.
#pragma once

#include "src/field/internal/field_sample.h"

namespace palpate { inline namespace v0 {

/// First and second derivatives in (u, v, z).
template <class Real>
struct ImageCurvature {
  ImageGradient<Real> first;
  Real uu, uv, vv, uz, vz, zz;
};

template <class Real>
PALPATE_FORMULA const ImageGradient<Real>& first_of(const ImageGradient<Real>& g) {
  return g;
}
template <class Real>
PALPATE_FORMULA const ImageGradient<Real>& first_of(const ImageCurvature<Real>& c) {
  return c.first;
}

/// Derivatives of the spline over three by three pixels, given row by row. Planes do not bend.
template <bool kArePlanes, class Real>
PALPATE_FORMULA ImageCurvature<Real> curvature_of(const Curved<Real> (&values)[3][3], Real s,
                                                  Real t, Real scale) {
  Curved<Real> phi[3], by_z[3], by_zz[3];
  for (int q = 0; q < 3; ++q) {
    const Curved<Real>(&row)[3] = values[q];
    phi[q] = spline(row[0].value, row[1].value, row[2].value, s);
    by_z[q] = spline(row[0].slope, row[1].slope, row[2].slope, s);
    by_zz[q] = spline(row[0].bend, row[1].bend, row[2].bend, s);
  }
  const Curved<Real> value = spline(phi[0].value, phi[1].value, phi[2].value, t);
  const Curved<Real> by_u = spline(phi[0].slope, phi[1].slope, phi[2].slope, t);
  const Curved<Real> z_value = spline(by_z[0].value, by_z[1].value, by_z[2].value, t);
  const Real squared = scale * scale;
  return {{value.value, by_u.value * scale, value.slope * scale, z_value.value},
          spline(phi[0].bend, phi[1].bend, phi[2].bend, t).value * squared,
          by_u.slope * squared,
          value.bend * squared,
          spline(by_z[0].slope, by_z[1].slope, by_z[2].slope, t).value * scale,
          z_value.slope * scale,
          kArePlanes ? Real{} : spline(by_zz[0].value, by_zz[1].value, by_zz[2].value, t).value};
}

/// `blend` of the next wider level, with its derivatives by z.
template <class Real>
PALPATE_FORMULA ImageCurvature<Real> blended(const ImageCurvature<Real>& c,
                                             const ImageCurvature<Real>& next, Real blend,
                                             Real by_z, Real by_zz) {
  const ImageGradient<Real> change{next.first.phi - c.first.phi, next.first.by_u - c.first.by_u,
                                   next.first.by_v - c.first.by_v, next.first.by_z - c.first.by_z};
  return {
      {c.first.phi + blend * change.phi, c.first.by_u + blend * change.by_u,
       c.first.by_v + blend * change.by_v, c.first.by_z + blend * change.by_z + by_z * change.phi},
      c.uu + blend * (next.uu - c.uu),
      c.uv + blend * (next.uv - c.uv),
      c.vv + blend * (next.vv - c.vv),
      c.uz + blend * (next.uz - c.uz) + by_z * change.by_u,
      c.vz + blend * (next.vz - c.vz) + by_z * change.by_v,
      c.zz + blend * (next.zz - c.zz) + 2.0f * by_z * change.by_z + by_zz * change.phi};
}

/// The six different numbers of a symmetric matrix.
template <class Real>
struct Symmetric {
  Real xx{}, xy{}, xz{}, yy{}, yz{}, zz{};
};

/// Second derivatives in space of a function of (u, v, z); see to_space.
template <class Real>
PALPATE_FORMULA Symmetric<Real> hessian_in_space(const ImageCurvature<Real>& c, Real from_center_u,
                                                 Real from_center_v, Real inverse_z, float fx,
                                                 float fy) {
  // Derivatives of u and v.
  const Real u_x = fx * inverse_z, v_y = fy * inverse_z;
  const Real u_z = -from_center_u * inverse_z, v_z = -from_center_v * inverse_z;
  return {c.uu * u_x * u_x,
          c.uv * u_x * v_y,
          u_x * (c.uu * u_z + c.uv * v_z + c.uz) - c.first.by_u * u_x * inverse_z,
          c.vv * v_y * v_y,
          v_y * (c.uv * u_z + c.vv * v_z + c.vz) - c.first.by_v * v_y * inverse_z,
          c.uu * u_z * u_z + 2.0f * c.uv * u_z * v_z + c.vv * v_z * v_z +
              2.0f * (c.uz * u_z + c.vz * v_z) + c.zz -
              2.0f * (c.first.by_u * u_z + c.first.by_v * v_z) * inverse_z};
}

/// f(c) for a function f of one number, sums and differences: what `deepened` requires.
template <class Real>
PALPATE_FORMULA ImageCurvature<Real> composed(const Curved<Real>& f,
                                              const ImageCurvature<Real>& c) {
  const ImageGradient<Real>& g = c.first;
  return {composed(f, g),
          f.slope * c.uu + f.bend * g.by_u * g.by_u,
          f.slope * c.uv + f.bend * g.by_u * g.by_v,
          f.slope * c.vv + f.bend * g.by_v * g.by_v,
          f.slope * c.uz + f.bend * g.by_u * g.by_z,
          f.slope * c.vz + f.bend * g.by_v * g.by_z,
          f.slope * c.zz + f.bend * g.by_z * g.by_z};
}
template <class Real>
PALPATE_FORMULA ImageCurvature<Real> difference(const ImageCurvature<Real>& a,
                                                const ImageCurvature<Real>& b) {
  return {difference(a.first, b.first),
          a.uu - b.uu,
          a.uv - b.uv,
          a.vv - b.vv,
          a.uz - b.uz,
          a.vz - b.vz,
          a.zz - b.zz};
}
template <class Real>
PALPATE_FORMULA ImageCurvature<Real> sum(const ImageCurvature<Real>& a,
                                         const ImageCurvature<Real>& b) {
  return {sum(a.first, b.first), a.uu + b.uu, a.uv + b.uv, a.vv + b.vv,
          a.uz + b.uz,           a.vz + b.vz, a.zz + b.zz};
}

template <class Real>
PALPATE_FORMULA ImageCurvature<Real> chosen(const auto& condition, const ImageCurvature<Real>& a,
                                            const ImageCurvature<Real>& b) {
  return {chosen(condition, a.first, b.first),
          condition ? a.uu : b.uu,
          condition ? a.uv : b.uv,
          condition ? a.vv : b.vv,
          condition ? a.uz : b.uz,
          condition ? a.vz : b.vz,
          condition ? a.zz : b.zz};
}

}}  // namespace palpate::v0
