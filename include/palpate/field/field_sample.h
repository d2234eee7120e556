// The value and gradient of a depth field at a point: one text for host and device, for single
// numbers and for vectors of numbers.
//
// The field at p = (x, y, z) in the camera frame is a quadratic B-spline over the image, at the
// pixel (u, v) where p is seen, of the distances of p's depth z to the tangent planes of the
// pixels:
//
//   phi(p) = sum_ij B(u - i) B(v - j) (offset_ij - z slope_ij)
//
// It is exact for a plane: 1 / depth is linear over the image, and so is the slope. Where one
// surface ends and another goes on behind it, each term is saturated first: no pixel says more than
// "well in front", and the field falls over the width of a sphere and not by the depth of the room.
// phi is once continuously differentiable in p, so forces are continuous.
//
// A sphere of radius r covers r f / z pixels and asks a level whose pixels are about as wide as
// itself (a B-spline then weighs the surface as a disc of radius r would); between two levels both
// are blended, and the blend is part of the gradient.
#pragma once

#include <cmath>
#include <cstring>

#include "palpate/field/depth_field.h"

namespace palpate {

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

/// The quadratic B-spline over three neighbours, at t in [-1/2, 1/2] from the middle one.
template <class Value, class Real>
PALPATE_FORMULA Curved<Value> spline(const Value& left, const Value& middle, const Value& right,
                                     Real t) {
  const Value from_left = left - middle, from_right = right - middle;
  const Real a = 0.5f - t, b = 0.5f + t;
  const Real half_aa = 0.5f * a * a, half_bb = 0.5f * b * b;
  return {middle + from_left * half_aa + from_right * half_bb, from_right * b - from_left * a,
          from_left + from_right};
}

/// Width of the wanted pixel over the radius of the sphere. With 0.87 the B-spline has the second
/// moment of a disc of that radius; less follows creases better and still averages noise.
inline constexpr float kFootprint = 0.7f;
/// A footprint between 1 and kBlendEnd pixels of a level is answered from it and the next one.
inline constexpr float kBlendEnd = 1.25f;
/// Nothing nearer to the camera than this is behind a surface, metres.
inline constexpr float kLeastDepth = 0.02f;

/// The distance itself from -thickness to `limit`. Beyond the limit a parabola up to 2 limits, flat
/// from 3 limits on; behind the thickness one down to -1.5 thicknesses, flat from 2 thicknesses on.
template <class Real>
PALPATE_FORMULA Sloped<Real> saturate(Real distance, Real limit, Real thickness) {
  const Real two = limit + limit;
  Real y = distance - limit;
  y = y < Real{} ? Real{} : y;
  y = y > two ? two : y;
  Real x = -thickness - distance;
  x = x < Real{} ? Real{} : x;
  x = x > thickness ? thickness : x;
  Real middle = distance < limit ? distance : limit;
  middle = middle < -thickness ? -thickness : middle;
  const Real bend_y = y / two, bend_x = x / thickness;
  return {middle + y * (1.0f - 0.5f * bend_y) - x * (1.0f - 0.5f * bend_x), 1.0f - bend_y - bend_x};
}

/// How much of the volume at a value of the field counts: 1 down to -thickness, 0 where the field
/// is flat.
template <class Real>
PALPATE_FORMULA Real fade(Real phi, Real thickness) {
  Real share = 3.0f + 2.0f * phi / thickness;
  share = share < Real{} ? Real{} : share;
  return share > Real{} + 1.0f ? Real{} + 1.0f : share;
}

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
PALPATE_FORMULA Gradient3<Real> to_space(const ImageGradient<Real>& g, Real from_centre_u,
                                         Real from_centre_v, Real inverse_z, float fx, float fy) {
  return {g.by_u * fx * inverse_z, g.by_v * fy * inverse_z,
          g.by_z - (g.by_u * from_centre_u + g.by_v * from_centre_v) * inverse_z};
}

/// Where a point is seen.
template <class Real>
struct PixelPosition {
  Real u, v;                          ///< pixels of level 0
  Real from_centre_u, from_centre_v;  ///< from the principal point
};
template <class Real>
PALPATE_HOSTDEV inline PixelPosition<Real> project(const Intrinsics& k, const Vec3<Real>& p_C) {
  const Real from_u = Real(k.fx) * p_C.x / p_C.z, from_v = Real(k.fy) * p_C.y / p_C.z;
  return {from_u + Real(k.cx), from_v + Real(k.cy), from_u, from_v};
}

/// Which level a sphere asks, and how much of the next wider one is blended in.
template <class Real>
struct LevelChoice {
  int level = 0;
  Sloped<Real> blend{};  ///< the slope is by z
  Real blend_by_zz{};
};
template <class Real>
PALPATE_HOSTDEV inline LevelChoice<Real> choose_level(const DepthFieldView& field, Real radius,
                                                      Real z) {
  Real footprint = Real(kFootprint) * radius * Real(field.intrinsics.fx) / z;
  LevelChoice<Real> choice;
  while (footprint >= 2 && choice.level < field.num_levels) {
    footprint /= 2;
    ++choice.level;
  }
  if (choice.level >= field.num_levels - 1) {
    choice.level = field.num_levels - 1;
    return choice;
  }
  const Real width = Real(kBlendEnd) - 1, x = (footprint - 1) / width;
  const Real x_by_z = -footprint / (width * z);
  const Sloped<Real> step = smooth_step(x);
  choice.blend = {step.value, step.slope * x_by_z};
  const bool is_between = x > 0 && x < 1;
  choice.blend_by_zz =
      (is_between ? (6 - 12 * x) * x_by_z * x_by_z : Real(0)) - 2 * step.slope * x_by_z / z;
  return choice;
}

/// The nearest pixel of a level, and how far right of and below its middle.
template <class Real>
struct PixelSpot {
  std::ptrdiff_t pixel;
  Real s, t;
};
template <class Real>
PALPATE_HOSTDEV inline PixelSpot<Real> spot_at(const DepthFieldLevel& level, Real u, Real v) {
  const auto place = [&level](Real at, float last) {
    const Real least = Real(DepthFieldLevel::kFirst), most = Real(last);
    const Real p = (at + Real(0.5)) * Real(level.scale) - Real(0.5);
    return p > least ? (p < most ? p : most) : least;  // NaN: least
  };
  const Real at_u = place(u, level.last_u), at_v = place(v, level.last_v);
  const int i = static_cast<int>(std::floor(at_u + Real(0.5)));
  const int j = static_cast<int>(std::floor(at_v + Real(0.5)));
  return {std::ptrdiff_t(j) * level.stride + i, at_u - Real(i), at_v - Real(j)};
}

/// Do the planes around a pixel have to be saturated one by one? At a step, and deep behind a
/// surface. Elsewhere the nine planes agree to within the limit of a step, and none of them is out
/// of the linear range while phi is below the radius.
template <class Real>
PALPATE_FORMULA bool must_saturate(const DepthFieldLevel& level, std::ptrdiff_t pixel, Real z,
                                   Real thickness) {
  const float* plane = level.planes + 2 * pixel;
  return level.is_step[pixel] != 0 ||
         Real(plane[0]) - z * Real(plane[1]) < 2 * Real(level.step_limit) - thickness;
}

/// Two neighbours among DepthFieldLevel::planes, which a GPU loads at once.
struct alignas(2 * sizeof(float)) PlanePair {
  float offset, slope;
};

/// One level.
template <class Real>
PALPATE_HOSTDEV inline ImageGradient<Real> sample_level(const DepthFieldLevel& level,
                                                        const PixelSpot<Real>& spot, Real z,
                                                        Real radius, Real thickness) {
  Real distance[3][3], slope[3][3];
  for (int q = 0; q < 3; ++q) {  // all is read before anything waits for it
    const float* row = level.planes + 2 * (spot.pixel + (q - 1) * level.stride - 1);
    for (int p = 0; p < 3; ++p) {
      const PlanePair pair = reinterpret_cast<const PlanePair*>(row)[p];
      slope[q][p] = Real(pair.slope);
      distance[q][p] = Real(pair.offset) - z * slope[q][p];
    }
  }
  if (must_saturate(level, spot.pixel, z, thickness)) {
    const Real limit = radius + Real(level.step_limit);
    for (int q = 0; q < 3; ++q) {
      for (int p = 0; p < 3; ++p) {
        const Sloped<Real> plane = saturate(distance[q][p], limit, thickness);
        distance[q][p] = plane.value;
        slope[q][p] *= plane.slope;
      }
    }
  }
  Curved<Real> rows[3], row_slopes[3];
  for (int q = 0; q < 3; ++q) {
    rows[q] = spline(distance[q][0], distance[q][1], distance[q][2], spot.s);
    row_slopes[q] = spline(slope[q][0], slope[q][1], slope[q][2], spot.s);
  }
  const Curved<Real> phi = spline(rows[0].value, rows[1].value, rows[2].value, spot.t);
  const Real scale = Real(level.scale);
  return {phi.value, spline(rows[0].slope, rows[1].slope, rows[2].slope, spot.t).value * scale,
          phi.slope * scale,
          -spline(row_slopes[0].value, row_slopes[1].value, row_slopes[2].value, spot.t).value};
}

/// phi for a sphere of this radius (m) at p_C, and its gradient. For single numbers; the vector
/// kernel of the contact query takes the same steps. In front of kLeastDepth: 2 radii, gradient 0.
template <class Real>
struct FieldSample {
  Real phi;
  Vec3<Real> gradient;
};
template <class Real>
PALPATE_HOSTDEV inline FieldSample<Real> sample_field(const DepthFieldView& field,
                                                      const Vec3<Real>& p_C, Real radius) {
  const Real z = p_C.z;
  if (!(z > Real(kLeastDepth))) return {2 * radius, {}};
  const PixelPosition<Real> at = project(field.intrinsics, p_C);
  const LevelChoice<Real> choice = choose_level(field, radius, z);
  const DepthFieldLevel& level = field.levels[choice.level];
  const Real thickness = Real(field.thickness);
  ImageGradient<Real> g = sample_level(level, spot_at(level, at.u, at.v), z, radius, thickness);
  if (choice.blend.value > 0) {
    const DepthFieldLevel& wider = field.levels[choice.level + 1];
    const ImageGradient<Real> next =
        sample_level(wider, spot_at(wider, at.u, at.v), z, radius, thickness);
    const Real b = choice.blend.value;
    g.by_u += b * (next.by_u - g.by_u);
    g.by_v += b * (next.by_v - g.by_v);
    g.by_z += b * (next.by_z - g.by_z) + (next.phi - g.phi) * choice.blend.slope;
    g.phi += b * (next.phi - g.phi);
  }
  const Gradient3<Real> n =
      to_space(g, at.from_centre_u, at.from_centre_v, 1 / z,
               static_cast<float>(field.intrinsics.fx), static_cast<float>(field.intrinsics.fy));
  return {g.phi, {n.x, n.y, n.z}};
}

}  // namespace palpate
