// Second derivatives of a depth field, for contact stiffness. The field itself: field_sample.h.
#pragma once

#include "palpate/field/field_sample.h"

namespace palpate {

/// A field sample and the symmetric matrix of its second derivatives in space, 1/m. The field is
/// once continuously differentiable, so these jump between pixels.
struct CurvedFieldSample {
  double phi = 0;
  Vec3d gradient;
  Mat3d hessian;
};

/// First and second derivatives in (u, v, z).
struct ImageCurvature {
  ImageGradient<double> first{};
  double uu = 0, uv = 0, vv = 0, uz = 0, vz = 0, zz = 0;
};

/// As sample_level, with second derivatives.
PALPATE_HOSTDEV inline ImageCurvature sample_level_curvature(const DepthFieldLevel& level,
                                                             const PixelWeights<double>& weights,
                                                             double z, double radius,
                                                             double thickness) {
  const bool is_bent = must_saturate(level, weights.pixel, z, thickness);
  const double limit = radius + static_cast<double>(level.step_limit);
  ImageCurvature sum;
  for (int q = 0; q < 3; ++q) {
    for (int p = 0; p < 3; ++p) {
      const int k = weights.pixel + (q - 1) * level.stride + p - 1;
      const double slope = level.planes[2 * k + 1];
      const double distance = static_cast<double>(level.planes[2 * k]) - z * slope;
      Sloped<double> plane{distance, 1};
      double bend = 0;
      if (is_bent) {
        plane = saturate(distance, limit, thickness);
        if (distance > limit && distance < 3 * limit) bend = -1 / (2 * limit);
        if (distance < -thickness && distance > -2 * thickness) bend = 1 / thickness;
      }
      const double wu = weights.u[p], du = weights.by_u[p];
      const double wv = weights.v[q], dv = weights.by_v[q];
      const double duu = 2 * static_cast<double>(kSplineC[p]);
      const double dvv = 2 * static_cast<double>(kSplineC[q]);
      const double by_z = -plane.slope * slope;
      sum.first.phi += wu * wv * plane.value;
      sum.first.by_u += du * wv * plane.value;
      sum.first.by_v += wu * dv * plane.value;
      sum.first.by_z += wu * wv * by_z;
      sum.uu += duu * wv * plane.value;
      sum.uv += du * dv * plane.value;
      sum.vv += wu * dvv * plane.value;
      sum.uz += du * wv * by_z;
      sum.vz += wu * dv * by_z;
      sum.zz += wu * wv * bend * slope * slope;
    }
  }
  const double s = level.scale;
  sum.first.by_u *= s;
  sum.first.by_v *= s;
  sum.uu *= s * s;
  sum.uv *= s * s;
  sum.vv *= s * s;
  sum.uz *= s;
  sum.vz *= s;
  return sum;
}

/// As sample_field, with second derivatives.
PALPATE_HOSTDEV inline CurvedFieldSample sample_field_curvature(const DepthFieldView& field,
                                                                const Vec3d& p_C, double radius) {
  const double z = p_C.z;
  if (!(z > static_cast<double>(kLeastDepth))) return {2 * radius, {}, {}};
  const PixelPosition<double> at = project(field.intrinsics, p_C);
  const LevelChoice<double> choice = choose_level(field, radius, z);
  const DepthFieldLevel& level = field.levels[choice.level];
  const double thickness = field.thickness;
  ImageCurvature c =
      sample_level_curvature(level, weights_at(level, at.u, at.v), z, radius, thickness);
  if (choice.blend.value > 0) {
    const DepthFieldLevel& wider = field.levels[choice.level + 1];
    const ImageCurvature next =
        sample_level_curvature(wider, weights_at(wider, at.u, at.v), z, radius, thickness);
    const double b = choice.blend.value, by_z = choice.blend.slope;
    const auto mix = [b](double from, double to) { return from + b * (to - from); };
    const ImageGradient<double> change{next.first.phi - c.first.phi, next.first.by_u - c.first.by_u,
                                       next.first.by_v - c.first.by_v,
                                       next.first.by_z - c.first.by_z};
    c.uu = mix(c.uu, next.uu);
    c.uv = mix(c.uv, next.uv);
    c.vv = mix(c.vv, next.vv);
    c.uz = mix(c.uz, next.uz) + by_z * change.by_u;
    c.vz = mix(c.vz, next.vz) + by_z * change.by_v;
    c.zz = mix(c.zz, next.zz) + 2 * by_z * change.by_z + choice.blend_by_zz * change.phi;
    c.first = {c.first.phi + b * change.phi, c.first.by_u + b * change.by_u,
               c.first.by_v + b * change.by_v, c.first.by_z + b * change.by_z + by_z * change.phi};
  }
  const double fx = field.intrinsics.fx, fy = field.intrinsics.fy;
  const Gradient3<double> n = to_space(c.first, at.from_centre_u, at.from_centre_v, 1 / z,
                                       static_cast<float>(fx), static_cast<float>(fy));
  // Derivatives of u and v.
  const double u_x = fx / z, v_y = fy / z, u_z = -at.from_centre_u / z, v_z = -at.from_centre_v / z;
  const double xx = c.uu * u_x * u_x, xy = c.uv * u_x * v_y, yy = c.vv * v_y * v_y;
  const double xz = u_x * (c.uu * u_z + c.uv * v_z + c.uz) - c.first.by_u * u_x / z;
  const double yz = v_y * (c.uv * u_z + c.vv * v_z + c.vz) - c.first.by_v * v_y / z;
  const double zz = c.uu * u_z * u_z + 2 * c.uv * u_z * v_z + c.vv * v_z * v_z +
                    2 * (c.uz * u_z + c.vz * v_z) + c.zz -
                    2 * (c.first.by_u * u_z + c.first.by_v * v_z) / z;
  return {c.first.phi, {n.x, n.y, n.z}, {{{xx, xy, xz}, {xy, yy, yz}, {xz, yz, zz}}}};
}

}  // namespace palpate
