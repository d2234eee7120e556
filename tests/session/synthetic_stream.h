// A small depth stream made on the spot, and a tool path that presses into it.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include "palpate/cloud/depth_source.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate::test {

/// A bumpy wall half a meter away that comes nearer by 2 mm a frame, to 0.3 m and back.
class SyntheticStream : public DepthSource {
 public:
  explicit SyntheticStream(int num_frames, double rate = 30) {
    info_.width = 96;
    info_.height = 72;
    info_.intrinsics = {90, 90, 47.5, 35.5};
    info_.unit = 0.0005;
    info_.rate = rate;
    info_.num_frames = num_frames;
    info_.name = "synthetic <wall> & \"bumps\"";
  }

  const DepthStreamInfo& info() const override { return info_; }

  Result<bool> next(DepthFrame& frame) override {
    if (next_ == fail_at) return Error{Errc::bad_input, "cannot read frame 3: it is broken"};
    if (next_ == *info_.num_frames) return false;
    frame.width = next_ == resize_at ? 95 : info_.width;
    frame.height = info_.height;
    frame.unit = info_.unit;
    frame.timestamp = 1000.25 + next_ / info_.rate;
    frame.pixels.clear();
    const int k = next_ % 200, near = std::min(k, 200 - k);
    for (int v = 0; v < frame.height; ++v) {
      for (int u = 0; u < frame.width; ++u) {
        const double z = 0.5 - 0.002 * near + 0.004 * std::sin(0.2 * u) * std::cos(0.17 * v);
        frame.pixels.push_back((u * 7 + v * 3) % 41 == 0
                                   ? 0
                                   : static_cast<std::uint16_t>(std::lround(z / info_.unit)));
      }
    }
    ++next_;
    return true;
  }

  int fail_at = -1, resize_at = -1;

 private:
  DepthStreamInfo info_;
  int next_ = 0;
};

inline Pose pressing_pose(double time) {
  const double angle = 0.3 * time;
  return {{0.01 * time, 0.005, 0.44 + 0.05 * std::sin(6 * time)}, axis_angle({1, 2, 3}, angle)};
}

inline Tool small_tool() { return random_tool(200, 0.03, 7); }

}  // namespace palpate::test
