// Averages of raw depth over time: the smoothing that thesis section 3.6 compares with
// interpolation. A mean calms noise, and what moves lags behind; an estimate that knows the noise
// calms what rests and follows what moves.
#pragma once

#include <memory>
#include <span>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/isa.h"
#include "palpate/core/result.h"
#include "palpate/core/thread_pool.h"
#include "palpate/settings/setting_table.h"

namespace palpate {

enum class DepthAverage {
  none,         ///< every frame as it is
  moving,       ///< mean of the last few measurements of a pixel
  exponential,  ///< mean += weight (measurement - mean)
  /// A Kalman filter of each pixel: the mean of all measurements since it last changed. Neighbours
  /// test together whether they move; what does is shown as it is measured, without lag.
  kalman,
};
constexpr auto names_of(DepthAverage) {
  return std::array{"none", "moving", "exponential", "kalman"};
}

/// Each pixel by itself. A measurement that is far from the mean so far is another surface: the
/// average starts anew with it.
struct DepthAverageOptions {
  DepthAverage kind = DepthAverage::none;
  int frames = 8;        ///< moving: measurements in the mean
  double weight = 0.25;  ///< exponential: of the newest measurement
  /// moving, exponential: share of the mean; farther off it is another surface.
  double max_jump = 0.03;
  /// A pixel without measurement keeps its mean over so many frames, then it has none; kalman:
  /// fewer while the mean is young.
  int keep_frames = 3;

  // kalman
  int rest_frames = 300;  ///< the mean of a pixel at rest goes over so many, at most
  /// Standard deviation of a measurement of z m: noise + noise_growth z^2, m. A Kinect v1's, within
  /// 20 % of Nguyen, Izadi & Lovell 2012 from 0.4 to 2 m.
  double noise = 0.0009;
  double noise_growth = 0.001;
  /// Noise of a camera that matches patterns is alike in so many neighbouring pixels.
  double noise_patch = 2;
};
inline void add_settings(SettingTable& t, DepthAverageOptions& o) {
  t.add("average", o.kind, "of each pixel's depth over time");
  t.add("average_frames", o.frames, {1, 64, "frames"}, "moving: measurements in the mean");
  t.add("average_weight", o.weight, {1e-9, 1}, "exponential: of the newest measurement");
  t.add("average_max_jump", o.max_jump, {0, 10},
        "moving, exponential: share of the mean; a measurement farther off is another surface");
  t.add("average_keep_frames", o.keep_frames, {0, 100, "frames"},
        "a pixel without measurement keeps its mean so long");
  t.add("average_rest_frames", o.rest_frames, {1, 10000, "frames"},
        "kalman: of a pixel at rest, at most, are in its mean");
  t.add("average_noise", o.noise, {1e-6, 1, "m"},
        "kalman: standard deviation of a measurement, close to the camera");
  t.add("average_noise_growth", o.noise_growth, {0, 1, "m"},
        "kalman: what it has grown by at 1 m; it grows with the square of the depth");
  t.add("average_noise_patch", o.noise_patch, {1, 10000, "pixels"},
        "kalman: of neighbouring pixels so many have their noise in common");
}

/// kalman: what the noise of such a camera asks for (docs/guide/cameras.md, "By kind of sensor").
/// Of none: the defaults.
DepthAverageOptions depth_average_options_for(SensorKind sensor);

/// Owns all buffers for one image size; `update` allocates nothing.
class DepthAverager {
 public:
  /// Errors: a size out of 8..4096, options out of range. All instruction sets give the same bits;
  /// one that the processor lacks is lowered.
  static Result<DepthAverager> create(int width, int height, const DepthAverageOptions& options,
                                      Isa isa = best_isa());
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
