// The hull for the elements of a cluster, packed into full vectors once a camera has seen which of
// them are free. Included by hull_kernel.cpp only.
#pragma once

#include <bit>
#include <cstring>
#include <utility>

#include "src/contact/hull/hull_joins.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

template <class Sample>
class ClusterHull : public Hull<Sample> {
  using Base = Hull<Sample>;
  using Base::answers_;
  using Base::freed_by_;
  using Base::is_between_;
  using Base::is_free_;
  using Base::join;
  using Base::look;
  using Base::look_on;
  using Base::nowhere;
  using Base::rows_;
  using Base::shallowest_;
  using Base::start;
  using typename Base::Space;

 public:
  using Base::Base;
  using Base::joined;

  // Evaluates the elements of a cluster that are no parts of a ball, and calls f(number) for each
  // vector of them unless some camera sees that all are free. Those that the first camera does not
  // see to be free are packed into full vectors for the others, if that saves one: no element's
  // value depends on its neighbors. Then their places are not known.
  template <class F>
  void evaluate_cluster(std::size_t first_slot, bool may_pack, const F& f) {
    const int first = freed_by_;
    std::uint32_t near[kNumVectors];
    int num = 0, num_vectors = 0;
    for (int i = 0; i < kNumVectors; ++i) {
      start(first_slot + static_cast<std::size_t>(i * kLanes), false, i);
      near[i] =
          look(first_slot + static_cast<std::size_t>(i * kLanes), first) ? mask_bits(~is_free_) : 0;
      num += std::popcount(near[i]);
      num_vectors += near[i] != 0;
      if (near[i] != 0) first_looks_[i] = {answers_[first], is_free_, shallowest_};
    }
    if (may_pack && (num + kLanes - 1) / kLanes < num_vectors) {
      return evaluate_packed(first_slot, near, f);
    }
    for (int i = 0; i < kNumVectors; ++i) {
      if (near[i] == 0) continue;
      const auto slot = first_slot + static_cast<std::size_t>(i * kLanes);
      start(slot, false, i);
      answers_[first] = first_looks_[i].answer;
      is_free_ = first_looks_[i].is_free;
      shallowest_ = first_looks_[i].shallowest;
      is_between_ = this->eyes_[first].num_fields > 1;
      if (!look_on(slot, first)) continue;
      join(slot);
      f(i);
    }
  }

 private:
  // First samples of the camera that is asked first.
  struct FirstLook {
    EyeAnswer<Sample> answer;
    VecI is_free;
    VecF shallowest;
  };
  // Values of elements of a cluster, and the elements that are packed.
  struct alignas(kLanes * 4) PackedRows {
    static constexpr int kNumbers = sizeof(Space) / sizeof(VecF);
    float x[kSize], y[kSize], z[kSize], radius[kSize];
    float space[kNumbers][kSize], seen_phi[kSize];
    std::int32_t decider[kSize];
  };

  // Evaluates the elements whose bits are set.
  template <class F>
  void evaluate_packed(std::size_t first_slot, const std::uint32_t (&near)[kNumVectors],
                       const F& f) {
    PackedRows packed, all;
    int places[kSize + kLanes], num = 0;
    for (int i = 0; i < kNumVectors; ++i) {
      for (std::uint32_t bits = near[i]; bits != 0; bits &= bits - 1) {
        places[num++] = i * kLanes + std::countr_zero(bits);
      }
    }
    const int num_used = num;
    while (num % kLanes != 0) places[num++] = places[0];
    for (int n = 0; n < num; ++n) {
      const auto slot = first_slot + static_cast<std::size_t>(places[n]);
      packed.x[n] = rows_.x[slot];
      packed.y[n] = rows_.y[slot];
      packed.z[n] = rows_.z[slot];
      packed.radius[n] = rows_.radius[slot];
    }
    std::uint32_t touching[kNumVectors] = {};
    const ElementRows rows = std::exchange(
        rows_, ElementRows{packed.x, packed.y, packed.z, packed.radius, nullptr, nullptr});
    for (int begin = 0; begin < num; begin += kLanes) {
      if (!this->evaluate(static_cast<std::size_t>(begin), false, 0)) continue;
      store_joined(packed, begin);
      const int end = begin + kLanes < num_used ? begin + kLanes : num_used;
      for (int n = begin; n < end; ++n) {
        const int place = places[n];
        touching[place / kLanes] |= 1u << place % kLanes;
        for (int k = 0; k < PackedRows::kNumbers; ++k) all.space[k][place] = packed.space[k][n];
        all.seen_phi[place] = packed.seen_phi[n];
        all.decider[place] = packed.decider[n];
      }
    }
    rows_ = rows;
    for (int i = 0; i < kNumVectors; ++i) {
      if (touching[i] == 0) continue;
      start(first_slot + static_cast<std::size_t>(i * kLanes), false, i);
      load_joined(all, i * kLanes, lanes_of(touching[i]));
      f(i);
    }
  }
  void store_joined(PackedRows& to, int begin) const {
    VecF numbers[PackedRows::kNumbers];
    std::memcpy(numbers, &joined.hull, sizeof numbers);
    for (int k = 0; k < PackedRows::kNumbers; ++k) store(to.space[k] + begin, numbers[k]);
    store(to.seen_phi + begin, joined.seen_phi);
    store(to.decider + begin, joined.decider);
  }
  // Loads the values of elements that were evaluated; the others are free.
  void load_joined(const PackedRows& from, int begin, VecI which) {
    Space space;
    VecF numbers[PackedRows::kNumbers];
    for (int k = 0; k < PackedRows::kNumbers; ++k) numbers[k] = load(from.space[k] + begin);
    std::memcpy(&space, numbers, sizeof numbers);
    joined.hull = chosen(which, space, nowhere());
    joined.seen_phi = select(which, load(from.seen_phi + begin), first_of(nowhere()).phi);
    joined.decider = which ? load(from.decider + begin) : VecI{};
  }
  static VecI lanes_of(std::uint32_t bits) {
    return ((splat(static_cast<std::int32_t>(bits)) >> lane_ids()) & 1) != 0;
  }

  FirstLook first_looks_[kNumVectors];
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
