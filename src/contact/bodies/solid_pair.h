// A pair of bodies by their distance fields: where the elements of one lie in the field of the
// other, and what the sums of both directions of sampling make of the pair (decision 30). Shared by
// host and device.
#pragma once

#include <cmath>

#include "src/contact/bodies/body_pair.h"
#include "src/contact/bodies/solid_sample.h"

namespace palpate { inline namespace v0 {

PALPATE_HOSTDEV inline void copy_rows(const Mat3d& from, float (&to)[3][3]) {
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      to[row][column] = static_cast<float>(from.m[row][column]);
    }
  }
}

/// Places the elements of a body E in the field of a body F.
/// `center_E`: the point that elements are relative to; `corner_F`: of the field's box.
PALPATE_HOSTDEV inline SolidFrame solid_frame(const Pose& X_WE, const Vec3d& center_E,
                                              const Pose& X_WF, const Vec3d& corner_F) {
  const Pose X_FE = relative_pose(X_WF, X_WE);
  SolidFrame frame;
  copy_rows(rotation_matrix(X_FE.rotation), frame.R_FE);
  copy_rows(rotation_matrix(normalized(X_WE.rotation)), frame.R_WE);
  copy_rows(rotation_matrix(normalized(X_WF.rotation)), frame.R_WF);
  const Vec3d p_F = X_FE * center_E - corner_F;
  for (int axis = 0; axis < 3; ++axis) frame.p_FC[axis] = static_cast<float>(p_F[axis]);
  return frame;
}

PALPATE_HOSTDEV inline Vec3d times(const Stiffness& k, int first_row, const Vec3d& shift,
                                   const Vec3d& turn) {
  Vec3d sum;
  for (int row = 0; row < 3; ++row) {
    const double(&m)[6] = k.m[first_row + row];
    sum[row] = m[0] * shift.x + m[1] * shift.y + m[2] * shift.z + m[3] * turn.x + m[4] * turn.y +
               m[5] * turn.z;
  }
  return sum;
}

/// Returns the stiffness of the wrench on the other body F, about C_F, by F's own pose, from that
/// of the wrench on a body E, about its center C_E, by E's. Moving F is moving both, which turns
/// all wrenches along, and E back. `d` is from C_F to C_E.
PALPATE_HOSTDEV inline Stiffness of_other(const Stiffness& k, const VolumeWrench& on_e,
                                          const Vec3d& d) {
  Stiffness other;
  for (int column = 0; column < 6; ++column) {
    Vec3d shift, turn;
    (column < 3 ? shift : turn)[column % 3] = 1;
    const Vec3d shift_e = shift + cross(turn, d);
    const Vec3d force = cross(turn, on_e.force) + times(k, 0, shift_e, turn);
    const Vec3d torque = cross(turn, on_e.torque) + times(k, 3, shift_e, turn);
    const Vec3d torque_f = torque + cross(d, force) - cross(shift, on_e.force);
    for (int row = 0; row < 3; ++row) {
      other.m[row][column] = force[row];
      other.m[row + 3][column] = torque_f[row];
    }
  }
  return other;
}

/// Returns the moments of the opposite forces about another point, from which F's center lies `d`
/// away, given those of the force on body F about its own center.
PALPATE_HOSTDEV inline VolumeMoments of_opposite(const VolumeMoments& f, const Vec3d& force,
                                                 const Vec3d& d) {
  VolumeMoments other;
  const Vec3d n = normalized(force);
  Vec3d sum;  // of levers times volumes
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      other.first[row][column] = -(f.first[row][column] + d[row] * force[column]);
      sum[row] += f.first[row][column] * n[column];
    }
  }
  const Vec3d off = cross(d, n);
  other.polar = f.polar + 2 * dot(cross(sum, n), off) + norm(force) * dot(off, off);
  return other;
}

PALPATE_HOSTDEV inline Stiffness sum_of(const Stiffness& a, double weight_a, const Stiffness& b,
                                        double weight_b) {
  Stiffness sum;
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) {
      sum.m[row][column] = weight_a * a.m[row][column] + weight_b * b.m[row][column];
    }
  }
  return sum;
}

/// sum += scale F F^T
PALPATE_HOSTDEV inline void add_product(Stiffness& sum, double scale, const VolumeWrench& F) {
  const double f[6] = {F.force.x, F.force.y, F.force.z, F.torque.x, F.torque.y, F.torque.z};
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) sum.m[row][column] += scale * f[row] * f[column];
  }
}

/// The potential U of a pair, a mean of the potentials of both directions of sampling with the
/// exponent 8, and its slope by each of them. Wrenches are on one body, about one point.
///
///   (U + e)^8 = w_a (U_a + e)^8 + w_b (U_b + e)^8
///
/// e is the potential of single spheres: where both have little more, neither is preferred.
class PairPotential {
 public:
  PALPATE_HOSTDEV PairPotential(double of_a, double weight_a, double of_b, double weight_b,
                                double e)
      : value_(weight_a * of_a + weight_b * of_b), slope_a_(weight_a), slope_b_(weight_b) {
    if (weight_a == 0 || weight_b == 0) return;
    raised_a_ = of_a + e;
    raised_b_ = of_b + e;
    const double most = raised_a_ > raised_b_ ? raised_a_ : raised_b_;
    const double a = raised_a_ / most, b = raised_b_ / most;
    const double a_7 = seventh_power(a), b_7 = seventh_power(b);
    const double mean = weight_a * a_7 * a + weight_b * b_7 * b;
    const double root = std::sqrt(std::sqrt(std::sqrt(mean)));
    raised_ = most * root;
    value_ = raised_ - e;
    slope_a_ = weight_a * a_7 * root / mean;
    slope_b_ = weight_b * b_7 * root / mean;
  }

  PALPATE_HOSTDEV double value() const { return value_; }
  PALPATE_HOSTDEV VolumeWrench wrench(const VolumeWrench& a, const VolumeWrench& b) const {
    return {slope_a_ * a.force + slope_b_ * b.force, slope_a_ * a.torque + slope_b_ * b.torque};
  }
  /// Derivative of the wrench, including that of the slopes.
  PALPATE_HOSTDEV Stiffness stiffness(const Stiffness& k_a, const VolumeWrench& a,
                                      const Stiffness& k_b, const VolumeWrench& b) const {
    Stiffness sum = sum_of(k_a, slope_a_, k_b, slope_b_);
    if (!(raised_ > 0)) return sum;
    add_product(sum, 7 * slope_a_ / raised_a_, a);
    add_product(sum, 7 * slope_b_ / raised_b_, b);
    add_product(sum, -7 / raised_, wrench(a, b));
    return sum;
  }
  /// Moments of the force, weighted by its slopes; that of the volume by its weights.
  PALPATE_HOSTDEV VolumeMoments moments(const VolumeMoments& a, double weight_a,
                                        const VolumeMoments& b, double weight_b) const {
    VolumeMoments sum;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        sum.first[row][column] = slope_a_ * a.first[row][column] + slope_b_ * b.first[row][column];
      }
    }
    sum.polar = weight_a * a.polar + weight_b * b.polar;
    return sum;
  }

 private:
  PALPATE_HOSTDEV static double seventh_power(double x) {
    const double x2 = x * x;
    return x2 * x2 * x2 * x;
  }

  double value_, slope_a_, slope_b_;
  double raised_ = 0, raised_a_ = 0, raised_b_ = 0;  // with e; 0: only one direction is sampled
};

/// Constants of a pair, whatever its poses: weights of the two directions, and the potential
/// of about one sphere in a light touch, m4.
struct PairWeights {
  double a = 0, b = 0, single_potential = 0;
  Vec3d p_AC, p_BC;  ///< centers of mass
};

/// Sums over the elements of one body in the field of the other, in W, about its center of mass.
struct SolidSums {
  double volume = 0, potential = 0;
  VolumeWrench wrench;
};

/// The pair by both directions of sampling, with wrenches of each on both bodies.
struct SolidPairSums {
  PALPATE_HOSTDEV SolidPairSums(const PairWeights& w, const SolidSums& a, const SolidSums& b,
                                const Pose& X_WA, const Pose& X_WB)
      : weights(w),
        potential(a.potential, w.a, b.potential, w.b, w.single_potential),
        volume(w.a * a.volume + w.b * b.volume),
        a_on_a(a.wrench),
        b_on_b(b.wrench) {
    // From one center of mass to the other.
    d_BA = Pose{X_WA.translation, normalized(X_WA.rotation)} * w.p_AC -
           Pose{X_WB.translation, normalized(X_WB.rotation)} * w.p_BC;
    b_on_a = {-b_on_b.force, -(b_on_b.torque - cross(d_BA, b_on_b.force))};
    a_on_b = {-a_on_a.force, -(a_on_a.torque + cross(d_BA, a_on_a.force))};
  }

  PALPATE_HOSTDEV VolumeWrench on_a() const { return potential.wrench(a_on_a, b_on_a); }
  PALPATE_HOSTDEV VolumeWrench on_b() const { return potential.wrench(a_on_b, b_on_b); }
  /// Computes the stiffness of a body from those of both directions.
  PALPATE_HOSTDEV Stiffness stiffness_a(const Stiffness& k_a, const Stiffness& k_b) const {
    return potential.stiffness(k_a, a_on_a, of_other(k_b, b_on_b, -d_BA), b_on_a);
  }
  PALPATE_HOSTDEV Stiffness stiffness_b(const Stiffness& k_a, const Stiffness& k_b) const {
    return potential.stiffness(of_other(k_a, a_on_a, d_BA), a_on_b, k_b, b_on_b);
  }

  PairWeights weights;
  PairPotential potential;
  double volume;
  VolumeWrench a_on_a, b_on_a, a_on_b, b_on_b;
  Vec3d d_BA;
};

}}  // namespace palpate::v0
