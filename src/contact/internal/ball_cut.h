// A large sphere is measured by thirty small balls, its parts (ball_parts.h), which follow
// bends that one value of the field cannot show. But balls inside a ball do not fill it evenly: at
// a plane they are off by up to 0.8 % of it. So they are corrected by a plane, as a control
// variate:
//
//   U = sum_k G_k(phi_k) + w |b| ( G(s) - sum_k G_k(s + d . x_k) ),   s = a / |b|,  d = b / |b|
//
// phi_k are the values of the parts at x_k, a + b . x their plane by least squares, G the integral
// of the cap volume of the sphere over the depth and G_k those of the parts. Where the values lie
// on a plane with a gradient of length 1, the sums cancel and the ball is cut exactly; where they
// bend, the brackets keep what the parts know. It is one function of the thirty values, so force
// and stiffness are its derivatives by the chain rule. w falls from 1 to 0 where the values are no
// plane: there the parts count alone.
//
// Shared by host and device, for single and double precision: `Row` holds a number for each of the
// 32 elements of a cluster (a vector on the host, one lane of a warp on a GPU), and sum(row) adds
// them up to a `Real`.
#pragma once

#include "src/contact/field/field_element.h"

namespace palpate { inline namespace v0 {

/// Number of the parts of a ball, their distance from its center and their radius, in its radii.
inline constexpr int kNumBallParts = 30;
inline constexpr float kPartDistance = 0.7f, kPartRadius = 0.43f;
/// Limit up to which values of a part count, in its radii: on a plane that touches any part they
/// are no larger than 1.13 + 0.7 radii of the ball.
inline constexpr float kPartExtent = 4.3f;

/// Elements of a cluster as the parts of a ball: their places in its radii, and 1; elements that
/// are no parts have zeros.
template <class Row>
struct BallRows {
  Row x, y, z, is_part;
};

/// The correction by a plane and its derivatives. Lengths are in radii of the ball, and it counts
/// once.
template <class Row, class Real>
struct BallPlane {
  bool is_plane = false;  ///< else all that follows is 0
  Real potential{};
  Row volume{};    ///< minus the derivatives of the potential by the values
  Row residual{};  ///< values of the parts off the plane
  // Second derivatives: disc sum_k J_k J_k^T + sum_ij form_ij X_i X_j^T for changes J_k of the
  // values, with X_i = sum_k weights_ik J_k (form_weights).
  Real disc{};
  Real form[5][5] = {};
};

/// Writes the derivatives of a, b and the residual's mean square by the values.
template <class Row>
PALPATE_FORMULA void form_weights(const BallRows<Row>& at, const Row& residual, Row (&weights)[5]) {
  constexpr float kShare = 1.0f / kNumBallParts;
  constexpr float kSlope = 3 * kShare / (kPartDistance * kPartDistance);
  weights[0] = kShare * at.is_part;
  weights[1] = kSlope * at.x;
  weights[2] = kSlope * at.y;
  weights[3] = kSlope * at.z;
  weights[4] = 2 * kShare * residual;
}

/// Returns the area of the disc in which a ball that counts `factor` times is cut.
template <class Real>
PALPATE_FORMULA Real cut_area(Real radius, Real factor, Real phi) {
  const Real squared = radius * radius - phi * phi;
  return factor * (static_cast<float>(kPi) * (squared > Real{} ? squared : Real{}));
}

/// Limits of a plane, in radii of the ball: the residual's mean square, and a weight of the squared
/// deviation of the gradient's length from 1.
inline constexpr float kNoPlane = 0.0225f, kLengthWeight = 0.055f;

template <class Real, class Row, class Sum>
PALPATE_FORMULA BallPlane<Row, Real> ball_plane(const BallRows<Row>& at, const Row& phi,
                                                const Sum& sum, bool with_forms) {
  constexpr float kShare = 1.0f / kNumBallParts;
  constexpr float kSecond = kPartDistance * kPartDistance / 3;  // mean of x x^T
  BallPlane<Row, Real> plane;
  const Real zero{}, one = zero + 1.0f;
  // a + b . x
  const Row value = phi * at.is_part;
  const Real a = kShare * sum(value);
  const Real b[3] = {(kShare / kSecond) * sum(value * at.x), (kShare / kSecond) * sum(value * at.y),
                     (kShare / kSecond) * sum(value * at.z)};
  plane.residual = value - (a * at.is_part + b[0] * at.x + b[1] * at.y + b[2] * at.z);
  const Real squared = b[0] * b[0] + b[1] * b[1] + b[2] * b[2], bent = squared - one;
  const Real off = (kShare * sum(plane.residual * plane.residual) + kLengthWeight * bent * bent) *
                   (1.0f / kNoPlane);
  if (!(off < one)) return plane;
  const Real length = Real(std::sqrt(squared)), per_length = one / length;
  const Real s = a * per_length;
  if (!(s < one * (kPartDistance + kPartRadius)) || !(s > -one * (kPartDistance + kPartRadius))) {
    return plane;
  }
  plane.is_plane = true;
  const Real left = one - off;
  const Real w = one - off * off * off * (10.0f - off * (15.0f - 6.0f * off));
  const Real w_off = -30.0f * off * off * left * left;
  const Real w_off2 = -60.0f * off * left * (left - off);
  // Volumes of the ball and the parts behind the plane.
  const Real d[3] = {b[0] * per_length, b[1] * per_length, b[2] * per_length};
  const Row t = s * at.is_part + d[0] * at.x + d[1] * at.y + d[2] * at.z;
  const Row part_radius = Row{} + kPartRadius;
  const Row factor = at.is_part * (kShare / (kPartRadius * kPartRadius * kPartRadius));
  const CutBall<Row> parts = cut_ball(part_radius, factor, t);
  const CutBall<Real> ball = cut_ball<Real>(one, one, s);
  const Real missing = ball.volume - sum(parts.volume);
  const Real c = length * (ball.potential - sum(parts.potential));
  // Derivatives of |b| (...) by a and b.
  const Real along = ball.potential + s * ball.volume - sum(parts.potential + t * parts.volume);
  const Real c_b[3] = {along * d[0] + sum(parts.volume * at.x),
                       along * d[1] + sum(parts.volume * at.y),
                       along * d[2] + sum(parts.volume * at.z)};
  const Real off_b = 4.0f * kLengthWeight / kNoPlane * bent;  // times b
  const Real by_residual = w_off * c * (2.0f * kShare / kNoPlane);
  plane.potential = w * c;
  Real by_b[3];
  for (int i = 0; i < 3; ++i) {
    by_b[i] = (kShare / kSecond) * (w * c_b[i] + w_off * c * off_b * b[i]);
  }
  plane.volume = w * missing * kShare * at.is_part -
                 (by_b[0] * at.x + by_b[1] * at.y + by_b[2] * at.z) - by_residual * plane.residual;
  if (!with_forms) return plane;
  // |b| G((a + b . x) / |b|) has the second derivatives A / |b| (1, z) (1, z)^T, z = x - t d, and
  // (G + t V) (1 - d d^T) / |b| by b; A is the area of the cut disc.
  const Row discs = cut_area(part_radius, factor, t);
  const Real disc = cut_area(one, one, s);
  const Row z[3] = {at.x - t * d[0], at.y - t * d[1], at.z - t * d[2]};
  Real hessian[4][4];
  hessian[0][0] = per_length * (disc - sum(discs));
  for (int i = 0; i < 3; ++i) {
    hessian[0][i + 1] = hessian[i + 1][0] = per_length * (-disc * s * d[i] - sum(discs * z[i]));
    for (int j = 0; j <= i; ++j) {
      const Real turned = (i == j ? one : zero) - d[i] * d[j];
      hessian[i + 1][j + 1] = hessian[j + 1][i + 1] =
          per_length * (disc * s * s * d[i] * d[j] - sum(discs * z[i] * z[j]) + along * turned);
    }
  }
  plane.disc = w_off * c * (2.0f * kShare / kNoPlane);
  const Real by[5] = {-missing, c_b[0], c_b[1], c_b[2], zero};
  const Real off_by[5] = {zero, off_b * b[0], off_b * b[1], off_b * b[2], one * (1.0f / kNoPlane)};
  for (int i = 0; i < 5; ++i) {
    for (int j = 0; j < 5; ++j) {
      plane.form[i][j] =
          w_off * (by[i] * off_by[j] + off_by[i] * by[j]) + w_off2 * c * off_by[i] * off_by[j];
      if (i < 4 && j < 4) plane.form[i][j] += w * hessian[i][j];
    }
  }
  plane.form[0][0] -= w_off * c * (2.0f / kNoPlane);
  for (int i = 1; i < 4; ++i) {
    plane.form[i][i] += w_off * c * (off_b - 2.0f * kSecond / kNoPlane);
    for (int j = 1; j < 4; ++j) {
      plane.form[i][j] += w_off * c * (8.0f * kLengthWeight / kNoPlane) * b[i - 1] * b[j - 1];
    }
  }
  return plane;
}

/// Adds the second derivatives of BallPlane::form to the terms of a stiffness; `X` are the sums
/// over J_k = (n_k, l_k x n_k), forces and torques for each change of a value.
template <class Real, class Terms>
PALPATE_FORMULA void add_form(const Real (&form)[5][5], const Real (&X)[5][6], Real scale,
                              Terms& terms) {
  Real moments[5][6];  // form X
  for (int i = 0; i < 5; ++i) {
    for (int k = 0; k < 6; ++k) {
      moments[i][k] = Real{};
      for (int j = 0; j < 5; ++j) moments[i][k] += form[i][j] * X[j][k];
    }
  }
  const auto product = [&](int row, int column) {
    Real total{};
    for (int i = 0; i < 5; ++i) total += X[i][row] * moments[i][column];
    return scale * total;
  };
  subtract_products(product, terms);
}

/// Returns the factor by which the force of a tool counts, so that it is never longer than
/// kLongestGradient times the volume, although corrections may take a little from light contacts.
template <class Real>
PALPATE_FORMULA Real force_scale(Real volume, Real force) {
  const Real most = volume * kLongestGradient;
  return force > most ? (volume > Real{} ? most / force : Real{}) : Real{} + 1.0f;
}

}}  // namespace palpate::v0
