// From exact depth to what a structured-light sensor would deliver. Rows are measured in two steps:
// whole numbers first (what is drawn, which pixel is seen), then arithmetic that the compiler turns
// into vectors, so that a camera beside a live run takes little of its cores.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "scenes/scene.h"

namespace palpate { inline namespace v0 { namespace scenes {

/// Turns images of one size into counts. Owns its buffers.
class DepthSensor {
 public:
  DepthSensor(const NoiseModel& model, const Intrinsics& intrinsics, int width, int height,
              double unit, std::uint64_t seed);

  /// `depth` in meters, NaN where there is nothing. Every pixel's random numbers are a function of
  /// seed, frame and pixel alone.
  void measure(std::span<const float> depth, std::uint64_t frame, std::span<std::uint16_t> counts);

 private:
  static constexpr int kJitterCoins = 32;

  void cast_shadows(std::span<const float> depth);
  void draw_row(std::span<const float> depth, std::uint64_t frame_key, int v);
  void measure_row();
  void count_row(std::span<std::uint16_t> counts) const;

  NoiseModel model_;
  int width_, height_;
  double unit_;
  std::uint64_t seed_;
  double disparity_;        ///< focal length * baseline: pixels of disparity * meters of depth
  std::vector<float> lit_;  ///< depth where the projector's light falls, else NaN
  std::array<int, kJitterCoins + 1> jitter_;  ///< pixels, by the heads
  std::vector<double> depth_;                 ///< of a row, m; NaN: no measurement
  std::vector<double> noise_;                 ///< of a row, in coins
};

}}}  // namespace palpate::v0::scenes
