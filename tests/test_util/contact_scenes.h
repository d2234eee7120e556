// Small tools and clouds made on the spot, independent of packer and camera.
#pragma once

#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "palpate/mesh/mesh.h"
#include "palpate/tool/tool.h"
#include "tests/test_util/random.h"

namespace palpate::test {

/// Disjoint spheres of many sizes inside a box of the given half side: random centers, each as
/// large as its neighbors and the box allow.
inline std::vector<Sphere> random_spheres(int num, double half_side, std::uint64_t seed) {
  Random random(seed);
  std::vector<Sphere> spheres;
  while (static_cast<int>(spheres.size()) < num) {
    const Vec3f c = to_float(random.in_box(half_side));
    double r = half_side / 2;
    for (int axis = 0; axis < 3; ++axis) {
      r = std::min(r, half_side - std::abs(static_cast<double>(c[axis])));
    }
    for (const Sphere& s : spheres) {
      r = std::min(r, norm(to_double(c) - to_double(s.center)) - static_cast<double>(s.radius));
    }
    if (r > half_side * 0.01) spheres.push_back({c, static_cast<float>(r * 0.999999)});
  }
  return spheres;
}

/// A box of 0.1 m with equal spheres, `side` along each edge.
inline Tool block_of_spheres(int side) {
  SpherePacking packing;
  const double step = 0.1 / side;
  for (int i = 0; i < side * side * side; ++i) {
    const Vec3d c{i % side + 0.5, i / side % side + 0.5, i / side / side + 0.5};
    packing.spheres.push_back(
        {to_float(step * c - Vec3d{0.05, 0.05, 0.05}), static_cast<float>(0.45 * step)});
  }
  return Tool::build(make_box({0.1, 0.1, 0.1}), std::move(packing)).value();
}

/// A tool of random spheres; its mesh is the box around them.
inline Tool random_tool(int num_spheres, double half_side, std::uint64_t seed) {
  SpherePacking packing;
  packing.spheres = random_spheres(num_spheres, half_side, seed);
  return Tool::build(make_box({2 * half_side, 2 * half_side, 2 * half_side}), std::move(packing),
                     {.gap_rule = GapRule::absolute})
      .value();
}

/// 4,096 balls in a grid: 128 compact clusters, which count as one ball each where they lie deep.
inline Tool grid_tool() {
  SpherePacking packing;
  for (int i = 0; i < 4096; ++i) {
    const auto at = [](int k) { return 0.0025f * (static_cast<float>(k) - 7.5f); };
    packing.spheres.push_back({{at(i % 16), at(i / 16 % 16), at(i / 256)}, 0.0012f});
  }
  return Tool::build(make_box({0.04, 0.04, 0.04}), std::move(packing)).value();
}

/// A bumpy wall at about `depth` seen by a pinhole camera, with depth noise, noisy normals and
/// holes.
inline PointCloud noisy_wall(int width, int height, double focal_length, double depth, double noise,
                             std::uint64_t seed) {
  Random random(seed);
  const Intrinsics k{focal_length, focal_length, width * 0.5 - 0.5, height * 0.5 - 0.5};
  PointCloud cloud(width, height, k);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const double z =
          depth + 0.01 * std::sin(u * 0.1) * std::cos(v * 0.13) + noise * random.normal();
      const Vec3d n = Vec3d{0, 0, -1} + 0.2 * random.direction();
      if (random.uniform() < 0.02) continue;
      cloud.set(static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                    static_cast<std::size_t>(u),
                to_float({(u - k.cx) * z / k.fx, (v - k.cy) * z / k.fy, z}), to_float(n));
    }
  }
  return cloud;
}

/// A cloud with depth-change vectors.
struct CloudWithEdges {
  PointCloud cloud;
  std::vector<float> edge[3];

  PointCloudView view() const {
    PointCloudView view = cloud.view();
    view.edge_x = edge[0].data();
    view.edge_y = edge[1].data();
    view.edge_z = edge[2].data();
    return view;
  }
};

/// A bumpy wall as above with a square hole or, where it is not, an outside: what `is_near` (of the
/// pixel) leaves out lies `step` behind. Depth-change vectors by their definition, with noise.
template <class IsNear>
CloudWithEdges stepped_wall(int width, int height, double focal_length, double depth, double step,
                            double noise, std::uint64_t seed, IsNear&& is_near) {
  Random random(seed);
  CloudWithEdges scene{noisy_wall(width, height, focal_length, depth, noise, seed), {}};
  for (std::vector<float>& axis : scene.edge) axis.assign(scene.cloud.size(), 0.0f);
  const auto is_inside = [&](int u, int v) { return u >= 0 && v >= 0 && u < width && v < height; };
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const std::size_t i = static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                            static_cast<std::size_t>(u);
      const Vec3d p = to_double(scene.cloud.point(i));
      if (!is_near(u, v)) {
        scene.cloud.set(i, to_float(p * ((p.z + step) / p.z)), scene.cloud.normal(i));
        continue;
      }
      Vec3d change;
      for (int dv = -1; dv <= 1; ++dv) {
        for (int du = -1; du <= 1; ++du) {
          if (!is_inside(u + du, v + dv) || is_near(u + du, v + dv)) continue;
          const double more = step - 0.05 + noise * random.normal();
          change += more * Vec3d{static_cast<double>(du), static_cast<double>(dv), 0};
        }
      }
      const Vec3d ray = normalized(p);
      change -= dot(change, ray) * ray;
      for (int axis = 0; axis < 3; ++axis) {
        scene.edge[axis][i] = static_cast<float>(std::isfinite(p.x) ? change[axis] : 0);
      }
    }
  }
  return scene;
}

}  // namespace palpate::test
