// The numbers of a pose, and derivatives by them (pose_gradients.h). Shared by host and device.
//
//   a shift t and a small rotation w of T move C by t + w x r,  r = R p_TC
//   so U changes by f . t + h . w,  h = m + r x f,  of g = (f, m)
//   w = B dx:  2 vec(dq q*) / |q|^2 for a quaternion, vec(dR R^T) for a matrix
#pragma once

#include "src/contact/internal/pose_gradients.h"
#include "src/math/internal/pose_of_matrix.h"

namespace palpate { inline namespace v0 {

PALPATE_HOSTDEV inline Vec3d vec3_at(const double* from) { return {from[0], from[1], from[2]}; }

/// tx ty tz qx qy qz qw.
struct SevenNumbers {
  static constexpr int kNum = 7;

  Vec3d t, axis;
  double w, per_length;  // 2 / |q|^2

  PALPATE_HOSTDEV explicit SevenNumbers(const double (&x)[kNum])
      : t{x[0], x[1], x[2]}, axis{x[3], x[4], x[5]}, w(x[6]) {
    per_length = 2 / (dot(axis, axis) + w * w);
  }
  /// Not finite if there is none.
  PALPATE_HOSTDEV Pose pose() const {
    const bool is_one = per_length > 0 && per_length < static_cast<double>(INFINITY);
    return {t, is_one ? Quaternion{axis.x, axis.y, axis.z, w}
                      : Quaternion{static_cast<double>(NAN), 0, 0, 0}};
  }
  PALPATE_HOSTDEV static Vec3d shift_of(const double (&y)[kNum]) { return {y[0], y[1], y[2]}; }
  /// R v.
  PALPATE_HOSTDEV Vec3d rotated(const Vec3d& v) const {
    return v + per_length * cross(axis, cross(axis, v) + w * v);
  }
  /// B y.
  PALPATE_HOSTDEV Vec3d turn(const double (&y)[kNum]) const {
    const Vec3d by{y[3], y[4], y[5]};
    return per_length * (w * by - y[6] * axis + cross(axis, by));
  }
  /// Writes (f, B^T h).
  PALPATE_HOSTDEV void put(const Vec3d& f, const Vec3d& h, double (&to)[kNum]) const {
    const Vec3d each = per_length * h, by_axis = w * each + cross(each, axis);
    for (int k = 0; k < 3; ++k) {
      to[k] = f[k];
      to[3 + k] = by_axis[k];
    }
    to[6] = -dot(each, axis);
  }
  /// Adds the derivative of h . (B y) for a fixed h.
  PALPATE_HOSTDEV void add_bend(const Vec3d& h, const double (&y)[kNum], double (&to)[kNum]) const {
    const Vec3d by{y[3], y[4], y[5]};
    const double along = dot(h, turn(y));
    const Vec3d by_axis = per_length * (cross(by, h) - y[6] * h - along * axis);
    for (int k = 0; k < 3; ++k) to[3 + k] += by_axis[k];
    to[6] += per_length * (dot(h, by) - along * w);
  }
};

/// A 4 x 4 matrix, row by row. Derivatives are right for changes that leave R a rotation.
struct MatrixNumbers {
  static constexpr int kNum = 16;

  const double (&m)[kNum];

  PALPATE_HOSTDEV explicit MatrixNumbers(const double (&x)[kNum]) : m(x) {}
  PALPATE_HOSTDEV static Vec3d column(const double (&of)[kNum], int j) {
    return {of[j], of[4 + j], of[8 + j]};
  }
  PALPATE_HOSTDEV Pose pose() const { return pose_of_matrix(m); }
  PALPATE_HOSTDEV static Vec3d shift_of(const double (&y)[kNum]) { return column(y, 3); }
  PALPATE_HOSTDEV Vec3d rotated(const Vec3d& v) const {
    return v.x * column(m, 0) + v.y * column(m, 1) + v.z * column(m, 2);
  }
  PALPATE_HOSTDEV Vec3d turn(const double (&y)[kNum]) const {
    Vec3d twice;
    for (int j = 0; j < 3; ++j) twice += cross(column(m, j), column(y, j));
    return 0.5 * twice;
  }
  PALPATE_HOSTDEV void put(const Vec3d& f, const Vec3d& h, double (&to)[kNum]) const {
    for (double& each : to) each = 0;
    for (int j = 0; j < 3; ++j) add_column(0.5 * cross(h, column(m, j)), j, to);
    add_column(f, 3, to);
  }
  PALPATE_HOSTDEV void add_bend(const Vec3d& h, const double (&y)[kNum], double (&to)[kNum]) const {
    for (int j = 0; j < 3; ++j) add_column(0.5 * cross(column(y, j), h), j, to);
  }

 private:
  PALPATE_HOSTDEV static void add_column(const Vec3d& v, int j, double (&to)[kNum]) {
    for (int i = 0; i < 3; ++i) to[4 * i + j] += v[i];
  }
};

/// Loads the numbers of pose i.
template <class Real, int kNum>
PALPATE_HOSTDEV void load_numbers(const void* from, std::ptrdiff_t i, double (&to)[kNum]) {
  const Real* const numbers = static_cast<const Real*>(from) + kNum * i;
  for (int k = 0; k < kNum; ++k) to[k] = static_cast<double>(numbers[k]);
}

/// Writes the pose of number i, see put_plain_poses.
template <class Numbers, class Real>
PALPATE_HOSTDEV void put_plain_pose(const PoseNumbers& poses, double* to, std::ptrdiff_t i) {
  double x[Numbers::kNum];
  load_numbers<Real>(poses.numbers, i, x);
  const Pose X = Numbers(x).pose();
  const double seven[] = {X.translation.x, X.translation.y, X.translation.z, X.rotation.x,
                          X.rotation.y,    X.rotation.z,    X.rotation.w};
  for (int k = 0; k < 7; ++k) to[7 * i + k] = seven[k];
}

/// Returns H^T (v, w) of pose i, the derivative of v . f + w . m by motions.
PALPATE_HOSTDEV inline void bend_of_motion(const PoseGradients& job, std::ptrdiff_t i,
                                           const Vec3d& f, const Vec3d& lever, const Vec3d& v,
                                           const Vec3d& w, Vec3d& by_shift, Vec3d& by_turn) {
  by_shift = by_turn = {};
  if (job.stiffness == nullptr) {
    by_turn = cross(lever, cross(f, w));  // m = lever x f
    return;
  }
  const double* const K = job.stiffness + 36 * i;
  for (int row = 0; row < 6; ++row) {
    const double share = -job.factor * (row < 3 ? v[row] : w[row - 3]);
    for (int k = 0; k < 3; ++k) {
      by_shift[k] += share * K[6 * row + k];
      by_turn[k] += share * K[6 * row + 3 + k];
    }
  }
}

/// Writes the gradient of pose i, see put_pose_gradients.
template <class Numbers, class Real>
PALPATE_HOSTDEV void put_pose_gradient(const PoseGradients& job, std::ptrdiff_t i) {
  constexpr int kNum = Numbers::kNum;
  double numbers[kNum], to[kNum] = {}, by_scale = 0;
  load_numbers<Real>(job.poses.numbers, i, numbers);
  const Numbers x(numbers);
  if (is_all_finite(x.pose())) {
    const Vec3d f = job.factor * vec3_at(job.by_shift + job.shift_step * i);
    const Vec3d m = job.factor * vec3_at(job.by_turn + job.turn_step * i);
    const Vec3d r = x.rotated(vec3_at(job.p_TC + job.center_step * i)), h = m + cross(r, f);
    if (job.along == nullptr) {
      x.put(f, h, to);
    } else {
      double y[kNum];
      load_numbers<Real>(job.along, i, y);
      const Vec3d w = x.turn(y), v = Numbers::shift_of(y) + cross(w, r);
      by_scale = dot(f, v) + dot(m, w);
      if (job.to != nullptr) {
        Vec3d by_shift, by_turn;
        const Vec3d lever = job.p_CQ == nullptr ? Vec3d{} : x.rotated(vec3_at(job.p_CQ + 3 * i));
        bend_of_motion(job, i, f, lever, v, w, by_shift, by_turn);
        x.put(by_shift, by_turn + cross(r, by_shift + cross(f, w)), to);
        x.add_bend(h, y, to);
      }
    }
  }
  if (job.by_scale != nullptr) static_cast<Real*>(job.by_scale)[i] = static_cast<Real>(by_scale);
  if (job.to == nullptr) return;
  const double scale =
      job.scale == nullptr
          ? 1.0
          : static_cast<double>(static_cast<const Real*>(job.scale)[job.scale_step * i]);
  Real* const out = static_cast<Real*>(job.to) + kNum * i;
  for (int k = 0; k < kNum; ++k) out[k] = static_cast<Real>(scale * to[k]);
}

/// Calls f(numbers, real) with a null pointer to the kind of numbers, and a zero of their type.
template <class F>
void for_numbers(const PoseNumbers& poses, const F& f) {
  const auto with = [&](auto real) {
    poses.is_matrix ? f(static_cast<MatrixNumbers*>(nullptr), real)
                    : f(static_cast<SevenNumbers*>(nullptr), real);
  };
  poses.is_single ? with(float{}) : with(double{});
}

}}  // namespace palpate::v0
