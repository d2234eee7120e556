// Distance of the surface from the spheres, by brute force over points of its own.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "tests/test_util/random.h"

namespace palpate::test {

struct StandoffTruth {
  double p95 = 0, max = 0;  ///< m
  Vec3d worst;
};

/// Spheres are added one after the other; every point remembers its nearest one.
class StandoffMeter {
 public:
  /// Random points, even over the area, and all corners.
  StandoffMeter(const TriangleMesh& mesh, int num_points, std::uint64_t seed) : num_even_(0) {
    std::vector<double> area_up_to;
    double area = 0;
    for (const auto& t : mesh.triangles) {
      const Vec3d a = mesh.vertices[t[0]];
      area += norm(cross(mesh.vertices[t[1]] - a, mesh.vertices[t[2]] - a)) / 2;
      area_up_to.push_back(area);
    }
    Random random(seed);
    for (int k = 0; k < num_points; ++k) {
      const auto found =
          std::upper_bound(area_up_to.begin(), area_up_to.end(), random.uniform(0, area));
      const auto i =
          std::min(static_cast<std::size_t>(found - area_up_to.begin()), area_up_to.size() - 1);
      const auto& t = mesh.triangles[i];
      const Vec3d a = mesh.vertices[t[0]], b = mesh.vertices[t[1]], c = mesh.vertices[t[2]];
      const double root = std::sqrt(random.uniform(0, 1)), v = random.uniform(0, 1);
      points_.push_back(a * (1 - root) + b * (root * (1 - v)) + c * (root * v));
    }
    num_even_ = points_.size();
    points_.insert(points_.end(), mesh.vertices.begin(), mesh.vertices.end());
    distance_.assign(points_.size(), INFINITY);
  }

  void add(const Sphere& sphere) {
    const Vec3d center = to_double(sphere.center);
    const double radius = sphere.radius;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const Vec3d d = points_[i] - center;
      const double reach = distance_[i] + radius;
      if (dot(d, d) < reach * reach) distance_[i] = norm(d) - radius;
    }
  }

  StandoffTruth measure() const {
    std::vector<double> even(distance_.begin(),
                             distance_.begin() + static_cast<std::ptrdiff_t>(num_even_));
    const auto rank = even.begin() + static_cast<std::ptrdiff_t>(even.size() * 95 / 100);
    std::nth_element(even.begin(), rank, even.end());
    const auto worst = std::max_element(distance_.begin(), distance_.end());
    return {*rank, *worst, points_[static_cast<std::size_t>(worst - distance_.begin())]};
  }

 private:
  std::size_t num_even_;
  std::vector<Vec3d> points_;
  std::vector<double> distance_;
};

inline double longest_side(const TriangleMesh& mesh) {
  const Bounds box = bounds(mesh);
  const Vec3d sides = box.high - box.low;
  return std::max({sides.x, sides.y, sides.z});
}

}  // namespace palpate::test
