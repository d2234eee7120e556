#include "src/cloud/internal/stream_noise.h"

#include <algorithm>
#include <cmath>

#include "src/cloud/frames/raw_depth.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kBlock = 1 << (kNumNoiseLevels - 1);  // side, pixels
constexpr int kNumFine = 4;                         // scales whose details surfaces show well
constexpr float kSameSurface = 0.05f;               // of the depth
constexpr double kMemory = 0.99;                    // share of what is known that a frame leaves
constexpr double kEnough = 100;                     // terms from which a scale is known

/// Depth of a pixel, m; 0: no measurement.
float depth_at(const DepthImageView& frame, int pixel) {
  const float z = frame.counts ? depth_of(frame.counts[pixel], frame.unit) : frame.meters[pixel];
  return z > 0 && std::isfinite(z) ? z : 0;
}

/// Sums how far pixels of nested squares about the middle of a block are from its depth.
class Rings {
 public:
  Rings(const DepthImageView& frame, int left, int top, float z)
      : frame_(frame), left_(left), top_(top), z_(z) {}

  /// Returns the mean over the next square, of twice the last one's side; 0 if it is not one
  /// surface, measured all over.
  float next_mean() {
    const int from = (kBlock - side_ + 1) / 2, to = from + side_;
    const int inner = (kBlock - side_ / 2 + 1) / 2, outer = inner + side_ / 2;
    for (int v = from; v < to; ++v) {
      const bool is_across = v >= inner && v < outer;
      for (int u = from; u < to; ++u) {
        if (is_across && u == inner) u = outer;
        if (u >= to) break;
        const float at = depth_at(frame_, (top_ + v) * frame_.width + left_ + u);
        if (!(std::fabs(at - z_) < kSameSurface * z_)) return 0;
        sum_ += at - z_;
      }
    }
    const float mean = z_ + sum_ / static_cast<float>(side_ * side_);
    side_ *= 2;
    return mean;
  }

 private:
  const DepthImageView& frame_;
  int left_, top_;
  float z_;
  int side_ = 1;
  float sum_ = 0;
};

/// Standard deviation of the details of the fine scales together, as base + growth z^2.
struct FineNoise {
  explicit FineNoise(const FrameNoise& noise) {
    for (int k = 0; k < kNumFine; ++k) {
      base = std::hypot(base, noise.base[k]);
      growth = std::hypot(growth, noise.growth[k]);
    }
  }
  float base = 0, growth = 0;
};

}  // namespace

StreamNoise::StreamNoise(int width, int height)
    : width_(width),
      blocks_wide_((width / kBlock + 1) / 2),
      blocks_high_((height / kBlock + 1) / 2),
      means_(static_cast<std::size_t>(blocks_wide_ * blocks_high_ * kNumNoiseLevels)) {}

void StreamNoise::add(const DepthImageView& frame, const FrameNoise& seen) {
  for (Scale& scale : scales_) scale = {kMemory * scale.turned, kMemory * scale.num};
  const FineNoise fine(seen);
  Mean* mean = means_.data();
  for (int block = 0; block < blocks_wide_ * blocks_high_; ++block) {
    const int left = block % blocks_wide_ * 2 * kBlock, top = block / blocks_wide_ * 2 * kBlock;
    const float z = depth_at(frame, (top + kBlock / 2) * width_ + left + kBlock / 2);
    const float sd = fine.base + fine.growth * z * z;
    bool is_known = z > 0 && sd > 0;
    Rings rings(frame, left, top, z);
    for (int k = 0; k < kNumNoiseLevels; ++k, ++mean) {
      const float now = is_known ? rings.next_mean() : 0;
      is_known = now > 0;
      if (!is_known) {
        mean->num_before = 0;
        continue;
      }
      const float step = now - mean->value;
      if (mean->num_before == 2) {
        // Something that appears or goes is no noise, and no motion either.
        constexpr double limit = 25;
        const double turned = static_cast<double>(-step * mean->step / (sd * sd));
        scales_[k].turned += std::clamp(turned, -limit, limit);
        scales_[k].num += 1;
      }
      *mean = {now, step, std::min(mean->num_before + 1, 2)};
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
    const double most = k > 1 ? before - 0.25 * (variance[k - 2] - before) : before;
    variance[k] = k == 0 ? std::max(own, 0.0) : std::clamp(own, before / 4, most);
  }
  constexpr double of_white = 0.75;  // what a mean of four loses
  const auto detail = [&](int k) {
    const bool is_last = k + 1 == kNumNoiseLevels;  // which stands for all wider ones
    return kDetailShare * (is_last ? variance[k] : (variance[k] - variance[k + 1]) / of_white);
  };
  double size = 1;
  if (is_averaged) {
    size = 0;
    for (int k = 0; k < kNumFine; ++k) size += detail(k);
  }
  if (!(size > 0) || !(variance[0] > 0)) return seen;
  const FineNoise fine(seen);
  FrameNoise result;
  result.is_whole = true;
  for (int k = 0; k < kNumNoiseLevels; ++k) {
    const auto share = static_cast<float>(std::sqrt(detail(k) / size));
    result.base[k] = share * fine.base;
    result.growth[k] = share * fine.growth;
  }
  return result;
}

}}  // namespace palpate::v0
