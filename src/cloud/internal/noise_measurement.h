// Noise of a depth camera, measured in resting scenes: its size by depth, and its length over the
// image.
//
// Half of the mean square of a pixel's steps from frame to frame is its variance, whatever drifts
// slowly. A depth has the median of its pixels, which edges that flicker do not change. Where steps
// that follow each other do not turn back, something moves (depth_estimate.h).
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "palpate/cloud/depth_noise.h"
#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

struct NoiseAtDepth {
  double depth = 0, deviation = 0;  ///< m
  std::size_t num_pixels = 0;
};

struct NoiseTable {
  MeasurementNoise noise;
  std::vector<NoiseAtDepth> by_depth;  ///< from near to far
  std::array<double, 4> correlation;   ///< at kNoiseDistances
};
inline constexpr std::array<int, 4> kNoiseDistances{1, 2, 4, 8};  ///< pixels
inline constexpr int kMinNoiseFrames = 20;

class NoiseMeasurement {
 public:
  /// Adds the frames of one scene, all of one size. `name` is for messages. Errors: too few frames;
  /// more than a tenth of the image moves. O(frames * pixels).
  Status add(const std::string& name, std::span<const DepthFrame> frames);
  /// Fits all scenes. `usual`: noise of such cameras, whose proportions hold where depths are too
  /// alike to tell the growth. Error: too little was measured.
  Result<NoiseTable> result(const MeasurementNoise& usual) const;

 private:
  static constexpr int kBins = 64;  ///< of depth, 8 an octave from 0.1 m on
  struct Bin {
    std::vector<float> variances;  ///< of pixels
    double depths = 0;             ///< sum
  };
  struct Correlation {
    double sum = 0, num = 0;
  };
  std::array<Bin, kBins> bins_;
  std::array<Correlation, kNoiseDistances.size()> correlations_ = {};
};

}}  // namespace palpate::v0
