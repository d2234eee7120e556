// Elements of a cluster that the first of several cameras does not see to be free, packed into full
// vectors for the other cameras, and the way back. Included by hull_joins.h only.
#pragma once

#include "src/contact/hull/hull_eyes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

template <class Sample>
class KeptElements {
 public:
  using Joined = JoinedViews<InSpace<Sample>, VecF, VecI>;

  /// Begins with the lanes of some vectors. Returns the number of vectors that they fill.
  int begin(std::uint32_t vectors, const VecI* is_free) {
    num_ = taken_ = 0;
    for_each(vectors, [&](int i) {
      lanes_[i] = mask_bits(~is_free[i]);
      num_ += __builtin_popcount(lanes_[i]);
    });
    return (num_ + kLanes - 1) / kLanes;
  }
  /// Packs vector i: its elements, their value so far and its samples at the camera's moments.
  void pack(int i, const ElementRows& rows, std::size_t slot, VecF shallowest,
            const EyeAnswer<Sample>& answer, int num_moments) {
    const VecF numbers[] = {load(rows.x + slot), load(rows.y + slot), load(rows.z + slot),
                            load(rows.radius + slot), shallowest};
    put(numbers, 0, taken_, lanes_[i]);
    for (int f = 0; f < num_moments; ++f) {
      put(answer.samples[f][i], kFirst + f * kNumbers, taken_, lanes_[i]);
    }
    taken_ += __builtin_popcount(lanes_[i]);
  }
  /// Returns them as elements; call it when all are packed.
  ElementRows rows() {
    for (float(&row)[kSlots] : rows_) store(&row[num_], splat(row[0]));
    taken_ = 0;
    return {rows_[0], rows_[1], rows_[2], rows_[3], nullptr, nullptr};
  }
  VecI is_beyond(int i) const { return lane_ids() + i * kLanes >= splat(num_); }
  VecF shallowest(int i) const { return load(&rows_[kFirst - 1][i * kLanes]); }
  void read(int i, EyeAnswer<Sample>& answer, int num_moments) const {
    for (int f = 0; f < num_moments; ++f) {
      VecF* const numbers = reinterpret_cast<VecF*>(&answer.samples[f][i]);
      for (int k = 0; k < kNumbers; ++k) {
        numbers[k] = load(&rows_[kFirst + f * kNumbers + k][i * kLanes]);
      }
    }
  }

  /// Keeps the joined values of packed vector i.
  void keep(int i, const Joined& joined) { put(joined, 0, i * kLanes, (1u << kLanes) - 1); }
  /// Puts them back to a vector, one after the other; other lanes stay as they are.
  void unpack(int i, Joined& to) {
    VecF* const numbers = reinterpret_cast<VecF*>(&to);
    for (std::size_t k = 0; k < sizeof to / sizeof(VecF); ++k) {
      expand_load(&rows_[k][taken_], lanes_[i], numbers[k]);
    }
    taken_ += __builtin_popcount(lanes_[i]);
  }

 private:
  static constexpr int kSlots = kSize + kLanes, kNumbers = sizeof(Sample) / sizeof(VecF);
  static constexpr int kFirst = 5;  // row of the samples
  static_assert(sizeof(Joined) / sizeof(VecF) <= kFirst + 2 * kNumbers);

  template <class Numbers>
  [[gnu::always_inline]] void put(const Numbers& from, int row, int place, std::uint32_t bits) {
    const VecF* const numbers = reinterpret_cast<const VecF*>(&from);
    for (std::size_t k = 0; k < sizeof from / sizeof(VecF); ++k) {
      compress_store(&rows_[static_cast<std::size_t>(row) + k][place], numbers[k], bits);
    }
  }

  int num_ = 0, taken_ = 0;
  std::uint32_t lanes_[kNumVectors];
  alignas(64) float rows_[kFirst + 2 * kNumbers][kSlots];
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
