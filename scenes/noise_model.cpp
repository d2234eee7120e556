#include "scenes/noise_model.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace palpate { inline namespace v0 { namespace scenes {
namespace {

// Numbers are drawn by position, not in turn: SplitMix64's output function of a counter (Steele,
// Lea & Flood 2014).
constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15u;

constexpr std::uint64_t mixed(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

enum Draw : std::uint64_t { kCoins, kUniforms, kJitter, kNumDraws };

std::uint64_t draw(std::uint64_t frame_key, std::uint64_t pixel, Draw which) {
  return mixed(frame_key + (pixel * kNumDraws + which + 1) * kGolden);
}

double uniform(std::uint32_t bits) { return (bits + 0.5) * 0x1.0p-32; }

/// Returns the heads among n coins, made smooth by one uniform number, less their mean. Over their
/// standard deviation that is normal for our purposes. Whole numbers and products only, so it has
/// the same bits everywhere.
double centered(int heads, int n, double smoothing) { return heads - 0.5 * n + smoothing - 0.5; }
/// Returns the standard deviation of that.
double deviation(int n) { return std::sqrt(n / 4.0 + 1.0 / 12.0); }
constexpr int kNoiseCoins = 64;

/// Jitter takes the other side of an edge only if it differs by this share of the depth: on a slope
/// it would be axial noise in disguise.
constexpr double kEdgeShare = 0.03;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

}  // namespace

DepthSensor::DepthSensor(const NoiseModel& model, const Intrinsics& intrinsics, int width,
                         int height, double unit, std::uint64_t seed)
    : model_(model),
      width_(width),
      height_(height),
      unit_(unit),
      seed_(seed),
      disparity_(intrinsics.fx * model.baseline),
      lit_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)),
      depth_(static_cast<std::size_t>(width)),
      noise_(static_cast<std::size_t>(width)) {
  for (int heads = 0; heads <= kJitterCoins; ++heads) {
    const double pixels =
        model.lateral * (centered(heads, kJitterCoins, 0.5) / deviation(kJitterCoins));
    jitter_[static_cast<std::size_t>(heads)] = static_cast<int>(std::floor(pixels + 0.5));
  }
}

void DepthSensor::cast_shadows(std::span<const float> depth) {
  std::copy(depth.begin(), depth.end(), lit_.begin());
  if (!(disparity_ > 0)) return;
  // Camera and projector see the same rows. A point of depth z at column u is at u - disparity / z
  // in the projector's image. Its light comes from the right (+x), so going left the columns in the
  // projector's image must fall; where they do not, something to the right is in the way.
  const auto width = static_cast<std::size_t>(width_);
  for (std::size_t row = 0; row < depth.size(); row += width) {
    double leftmost = std::numeric_limits<double>::infinity();
    for (std::size_t u = width; u-- > 0;) {
      const double z = depth[row + u];
      if (!(z > 0)) continue;
      const double column = static_cast<double>(u) - disparity_ / z;
      if (column < leftmost) {
        leftmost = column;
      } else {
        lit_[row + u] = static_cast<float>(kNone);
      }
    }
  }
}

/// Draws the numbers of a row, and finds the depth that each of its pixels sees.
void DepthSensor::draw_row(std::span<const float> depth, std::uint64_t frame_key, int v) {
  const auto index = [&](int column, int row) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(column);
  };
  const auto shifted = [&](int at, std::uint64_t coins, int size) {
    return std::clamp(at + jitter_[static_cast<std::size_t>(std::popcount(coins))], 0, size - 1);
  };
  for (int u = 0; u < width_; ++u) {
    const std::size_t pixel = index(u, v);
    std::size_t source = pixel;
    if (model_.lateral > 0) {
      const std::uint64_t jitter = draw(frame_key, pixel, kJitter);
      const std::size_t other =
          index(shifted(u, jitter & 0xffffffffu, width_), shifted(v, jitter >> 32, height_));
      // Written so that an edge towards nothing (NaN) counts as well.
      const double step =
          std::abs(static_cast<double>(depth[other]) - static_cast<double>(depth[pixel]));
      if (!(step <= kEdgeShare * static_cast<double>(depth[pixel]))) source = other;
    }
    const std::uint64_t uniforms = draw(frame_key, pixel, kUniforms);
    const bool is_missing = uniform(static_cast<std::uint32_t>(uniforms)) < model_.missing;
    const auto column = static_cast<std::size_t>(u);
    depth_[column] = is_missing || !(lit_[source] > 0) ? kNone : static_cast<double>(lit_[source]);
    noise_[column] = centered(std::popcount(draw(frame_key, pixel, kCoins)), kNoiseCoins,
                              uniform(static_cast<std::uint32_t>(uniforms >> 32)));
  }
}

/// Replaces the depth of a row by what the sensor measures.
void DepthSensor::measure_row() {
  const double base = model_.axial_base, growth = model_.axial_growth,
               steps = disparity_ * model_.disparity_steps, noise_unit = deviation(kNoiseCoins);
  const std::size_t width = depth_.size();
  double* const depth = depth_.data();
  const double* const noise = noise_.data();
  if (!(steps > 0)) {
    for (std::size_t u = 0; u < width; ++u) {
      const double z = depth[u];
      depth[u] = z + (base + growth * (z - 0.4) * (z - 0.4)) * (noise[u] / noise_unit);
    }
    return;
  }
  for (std::size_t u = 0; u < width; ++u) {
    const double z = depth[u];
    const double sigma = base + growth * (z - 0.4) * (z - 0.4);
    // The measured sigma contains the rounding error of variance step^2 / 12; it is not added
    // twice.
    const double step = z * z / steps;
    const double spread = std::sqrt(std::max(0.0, sigma * sigma - step * step / 12));
    const double noisy = z + spread * (noise[u] / noise_unit);
    const double rounded = steps / std::max(1.0, std::floor(steps / noisy + 0.5));
    depth[u] = noisy > 0 ? rounded : kNone;
  }
}

/// Rounds a row to counts; NaN and whatever does not fit are no measurement.
void DepthSensor::count_row(std::span<std::uint16_t> counts) const {
  const double unit = unit_;
  const double* const depth = depth_.data();
  for (std::size_t u = 0; u < counts.size(); ++u) {
    const double count = std::floor(depth[u] / unit + 0.5);
    const double kept = count >= 1 && count < 65535 ? count : 0.0;
    counts[u] = static_cast<std::uint16_t>(static_cast<std::int32_t>(kept));
  }
}

void DepthSensor::measure(std::span<const float> depth, std::uint64_t frame,
                          std::span<std::uint16_t> counts) {
  if (model_.enabled) cast_shadows(depth);
  const std::uint64_t frame_key = mixed(mixed(seed_ + kGolden) + (frame + 1) * kGolden);
  const auto width = static_cast<std::size_t>(width_);
  for (int v = 0; v < height_; ++v) {
    const std::size_t first = static_cast<std::size_t>(v) * width;
    if (model_.enabled) {
      draw_row(depth, frame_key, v);
      measure_row();
    } else {
      std::ranges::copy(depth.subspan(first, width), depth_.begin());
    }
    count_row(counts.subspan(first, width));
  }
}

}}}  // namespace palpate::v0::scenes
