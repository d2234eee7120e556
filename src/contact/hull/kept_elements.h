// Elements of a group that no camera is known to see free, packed into full vectors, and their
// joined values, which go back to their own places. Included by hull_joins.h only.
#pragma once

#include "src/contact/hull/hull_eyes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

template <class Sample>
class KeptElements {
 public:
  using Joined = JoinedViews<InSpace<Sample>, VecF, VecI>;
  using Samples = Sample[2][kNumVectors];  // by moment

  /// Begins with none, of slots from `first_slot` on.
  void begin(std::size_t first_slot) {
    first_slot_ = first_slot;
    num_ = 0;
  }
  /// Adds lanes of a vector of elements; values above `enough` are free.
  void add(const ElementRows& from, std::size_t slot, VecF enough, std::uint32_t bits) {
    const auto first = static_cast<std::int32_t>(slot - first_slot_);
    const VecF numbers[kFirst] = {load(from.x + slot), load(from.y + slot), load(from.z + slot),
                                  load(from.radius + slot), enough};
    compress_store(&places_[num_], lane_ids() + first, bits);
    put(numbers, 0, num_, bits);
    num_ += __builtin_popcount(bits);
  }
  /// Adds lanes of a vector of others, with their value so far and their samples by a camera.
  void add(const KeptElements& from, int place, VecF shallowest, const Samples& samples, int i,
           int num_moments, std::uint32_t bits) {
    if (bits == 0) return;
    VecF numbers[kFirst + 1];
    for (int k = 0; k < kFirst; ++k) numbers[k] = load(&from.rows_[k][place]);
    numbers[kFirst] = shallowest;
    compress_store(&places_[num_], load(&from.places_[place]), bits);
    put(numbers, 0, num_, bits);
    for (int f = 0; f < num_moments; ++f) put(samples[f][i], row_of(f), num_, bits);
    num_ += __builtin_popcount(bits);
  }

  /// Fills the last vector, and returns all as elements.
  ElementRows rows() {
    for (int k = 0; k < kFirst; ++k) store(&rows_[k][num_], splat(rows_[k][0]));
    return {rows_[0], rows_[1], rows_[2], rows_[3], nullptr, nullptr};
  }
  int num_vectors() const { return (num_ + kLanes - 1) / kLanes; }
  VecI is_beyond(int place) const { return lane_ids() + place >= splat(num_); }
  VecF enough(int place) const { return load(&rows_[kFirst - 1][place]); }
  VecF shallowest(int place) const { return load(&rows_[kFirst][place]); }
  void read(int place, Samples& samples, int i, int num_moments) const {
    for (int f = 0; f < num_moments; ++f) {
      VecF* const numbers = reinterpret_cast<VecF*>(&samples[f][i]);
      for (int k = 0; k < kNumbers; ++k) numbers[k] = load(&rows_[row_of(f) + k][place]);
    }
  }

  /// Replaces the vector at a place by its joined values.
  void set(int place, const Joined& joined) { put(joined, 0, place, kAllLanes); }
  /// Finds the slots of all; call it when all are set.
  void finish() {
    for (std::uint32_t& lanes : lanes_) lanes = 0;
    for (int i = 0; i < num_; ++i) lanes_[places_[i] / kLanes] |= 1u << places_[i] % kLanes;
    taken_ = 0;
  }
  /// Returns the lanes of a vector that are kept.
  std::uint32_t lanes(std::size_t slot) const { return lanes_[(slot - first_slot_) / kLanes]; }
  /// Puts the joined values of these lanes into it; the others stay as they are. Call it for one
  /// slot after the other.
  void take(std::size_t slot, Joined& to) {
    VecF* const numbers = reinterpret_cast<VecF*>(&to);
    for (std::size_t k = 0; k < sizeof to / sizeof(VecF); ++k) {
      expand_load(&rows_[k][taken_], lanes(slot), numbers[k]);
    }
    taken_ += __builtin_popcount(lanes(slot));
  }

 private:
  static constexpr int kMax = SphereClusters::kClustersPerGroup * kSize, kSlots = kMax + kLanes;
  static constexpr int kNumbers = sizeof(Sample) / sizeof(VecF), kFirst = 5;
  static constexpr int row_of(int moment) { return kFirst + 1 + moment * kNumbers; }
  static_assert(sizeof(Joined) / sizeof(VecF) <= row_of(2));

  template <class Numbers>
  [[gnu::always_inline]] void put(const Numbers& from, int row, int place, std::uint32_t bits) {
    const VecF* const numbers = reinterpret_cast<const VecF*>(&from);
    for (std::size_t k = 0; k < sizeof from / sizeof(VecF); ++k) {
      compress_store(&rows_[static_cast<std::size_t>(row) + k][place], numbers[k], bits);
    }
  }

  std::size_t first_slot_ = 0;
  int num_ = 0, taken_ = 0;
  std::uint32_t lanes_[kMax / kLanes];
  alignas(64) std::int32_t places_[kSlots];
  alignas(64) float rows_[row_of(2)][kSlots];
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
