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

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
