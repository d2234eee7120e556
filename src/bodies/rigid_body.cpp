#include "src/bodies/internal/rigid_body.h"

#include <algorithm>
#include <cmath>

#include "src/math/internal/matrix.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kMaxIterations = 50;  // five do at 100 rad/s and a millisecond
constexpr double kClose = 1e-15;
/// Smallest moment of inertia over the mean one: that of rods about their axis.
constexpr double kMinInertia = 1e-3;

}  // namespace

RigidBody rigid_body(double mass, const MassProperties& shape, const Vec3d& center_B,
                     const Pose& X_WB) {
  RigidBody body;
  body.mass = mass;
  body.p_BC = center_B;
  body.X_WB = {X_WB.translation, normalized(X_WB.rotation)};
  double mean = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      body.inertia_B.m[i][j] = shape.volume > 0 ? mass * shape.inertia.m[i][j] / shape.volume : 0;
    }
    mean += body.inertia_B.m[i][i] / 3;
  }
  for (int i = 0; i < 3; ++i) {
    double& own = body.inertia_B.m[i][i];
    own = std::max(own, kMinInertia * mean);
  }
  return body;
}

Mat3d inertia_W(const RigidBody& body) {
  const Mat3d r = rotation_matrix(body.X_WB.rotation);
  return product(product(r, body.inertia_B), transposed(r));
}

Twist changed_by(const RigidBody& body, const Wrench& impulse) {
  return {impulse.force / body.mass, inverse(inertia_W(body)) * impulse.torque};
}

Vec3d angular_momentum(const RigidBody& body) { return inertia_W(body) * body.V_W.angular; }

double kinetic_energy(const RigidBody& body) {
  const Vec3d &v = body.V_W.linear, &w = body.V_W.angular;
  return 0.5 * (body.mass * dot(v, v) + dot(w, angular_momentum(body)));
}

/// Momentum p in the body's axes with p' - p = dt m x W, where m is the mean of both and W = I^-1
/// m: both p^2 and p I^-1 p stay. The turn exp(...) replaced by its Cayley map for dt W takes p' to
/// the same vector in W as p before.
void move(RigidBody& body, const Vec3d& shift, double dt) noexcept {
  const Vec3d center = body.center_W() + shift;
  Quaternion& q = body.X_WB.rotation;
  const Vec3d w_B = rotate(conjugate(q), body.V_W.angular);
  if (norm(w_B) > 0) {
    const Mat3d to_velocity = inverse(body.inertia_B);
    const Vec3d before = body.inertia_B * w_B, momentum_W = rotate(q, before);
    Vec3d after = before, mean = w_B;
    for (int i = 0; i < kMaxIterations; ++i) {
      const Vec3d middle = (before + after) / 2;
      mean = to_velocity * middle;
      const Vec3d next = before + dt * cross(middle, mean);
      const double change = norm(next - after);
      after = next;
      if (!(change > kClose * norm(before))) break;
    }
    const Vec3d turn = mean * (dt / 2);
    q = normalized(q * Quaternion{turn.x, turn.y, turn.z, 1});
    body.V_W.angular = rotate(q, to_velocity * rotate(conjugate(q), momentum_W));
  }
  body.X_WB.translation = center - rotate(q, body.p_BC);
}

}}  // namespace palpate::v0
