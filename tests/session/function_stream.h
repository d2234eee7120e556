// A small depth stream that is a function of time and pixel.
#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "src/session/internal/probing_path.h"

namespace palpate::test {

/// Depth as a function of time and pixel; 0: no measurement.
using DepthFunction = std::function<double(double time, int u, int v)>;

class FunctionStream : public DepthSource {
 public:
  FunctionStream(DepthFunction scene, std::vector<double> times)
      : scene_(std::move(scene)), times_(times) {
    info_.width = 240;
    info_.height = 180;
    info_.intrinsics = {220, 220, 119.5, 89.5};
    info_.unit = 0.0005;
    info_.rate = 25;
    info_.num_frames = static_cast<int>(times.size());
  }
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    if (next_ == fail_at) return Error{Errc::bad_input, "frame 2 is broken"};
    if (next_ == static_cast<int>(times_.size())) return false;
    const double time = times_[static_cast<std::size_t>(next_++)];
    frame = {info_.width, info_.height, info_.unit, {}, 1000 + time};
    for (int v = 0; v < info_.height; ++v) {
      for (int u = 0; u < info_.width; ++u) {
        frame.pixels.push_back(
            static_cast<std::uint16_t>(std::lround(scene_(time, u, v) / info_.unit)));
      }
    }
    return true;
  }

  int fail_at = -1;

 private:
  DepthFunction scene_;
  std::vector<double> times_;
  DepthStreamInfo info_;
  int next_ = 0;
};

/// Opens copies of a stream.
template <class Stream>
OpenDepthSource copies_of(const Stream& stream) {
  return [stream]() -> Result<std::unique_ptr<DepthSource>> {
    return std::unique_ptr<DepthSource>(std::make_unique<Stream>(stream));
  };
}

inline std::vector<double> every(double period, int num) {
  std::vector<double> times;
  for (int k = 0; k < num; ++k) times.push_back(k * period);
  return times;
}

}  // namespace palpate::test
