// Setup of the benchmarks with several cameras: solids with exact truth, seen from the front, from
// both sides and from above, with noise.
#pragma once

#include <algorithm>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "tests/test_util/hull_scenes.h"

namespace palpate::bench {

/// A solid with its outward normal, and its intersection with a ray.
struct Solid {
  std::string name;
  test::Ray ray;
  std::function<bool(const Vec3d&)> is_solid;
  Vec3d touched;  ///< a point of its surface that a tool is pressed into
  Vec3d normal;   ///< outward, at that point
};

/// Makes an intersection of half spaces n . x < d.
inline Solid convex(std::string name, std::vector<Plane<double>> faces, const Vec3d& touched,
                    const Vec3d& normal) {
  Solid solid;
  solid.name = std::move(name);
  solid.ray = [faces](const Vec3d& p, const Vec3d& d) {
    double enter = 0, leave = 1e30;
    for (const auto& [n, offset] : faces) {
      const double speed = dot(n, d), ahead = offset - dot(n, p);
      if (speed < 0) enter = std::max(enter, ahead / speed);
      if (speed > 0) leave = std::min(leave, ahead / speed);
      if (speed == 0 && ahead < 0) return 1e30;
    }
    return enter < leave && enter > 0 ? enter : 1e30;
  };
  solid.is_solid = [faces](const Vec3d& p) {
    return std::all_of(faces.begin(), faces.end(),
                       [&p](const Plane<double>& f) { return dot(f.normal, p) < f.offset; });
  };
  solid.touched = touched;
  solid.normal = normalized(normal);
  return solid;
}

/// Returns solids at (0, 0, 1): a wall, a ball, a ridge of 90 degrees along y, a box corner.
inline std::vector<Solid> solids() {
  const Vec3d p{0, 0, 1};
  const auto plane = [&p](const Vec3d& out) {
    const Vec3d n = normalized(out);
    return Plane<double>{n, dot(n, p)};
  };
  std::vector<Solid> all;
  all.push_back(convex("wall", {plane({0, 0, -1})}, p, {0, 0, -1}));
  Solid ball;
  ball.name = "ball of 200 mm";
  ball.ray = [](const Vec3d& from, const Vec3d& d) {
    return test::to_ball(from, d, {0, 0, 1.1}, 0.1);
  };
  ball.is_solid = [](const Vec3d& at) { return norm(at - Vec3d{0, 0, 1.1}) < 0.1; };
  ball.touched = p;
  ball.normal = {0, 0, -1};
  all.push_back(ball);
  all.push_back(convex("ridge", {plane({1, 0, -1}), plane({-1, 0, -1})}, p, {0, 0, -1}));
  const double side = std::sqrt(3.0) / 2;
  all.push_back(convex("corner",
                       {plane({1, 0, -1}), plane({-0.5, side, -1}), plane({-0.5, -side, -1})}, p,
                       {0, 0, -1}));
  return all;
}

/// Returns poses 1 m away from (0, 0, 1): one camera in front of it, two at +-35 degrees, three and
/// four with one in front and one above.
inline std::vector<Pose> cameras_around(int num) {
  const Vec3d target{0, 0, 1};
  const auto at = [&](double degrees, double elevation) {
    const double a = degrees * kPi / 180, e = elevation * kPi / 180;
    const Vec3d away{std::sin(a) * std::cos(e), -std::sin(e), -std::cos(a) * std::cos(e)};
    return test::look_at(target + away, target);
  };
  if (num == 1) return {at(0, 0)};
  std::vector<Pose> cameras = {at(35, 0), at(-35, 0)};
  if (num > 2) cameras.push_back(at(0, 0));
  if (num > 3) cameras.push_back(at(0, 35));
  return cameras;
}

/// Renders a solid for all cameras, with noise of this deviation (m) in depth.
inline test::HullScene scene_of(const Solid& solid, const std::vector<Pose>& cameras, double noise,
                                std::uint64_t seed) {
  test::Random random(seed);
  test::HullScene scene;
  for (const Pose& X_WC : cameras) {
    std::vector<float> meters = test::depth_seen(solid.ray, test::vga(), X_WC);
    for (float& z : meters) {
      if (z > 0) z += static_cast<float>(noise * random.normal());
    }
    test::add_view(scene, test::vga(), X_WC, meters);
  }
  scene.ray = solid.ray;
  scene.is_solid = solid.is_solid;
  return scene;
}

}  // namespace palpate::bench
