// A query of a depth field by one element: of the levels of its size, and of wider spheres where it
// lies deep. By a thread of a GPU, or in double precision; vectors have an order of work of their
// own (src/contact/field/packed_samples.h).
#pragma once

#include "src/field/internal/field_sampler.h"

namespace palpate { inline namespace v0 {

/// Levels of an element and of the wider spheres around it, one after another: their footprints are
/// m 2^e with one m.
template <class Lane, class Real>
struct LevelSteps {
  LevelChoice<Lane> levels;
  std::int32_t exponent;

  PALPATE_FORMULA LevelSteps(const FieldGrid& grid, Real radius, Real inverse_depth) {
    const Real footprint = kFootprint * radius * grid.fx * inverse_depth;
    exponent = Lane::exponent(footprint);
    const Real m = footprint * Lane::inverse_power(exponent);
    levels.x = (m - 1.0f) * (1.0f / (kBlendEnd - 1));
    levels.x_by_z = m * inverse_depth * (-1.0f / (kBlendEnd - 1));
    levels.step = smooth_step(levels.x);
    set(grid.last_level);
  }
  /// Goes on to a wider sphere.
  PALPATE_FORMULA void go_on(const FieldGrid& grid, std::int32_t num) {
    static_assert(kDeepGrowth == 4);
    exponent += 2 * num;
    set(grid.last_level);
  }

 private:
  PALPATE_FORMULA void set(std::int32_t last) {
    const bool is_next = levels.step.value >= Real{} + 1.0f;
    const std::int32_t own = exponent + static_cast<std::int32_t>(is_next);
    levels.is_single = is_next | (exponent < 0) | (exponent >= last);
    levels.level = exponent < 0 ? 0 : (own < last ? own : last);
    levels.wider = levels.level < last ? levels.level + 1 : last;
  }
};

/// Joins the samples of an element of this radius and of wider spheres, as many as it needs:
/// sample(k) is that of the k-th.
template <class Sample, class Real, class SampleOf>
PALPATE_FORMULA Sample deepest(Real radius, const SampleOf& sample) {
  Sample answer{};
  Real requested = radius;
#ifdef __CUDA_ARCH__
#pragma unroll 1
#endif
  for (int step = 0;; ++step) {
    const Sample here = sample(step);
    if (step > 0) {
      const Real finer = requested * (1.0f / kDeepGrowth);
      answer = deepened(answer, here, first_of(answer).phi, first_of(here).phi, finer);
    } else {
      answer = here;
    }
    if (step == kMaxDeepSteps || !(first_of(answer).phi < -deep_limit(requested))) break;
    requested *= kDeepGrowth;
  }
  return answer;
}

/// Samples an element at (u, v) by the levels of one of its spheres.
template <class Sample, class Lane, class Real>
PALPATE_FORMULA Sample query_steps(const FieldGrid& grid, const FieldPixels& pixels, Real u, Real v,
                                   Real depth, Real inverse_depth,
                                   const LevelSteps<Lane, Real>& steps) {
  PixelLook<Lane> look;
  look.u = u;
  look.v = v;
  look.levels = steps.levels;
  look.has_wider = steps.levels.blend() > Real{};
  return query_field<Sample>(grid, pixels, look, depth, inverse_depth);
}

/// Samples one element of this radius at (u, v), and wider pixels if it lies deep.
template <class Lane, class Sample, class Real>
PALPATE_FORMULA Sample query_deep(const FieldGrid& grid, const FieldPixels& pixels, Real u, Real v,
                                  Real depth, Real inverse_depth, Real radius) {
  LevelSteps<Lane, Real> steps(grid, radius, inverse_depth);
  return deepest<Sample>(radius, [&](int step) {
    if (step > 0) steps.go_on(grid, 1);
    return query_steps<Sample>(grid, pixels, u, v, depth, inverse_depth, steps);
  });
}

}}  // namespace palpate::v0
