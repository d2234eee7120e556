// Averages of raw depth over time: the smoothing that thesis section 3.6 compares with
// interpolation. An average calms noise, and what moves lags behind.
#pragma once

#include <memory>
#include <span>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/result.h"
#include "palpate/core/thread_pool.h"

namespace palpate {

enum class DepthAverage {
  none,         ///< every frame as it is
  moving,       ///< mean of the last few measurements of a pixel
  exponential,  ///< mean += weight (measurement - mean)
};

/// Each pixel by itself. A measurement that is far from the mean so far is another surface: the
/// average starts anew with it.
struct DepthAverageOptions {
  DepthAverage kind = DepthAverage::none;
  int frames = 8;          ///< moving: measurements in the mean, 1..64
  double weight = 0.25;    ///< exponential: of the newest measurement, above 0, up to 1
  double max_jump = 0.03;  ///< share of the mean; farther off it is another surface
  /// A pixel without measurement keeps its mean over so many frames, then it has none. 0..100
  int keep_frames = 3;
};

/// Owns all buffers for one image size; `update` allocates nothing.
class DepthAverager {
 public:
  /// Errors: a size out of 8..4096, options out of range.
  static Result<DepthAverager> create(int width, int height, const DepthAverageOptions& options);
  DepthAverager(DepthAverager&&) noexcept;
  DepthAverager& operator=(DepthAverager&&) noexcept;
  ~DepthAverager();

  /// Takes one more frame, of the size given at construction and of one unit over the stream.
  /// Returns metres, NaN where there is no measurement; valid until the next update. The same bits
  /// for any number of threads.
  std::span<const float> update(const DepthFrame& frame, ThreadPool& pool);

 private:
  struct Impl;
  explicit DepthAverager(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
