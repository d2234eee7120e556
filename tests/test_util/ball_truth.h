// A ball in thirty parts by its definition, in double: the potential of its thirty values, and the
// volumes of its parts as differences of that.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "palpate/math/geometry.h"
#include "src/contact/internal/ball_parts.h"

namespace palpate::test {

using BallValues = std::array<double, 30>;

/// Integral over the depth of the volume of a ball that a plane at the distance `phi` cuts off.
inline double cap_potential(double radius, double phi) {
  const double h = std::clamp(radius - phi, 0.0, 2 * radius);
  return kPi / 12 * h * h * h * (4 * radius - h) +
         sphere_volume(radius) * std::max(-phi - radius, 0.0);
}

/// The gain of a ball of radius 1 by the plane by least squares through the values of its parts,
/// instead of what the parts say of that plane: its potential.
inline double ball_correction(const BallValues& phi) {
  static const std::vector<BallPart> parts = thirty_parts();
  double mean = 0, squares = 0;
  Vec3d slope;
  for (std::size_t k = 0; k < 30; ++k) {
    mean += phi[k] / 30;
    slope += parts[k].center * (3 * phi[k] / (30 * dot(parts[k].center, parts[k].center)));
  }
  for (std::size_t k = 0; k < 30; ++k) {
    const double off = phi[k] - mean - dot(slope, parts[k].center);
    squares += off * off / 30;
  }
  const double length = norm(slope), bent = length * length - 1;
  const double y = std::min((squares + 0.055 * bent * bent) / 0.0225, 1.0);
  const double weight = 1 - y * y * y * (10 - 15 * y + 6 * y * y);
  if (!(weight > 0)) return 0;
  double plane = cap_potential(1, mean / length);
  for (const BallPart& part : parts) {
    const double count = part.share / (part.radius * part.radius * part.radius);
    plane -= count * cap_potential(part.radius, (mean + dot(slope, part.center)) / length);
  }
  return weight * length * plane;
}

/// Minus its derivatives by the values.
inline BallValues ball_corrections(const BallValues& phi) {
  BallValues volumes;
  constexpr double kStep = 1e-5;
  for (std::size_t k = 0; k < 30; ++k) {
    BallValues more = phi, less = phi;
    more[k] += kStep;
    less[k] -= kStep;
    volumes[k] = (ball_correction(less) - ball_correction(more)) / (2 * kStep);
  }
  return volumes;
}

}  // namespace palpate::test
