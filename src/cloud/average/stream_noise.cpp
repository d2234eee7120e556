#include "src/cloud/internal/stream_noise.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "src/cloud/frames/raw_depth.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kBlock = 1 << (kNumNoiseLevels - 1);  // side, pixels
constexpr int kNumFine = 4;                         // scales whose details surfaces show well
constexpr float kSameSurface = 0.05f;               // of the depth, from frame to frame
constexpr float kMinKnown = 0.75f;                  // share of a square's pixels that must be known
constexpr double kMemory = 0.99;                    // share of what is known that a frame leaves
constexpr double kEnough = 100;                     // terms from which a scale is known

/// Depth of a pixel, m; 0: no measurement.
float depth_at(const DepthImageView& frame, int pixel) {
  const float z = frame.counts ? depth_of(frame.counts[pixel], frame.unit) : frame.meters[pixel];
  return z > 0 && std::isfinite(z) ? z : 0;
}

/// Standard deviation of the details of the fine scales together, as base + growth z^2.
struct FineNoise {
  explicit FineNoise(const FrameNoise& noise) {
    for (int k = 0; k < kNumFine; ++k) {
      base = std::hypot(base, noise.base[k]);
      growth = std::hypot(growth, noise.growth[k]);
    }
  }
  float at(float z) const { return base + growth * z * z; }

  float base = 0, growth = 0;
};

/// Sums the steps of nested squares about the middle of a block, as shares of the deviation of what
/// is seen.
class Rings {
 public:
  /// `before`: the pixels of the block in the last frame, which become those of this one.
  Rings(const DepthImageView& frame, int left, int top, const FineNoise& fine, float* before)
      : frame_(frame), left_(left), top_(top), fine_(fine), before_(before) {}

  /// Returns the step of the mean over the next square, of twice the last one's side; no number if
  /// too few pixels are known in both frames.
  float next_step() {
    const int from = (kBlock - side_ + 1) / 2, to = from + side_;
    const int inner = (kBlock - side_ / 2 + 1) / 2, outer = inner + side_ / 2;
    for (int v = from; v < to; ++v) {
      const bool is_across = v >= inner && v < outer;
      for (int u = from; u < to; ++u) {
        if (is_across && u == inner) u = outer;
        if (u >= to) break;
        add(u, v);
      }
    }
    const auto all = static_cast<float>(side_ * side_);
    side_ *= 2;
    return num_ >= kMinKnown * all ? sum_ / num_ : std::numeric_limits<float>::quiet_NaN();
  }

 private:
  void add(int u, int v) {
    float& before = before_[v * kBlock + u];
    const float z = depth_at(frame_, (top_ + v) * frame_.width + left_ + u);
    const float step = z - before, sd = fine_.at(z);
    if (before > 0 && std::fabs(step) < kSameSurface * z && sd > 0) {
      sum_ += step / sd;
      num_ += 1;
    }
    before = z;
  }

  const DepthImageView& frame_;
  int left_, top_;
  const FineNoise& fine_;
  float* before_;
  int side_ = 1;
  float sum_ = 0, num_ = 0;
};

/// Returns the variance of the mean over a square of 2^k pixels by the white noise of the cells of
/// a scale, of unit variance. Queries make it a B-spline (place_scales in
/// src/contact/noise/noise_model.h), whose mean over squares of about its own cells is calmer;
/// pixels remain what they are.
double seen_in(int k, int scale) {
  if (scale == 0) return std::ldexp(1, -2 * k);
  constexpr double of_spline[2 * kNumNoiseLevels - 1] = {0.7561,  0.7555,  0.7532, 0.7442, 0.7100,
                                                         0.5988,  0.3692,  0.1548, 0.0495, 0.0139,
                                                         0.00367, 0.00094, 0.00024};
  return of_spline[k - scale + kNumNoiseLevels - 1];
}

/// Moves noise between the cells of the scales until the means over squares have these variances:
/// each scale grows by what the squares that see it have too little. What fits stays, as white
/// noise does.
void fit_cells(const double (&variance)[kNumNoiseLevels], double (&cells)[kNumNoiseLevels]) {
  constexpr int num_steps = 10;
  for (int step = 0; step < num_steps; ++step) {
    double by_told[kNumNoiseLevels] = {}, by_known[kNumNoiseLevels] = {};
    for (int k = 0; k < kNumNoiseLevels; ++k) {
      double reported = 0;
      for (int scale = 0; scale < kNumNoiseLevels; ++scale)
        reported += seen_in(k, scale) * cells[scale];
      for (int scale = 0; scale < kNumNoiseLevels; ++scale) {
        by_told[scale] += seen_in(k, scale) / reported;
        by_known[scale] += seen_in(k, scale) / variance[k];
      }
    }
    for (int scale = 0; scale < kNumNoiseLevels; ++scale) {
      cells[scale] *= by_told[scale] / by_known[scale];
    }
  }
}

}  // namespace

StreamNoise::StreamNoise(int width, int height)
    : width_(width),
      blocks_wide_((width / kBlock + 1) / 2),
      blocks_high_((height / kBlock + 1) / 2),
      before_(static_cast<std::size_t>(blocks_wide_ * blocks_high_ * kBlock * kBlock)),
      steps_(static_cast<std::size_t>(blocks_wide_ * blocks_high_ * kNumNoiseLevels),
             std::numeric_limits<float>::quiet_NaN()) {}

void StreamNoise::add(const DepthImageView& frame, const FrameNoise& seen) {
  for (Scale& scale : scales_) scale = {kMemory * scale.turned, kMemory * scale.num};
  const FineNoise fine(seen);
  float* last = steps_.data();
  for (int block = 0; block < blocks_wide_ * blocks_high_; ++block) {
    const int left = block % blocks_wide_ * 2 * kBlock, top = block / blocks_wide_ * 2 * kBlock;
    Rings rings(frame, left, top, fine, before_.data() + block * kBlock * kBlock);
    for (int k = 0; k < kNumNoiseLevels; ++k, ++last) {
      const float step = rings.next_step(), turned = -step * *last;
      *last = step;
      if (std::isnan(turned)) continue;
      // Noise hardly ever goes on by more than that: something moves. Its steps are large, and few
      // of them would hide the noise of many others.
      constexpr double least = -4;
      Scale& scale = scales_[k];
      const double own = scale.num > 0 ? scale.turned / scale.num : 0;
      scale.turned +=
          std::max(static_cast<double>(turned), least * std::max(own, std::ldexp(1, -2 * k)));
      scale.num += 1;
    }
  }
}

FrameNoise StreamNoise::of_frame(const FrameNoise& seen, bool is_averaged) const {
  // Variances of means: what a mean of four loses is neither negative nor less than what the next
  // one loses, and it loses no more than one of independent pixels.
  double variance[kNumNoiseLevels];
  for (int k = 0; k < kNumNoiseLevels; ++k) {
    const Scale& scale = scales_[k];
    const double before = k > 0 ? variance[k - 1] : 0;
    if (scale.num < kEnough) {
      if (k <= kNumFine) return seen;
      variance[k] = before / 4;
      continue;
    }
    const double own = scale.turned / scale.num;
    const double least = before / 4;
    const double most = k > 1 ? before - 0.25 * (variance[k - 2] - before) : before;
    variance[k] = k == 0 ? std::max(own, 0.0) : std::clamp(own, least, std::max(least, most));
  }
  if (!(variance[0] > 0)) return seen;
  constexpr double of_white = 0.75;  // what a mean of four loses
  double cells[kNumNoiseLevels], size = 1, fine_details = 0, detail = 0;
  for (int k = 0; k < kNumNoiseLevels; ++k) {
    const bool is_last = k + 1 == kNumNoiseLevels;  // which stands for all wider ones
    const double wider = 0.25 * detail;
    detail = is_last ? variance[k] : (variance[k] - variance[k + 1]) / of_white;
    cells[k] = detail - wider;
    if (k < kNumFine) fine_details += kDetailShare * detail;
  }
  if (is_averaged) size = fine_details;
  if (!(size > 0)) return seen;
  fit_cells(variance, cells);
  const FineNoise fine(seen);
  FrameNoise result;
  result.is_whole = true;
  detail = 0;
  for (int k = 0; k < kNumNoiseLevels; ++k) {
    detail = cells[k] + 0.25 * detail;
    const auto share = static_cast<float>(std::sqrt(kDetailShare * detail / size));
    result.base[k] = share * fine.base;
    result.growth[k] = share * fine.growth;
  }
  return result;
}

}}  // namespace palpate::v0
