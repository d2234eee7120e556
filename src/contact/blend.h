// Weighted mean of the results against two surfaces.
#pragma once

#include <algorithm>
#include <optional>

#include "palpate/contact/contact.h"

namespace palpate { inline namespace v0 {

/// Returns the noise of (1 - alpha) `from` + alpha `to`. None: that of one of them is unknown.
inline std::optional<MeasureNoise> blend(const std::optional<MeasureNoise>& from,
                                         const std::optional<MeasureNoise>& to, double alpha) {
  if (!from || !to) return std::nullopt;
  MeasureNoise both;
  both.add(*from, 1 - alpha);
  both.add(*to, alpha);
  return both;
}

/// Returns (1 - alpha) `from` + alpha `to`; counts are those of `to`.
inline ContactResult blend(const ContactResult& from, const ContactResult& to, double alpha) {
  const double s = 1 - alpha, t = alpha;
  const Penetration &a = from.penetration, &b = to.penetration;
  ContactResult both = to;
  both.penetration.volume = s * a.volume + t * b.volume;
  both.penetration.potential = s * a.potential + t * b.potential;
  both.penetration.measure_W.force = s * a.measure_W.force + t * b.measure_W.force;
  both.penetration.measure_W.torque = s * a.measure_W.torque + t * b.measure_W.torque;
  both.penetration.status |= a.status;
  both.noise = blend(from.noise, to.noise, alpha);
  if (!both.stiffness || !from.stiffness) return both;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) {
      double& k = both.stiffness->m[row][column];
      k = s * from.stiffness->m[row][column] + t * k;
    }
  }
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      double& moment = both.moments.first[row][column];
      moment = s * from.moments.first[row][column] + t * moment;
    }
  }
  both.moments.polar = s * from.moments.polar + t * both.moments.polar;
  return both;
}

/// Result of a query that cannot measure. Stiffness, states and planes are those of free space.
inline ContactResult unmeasured(StepStatus why, const ContactWants& wants, bool has_stiffness) {
  ContactResult result;
  result.penetration.status = why;
  if (wants.stiffness && has_stiffness) result.stiffness.emplace();
  if (wants.noise && has_stiffness) result.noise.emplace();
  std::fill(wants.states.begin(), wants.states.end(), SphereState::outside);
  std::fill(wants.planes.begin(), wants.planes.end(), Plane<float>{});
  std::fill(wants.deciders.begin(), wants.deciders.end(), kNoCamera);
  std::fill(wants.unseen.begin(), wants.unseen.end(), 0);
  return result;
}

}}  // namespace palpate::v0
