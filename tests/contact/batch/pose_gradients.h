// Poses with a potential that is known in closed form, for tests of derivatives by their numbers.
#pragma once

#include <vector>

#include "src/contact/internal/pose_gradients.h"
#include "tests/test_util/contact_scenes.h"

namespace palpate::test {

/// The matrix of a pose, row by row.
inline std::vector<double> matrix_of(const Pose& X) {
  const Mat3d R = rotation_matrix(X.rotation);
  std::vector<double> m(16, 0.0);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) m[std::size_t(4 * i + j)] = R.m[i][j];
    m[std::size_t(4 * i + 3)] = X.translation[i];
  }
  m[15] = 1;
  return m;
}

/// A spring from a point Q of the tool to a fixed point: U = d^2 / 2, d = X_WT p_TQ - c_W.
struct Spring {
  Vec3d p_TC{0.02, -0.03, 0.05}, p_TQ{-0.1, 0.2, 0.15}, c_W{0.3, 0.1, -0.2};

  Vec3d stretch(const Pose& X) const { return X * p_TQ - c_W; }
  double potential(const Pose& X) const { return dot(stretch(X), stretch(X)) / 2; }
  /// Force and torque about C: minus the derivative of U by motions.
  void wrench(const Pose& X, double* force, double* torque) const {
    const Vec3d f = -stretch(X), m = cross(rotate(X.rotation, p_TQ - p_TC), f);
    for (int k = 0; k < 3; ++k) {
      force[k] = f[k];
      torque[k] = m[k];
    }
  }
  /// Minus the derivative of the wrench: a motion v, w of C changes d by v + w x lever.
  void stiffness(const Pose& X, double* K) const {
    const Vec3d lever = rotate(X.rotation, p_TQ - p_TC), d = stretch(X);
    for (int column = 0; column < 6; ++column) {
      Vec3d v, w;
      (column < 3 ? v : w)[column % 3] = 1;
      const Vec3d by = v + cross(w, lever), turn = cross(cross(w, lever), d) + cross(lever, by);
      for (int k = 0; k < 3; ++k) {
        K[6 * k + column] = by[k];
        K[6 * (3 + k) + column] = turn[k];
      }
    }
  }
};

/// Poses with quaternions of any length, or as matrices, and their springs' forces.
template <class Real>
struct PosesOfSprings {
  Spring spring;
  std::size_t num, each;
  std::vector<Pose> X;
  std::vector<Real> numbers, along, scale, to, by_scale;
  std::vector<double> wrench, stiffness;

  PosesOfSprings(std::size_t num_poses, bool is_matrix, std::uint64_t seed)
      : num(num_poses), each(is_matrix ? 16 : 7) {
    Random random(seed);
    for (std::size_t i = 0; i < num; ++i) {
      const Vec3d t{random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)};
      X.push_back({t, random.rotation(3.0)});
      const Quaternion& q = X.back().rotation;
      const double length = random.uniform(0.5, 2);
      const std::vector<double> seven{t.x,          t.y,          t.z,         length * q.x,
                                      length * q.y, length * q.z, length * q.w};
      for (const double number : is_matrix ? matrix_of(X.back()) : seven) {
        numbers.push_back(static_cast<Real>(number));
        along.push_back(static_cast<Real>(random.uniform(-1, 1)));
      }
      scale.push_back(static_cast<Real>(random.uniform(0.5, 1.5)));
    }
    wrench.resize(6 * num);
    stiffness.resize(36 * num);
    for (std::size_t i = 0; i < num; ++i) {
      spring.wrench(X[i], &wrench[3 * i], &wrench[3 * num + 3 * i]);
      spring.stiffness(X[i], &stiffness[36 * i]);
    }
    to.assign(each * num, Real(77));
    by_scale.assign(num, Real(77));
  }
  /// Asks for the gradients of U, or their derivatives along `along`.
  PoseGradients job(bool is_second) {
    PoseGradients job;
    job.poses = {numbers.data(), num, each == 16, sizeof(Real) == sizeof(float), kHostMemory};
    job.p_TC = &spring.p_TC.x;
    job.by_shift = wrench.data();
    job.by_turn = wrench.data() + 3 * num;
    job.factor = -1;
    job.scale = scale.data();
    if (is_second) {
      job.along = along.data();
      job.stiffness = stiffness.data();
      job.by_scale = by_scale.data();
    }
    job.to = to.data();
    return job;
  }
};

}  // namespace palpate::test
