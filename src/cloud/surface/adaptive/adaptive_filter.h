// The adaptive filter of a depth image: its scales, and the passes over them.
#pragma once

#include <array>
#include <vector>

#include "src/cloud/surface/adaptive/scale_noise.h"
#include "src/cloud/surface/adaptive/scale_rows.h"

namespace palpate { inline namespace v0 {

/// Owns the scales of one image size; `run` allocates nothing.
class AdaptiveFilter {
 public:
  AdaptiveFilter(int width, int height, Isa isa);

  /// Smooths the pixels in `window`, which begins and ends at whole parts, with the noise of the
  /// whole image. The same bits for any window and any number of threads.
  void run(const FilterPass& pass, const PixelWindow& window, ThreadPool& pool);
  /// Noise of the last image.
  FrameNoise noise() const;

 private:
  void count_details(ThreadPool& pool);

  ScaleRows rows_;
  std::vector<float> memory_;
  std::array<ScaleLevel, kNumScales + 1> levels_;
  std::vector<std::array<DetailCounts, kNumScales>> counts_;  // of each task
  std::array<ScaleNoise, kNumScales> noise_{};
};

}}  // namespace palpate::v0
