// The noise of each scale, learned from the frame: most places of most frames are flat at the
// finest scales, so a quantile of the details' sizes tells the noise, whatever its correlation. A
// frame averaged over time has less of it and becomes sharper by itself.
#pragma once

#include <array>
#include <cstdint>

#include "palpate/core/core.h"
#include "src/cloud/internal/frame_noise.h"

namespace palpate { inline namespace v0 {

/// Levels with details; the widest cells are 2^5 pixels wide.
inline constexpr int kNumScales = 5;
static_assert(kNumScales <= kNumNoiseLevels);

/// Factor by which the noise is taken to be larger than its quantile tells: real noise has longer
/// tails than a normal variable.
inline constexpr double kTails = 1.05;

/// The noise of a level: sd of its details, base + growth z^2 in meters of depth at depth z.
struct ScaleNoise {
  float base = 0, growth = 0;

  PALPATE_HOSTDEV double at(double z) const {
    return static_cast<double>(base) + static_cast<double>(growth) * z * z;
  }
};

/// Distance in cells between those that are counted, each way: about as many of every level.
PALPATE_HOSTDEV constexpr int count_step(int level) { return level < 2 ? 4 >> level : 1; }

/// Counts of details by their depth and their size, both in steps of a share of themselves. Sums of
/// whole numbers: any number of threads gives the same.
struct DetailCounts {
  static constexpr int kDepths = 28;  ///< four an octave, from kNearest on
  static constexpr int kSizes = 160;  ///< eight an octave, from kSmallest on
  static constexpr float kNearest = 0.0625f, kSmallest = 9.5367431640625e-7f;  // m, powers of 2

  std::uint32_t counts[kDepths][kSizes] = {};

  void clear() { *this = {}; }
  void add(const DetailCounts& other);
  /// Counts one detail of a cell at an inverse depth.
  void add(float inverse_depth, float detail);
};

/// Returns the noise of all levels. A level's noise is at most a few times that of the finer ones:
/// more is shape.
std::array<ScaleNoise, kNumScales> noise_of(const std::array<DetailCounts, kNumScales>& counts);

}}  // namespace palpate::v0
