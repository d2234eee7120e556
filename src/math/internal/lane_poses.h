// Poses in lanes: the formulas of geometry.h for vectors of doubles, one frame in each lane. They
// are computed in the same order, so a lane has the bits of a Pose. Included by kernel files only.
#pragma once

#include "palpate/math/geometry.h"
#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

typedef double VecD __attribute__((vector_size(PALPATE_LANES * 4), aligned(PALPATE_LANES * 4)));
inline constexpr int kDoubles = kLanes / 2;  // lanes

[[gnu::always_inline]] inline VecD splat(double value) { return value - VecD{}; }
[[gnu::always_inline]] inline VecD load(const double* from) {
  VecD v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
[[gnu::always_inline]] inline void store(double* to, VecD v) { std::memcpy(to, &v, sizeof v); }
/// Writes them in single precision.
[[gnu::always_inline]] inline void store(float* to, VecD v) {
  for (int i = 0; i < kDoubles; ++i) to[i] = static_cast<float>(v[i]);
}
[[gnu::always_inline]] inline VecD sqrt(VecD v) {
#if PALPATE_LANES == 16
  return reinterpret_cast<VecD>(_mm512_sqrt_pd(reinterpret_cast<__m512d>(v)));
#elif PALPATE_LANES == 8
  return reinterpret_cast<VecD>(_mm256_sqrt_pd(reinterpret_cast<__m256d>(v)));
#else
  for (int i = 0; i < kDoubles; ++i) v[i] = std::sqrt(v[i]);
  return v;
#endif
}

struct LaneVector {
  VecD x, y, z;
};
struct LaneRotation {
  VecD x, y, z, w;
};
struct LaneMatrix {
  VecD m[3][3];
};
struct LanePose {
  LaneVector translation;
  LaneRotation rotation;
};

[[gnu::always_inline]] inline LaneRotation operator*(const LaneRotation& a, const LaneRotation& b) {
  return {
      a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
      a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
}

[[gnu::always_inline]] inline LaneRotation normalized(const LaneRotation& q) {
  const VecD length = sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  const auto has_length = length > VecD{};
  return {has_length ? q.x / length : VecD{}, has_length ? q.y / length : VecD{},
          has_length ? q.z / length : VecD{}, has_length ? q.w / length : splat(1.0)};
}

[[gnu::always_inline]] inline LaneMatrix rotation_matrix(const LaneRotation& q) {
  const VecD xx = q.x * q.x, yy = q.y * q.y, zz = q.z * q.z;
  const VecD xy = q.x * q.y, xz = q.x * q.z, yz = q.y * q.z;
  const VecD wx = q.w * q.x, wy = q.w * q.y, wz = q.w * q.z;
  return {{{1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy)},
           {2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx)},
           {2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy)}}};
}

[[gnu::always_inline]] inline LaneVector operator*(const LanePose& X_AB, const LaneVector& p_B) {
  const LaneMatrix a = rotation_matrix(X_AB.rotation);
  const auto row = [&](int k) { return a.m[k][0] * p_B.x + a.m[k][1] * p_B.y + a.m[k][2] * p_B.z; };
  const LaneVector& t = X_AB.translation;
  return {row(0) + t.x, row(1) + t.y, row(2) + t.z};
}

[[gnu::always_inline]] inline LanePose operator*(const LanePose& X_AB, const LanePose& X_BC) {
  return {X_AB * X_BC.translation, normalized(X_AB.rotation * X_BC.rotation)};
}

/// The same in all lanes.
[[gnu::always_inline]] inline LanePose splat(const Pose& X) {
  const Vec3d& t = X.translation;
  const Quaternion& q = X.rotation;
  return {{splat(t.x), splat(t.y), splat(t.z)}, {splat(q.x), splat(q.y), splat(q.z), splat(q.w)}};
}

/// Poses one after the other, `count` of them: the last one is repeated.
[[gnu::always_inline]] inline LanePose load(const Pose* from, int count) {
  LanePose X;
  for (int i = 0; i < kDoubles; ++i) {
    const Pose& at = from[i < count ? i : count - 1];
    X.translation.x[i] = at.translation.x;
    X.translation.y[i] = at.translation.y;
    X.translation.z[i] = at.translation.z;
    X.rotation.x[i] = at.rotation.x;
    X.rotation.y[i] = at.rotation.y;
    X.rotation.z[i] = at.rotation.z;
    X.rotation.w[i] = at.rotation.w;
  }
  return X;
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
