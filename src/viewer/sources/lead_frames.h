// The earlier frames that the surface of a depth frame depends on.
#pragma once

#include <algorithm>
#include <cmath>

#include "palpate/field/sensor.h"

namespace palpate { inline namespace v0 {

inline constexpr int kMaxLeadFrames = 128;

/// Returns the number of earlier frames that a surface is blended with or predicted from.
inline int num_blended_frames(const TimeOptions& time) {
  return time.mode == TimeMode::latest ? 0 : time.mode == TimeMode::interpolate ? 1 : 2;
}

/// Returns the number of earlier frames that decide a surface: those that it is blended with or
/// predicted from, and those in its average or memory. Frames further back are not seen in an
/// average with 8 bits, or too long ago to be made up for (kMaxLeadFrames).
inline int num_lead_frames(const TimeOptions& time) {
  const DepthAverageOptions& average = time.average;
  double averaged = 0;
  if (average.kind == DepthAverage::moving) {
    averaged = average.frames * (1 + average.keep_frames);
  } else if (average.kind == DepthAverage::exponential) {
    constexpr double kForgotten = 1e-6;  // share of what was measured
    averaged = average.weight < 1 ? std::log(kForgotten) / std::log1p(-average.weight) : 0;
    averaged = std::ceil(averaged) + average.keep_frames;
  } else if (average.kind == DepthAverage::kalman) {
    averaged = kMaxLeadFrames;
  }
  if (time.memory.kind != DepthMemory::off) averaged = kMaxLeadFrames;
  return num_blended_frames(time) + static_cast<int>(std::min<double>(averaged, kMaxLeadFrames));
}

}}  // namespace palpate::v0
