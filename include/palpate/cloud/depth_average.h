// Averages of raw depth over time: the smoothing that thesis section 3.6 compares with
// interpolation. An average calms noise, and what moves lags behind.
#pragma once

#include <memory>
#include <span>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/result.h"
#include "palpate/core/thread_pool.h"
#include "palpate/settings/setting_table.h"

namespace palpate {

enum class DepthAverage {
  none,         ///< every frame as it is
  moving,       ///< mean of the last few measurements of a pixel
  exponential,  ///< mean += weight (measurement - mean)
};
constexpr auto names_of(DepthAverage) { return std::array{"none", "moving", "exponential"}; }

/// Each pixel by itself. A measurement that is far from the mean so far is another surface: the
/// average starts anew with it.
struct DepthAverageOptions {
  DepthAverage kind = DepthAverage::none;
  int frames = 8;          ///< moving: measurements in the mean
  double weight = 0.25;    ///< exponential: of the newest measurement
  double max_jump = 0.03;  ///< share of the mean; farther off it is another surface
  /// A pixel without measurement keeps its mean over so many frames, then it has none.
  int keep_frames = 3;
};
inline void add_settings(SettingTable& t, DepthAverageOptions& o) {
  t.add("average", o.kind, "of each pixel's depth over time");
  t.add("average_frames", o.frames, {1, 64, "frames"}, "moving: measurements in the mean");
  t.add("average_weight", o.weight, {1e-9, 1}, "exponential: of the newest measurement");
  t.add("average_max_jump", o.max_jump, {0, 10},
        "share of the mean; a measurement farther off is another surface");
  t.add("average_keep_frames", o.keep_frames, {0, 100, "frames"},
        "a pixel without measurement keeps its mean so long");
}

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
  std::span<const float> update(const DepthImageView& counts, ThreadPool& pool);

 private:
  struct Impl;
  explicit DepthAverager(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
