// The part of a ball behind two planes, in closed form (thesis section 3.5 leaves it out as too
// costly).
#pragma once

#include <cmath>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// A volume, and how fast it shrinks as either plane moves back: -dV/d(distance), which is the area
/// that this plane shows inside the cut ball.
template <class Real>
struct TwoPlaneCut {
  Real volume{}, area_a{}, area_b{};
};

/// Ball of the given radius behind plane a *and* behind plane b. The distances are signed, of the
/// center in front of each plane, as in cap_volume; `cosine` is that of the angle between the
/// normals.
///
/// The surface is a spherical polygon of two arcs and two pieces of discs. Gauss-Bonnet gives the
/// area of the polygon, the divergence theorem (from the center) the volume.
template <class Real>
PALPATE_HOSTDEV TwoPlaneCut<Real> two_plane_cut(Real radius, Real distance_a, Real distance_b,
                                                Real cosine) {
  const Real R2 = radius * radius;
  const auto disc = [&](Real d) { return Real(kPi) * (R2 - d * d); };
  if (distance_a >= radius || distance_b >= radius) return {};
  const TwoPlaneCut<Real> only_a{cap_volume(radius, distance_a), disc(distance_a), Real(0)};
  const TwoPlaneCut<Real> only_b{cap_volume(radius, distance_b), Real(0), disc(distance_b)};
  const TwoPlaneCut<Real> both{only_a.volume + only_b.volume - sphere_volume(radius), only_a.area_a,
                               only_b.area_b};
  if (distance_b <= -radius) return distance_a <= -radius ? TwoPlaneCut<Real>{both.volume} : only_a;
  if (distance_a <= -radius) return only_b;

  // In the plane across both: the line where the planes meet lies u_a along plane a, measured from
  // the foot of the center, away from what plane b keeps; u_b likewise.
  const Real a = -distance_a, b = -distance_b;
  const Real sine_squared = (Real(1) - cosine) * (Real(1) + cosine);
  const Real sine = sine_squared > Real(0) ? std::sqrt(sine_squared) : Real(0);
  constexpr Real kParallel = sizeof(Real) == 8 ? Real(1e-7) : Real(1e-3);
  if (sine < kParallel) {
    if (cosine > Real(0)) return a < b ? only_a : only_b;
    return both.volume > Real(0) ? both : TwoPlaneCut<Real>{};
  }
  const Real u_a = (b - cosine * a) / sine, u_b = (a - cosine * b) / sine;
  const Real half_chord_squared = R2 - a * a - u_a * u_a;
  if (half_chord_squared <= Real(0)) {  // the planes do not meet inside
    if (u_a > Real(0)) return u_b > Real(0) ? both : only_a;
    return u_b > Real(0) ? only_b : TwoPlaneCut<Real>{};
  }
  // Angles of the two arcs, areas of the two pieces of discs, and the angle between the arcs.
  const Real half_chord = std::sqrt(half_chord_squared);
  const Real arc_a = Real(2) * (Real(kPi) - std::atan2(half_chord, u_a));
  const Real arc_b = Real(2) * (Real(kPi) - std::atan2(half_chord, u_b));
  const Real area_a = (R2 - a * a) * arc_a / Real(2) + u_a * half_chord;
  const Real area_b = (R2 - b * b) * arc_b / Real(2) + u_b * half_chord;
  const Real corner = std::atan2(radius * sine * half_chord, R2 * cosine - a * b);
  const Real polygon = R2 * Real(2) * (Real(kPi) - corner) + radius * (a * arc_a + b * arc_b);
  const Real volume = (radius * polygon + a * area_a + b * area_b) / Real(3);
  return {volume > Real(0) ? volume : Real(0), area_a, area_b};
}

}}  // namespace palpate::v0
