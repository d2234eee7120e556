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
  if (frame.counts == nullptr) {
    const float z = frame.meters[pixel];
    return z > 0 && std::isfinite(z) ? z : 0;
  }
  const std::uint16_t count = frame.counts[pixel];
  return is_measurement(count) ? static_cast<float>(frame.unit * count) : 0;
}

/// Returns the mean over a square of one surface, 0 if it is not, or not measured all over.
float mean_over(const DepthImageView& frame, int left, int top, int side, float z) {
  const int step = std::max(side / 16, 1);
  float sum = 0;
  for (int v = top; v < top + side; v += step) {
    for (int u = left; u < left + side; u += step) {
      const float at = depth_at(frame, v * frame.width + u);
      if (!(std::fabs(at - z) < kSameSurface * z)) return 0;
      sum += at - z;
    }
  }
  const int num = side / step;
  return z + sum / static_cast<float>(num * num);
}

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
      blocks_wide_(width / kBlock),
      blocks_high_(height / kBlock),
      means_(static_cast<std::size_t>(blocks_wide_ * blocks_high_ * kNumNoiseLevels)) {}

void StreamNoise::add(const DepthImageView& frame, const FrameNoise& seen) {
  for (Scale& scale : scales_) scale = {kMemory * scale.turned, kMemory * scale.num};
  const FineNoise fine(seen);
  Mean* mean = means_.data();
  for (int block = 0; block < blocks_wide_ * blocks_high_; ++block) {
    const int left = block % blocks_wide_ * kBlock, top = block / blocks_wide_ * kBlock;
    const float z = depth_at(frame, (top + kBlock / 2) * width_ + left + kBlock / 2);
    const float sd = fine.base + fine.growth * z * z;
    bool is_known = z > 0 && sd > 0;
    for (int k = 0; k < kNumNoiseLevels; ++k, ++mean) {
      const int side = 1 << k, apart = (kBlock - side + 1) / 2;
      const float now = is_known ? mean_over(frame, left + apart, top + apart, side, z) : 0;
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
  // Variances of means, none larger than that of fewer pixels, none less than of independent ones.
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
    variance[k] = k == 0 ? std::max(own, 0.0) : std::clamp(own, before / 4, before);
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
