// Keeps what vectors of elements tell of the noise (noise_rows.h). Included by kernel files only.
#pragma once

#include "src/contact/field/field_answers.h"
#include "src/contact/noise/noise_element.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

using NoisePlace = NoisePlaceOf<VecF>;

/// Returns the places in a camera whose frame has the rotation R_WC.
[[gnu::always_inline]] inline NoisePlace noise_place(const FieldFrame& frame, const Lanes& e,
                                                     const float (&R_WC)[3][3], int camera) {
  return palpate::noise_place(frame, e.from_u, e.from_v, e.inverse_depth, e.radius, R_WC, camera);
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
    set_changes(Gradient3<VecF>{e.lx, e.ly, e.lz}, n, change);
    for (VecF& each : change) each *= disc;
    keep(e, at, volume, change, n);
  }
  /// The same with all decreases by the field.
  template <class Element>
  [[gnu::always_inline]] void keep(const Element& e, const NoisePlace& at, VecF volume,
                                   const VecF (&change)[kNumChanges], const Gradient3<VecF>& n) {
    float* const to = to_.first + next_;
    put_numbers(at, Gradient3<VecF>{e.lx, e.ly, e.lz}, n, volume, change,
                [&](int row, const VecF& number) { store(to + row * to_.apart, number); });
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
