// Images whose every pixel is known, and raw cameras under full control of a test.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "palpate/cloud/depth_source.h"

namespace palpate::test {

/// Returns the count of pixel (u, v) in frame `number`: never the same in two consecutive frames,
/// odd and even, from 500 to 4499.
inline std::uint16_t count_at(int u, int v, int number) {
  return static_cast<std::uint16_t>(500 + (7 * u + 13 * v + 31 * number) % 4000);
}

inline std::vector<std::uint16_t> pattern(int width, int height, int number) {
  std::vector<std::uint16_t> pixels;
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) pixels.push_back(count_at(u, v, number));
  }
  return pixels;
}

inline DepthFrame pattern_frame(int width, int height, int number, double timestamp,
                                double unit = 0.001) {
  return {width, height, unit, pattern(width, height, number), timestamp};
}

/// The number of the frame with these pixels, of the first `num`; -1: of none.
inline int number_of(const DepthFrame& frame, int num) {
  for (int k = 0; k < num; ++k) {
    if (frame.pixels == pattern(frame.width, frame.height, k)) return k;
  }
  return -1;
}

inline DepthStreamInfo stream_info(int width, int height) {
  DepthStreamInfo info;
  info.width = width;
  info.height = height;
  info.intrinsics = {1.0 * width, 1.0 * width, 0.5 * (width - 1), 0.5 * (height - 1)};
  info.name = "the test's camera";
  return info;
}

/// Does `then` for every frame: it may fill the frame, wait, or fail.
class ScriptedCamera final : public DepthSource {
 public:
  using Script = std::function<Result<bool>(int number, DepthFrame& frame, DepthStreamInfo& info,
                                            const std::atomic<bool>& is_cancelled)>;
  ScriptedCamera(DepthStreamInfo info, Script script)
      : info_(std::move(info)), script_(std::move(script)) {
    info_.is_live = true;
  }
  const DepthStreamInfo& info() const override { return info_; }
  void cancel() noexcept override { is_cancelled_ = true; }
  Result<bool> next(DepthFrame& frame) override {
    return script_(number_++, frame, info_, is_cancelled_);
  }

 private:
  DepthStreamInfo info_;
  Script script_;
  int number_ = 0;
  std::atomic<bool> is_cancelled_ = false;
};

inline void sleep_seconds(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

}  // namespace palpate::test
