// Values of depth fields for a vector of elements. Included by kernel files only.
#pragma once

#include "src/contact/field/field_lanes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

using Gradient = ImageGradient<VecF>;
using Curvature = ImageCurvature<VecF>;

inline constexpr int kNumVectors = kSize / kLanes;  // of a cluster

// Positions of a vector of elements.
struct Lanes {
  VecF lx, ly, lz;      // from C, in W
  VecF from_u, from_v;  // pixels of level 0 from the principal point
  VecF depth, inverse_depth, radius;
};

[[gnu::always_inline]] inline Lanes aim(const ElementRows& elements, const FieldFrame& frame,
                                        const Grid& grid, std::size_t slot) {
  const VecF x_T = load(elements.x + slot), y_T = load(elements.y + slot),
             z_T = load(elements.z + slot);
  const auto rotated = [&](const float(&row)[3]) {
    return row[0] * x_T + row[1] * y_T + row[2] * z_T;
  };
  Lanes e;
  e.lx = rotated(frame.R_WT[0]);
  e.ly = rotated(frame.R_WT[1]);
  e.lz = rotated(frame.R_WT[2]);
  e.depth = max(e.lz + frame.p_WC[2], splat(kMinDepth));
  e.inverse_depth = 1.0f / e.depth;
  e.from_u = grid.fx * (e.lx + frame.p_WC[0]) * e.inverse_depth;
  e.from_v = grid.fy * (e.ly + frame.p_WC[1]) * e.inverse_depth;
  e.radius = load(elements.radius + slot);
  return e;
}

[[gnu::always_inline]] inline Look look_of(const Grid& grid, const Lanes& e, VecF radius) {
  return look_at<Vectors>(grid, e.from_u + grid.cx, e.from_v + grid.cy, e.inverse_depth, radius);
}

// Values of the fields for a vector of elements.
template <class Sample, int kFields>
struct Answer {
  Sample samples[kFields];
  VecI is_touching[kFields];  // before the camera and nearer to the surface than a radius

  [[gnu::always_inline]] bool is_free() const {
    VecI any = is_touching[0];
    for (int k = 1; k < kFields; ++k) any |= is_touching[k];
    return mask_bits(any) == 0;
  }
};

// Samples wider pixels, too, for deep elements.
template <class Sample, int kFields>
[[gnu::always_inline]] inline void query_deeper(const Grid& grid, const Pixels (&fields)[kFields],
                                                const Lanes& e, Answer<Sample, kFields>& answer) {
  VecF requested = e.radius;
  for (int step = 0; step < kMaxDeepSteps; ++step) {
    VecI is_deep[kFields], any{};
    for (int k = 0; k < kFields; ++k) {
      is_deep[k] =
          answer.is_touching[k] & (first_of(answer.samples[k]).phi < -deep_limit(requested));
      any |= is_deep[k];
    }
    if (mask_bits(any) == 0) break;
    const Look look = look_of(grid, e, requested * kDeepGrowth);
    for (int k = 0; k < kFields; ++k) {
      if (kFields > 1 && mask_bits(is_deep[k]) == 0) continue;
      Sample& known = answer.samples[k];
      Sample wide = query_field<Sample>(grid, fields[k], look, e.depth, e.inverse_depth);
      known =
          chosen(is_deep[k],
                 deepened(known, wide, first_of(known).phi, first_of(wide).phi, requested), known);
    }
    requested *= kDeepGrowth;
  }
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
