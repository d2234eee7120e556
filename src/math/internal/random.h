// Random numbers that are identical on all platforms.
#pragma once

#include <cmath>
#include <cstdint>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// SplitMix64.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t bits() {
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
  }
  double uniform(double low = 0, double high = 1) {
    return low + (high - low) * (static_cast<double>(bits() >> 11) * 0x1.0p-53);
  }
  double normal() {
    return std::sqrt(-2 * std::log(1 - uniform())) *
           std::cos(2 * 3.14159265358979323846 * uniform());
  }
  Vec3d in_box(double half) {
    const double x = uniform(-half, half), y = uniform(-half, half), z = uniform(-half, half);
    return {x, y, z};
  }
  Vec3d direction() {
    for (;;) {
      const Vec3d v = in_box(1);
      const double length = norm(v);
      if (length > 0.1 && length < 1) return v / length;
    }
  }
  Quaternion rotation(double max_angle) {
    const double angle = uniform(0, max_angle);  // compilers differ in the order of arguments
    return axis_angle(direction(), angle);
  }

 private:
  std::uint64_t state_;
};

}}  // namespace palpate::v0
