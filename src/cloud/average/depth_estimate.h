// Depth of a pixel from all frames so far: a Kalman filter per pixel, with tests for change that
// neighbors share. Shared code for vectors and for single numbers (lanes.h).
//
// A pixel has a mean and its variance, in variances of one measurement (`gain`: also the share of
// the last measurement in the mean). At rest gains fall as 1, 1/2, 1/3, ... The deviation of a
// measurement is its difference from the mean over the expected noise: of unit variance as long as
// nothing moves. Deviations are tested for each pixel and as means over squares of 8, 16, 32 and 64
// pixels a side: a thousand pixels show changes that one cannot tell from noise. Changes that a
// finer test has explained are left out of the coarser ones. A pixel that has changed starts anew.
// Measurements pass the filter unchanged where a neighborhood moves, and the means, which lag
// behind, only serve to detect when it rests again. So there is no lag and no trail, and no value
// is ever taken from another pixel.
//
// The noise is learned: for the pixels of a tile, and for the mean of each neighborhood, whose
// pixels share an unknown part of it. Steps of a mean that follow each other tell noise from
// motion: with noise of variance V that is new in each frame, the mean of -step * previous step is
// V; motion goes on, so for any that is slower than a quarter of the frame rate it is negative. So
// V bounds what is taken for noise, and no sensor needs a bound of its own.
#pragma once

#include "palpate/cloud/depth_source.h"
#include "src/cloud/frames/raw_depth.h"
#include "src/core/internal/lanes.h"

namespace palpate { inline namespace v0 {

/// Numbers that all pixels share.
struct EstimateModel {
  float noise = 0, noise_growth = 0;  ///< at least noise + noise_growth z^2 at depth z, m
  float patch = 1;                    ///< pixels that share their noise, at most
  float drift = 0;                    ///< growth of a gain per frame
  float missing = 0;                  ///< the same for a pixel without measurement

  EstimateModel() = default;
  explicit EstimateModel(const DepthAverageOptions& o)
      : noise(static_cast<float>(o.noise)),
        noise_growth(static_cast<float>(o.noise_growth)),
        patch(static_cast<float>(o.noise_patch)),
        // Gains settle where gain^2 = drift (1 - gain).
        drift(static_cast<float>(
            1.0 / (static_cast<double>(o.rest_frames) * static_cast<double>(o.rest_frames)))),
        missing(1.0f / static_cast<float>(o.keep_frames + 1)) {}
};

/// Gain of a pixel without a mean: its variance is unbounded, so the formulas below need no special
/// case.
inline constexpr float kUnknownGain = 1e30f;

inline constexpr int kEstimateBlock = 64;  ///< side in pixels; blocks are independent
inline constexpr int kEstimateTile = 8;    ///< side of the finest neighborhood, pixels
inline constexpr int kTilesPerBlock = kEstimateBlock / kEstimateTile;

/// Sums over a neighborhood.
struct DeviationSum {
  float sum = 0, num = 0;

  PALPATE_FORMULA void add(const DeviationSum& s) {
    sum += s.sum;
    num += s.num;
  }
};

/// Sums over a tile.
struct TileSum {
  DeviationSum deviations;  ///< of pixels without a change of their own
  DeviationSum bounded;     ///< of pixels that were seen before and now, each within kBound
  float squares = 0;        ///< of these
  float num_known = 0;      ///< pixels that were seen before
  float num_gone = 0;       ///< those that are missing now or show something else

  PALPATE_FORMULA void add(const TileSum& s) {
    deviations.add(s.deviations);
    bounded.add(s.bounded);
    squares += s.squares;
    num_known += s.num_known;
    num_gone += s.num_gone;
  }
};

/// A learned variance: the mean of all values and one more, the expected one; later a running mean.
/// All zero: no value yet.
struct LearnedVariance {
  float value = 0, weight = 0;

  PALPATE_FORMULA float or_expected(float expected) const { return weight > 0 ? value : expected; }
  PALPATE_FORMULA void learn(float squared, float expected) {
    constexpr float kMinWeight = 1.0f / 16;
    value = or_expected(expected);
    weight = weight > 0 ? weight / (1.0f + weight) : 0.5f;
    if (weight < kMinWeight) weight = kMinWeight;
    value += weight * (squared - value);
  }
};

// Deviations within +-kBound: what a few pixels of another surface add is bounded.
inline constexpr float kBound = 1.5f;
inline constexpr float kBoundedVariance = 0.7786f;  ///< of standard normal numbers within kBound

/// Returns the variance of normal numbers by the mean square of them within kBound: exact for 1,
/// too little and at most 30 for more.
PALPATE_FORMULA float unbounded_variance(float mean_square) {
  constexpr float kUnit = 0.8398f, kMinOpen = 1.0f / 16;
  const float open = 1.0f - mean_square * (1.0f / (kBound * kBound));
  return kUnit * mean_square / (open > kMinOpen ? open : kMinOpen);
}

/// Change that a neighborhood reports to its pixels.
struct SharedChange {
  float follow = 0;  ///< 0: at rest; 1: moving
  float gain = 0;    ///< lower bound of the gain
  float keep = 0;    ///< 1: a missing surface may still be there
};

}}  // namespace palpate::v0

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// Returns the certainty of a change, 0 to 1, by a deviation that is standard normal without one:
/// 0.3 % of all are above 3, less than one in a million above 5.
PALPATE_FORMULA VecF change_of(VecF deviation) {
  return min(max((deviation - 3.0f) * 0.5f, splat(0.0f)), splat(1.0f));
}

/// Returns the measurement to average: 0 where it is too far to be counted (kFar).
PALPATE_FORMULA VecF counted(VecF measured) {
  return select(measured < splat(kFarthest), measured, splat(0.0f));
}

struct PixelDeviation {
  VecF gain;  ///< of this measurement, from the pixel alone
  /// Added to those of its tile.
  VecF sum, num, bounded, num_seen, squares, num_known, num_gone;
};

/// Computes the deviation of a pixel. `scale`: its noise over the model's.
PALPATE_FORMULA PixelDeviation deviation_of(VecF seen, VecF mean, VecF gain, VecF scale,
                                            const EstimateModel& model) {
  const VecF zero = splat(0.0f), measured = counted(seen);
  const VecF variance = gain + (1.0f + model.drift);  // of seen - mean, in those of a measurement
  const VecF noise = scale * (model.noise + model.noise_growth * measured * measured);
  const VecF deviation = (measured - mean) / (noise * sqrt(variance));
  const VecF change = change_of(abs(deviation));
  const Mask is_seen = measured > zero, is_known = gain < splat(2.0f);
  const VecF one = splat(1.0f), num = select(is_seen & is_known, one - change, zero);
  const VecF known = select(is_known, one, zero), both = select(is_seen, known, zero);
  const VecF bounded = both * min(max(deviation, splat(-kBound)), splat(kBound));
  return {max(one - one / variance, change),
          num * deviation,
          num,
          bounded,
          both,
          bounded * bounded,
          known,
          known - num};
}

struct PixelEstimate {
  VecF mean, gain;
  VecF depth;  ///< output; 0: none; kFar as soon as it is measured
};

/// Updates a pixel. `seen` is 0 where there is no measurement, `own_gain` is PixelDeviation::gain,
/// `gain` the previous one.
PALPATE_FORMULA PixelEstimate estimate_of(VecF seen, VecF mean, VecF gain, VecF own_gain,
                                          VecF follow, VecF shared_gain, VecF keep,
                                          const EstimateModel& model) {
  const VecF zero = splat(0.0f), one = splat(1.0f), measured = counted(seen);
  const Mask is_seen = measured > zero;
  const VecF share = max(own_gain, shared_gain);
  // Written so that a share of 1 gives the measurement to the bit.
  const VecF updated = measured + (one - share) * (mean - measured);
  const VecF shown = measured + (one - follow) * (updated - measured);
  const VecF aged = gain + model.missing;
  const Mask is_kept = (aged <= one) & (keep > zero);
  const VecF kept = select(is_kept, mean, zero);
  return {select(is_seen, updated, kept),
          select(is_seen, share, select(is_kept, aged, splat(kUnknownGain))),
          select(is_seen, shown, select(seen > zero, seen, kept))};
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE

namespace palpate { inline namespace v0 {

PALPATE_FORMULA float clamped(float value, float least, float most) {
  return value < least ? least : value > most ? most : value;
}

/// Variance of noise by steps that follow each other and turn back, learned like any.
struct LearnedTurns : LearnedVariance {
  PALPATE_FORMULA void learn_turn(float turned) {
    learn(turned, 0);
    if (value < 0.0f) value = 0;
  }
};

/// Memory of one neighborhood. All zero: nothing seen yet.
struct NeighborhoodMemory {
  LearnedVariance noise;  ///< of the mean deviation
  LearnedTurns turns;
  float bounded = 0;  ///< last mean of bounded deviations, from the means after it
  float step = 0;     ///< last change of it
  float follow = 0;   ///< last result
};

/// Learns from the step to the mean of bounded deviations. Returns what the step has turned back.
PALPATE_FORMULA float turn_back(float bounded, NeighborhoodMemory& memory) {
  const float step = bounded - memory.bounded;
  const float turned = -step * memory.step * (1.0f / kBoundedVariance);
  memory.turns.learn_turn(turned);
  memory.step = step;
  memory.bounded = bounded;
  return turned;
}

/// Tests a neighborhood for a change by its own deviations. `turns`: of all neighborhoods of its
/// size.
PALPATE_FORMULA SharedChange change_in(const DeviationSum& s, float turns,
                                       NeighborhoodMemory& memory, const EstimateModel& model) {
  SharedChange change;
  if (s.num > 0.0f) {
    const float mean = s.sum / s.num, squared = mean * mean;
    // Variance of the mean for independent pixels, and for pixels that share their noise.
    const float independent = 1.0f / s.num;
    const float shared = model.patch / (s.num + (model.patch - 1.0f));
    const float least = independent > turns ? independent : turns;
    const float turned = 2.0f * (turns > memory.turns.value ? turns : memory.turns.value);
    const float most = shared > turned ? shared : turned;
    const float variance = clamped(memory.noise.or_expected(shared), least, most);
    const float deviation = sqrtf(squared / variance);
    // A moving neighborhood is at rest only when its means have caught up.
    change.follow = memory.follow > 0 ? clamped(deviation - 1.0f, 0, 1)
                                      : clamped((deviation - 3.5f) / 1.5f, 0, 1);
    // Means lag behind a motion far enough for the next frame to detect it again: at v noises a
    // frame by 5.7 sqrt(v) noises, and by those of four frames at least.
    change.gain = change.follow * clamped(deviation / 32.0f, 0.25f, 1.0f);
    // The beginning of a motion is not learned as noise.
    memory.noise.learn(squared < 9.0f * variance ? squared : 9.0f * variance, shared);
  }
  memory.bounded -= change.gain * memory.bounded;
  memory.follow = change.follow;
  return change;
}

/// Adds the deviations that a finer neighborhood has not explained.
PALPATE_FORMULA void add_unexplained(DeviationSum& to, const DeviationSum& finer,
                                     const SharedChange& change) {
  const float share = 1.0f - change.follow;
  to.add({share * finer.sum, share * finer.num});
}

PALPATE_FORMULA SharedChange stronger(const SharedChange& a, const SharedChange& b) {
  return {a.follow > b.follow ? a.follow : b.follow, a.gain > b.gain ? a.gain : b.gain, 0};
}

/// Neighborhoods have four levels, each four times as large as the one before. Entries: tiles row
/// by row, then those of the coarser levels.
inline constexpr int kEstimateLevels = 4;
inline constexpr int kNeighborhoods = 64 + 16 + 4 + 1;
PALPATE_FORMULA int first_entry(int level) {
  return level == 0 ? 0 : level == 1 ? 64 : level == 2 ? 80 : 84;
}
PALPATE_FORMULA int level_side(int level) { return kTilesPerBlock >> level; }

/// Memory of a block beside its pixels. All zero: nothing seen yet.
struct BlockMemory {
  NeighborhoodMemory neighborhoods[kNeighborhoods];
  LearnedVariance pixels[kTilesPerBlock * kTilesPerBlock];  ///< of deviations, by tile
  LearnedTurns turns[kEstimateLevels];                      ///< of all neighborhoods of a level

  /// Noise of a tile's pixels over the model's.
  PALPATE_FORMULA float noise_scale(int tile) const {
    constexpr float kMaxWeight = 256;
    return sqrtf(clamped(pixels[tile].value, 1.0f, kMaxWeight));
  }
  /// Learns from sums over a tile of deviations, which are shares of `scale`.
  PALPATE_FORMULA void learn_noise(int tile, const TileSum& s, float scale) {
    if (s.bounded.num > 8) {
      const float mean = s.bounded.sum / s.bounded.num;
      const float within = s.squares / s.bounded.num - mean * mean;
      // Motion is in the mean of a tile, and does not turn back.
      const float noise = unbounded_variance(within + kBoundedVariance * turns[0].value);
      pixels[tile].learn(scale * scale * noise, 1);
    }
  }
};

/// Deviations of a neighborhood in one frame, and what has turned back in it.
struct NeighborhoodSums {
  DeviationSum unexplained;              ///< of pixels and finer neighborhoods without a change
  DeviationSum bounded;                  ///< see TileSum
  DeviationSum turned[kEstimateLevels];  ///< of the neighborhoods of each level in it
};

/// The tests of a block in one frame.
struct BlockChange {
  NeighborhoodSums sums[kNeighborhoods];
  float
      keep[kTilesPerBlock * kTilesPerBlock];  ///< 1: a missing surface of a tile may still be there
  SharedChange changes[kNeighborhoods];

  /// Computes entry (u, v) of a level above the tiles from the level below.
  PALPATE_FORMULA void join(int level, int u, int v) {
    NeighborhoodSums all;
    for (int child = 0; child < 4; ++child) {
      const int finer =
          first_entry(level - 1) + (2 * v + child / 2) * level_side(level - 1) + 2 * u + child % 2;
      add_unexplained(all.unexplained, sums[finer].unexplained, changes[finer]);
      all.bounded.add(sums[finer].bounded);
      for (int i = 0; i < level; ++i) all.turned[i].add(sums[finer].turned[i]);
    }
    sums[first_entry(level) + v * level_side(level) + u] = all;
  }
  PALPATE_FORMULA void take(int tile, const TileSum& s) {
    sums[tile] = {s.deviations, s.bounded, {}};
    keep[tile] = s.num_gone > 0.75f * s.num_known ? 0.0f : 1.0f;
  }
  PALPATE_FORMULA void test(int level, int entry, BlockMemory& memory, const EstimateModel& model) {
    NeighborhoodSums& s = sums[entry];
    NeighborhoodMemory& own = memory.neighborhoods[entry];
    if (s.bounded.num > 0.0f) {
      s.turned[level] = {turn_back(s.bounded.sum / s.bounded.num, own), 1};
    }
    changes[entry] = change_in(s.unexplained, memory.turns[level].value, own, model);
  }
  /// Learns from all neighborhoods of a level, after all tests.
  PALPATE_FORMULA void learn_turns(int level, BlockMemory& memory) const {
    const DeviationSum& all = sums[kNeighborhoods - 1].turned[level];
    if (all.num > 0.0f) memory.turns[level].learn_turn(all.sum / all.num);
  }
  /// Combines the changes of all levels at a tile.
  PALPATE_FORMULA SharedChange of_tile(int u, int v) const {
    SharedChange all = changes[v * kTilesPerBlock + u];
    for (int level = 1; level < kEstimateLevels; ++level) {
      all = stronger(all,
                     changes[first_entry(level) + (v >> level) * level_side(level) + (u >> level)]);
    }
    // Missing pixels do not keep their depth where something moves.
    all.keep = all.follow < 0.5f ? keep[v * kTilesPerBlock + u] : 0.0f;
    return all;
  }
};

}}  // namespace palpate::v0
