// A contact as a uniform disc, for queries of images under it.
#pragma once

#include <array>
#include <cmath>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// The disc of a contact with a surface that cameras see.
struct TouchedDisc {
  Vec3d p_W;                  ///< its center
  Vec3d n_W;                  ///< any length
  double torsion_radius = 0;  ///< ContactPatch's

  /// Returns the radius of the uniform disc with this torsion radius, m.
  double radius() const { return 1.5 * torsion_radius; }
};

/// A sample position on the unit disc.
struct DiscSpot {
  double x = 0, y = 0;
};
inline constexpr int kNumDiscSpots = 128;

/// Returns samples spread evenly over the unit disc: Vogel's spiral.
inline std::array<DiscSpot, kNumDiscSpots> make_disc_spots() {
  const double golden = kPi * (3 - std::sqrt(5.0));
  std::array<DiscSpot, kNumDiscSpots> spots;
  for (int i = 0; i < kNumDiscSpots; ++i) {
    const double r = std::sqrt((i + 0.5) / kNumDiscSpots);
    spots[static_cast<std::size_t>(i)] = {r * std::cos(i * golden), r * std::sin(i * golden)};
  }
  return spots;
}
inline const std::array<DiscSpot, kNumDiscSpots> kDiscSpots = make_disc_spots();

/// Calls `visit(column, row, weight)` for the pixels around an image point, at most four, with
/// bilinear weights: sums change without a jump.
void visit_pixels_around(double u, double v, int width, int height, auto&& visit) {
  if (!(u > -1 && v > -1 && u < width && v < height)) return;
  const int left = static_cast<int>(std::floor(u)), top = static_cast<int>(std::floor(v));
  for (int k = 0; k < 4; ++k) {
    const int column = left + k % 2, row = top + k / 2;
    if (column < 0 || row < 0 || column >= width || row >= height) continue;
    visit(column, row, (1 - std::abs(u - column)) * (1 - std::abs(v - row)));
  }
}

}}  // namespace palpate::v0
