// The algebra behind the normals: moments of a pixel window, their covariance, and the plane that
// fits it best. Shared code for vectors and for single numbers (lanes.h).
//
// Moments are taken in pixel units around the center pixel p, not in meters: with
// e = (du z_q, dv z_q, z_q - z_p), neighbor q is
//   q - p = M e,   M = [1/fx 0 a_x; 0 1/fy a_y; 0 0 1],   a = ((u - cx) / fx, (v - cy) / fy, 1),
// where a is the ray of p. So the covariance of the points is C = M E M^T with that of the e's. All
// terms stay small and single precision suffices at any distance.
#pragma once

#include "src/core/internal/lanes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// Smallest determinant of the spread in the image, relative to the spread itself: below it the
/// points are on one line.
inline constexpr float kMinSpread = 1e-5f;

/// Sums over a window of some value times 1, du, dv, du^2, du dv, dv^2.
struct Moments {
  VecF s, u, v, uu, uv, vv;
};

/// The same over one row of it.
struct RowMoments {
  VecF s, u, uu;
};

/// Moments of the weight w, of w t and of w t^2, where t = z - reference (per lane).
struct WindowSums {
  Moments w, t, tt;
  VecF reference;
};

struct Vector {
  VecF x, y, z;
};

struct SymmetricMatrix {
  VecF xx, xy, xz, yy, yz, zz;
};

PALPATE_HOSTDEV inline Vector operator*(const SymmetricMatrix& c, const Vector& v) {
  return {c.xx * v.x + c.xy * v.y + c.xz * v.z, c.xy * v.x + c.yy * v.y + c.yz * v.z,
          c.xz * v.x + c.yz * v.y + c.zz * v.z};
}

PALPATE_HOSTDEV inline SymmetricMatrix blend(Mask mask, const SymmetricMatrix& a,
                                             const SymmetricMatrix& b) {
  return {select(mask, a.xx, b.xx), select(mask, a.xy, b.xy), select(mask, a.xz, b.xz),
          select(mask, a.yy, b.yy), select(mask, a.yz, b.yz), select(mask, a.zz, b.zz)};
}

/// Transform from pixel units to camera axes at one pixel.
struct PixelFrame {
  VecF ray_x, ray_y;       ///< ray = (ray_x, ray_y, 1)
  float pixel_x, pixel_y;  ///< 1 / fx, 1 / fy
};

/// A vector in units (pixel z, pixel z, z) in camera axes.
PALPATE_HOSTDEV inline Vector to_camera(const Vector& d, const PixelFrame& frame) {
  return {d.x * frame.pixel_x + d.z * frame.ray_x, d.y * frame.pixel_y + d.z * frame.ray_y, d.z};
}

PALPATE_HOSTDEV inline Vector mean_of(const WindowSums& sums) {
  const VecF r = sums.reference;
  const VecF inverse = 1.0f / sums.w.s;
  return {(r * sums.w.u + sums.t.u) * inverse, (r * sums.w.v + sums.t.v) * inverse,
          sums.t.s * inverse};
}

/// E about `center`, the mean or zero (zero is p if the reference is the depth of p).
PALPATE_HOSTDEV inline SymmetricMatrix covariance(const WindowSums& sums, const Vector& center) {
  const VecF r = sums.reference;
  const VecF inverse = 1.0f / sums.w.s;
  return {(r * (r * sums.w.uu + 2.0f * sums.t.uu) + sums.tt.uu) * inverse - center.x * center.x,
          (r * (r * sums.w.uv + 2.0f * sums.t.uv) + sums.tt.uv) * inverse - center.x * center.y,
          (r * sums.t.u + sums.tt.u) * inverse - center.x * center.z,
          (r * (r * sums.w.vv + 2.0f * sums.t.vv) + sums.tt.vv) * inverse - center.y * center.y,
          (r * sums.t.v + sums.tt.v) * inverse - center.y * center.z,
          sums.tt.s * inverse - center.z * center.z};
}

/// C = M E M^T.
PALPATE_HOSTDEV inline SymmetricMatrix to_camera(const SymmetricMatrix& e,
                                                 const PixelFrame& frame) {
  const VecF a = frame.ray_x, b = frame.ray_y;
  const VecF scaled_xz = e.xz * frame.pixel_x, scaled_yz = e.yz * frame.pixel_y;
  const VecF camera_xz = scaled_xz + a * e.zz, camera_yz = scaled_yz + b * e.zz;
  return {e.xx * (frame.pixel_x * frame.pixel_x) + a * (scaled_xz + camera_xz),
          e.xy * (frame.pixel_x * frame.pixel_y) + a * scaled_yz + b * camera_xz,
          camera_xz,
          e.yy * (frame.pixel_y * frame.pixel_y) + b * (scaled_yz + camera_yz),
          camera_yz,
          e.zz};
}

PALPATE_HOSTDEV inline SymmetricMatrix operator*(VecF s, const SymmetricMatrix& c) {
  return {s * c.xx, s * c.xy, s * c.xz, s * c.yy, s * c.yz, s * c.zz};
}

/// Brings the trace near 1, so that products of elements neither vanish nor overflow.
PALPATE_HOSTDEV inline SymmetricMatrix with_unit_trace(const SymmetricMatrix& c) {
  return scale_to_unit(c.xx + c.yy + c.zz) * c;
}

/// The plane if only the distance along the ray is noisy, as a depth camera's is: its normal
/// minimizes n^T C n subject to n.a = 1, which is n ~ C^-1 a ~ adj(C) a. As a = M (0, 0, 1), that
/// is M^-T times the last column of adj(E): three minors. E itself is not inverted, so points
/// without noise, whose E is singular, do no harm. The last minor is n.a, positive unless the
/// points are on one line of the image: then the result is zero.
PALPATE_HOSTDEV inline Vector normal_along_ray(const SymmetricMatrix& e, const PixelFrame& frame) {
  const SymmetricMatrix c = scale_to_unit(e.xx + e.yy) * e;
  const VecF minor_z = c.xx * c.yy - c.xy * c.xy;
  const VecF x = (c.xy * c.yz - c.xz * c.yy) * frame.pixel_y;
  const VecF y = (c.xy * c.xz - c.xx * c.yz) * frame.pixel_x;
  const VecF z = minor_z * (frame.pixel_x * frame.pixel_y) - (frame.ray_x * x + frame.ray_y * y);
  const Mask valid = minor_z > kMinSpread;
  const VecF zero = splat(0.0f);
  return {select(valid, x, zero), select(valid, y, zero), select(valid, z, zero)};
}

/// The plane if all coordinates are equally noisy (eq. 3.7): an eigenvector of the smallest
/// eigenvalue (any length, zero if there is none). The eigenvalue is the smallest root of the
/// characteristic polynomial x^3 - c2 x^2 + c1 x - c0, whose roots are all real and not negative:
/// one step of Laguerre's method from 0, which has a short form there, and one of Newton's come
/// close and never pass it. The adjugate of C - x 1 is then near to a multiple of n n^T; applied
/// three times, what the steps left is cubed away.
PALPATE_FORMULA Vector smallest_eigenvector(SymmetricMatrix c) {
  c = with_unit_trace(c);
  const VecF minor_x = c.yy * c.zz - c.yz * c.yz;
  const VecF minor_y = c.xx * c.zz - c.xz * c.xz;
  const VecF minor_z = c.xx * c.yy - c.xy * c.xy;
  const VecF c2 = c.xx + c.yy + c.zz;
  const VecF c1 = minor_x + minor_y + minor_z;
  const VecF c0 =
      c.xx * minor_x + c.xy * (c.xz * c.yz - c.xy * c.zz) + c.xz * (c.xy * c.yz - c.xz * c.yy);
  const VecF zero = splat(0.0f);
  const VecF root = sqrt(max(4.0f * (c1 * c1) - 12.0f * (c0 * c2), zero));
  VecF x = max(3.0f * c0 / (c1 + root), zero);
  const VecF slope = (3.0f * x - 2.0f * c2) * x + c1;
  x -= select(slope > 0.0f, (((x - c2) * x + c1) * x - c0) / slope, zero);
  c.xx -= x;
  c.yy -= x;
  c.zz -= x;

  const SymmetricMatrix adjugate = with_unit_trace(
      {c.yy * c.zz - c.yz * c.yz, c.xz * c.yz - c.xy * c.zz, c.xy * c.yz - c.xz * c.yy,
       c.xx * c.zz - c.xz * c.xz, c.xy * c.xz - c.xx * c.yz, c.xx * c.yy - c.xy * c.xy});
  // Its longest column is the one with the largest diagonal element.
  const Mask y_beats_x = adjugate.yy > adjugate.xx;
  const Mask z_beats_both = adjugate.zz > max(adjugate.xx, adjugate.yy);
  Vector n{select(y_beats_x, adjugate.xy, adjugate.xx), select(y_beats_x, adjugate.yy, adjugate.xy),
           select(y_beats_x, adjugate.yz, adjugate.xz)};
  n = {select(z_beats_both, adjugate.xz, n.x), select(z_beats_both, adjugate.yz, n.y),
       select(z_beats_both, adjugate.zz, n.z)};
  return adjugate * (adjugate * n);
}

struct UnitNormal {
  Vector n;
  Mask exists;
};

/// The normal of the fitted plane, towards the camera (eq. 3.8). `along_ray` as PlaneFit.
PALPATE_FORMULA UnitNormal unit_normal(const SymmetricMatrix& e, const PixelFrame& frame,
                                       bool along_ray) {
  const Vector n =
      along_ray ? normal_along_ray(e, frame) : smallest_eigenvector(to_camera(e, frame));
  const VecF squared = n.x * n.x + n.y * n.y + n.z * n.z;
  const VecF from_camera = n.x * frame.ray_x + n.y * frame.ray_y + n.z;
  const VecF inverse = 1.0f / sqrt(squared);
  const VecF scale = select(from_camera > 0.0f, -inverse, inverse);
  return {{n.x * scale, n.y * scale, n.z * scale}, squared > 0.0f};
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
