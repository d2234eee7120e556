// Interpolation between two points (thesis eq. 3.18). Shared by host and device.
#pragma once

#include <cmath>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// x, y, z, nx, ny, nz.
struct OrientedPoint {
  float values[6];
};

struct BlendShares {
  float old_share, new_share;
  float max_jump;

  PALPATE_HOSTDEV static BlendShares at(double t, double max_jump) {
    return {static_cast<float>(1 - t), static_cast<float>(t), static_cast<float>(max_jump)};
  }
};

/// As blend_clouds says.
PALPATE_HOSTDEV inline OrientedPoint blend_points(const OrientedPoint& a, const OrientedPoint& b,
                                                  const BlendShares& shares) {
  float mixed[6];
  for (int k = 0; k < 6; ++k) {
    mixed[k] = shares.old_share * a.values[k] + shares.new_share * b.values[k];
  }
  const float length = std::sqrt(mixed[3] * mixed[3] + mixed[4] * mixed[4] + mixed[5] * mixed[5]);
  // Comparisons with an invalid point, which is NaN, fail.
  const float z = b.values[2];
  const bool is_one_surface =
      std::fabs(z - a.values[2]) <= shares.max_jump * std::fabs(z) && length > 0.1f;
  OrientedPoint point;
  for (int k = 0; k < 3; ++k) {
    point.values[k] = is_one_surface ? mixed[k] : b.values[k];
    point.values[3 + k] = is_one_surface ? mixed[3 + k] / length : b.values[3 + k];
  }
  return point;
}

}}  // namespace palpate::v0
