// Boxes that stand on plates by a grid of springs under them: contacts in closed form, for tests of
// the dynamics alone.
#pragma once

#include <vector>

#include "src/bodies/internal/body_solver.h"

namespace palpate::test {

inline MassProperties box_shape(const Vec3d& size) {
  const double v = size.x * size.y * size.z;
  MassProperties shape{v, {}, {}};
  shape.inertia.m[0][0] = v * (size.y * size.y + size.z * size.z) / 12;
  shape.inertia.m[1][1] = v * (size.x * size.x + size.z * size.z) / 12;
  shape.inertia.m[2][2] = v * (size.x * size.x + size.y * size.y) / 12;
  return shape;
}

/// A grid of n x n x 2 points over the faces at the ends of z, evenly.
inline std::vector<Vec3d> end_points(const Vec3d& size, int n) {
  std::vector<Vec3d> points;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      for (const double z : {-0.5, 0.5}) {
        points.push_back(
            {size.x * ((i + 0.5) / n - 0.5), size.y * ((j + 0.5) / n - 0.5), size.z * z});
      }
    }
  }
  return points;
}

/// A half space: what lies on the side of its normal is free.
struct HalfSpace {
  Vec3d n_W{0, 0, 1};
  double offset = 0;
};

/// Springs of `k` N/m from points of a body into a half space; `energy` grows by what is in them.
inline BodyTouch touch_of(int a, const RigidBody& body, const std::vector<Vec3d>& points_B,
                          const HalfSpace& plate, double k, double& energy) {
  BodyTouch touch;
  touch.a = a;
  const Vec3d c = body.center_W(), n = plate.n_W;
  double force = 0;
  for (const Vec3d& p_B : points_B) {
    const Vec3d p = body.X_WB * p_B, l = p - c, turn = cross(l, n);
    const double depth = plate.offset - dot(n, p);
    if (!(depth > 0)) continue;
    force += k * depth;
    energy += 0.5 * k * depth * depth;
    touch.F_A_W.force += k * depth * n;
    touch.F_A_W.torque += k * depth * turn;
    touch.patch.lever_W += k * depth * l;
    const double row[6] = {n.x, n.y, n.z, turn.x, turn.y, turn.z};
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) touch.stiffness.m[i][j] += k * row[i] * row[j];
    }
  }
  if (!(force > 0)) return touch;
  touch.patch.lever_W = touch.patch.lever_W / force;
  for (const Vec3d& p_B : points_B) {
    const Vec3d p = body.X_WB * p_B;
    const double depth = plate.offset - dot(n, p);
    if (depth > 0) {
      touch.patch.torsion_radius += k * depth / force * norm(p - c - touch.patch.lever_W);
    }
  }
  return touch;
}

}  // namespace palpate::test
