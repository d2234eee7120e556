// Depth frames as a structured-light camera would have seen them, made by a formula: for everybody
// who has no recorded ones.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "tests/test_util/random.h"

namespace palpate::test {

inline constexpr Intrinsics kMadeIntrinsics{575.8, 575.8, 319.5, 239.5};
inline constexpr int kNumMadeFrames = 3;

/// Depth along the ray through (x, y, 1), m: a room with a floor, a shelf with boxes, a pole and
/// somebody who stands in it, sways from frame to frame and leans towards the camera.
inline double made_depth(double x, double y, int which) {
  double z = 2.9 / (1 + 0.12 * x);         // the wall behind, not quite across
  if (y > 0.05) z = std::min(z, 0.9 / y);  // the floor, 0.9 m below
  const auto box = [&](double x0, double x1, double y0, double y1, double at, double slant) {
    if (x > x0 && x < x1 && y > y0 && y < y1) z = std::min(z, at / (1 - slant * (x - x0)));
  };
  box(-0.5, -0.18, -0.02, 0.3, 1.3 + 0.1 * which, 0.4);
  box(-0.42, -0.3, -0.16, -0.02, 1.45, -0.3);
  box(0.36, 0.38, -0.4, 0.36, 1.1, 0);               // a pole of 2 cm
  const auto ball = [&](const Vec3d& c, double r) {  // |t (x, y, 1) - c| = r, the nearer t
    const Vec3d d{x, y, 1};
    const double dd = dot(d, d), dc = dot(d, c), rest = dc * dc - dd * (dot(c, c) - r * r);
    if (rest > 0) z = std::min(z, (dc - std::sqrt(rest)) / dd);
  };
  const double sway = 0.04 * which;
  ball({0.05 + sway, -0.1, 0.85}, 0.11);  // head
  for (int i = 0; i < 7; ++i)             // shoulders and an arm that comes nearer
    ball({-0.13 + 0.06 * i + sway, 0.12 + 0.004 * i * i, 0.95 - 0.05 * std::max(0, i - 3)}, 0.09);
  return z;
}

/// Frame `which` (0 to kNumMadeFrames - 1): 640 x 480, mm. What such a camera does to depth:
/// disparities in steps of 1/8 pixel (baseline 75 mm), noise of 0.12 mm at 0.4 m that grows with
/// the square of distance, edges that wander by a pixel, no measurement where the projector 75 mm
/// beside it is hidden, at grazing angles, in patches that do not reflect and in the last 8
/// columns.
inline DepthFrame made_frame(int which) {
  constexpr int kWidth = 640, kHeight = 480;
  constexpr double kBaseline = 0.075, kUnit = 0.001;
  const Intrinsics& k = kMadeIntrinsics;
  Random random(static_cast<std::uint64_t>(900 + which));
  const auto depth = [&](double u, double v) {
    return made_depth((u - k.cx) / k.fx, (v - k.cy) / k.fy, which);
  };
  DepthFrame frame{kWidth, kHeight, kUnit, {}, 0};
  frame.pixels.assign(static_cast<std::size_t>(kWidth * kHeight), 0);
  for (int v = 0; v < kHeight; ++v) {
    std::vector<double> disparity(kWidth);
    for (double u = 0; u < kWidth; ++u)
      disparity[static_cast<std::size_t>(u)] = k.fx * kBaseline / depth(u, v);
    double farthest_left = -1e9;  // of what the projector reaches, columns of its own image
    for (int u = 0; u < kWidth - 8; ++u) {
      const double d = disparity[static_cast<std::size_t>(u)];
      const bool hidden = u + d < farthest_left - 0.5;
      farthest_left = std::max(farthest_left, u + d);
      const double at_u = u + 0.6 * random.normal(), at_v = v + 0.6 * random.normal();
      double z = depth(at_u, at_v);
      const double slope =
          std::abs(depth(u + 1, v) - depth(u - 1, v)) + std::abs(depth(u, v + 1) - depth(u, v - 1));
      const bool grazing = slope > 0.03 && slope < 0.05;
      const bool dark = std::hypot(u - 180 - 40 * which, v - 390) < 24 ||
                        (std::abs(u - 520) < 22 && std::abs(v - 120) < 5);
      z += 0.0012 * z * z * random.normal() * 0.6;
      const double counted = std::round(8 * k.fx * kBaseline / z) / 8;
      if (hidden || grazing || dark || random.uniform() < 0.004 || counted <= 0) continue;
      frame.pixels[static_cast<std::size_t>(v * kWidth + u)] = static_cast<std::uint16_t>(
          std::clamp(k.fx * kBaseline / counted / kUnit + 0.5, 0.0, 65534.0));
    }
  }
  return frame;
}

}  // namespace palpate::test
