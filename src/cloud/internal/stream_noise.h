// The random noise of a stream, learned from frames that follow each other. A single frame shows
// neither what its noise shares over the whole image nor which of its details come again in the
// next one; time shows both. In every second block of each second row, means over squares of 2^k
// pixels step from frame to frame, by the pixels that both frames measure. Noise turns back and
// motion goes on (depth_estimate.h): with d the step of a mean and d' the next one, the mean of
// -d d' is its variance. So there is no option, and what moves is not learned as noise.
#pragma once

#include <vector>

#include "palpate/cloud/depth_source.h"
#include "src/cloud/internal/frame_noise.h"

namespace palpate { inline namespace v0 {

class StreamNoise {
 public:
  StreamNoise(int width, int height);

  /// Adds a frame in host memory as the camera measured it. `seen`: what the surface made of it
  /// shows by itself, which tells how noise grows with depth. No allocation; a quarter of the
  /// pixels.
  void add(const DepthImageView& frame, const FrameNoise& seen);
  /// Returns the noise of that surface. `is_averaged`: it is a mean of frames, with less noise of
  /// the same kind: then time tells the shares of the scales, and the surface their size. Returns
  /// `seen` until enough frames are known.
  FrameNoise of_frame(const FrameNoise& seen, bool is_averaged) const;

 private:
  struct Scale {
    double turned = 0, num = 0;  ///< sum of -d d' in variances of what is seen; its terms
  };

  int width_, blocks_wide_, blocks_high_;
  std::vector<float> before_;  ///< m, pixels of the last frame, block by block; 0: no measurement
  std::vector<float> steps_;   ///< of each block, from fine to wide; no number: unknown
  Scale scales_[kNumNoiseLevels];
};

}}  // namespace palpate::v0
