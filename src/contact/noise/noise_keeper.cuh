// Numbers of the elements that touch, kept by the warps of a GPU that sample them: each writes its
// own part of the rows (noise_rows.h), one element after the other.
#pragma once

#include "src/contact/noise/noise_element.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 { namespace {

/// Keeps nothing: nobody asked.
struct NoNoise {
  static constexpr bool kWants = false;
  template <class Look>
  __device__ void look(const FieldFrame&, const Look&, float) {}
  __device__ void note(const float (&)[3], float, float, const Gradient3<float>&) {}
  __device__ void keep() {}
};

class NoiseKeeper {
 public:
  static constexpr bool kWants = true;

  /// Writes part `part` of the rows.
  __device__ NoiseKeeper(const KeptRows& kept, int part) : rows_(kept.rows), part_(part) {
    rows_.first += part * kept.capacity;
  }

  /// Notes where a camera sees the next element of this lane; see noise_place.
  template <class Look>
  __device__ void look(const FieldFrame& frame, const Look& at, float radius,
                       const float (&R_WC)[3][3], int camera) {
    place_ = noise_place(frame, at.from_u, at.from_v, at.inverse_depth, radius, R_WC, camera);
  }
  /// The same of a camera that defines W.
  template <class Look>
  __device__ void look(const FieldFrame& frame, const Look& at, float radius) {
    const float not_turned[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    look(frame, at, radius, not_turned, 0);
  }
  /// Notes that no camera decides it.
  __device__ void look_away() { place_ = {}; }
  /// Notes the element: its volume shrinks by `disc` with the field.
  __device__ void note(const float (&lever)[3], float volume, float disc,
                       const Gradient3<float>& n) {
    const Gradient3<float> l{lever[0], lever[1], lever[2]};
    float change[kNumChanges];
    set_changes(l, n, change);
    for (float& each : change) each *= disc;
    note(l, volume, change, n);
  }
  /// The same with all decreases by the field.
  __device__ void note(const Gradient3<float>& lever, float volume,
                       const float (&by_field)[kNumChanges], const Gradient3<float>& n) {
    put_numbers(place_, lever, n, volume, by_field,
                [&](int row, float number) { numbers_[row] = number; });
    is_noted_ = numbers_[static_cast<int>(NoiseRow::change)] != 0 ||
                numbers_[static_cast<int>(NoiseRow::volume)] != 0;
  }
  /// Keeps what the lanes have noted. The whole warp calls.
  __device__ void keep() {
    const unsigned noted = __ballot_sync(gpu::kWholeWarp, is_noted_);
    if (is_noted_) {
      const unsigned before = noted & ((1u << gpu::lane_id()) - 1);
      float* const to = rows_.first + num_ + __popc(before);
#pragma unroll
      for (int k = 0; k < kNumNoiseRows; ++k) to[k * rows_.apart] = numbers_[k];
    }
    num_ += __popc(noted);
    is_noted_ = false;
  }
  /// Ends the part. The whole warp calls.
  __device__ void finish() const {
    if (gpu::lane_id() == 0) rows_.num[part_] = num_;
  }

 private:
  NoiseRows rows_;
  int part_, num_ = 0;
  NoisePlaceOf<float> place_{};
  float numbers_[kNumNoiseRows] = {};
  bool is_noted_ = false;
};

}}}  // namespace palpate::v0
