// The least depth that an image shows around balls, a ball in each lane: whatever is nearer to a
// ball than its distance to that depth would show there. Included by kernel files only.
#pragma once

#include "src/contact/clearance/search/image_search.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

// The pixels of one axis that show balls, as far as they are in the image.
struct PixelRange {
  VecI first, last, is_any;
  VecF width;
};
PALPATE_LANE_INLINE PixelRange pixels_of(VecF x, VecF reach, VecF near_scale, VecF far_scale,
                                         float focal, float center, std::int32_t size) {
  const VecF low = focal * (x - reach) * select(x < reach, near_scale, far_scale) + (center - 1);
  const VecF high = focal * (x + reach) * select(x > -reach, near_scale, far_scale) + (center + 1);
  const VecF most = splat(static_cast<float>(size - 1));
  const VecF first = min(max(low, VecF{}), most), last = min(max(high, VecF{}), most);
  return {to_int(first), to_int(last), (low < most + 1.0f) & (high >= VecF{}), last - first};
}

// Returns the least depth of pixels that show balls; kFarAway where none do.
PALPATE_LANE_CODE inline VecF depth_around(const Image& image, const CameraPoint<VecF>& at,
                                           VecF reach) {
  const DepthWindows& windows = image.windows;
  const VecF near = at.z - reach, far = at.z + reach;
  const VecI is_before = near > splat(0.005f);
  const VecF near_scale = 1.0f / select(is_before, near, splat(1.0f));
  const VecF far_scale = 1.0f / select(is_before, far, splat(1.0f));
  const PixelRange u =
      pixels_of(at.x, reach, near_scale, far_scale, image.fx, image.cx, image.width);
  const PixelRange v =
      pixels_of(at.y, reach, near_scale, far_scale, image.fy, image.cy, image.height);
  // The first level of which two windows cover them: the exponent, rounded up.
  constexpr float kMaxPixels = DepthWindows::kMaxSteps * DepthWindows::kStep;
  const VecF steps = (max(u.width, v.width) + 1.0f) * (1 / kMaxPixels);
  VecI level = ((bits_of(steps) + -1) >> 23) + -126;
  level = select(level > VecI{}, level, VecI{});
  const VecI is_covered = level < splat(windows.num_levels);
  level = select(is_covered, level, VecI{});
  const VecI from = pick(windows.first, level), wide = pick(windows.wide, level);
  const VecI shift = level + 2;
  const auto other = [&](VecI one, VecI last) {
    const VecI at_end = (last >> shift) + -3;
    return select(at_end > one, at_end, one);
  };
  const VecI left = u.first >> shift, right = other(left, u.last);
  const VecI row = v.first >> shift;
  const VecI top = from + row * wide, bottom = from + other(row, v.last) * wide;
  const VecF depth =
      min(min(gather(windows.nearest, top + left), gather(windows.nearest, top + right)),
          min(gather(windows.nearest, bottom + left), gather(windows.nearest, bottom + right)));
  const VecI is_seen = select(is_before, u.is_any & v.is_any, far >= VecF{});
  const VecF of_all = splat(windows.whole >= 0 ? windows.nearest[windows.whole] : 0.0f);
  return select(is_seen, select(is_before & is_covered, depth, of_all), splat(kFarAway));
}

// Bounds the clearance of all spheres in balls, up to `most`: all that can be seen there is farther
// away. A ball whose middle is behind something has no bound: a number far below 0, for the order.
PALPATE_LANE_CODE inline VecF bound_around(const Image& image, const CameraPoint<VecF>& at,
                                           VecF radius, VecF most) {
  constexpr float kNoBound = -1e3f;
  if (image.windows.nearest == nullptr) return splat(kNoBound);
  const VecF reach = max((radius + most) * 1.0001f, VecF{});
  const VecF slack = 1e-5f * (abs(at.z) + reach) + 1e-6f;
  const VecF before = depth_around(image, at, reach) - at.z - slack;
  const VecF bound = before - radius;
  return min(most, select(before > VecF{}, bound, bound + kNoBound));
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
