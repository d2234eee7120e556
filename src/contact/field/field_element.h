// Contribution of one element of the tool to the field measure: shared by host and device, for
// single numbers and for vectors of them.
#pragma once

#include "palpate/contact/contact.h"
#include "palpate/math/geometry.h"
#include "src/field/internal/field_curvature.h"

namespace palpate { inline namespace v0 {

/// The longest gradient of the field that a force follows: |force| <= 1.05 volume, always. Near one
/// surface gradients are 1 long but for noise, behind silhouettes 1 or less but for places where
/// the walls of two levels lie apart. Where one is longer it is shortened, and the force there no
/// longer is the derivative of the potential.
inline constexpr float kLongestGradient = 1.05f;

/// Returns n of this length, but not longer than kLongestGradient.
template <class Real>
PALPATE_FORMULA Gradient3<Real> bounded(const Gradient3<Real>& n, Real length) {
  const Real one = Real{} + 1.0f;
  const Real scale = length > one * kLongestGradient ? kLongestGradient / length : one;
  return {n.x * scale, n.y * scale, n.z * scale};
}

/// Returns its second derivatives where it was shortened, without parts that no potential has: of
/// the motion of n only its rotation.
template <class Real>
PALPATE_FORMULA Symmetric<Real> bounded(const Symmetric<Real>& h, const Gradient3<Real>& n,
                                        Real length) {
  const Real zero{}, one = zero + 1.0f;
  const auto is_long = length > one * kLongestGradient;
  const Real scale = is_long ? kLongestGradient / length : one;
  const Real share = is_long ? one / length : zero;
  const Gradient3<Real> e{n.x * share, n.y * share, n.z * share};
  // H e, and of e H e half: H - e (H e)^T - (H e) e^T + (e H e) e e^T has neither.
  const Gradient3<Real> he{h.xx * e.x + h.xy * e.y + h.xz * e.z,
                           h.xy * e.x + h.yy * e.y + h.yz * e.z,
                           h.xz * e.x + h.yz * e.y + h.zz * e.z};
  const Real half = 0.5f * (e.x * he.x + e.y * he.y + e.z * he.z);
  const Gradient3<Real> w{he.x - half * e.x, he.y - half * e.y, he.z - half * e.z};
  return {scale * (h.xx - 2.0f * e.x * w.x),      scale * (h.xy - e.x * w.y - e.y * w.x),
          scale * (h.xz - e.x * w.z - e.z * w.x), scale * (h.yy - 2.0f * e.y * w.y),
          scale * (h.yz - e.y * w.z - e.z * w.y), scale * (h.zz - 2.0f * e.z * w.z)};
}

/// Turns derivatives into other axes, those of a world from those of a camera: R n and R H R^T.
template <class Real>
PALPATE_FORMULA Gradient3<Real> turned(const float (&R)[3][3], const Gradient3<Real>& n) {
  return {R[0][0] * n.x + R[0][1] * n.y + R[0][2] * n.z,
          R[1][0] * n.x + R[1][1] * n.y + R[1][2] * n.z,
          R[2][0] * n.x + R[2][1] * n.y + R[2][2] * n.z};
}
template <class Real>
PALPATE_FORMULA Symmetric<Real> turned(const float (&R)[3][3], const Symmetric<Real>& h) {
  // The columns of R H, row by row.
  const Gradient3<Real> x = turned(R, Gradient3<Real>{h.xx, h.xy, h.xz});
  const Gradient3<Real> y = turned(R, Gradient3<Real>{h.xy, h.yy, h.yz});
  const Gradient3<Real> z = turned(R, Gradient3<Real>{h.xz, h.yz, h.zz});
  const Gradient3<Real> first = turned(R, Gradient3<Real>{x.x, y.x, z.x});
  const Gradient3<Real> second = turned(R, Gradient3<Real>{x.y, y.y, z.y});
  const Gradient3<Real> third = turned(R, Gradient3<Real>{x.z, y.z, z.z});
  return {first.x, first.y, first.z, second.y, second.z, third.z};
}

/// A ball that counts `factor` times, and the field at its center.
template <class Real>
struct CutBall {
  Real volume;     ///< behind the surface; times the gradient of the field it is the force
  Real potential;  ///< its integral over the depth
};
template <class Real>
PALPATE_FORMULA CutBall<Real> cut_ball(Real radius, Real factor, Real phi) {
  Real h = radius - phi;
  h = h < Real{} ? Real{} : h;
  h = h > radius + radius ? radius + radius : h;
  const Real whole = factor * (static_cast<float>(4 * kPi / 3) * radius * radius * radius);
  Real deeper = -phi - radius;
  deeper = deeper < Real{} ? Real{} : deeper;
  return {
      factor * (static_cast<float>(kPi / 3) * h * h * (3.0f * radius - h)),
      factor * (static_cast<float>(kPi / 12) * h * h * h * (4.0f * radius - h)) + whole * deeper};
}

/// Second moment of that volume about the axis along which the ball is cut: a disc of radius rho
/// has pi / 2 rho^4.
template <class Real>
PALPATE_FORMULA Real polar_moment(Real radius, Real factor, Real phi) {
  Real h = radius - phi;
  h = h < Real{} ? Real{} : h;
  h = h > radius + radius ? radius + radius : h;
  return factor * (static_cast<float>(kPi / 2) * h * h * h *
                   (static_cast<float>(4.0 / 3) * radius * radius - h * (radius - 0.2f * h)));
}

/// Sums over all elements for the stiffness. F = sum f V(phi) n with n = grad phi, so dF = sum S dc
/// with S = f (V H - A n n^T): A is the area of the cut disc, H holds the second derivatives of
/// phi. A motion of the tool by `shift` and a small `turn` about C moves the element at lever l by
/// dc = shift + turn x l, and its torque l x F changes with both factors.
struct StiffnessSums {
  // S: 6 numbers (xx, xy, xz, yy, yz, zz); L S with L w = l x w: 9, row by row; L S L: 6; l F^T: 9.
  // And V |l x n|^2 with what a cut ball has about its own axis, for VolumeMoments.
  static constexpr int kS = 0, kLS = 6, kLSL = 15, kLF = 21, kPolar = 30, kNum = 31;
  double numbers[kNum] = {};

  PALPATE_HOSTDEV void add(const StiffnessSums& other) {
    for (int k = 0; k < kNum; ++k) numbers[k] += other.numbers[k];
  }

  PALPATE_HOSTDEV Stiffness stiffness() const {
    constexpr int kPlace[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
    Stiffness k;
    const double *S = numbers + kS, *LS = numbers + kLS, *LSL = numbers + kLSL, *LF = numbers + kLF;
    const double trace = LF[0] + LF[4] + LF[8];
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        k.m[row][column] = -S[kPlace[row][column]];
        k.m[row + 3][column] = -LS[3 * row + column];
        // dF by the turn is -S L = (L S)^T.
        k.m[row][column + 3] = -LS[3 * column + row];
        // (turn x l) x F = (l F^T - (l.F) 1) turn
        const double of_force = LF[3 * row + column] - (row == column ? trace : 0);
        k.m[row + 3][column + 3] = LSL[kPlace[row][column]] - of_force;
      }
    }
    return k;
  }

  PALPATE_HOSTDEV VolumeMoments moments() const {
    VolumeMoments moments;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        moments.first[row][column] = numbers[kLF + 3 * row + column];
      }
    }
    moments.polar = numbers[kPolar];
    return moments;
  }
};

/// Terms of an element; volume, disc and the polar moment of the cut ball include its factor.
template <class Real>
PALPATE_FORMULA void stiffness_terms(const Gradient3<Real>& l, Real volume, Real disc, Real polar,
                                     const Gradient3<Real>& n, const Symmetric<Real>& h,
                                     Real (&terms)[StiffnessSums::kNum]) {
  const Real nx = disc * n.x, ny = disc * n.y, nz = disc * n.z;
  const Real xx = volume * h.xx - nx * n.x, xy = volume * h.xy - nx * n.y,
             xz = volume * h.xz - nx * n.z, yy = volume * h.yy - ny * n.y,
             yz = volume * h.yz - ny * n.z, zz = volume * h.zz - nz * n.z;
  const Real S[StiffnessSums::kLS] = {xx, xy, xz, yy, yz, zz};
  // L S: the columns of S, crossed with l.
  const Real LS[9] = {l.y * xz - l.z * xy, l.y * yz - l.z * yy, l.y * zz - l.z * yz,
                      l.z * xx - l.x * xz, l.z * xy - l.x * yz, l.z * xz - l.x * zz,
                      l.x * xy - l.y * xx, l.x * yy - l.y * xy, l.x * yz - l.y * xz};
  // (L S) L: the rows of L S, crossed with l.
  const Real LSL[6] = {LS[1] * l.z - LS[2] * l.y, LS[2] * l.x - LS[0] * l.z,
                       LS[0] * l.y - LS[1] * l.x, LS[5] * l.x - LS[3] * l.z,
                       LS[3] * l.y - LS[4] * l.x, LS[6] * l.y - LS[7] * l.x};
  const Real fx = volume * n.x, fy = volume * n.y, fz = volume * n.z;
  const Real LF[9] = {l.x * fx, l.x * fy, l.x * fz, l.y * fx, l.y * fy,
                      l.y * fz, l.z * fx, l.z * fy, l.z * fz};
  for (int k = 0; k < 6; ++k) terms[StiffnessSums::kS + k] = S[k];
  for (int k = 0; k < 9; ++k) terms[StiffnessSums::kLS + k] = LS[k];
  for (int k = 0; k < 6; ++k) terms[StiffnessSums::kLSL + k] = LSL[k];
  for (int k = 0; k < 9; ++k) terms[StiffnessSums::kLF + k] = LF[k];
  const Real cx = l.y * n.z - l.z * n.y, cy = l.z * n.x - l.x * n.z, cz = l.x * n.y - l.y * n.x;
  terms[StiffnessSums::kPolar] = volume * (cx * cx + cy * cy + cz * cz) + polar;
}

/// Takes the second derivatives of a potential off the terms: product(i, k) is the one by motions i
/// and k, of three shifts and three turns.
template <class Terms, class Product>
PALPATE_FORMULA void subtract_products(const Product& product, Terms& terms) {
  int place = 0;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      terms[StiffnessSums::kLS + 3 * row + column] -= product(row + 3, column);
      if (column < row) continue;
      terms[StiffnessSums::kS + place] -= product(row, column);
      terms[StiffnessSums::kLSL + place] += product(row + 3, column + 3);
      ++place;
    }
  }
}

}}  // namespace palpate::v0
