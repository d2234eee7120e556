// Samples of a depth field by many elements, in full vectors. Elements beside each other differ:
// some are near silhouettes, some lie between two levels, some are deep. So what is dear is packed
// first: lists of elements that sample one level each, those near silhouettes apart from those that
// need planes alone. Every answer goes back to its own element, with the bits that it has in any
// other company. Included by kernel files only.
#pragma once

#include "src/contact/field/field_answers.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// Elements that sample one level each, without gaps between them, and their samples.
template <class Sample, int kMax>
class SampleList {
 public:
  [[gnu::always_inline]] void add(const PixelSpot<Vectors>& at, VecI level, VecF depth,
                                  std::uint32_t bits) {
    compress_store(&pixel_[num_], at.pixel, bits);
    compress_store(&level_[num_], level, bits);
    const VecF numbers[] = {at.s, at.t, depth};
    for (int k = 0; k < 3; ++k) compress_store(&numbers_[k][num_], numbers[k], bits);
    num_ += __builtin_popcount(bits);
  }
  /// Calls f(spot, level, depth) for full vectors of them.
  template <class F>
  [[gnu::always_inline]] void sample(const F& f) {
    if (num_ % kLanes != 0) {  // the last vector has only valid pixels
      store(&pixel_[num_], splat(pixel_[0]));
      store(&level_[num_], splat(level_[0]));
      for (float(&row)[kSlots] : numbers_) store(&row[num_], splat(row[0]));
    }
    for (int i = 0; i < num_; i += kLanes) {
      const VecF depth = load(&numbers_[2][i]);
      const PixelSpot<Vectors> at{load(&pixel_[i]), load(&numbers_[0][i]), load(&numbers_[1][i])};
      const Sample sample = f(at, load(&level_[i]), depth);
      const VecF* const numbers = reinterpret_cast<const VecF*>(&sample);
      for (int k = 0; k < kNumbers; ++k) store(&samples_[k][i], numbers[k]);
    }
  }
  /// Puts the samples of the next elements to their places; call it in the order of add.
  [[gnu::always_inline]] void take(std::uint32_t bits, Sample& to) {
    if (bits == 0) return;
    VecF* const numbers = reinterpret_cast<VecF*>(&to);
    for (int k = 0; k < kNumbers; ++k) expand_load(&samples_[k][taken_], bits, numbers[k]);
    taken_ += __builtin_popcount(bits);
  }

 private:
  static constexpr int kSlots = kMax + kLanes, kNumbers = sizeof(Sample) / sizeof(VecF);

  int num_ = 0, taken_ = 0;
  alignas(64) std::int32_t pixel_[kSlots], level_[kSlots];
  alignas(64) float numbers_[3][kSlots], samples_[kNumbers][kSlots];
};

/// Samples a field for `num` of at most kMaxVectors vectors of elements, those in `which`, with
/// radii that are `growth` times theirs.
template <int kMaxVectors, class Sample>
[[gnu::always_inline]] inline void sample_together(const Grid& grid, const Pixels& pixels,
                                                   const Lanes* elements, const VecI* which,
                                                   int num, float growth, Sample* to) {
  if constexpr (kMaxVectors == 1) {  // nothing to pack
    const Lanes& e = *elements;
    const Look look = look_of(grid, e, growth * e.radius);
    *to = sample_level<Vectors, Sample>(grid, pixels, look.own, look.levels.level, e.depth);
    if (!look.has_wider) return;
    const Sample next =
        sample_level<Vectors, Sample>(grid, pixels, look.wider, look.levels.wider, e.depth);
    *to = with_wider(*to, next, look.levels, e.inverse_depth);
    return;
  }
  SampleList<Sample, 2 * kMaxVectors * kLanes> smooth, near;
  struct Packed {
    LevelChoice<Vectors> levels;
    std::uint32_t smooth, near, wider_smooth, wider_near;
  } packed[kMaxVectors];
  std::uint32_t are_packed = 0;  // bits of vectors
  const auto sample_smooth = [&](const PixelSpot<Vectors>& at, VecI level, VecF depth)
      __attribute__((always_inline)) {
    return sample_level<Vectors, Sample>(grid, pixels, at, level, depth, VecI{}, true);
  };
  for (int i = 0; i < num; ++i) {
    const std::uint32_t bits = mask_bits(which[i]);
    if (bits == 0) continue;
    const Lanes& e = elements[i];
    const Look look = look_of(grid, e, growth * e.radius);
    const std::uint32_t wider = bits & mask_bits(look.levels.blend() > VecF{});
    const std::uint32_t is_near = mask_bits(Vectors::is_near_silhouette(pixels, look.own.pixel));
    const std::uint32_t is_wider_near =
        wider == 0 ? 0 : mask_bits(Vectors::is_near_silhouette(pixels, look.wider.pixel));
    if ((is_near | is_wider_near) == 0) {
      to[i] = sample_smooth(look.own, look.levels.level, e.depth);
      if (wider == 0) continue;
      to[i] = with_wider(to[i], sample_smooth(look.wider, look.levels.wider, e.depth), look.levels,
                         e.inverse_depth);
      continue;
    }
    are_packed |= 1u << i;
    Packed& at = packed[i];
    at.levels = look.levels;
    at.near = bits & is_near;
    at.smooth = bits & ~is_near;
    at.wider_near = wider & is_wider_near;
    at.wider_smooth = wider & ~is_wider_near;
    smooth.add(look.own, look.levels.level, e.depth, at.smooth);
    near.add(look.own, look.levels.level, e.depth, at.near);
    if (wider == 0) continue;
    smooth.add(look.wider, look.levels.wider, e.depth, at.wider_smooth);
    near.add(look.wider, look.levels.wider, e.depth, at.wider_near);
  }
  if (are_packed == 0) return;
  smooth.sample(sample_smooth);
  near.sample([&](const PixelSpot<Vectors>& at, VecI level, VecF depth) {
    return sample_by_call<Vectors, Sample>(grid, pixels, at, level, depth, splat(-1));
  });
  for (; are_packed != 0; are_packed &= are_packed - 1) {
    const int i = __builtin_ctz(are_packed);
    const Packed& at = packed[i];
    smooth.take(at.smooth, to[i]);
    near.take(at.near, to[i]);
    if ((at.wider_smooth | at.wider_near) == 0) continue;
    Sample next = to[i];
    smooth.take(at.wider_smooth, next);
    near.take(at.wider_near, next);
    to[i] = with_wider(to[i], next, at.levels, elements[i].inverse_depth);
  }
}

/// Samples wider pixels, too, for those in `which` that lie deep.
template <int kMaxVectors, class Sample>
[[gnu::always_inline]] inline void deepen_together(const Grid& grid, const Pixels& pixels,
                                                   const Lanes* elements, const VecI* which,
                                                   int num, Sample* known) {
  VecI is_deep[kMaxVectors];
  Sample wide[kMaxVectors];
  float growth = 1;
  for (int step = 0; step < kMaxDeepSteps; ++step) {
    VecI any{};
    for (int i = 0; i < num; ++i) {
      is_deep[i] = which[i] & (first_of(known[i]).phi < -deep_limit(growth * elements[i].radius));
      any |= is_deep[i];
    }
    if (mask_bits(any) == 0) return;
    sample_together<kMaxVectors>(grid, pixels, elements, is_deep, num, kDeepGrowth * growth, wide);
    for (int i = 0; i < num; ++i) {
      if (mask_bits(is_deep[i]) == 0) continue;
      const Sample deeper = deepened(known[i], wide[i], first_of(known[i]).phi,
                                     first_of(wide[i]).phi, growth * elements[i].radius);
      known[i] = chosen(is_deep[i], deeper, known[i]);
    }
    growth *= kDeepGrowth;
  }
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
