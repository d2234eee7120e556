// Keeps what vectors of elements tell of the noise (noise_rows.h). Included by kernel files only.
#pragma once

#include "src/contact/field/field_answers.h"
#include "src/contact/noise/noise_rows.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// Places of a vector of elements in the cameras that decide them.
struct NoisePlace {
  VecF u, v, inverse_depth, footprint;
  VecF ray[3];  // from the eye, with a depth of 1, in W
  VecF camera;
};

/// Returns the places in a camera whose frame has the rotation R_WC.
[[gnu::always_inline]] inline NoisePlace noise_place(const FieldFrame& frame, const Lanes& e,
                                                     const float (&R_WC)[3][3], int camera) {
  NoisePlace at;
  at.u = e.from_u + frame.cx;
  at.v = e.from_v + frame.cy;
  at.inverse_depth = e.inverse_depth;
  at.footprint = kFootprint * e.radius * frame.fx * e.inverse_depth;
  const VecF x = e.from_u * (1.0f / frame.fx), y = e.from_v * (1.0f / frame.fy);
  for (int axis = 0; axis < 3; ++axis) {
    at.ray[axis] = R_WC[axis][0] * x + R_WC[axis][1] * y + R_WC[axis][2];
  }
  at.camera = splat(static_cast<float>(camera));
  return at;
}
inline constexpr float kNotTurned[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

[[gnu::always_inline]] inline NoisePlace chosen(VecI which, const NoisePlace& a,
                                                const NoisePlace& b) {
  return {select(which, a.u, b.u),
          select(which, a.v, b.v),
          select(which, a.inverse_depth, b.inverse_depth),
          select(which, a.footprint, b.footprint),
          {select(which, a.ray[0], b.ray[0]), select(which, a.ray[1], b.ray[1]),
           select(which, a.ray[2], b.ray[2])},
          select(which, a.camera, b.camera)};
}

/// Writes what a unit of volume does: to the volume, the force and the torque.
template <class Element>
[[gnu::always_inline]] inline void set_changes(const Element& e, const Gradient3<VecF>& n,
                                               VecF (&change)[kNumChanges]) {
  const VecF changes[kNumChanges] = {splat(1.0f),
                                     n.x,
                                     n.y,
                                     n.z,
                                     e.ly * n.z - e.lz * n.y,
                                     e.lz * n.x - e.lx * n.z,
                                     e.lx * n.y - e.ly * n.x};
  for (int k = 0; k < kNumChanges; ++k) change[k] = changes[k];
}

/// Keeps the elements of one group, in the order of their slots.
class NoiseWriter {
 public:
  NoiseWriter(const NoiseRows& to, int group) : to_(to) {
    if (!wants()) return;
    to_.first += first_noise_row(group);
    to_.num += group;
  }

  bool wants() const { return to_.num != nullptr; }
  /// Keeps a vector of elements, of which some touch: the others have no volume and no disc, the
  /// decrease of the volume by the field.
  template <class Element>
  [[gnu::always_inline]] void keep(const Element& e, const NoisePlace& at, VecF volume, VecF disc,
                                   const Gradient3<VecF>& n) {
    VecF change[kNumChanges];
    set_changes(e, n, change);
    for (VecF& each : change) each *= disc;
    keep(e, at, volume, change, n);
  }
  /// The same with all decreases by the field.
  template <class Element>
  [[gnu::always_inline]] void keep(const Element& e, const NoisePlace& at, VecF volume,
                                   const VecF (&change)[kNumChanges], const Gradient3<VecF>& n) {
    const VecF slope = -(n.x * at.ray[0] + n.y * at.ray[1] + n.z * at.ray[2]);
    const VecF numbers[] = {
        at.u, at.v, at.inverse_depth, at.footprint, volume * slope, n.x, n.y, n.z, e.lx,
        e.ly, e.lz, at.camera};
    float* to = to_.first + next_;
    for (const VecF& each : numbers) {
      store(to, each);
      to += to_.apart;
    }
    for (const VecF& each : change) {
      store(to, -slope * each);
      to += to_.apart;
    }
    next_ += kLanes;
  }
  void finish() const {
    if (wants()) *to_.num = static_cast<int>(next_);
  }

 private:
  NoiseRows to_;
  std::ptrdiff_t next_ = 0;
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
