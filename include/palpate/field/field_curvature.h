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
                                                             const PixelSpot<double>& spot,
                                                             double z, double radius,
                                                             double thickness) {
  const bool is_bent = must_saturate(level, spot.pixel, z, thickness);
  const double limit = radius + static_cast<double>(level.step_limit);
  // Of each row: phi, its derivative by z, its second derivative by z.
  Curved<double> phi[3], by_z[3], by_zz[3];
  for (int q = 0; q < 3; ++q) {
    const float* pair = level.planes + 2 * (spot.pixel + (q - 1) * level.stride - 1);
    double distance[3], first[3], second[3];
    for (int p = 0; p < 3; ++p) {
      const double slope = pair[2 * p + 1];
      distance[p] = static_cast<double>(pair[2 * p]) - z * slope;
      first[p] = -slope;
      second[p] = 0;
      if (!is_bent) continue;
      const double d = distance[p];
      if (d > limit && d < 3 * limit) second[p] = -slope * slope / (2 * limit);
      if (d < -thickness && d > -2 * thickness) second[p] = slope * slope / thickness;
      const Sloped<double> plane = saturate(d, limit, thickness);
      distance[p] = plane.value;
      first[p] *= plane.slope;
    }
    phi[q] = spline(distance[0], distance[1], distance[2], spot.s);
    by_z[q] = spline(first[0], first[1], first[2], spot.s);
    by_zz[q] = spline(second[0], second[1], second[2], spot.s);
  }
  const double t = spot.t, s = level.scale;
  const Curved<double> value = spline(phi[0].value, phi[1].value, phi[2].value, t);
  const Curved<double> by_u = spline(phi[0].slope, phi[1].slope, phi[2].slope, t);
  const Curved<double> z_value = spline(by_z[0].value, by_z[1].value, by_z[2].value, t);
  ImageCurvature sum;
  sum.first = {value.value, by_u.value * s, value.slope * s, z_value.value};
  sum.uu = spline(phi[0].bend, phi[1].bend, phi[2].bend, t).value * s * s;
  sum.uv = by_u.slope * s * s;
  sum.vv = value.bend * s * s;
  sum.uz = spline(by_z[0].slope, by_z[1].slope, by_z[2].slope, t).value * s;
  sum.vz = z_value.slope * s;
  sum.zz = spline(by_zz[0].value, by_zz[1].value, by_zz[2].value, t).value;
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
      sample_level_curvature(level, spot_at(level, at.u, at.v), z, radius, thickness);
  if (choice.blend.value > 0) {
    const DepthFieldLevel& wider = field.levels[choice.level + 1];
    const ImageCurvature next =
        sample_level_curvature(wider, spot_at(wider, at.u, at.v), z, radius, thickness);
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
