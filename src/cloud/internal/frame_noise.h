// The noise of a frame by scale, as its surface carries it: of cells 2^k pixels wide, the standard
// deviation of what the next wider cells do not tell, base + growth z^2 in meters at depth z.
#pragma once

#include "palpate/cloud/depth_noise.h"
#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

inline constexpr int kNumNoiseLevels = 7;
/// Share of white noise that the next wider cells do not tell.
inline constexpr double kDetailShare = 0.78;

struct FrameNoise {
  float base[kNumNoiseLevels] = {}, growth[kNumNoiseLevels] = {};
  bool is_whole = false;  ///< shape has no part in it, and the last level stands for all wider ones

  friend bool operator==(const FrameNoise&, const FrameNoise&) = default;
};

/// Returns the noise by scale of a camera. The mean over a cell of n pixels has the variance of
/// p / (p + n - 1) pixels, if p of them share their noise, and a detail is what the next mean
/// loses.
FrameNoise frame_noise(const MeasurementNoise& noise);

}}  // namespace palpate::v0
