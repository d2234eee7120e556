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

/// A number of mean 0 and variance 1 that is normal for our purposes: the heads among n coins, made
/// smooth by one uniform number. Whole numbers and products only, so it has the same bits
/// everywhere.
double normal(std::uint64_t coins, int n, double smoothing) {
  return (std::popcount(coins) - 0.5 * n + smoothing - 0.5) / std::sqrt(n / 4.0 + 1.0 / 12.0);
}

/// Jitter takes the other side of an edge only if it differs by this share of the depth: on a slope
/// it would be axial noise in disguise.
constexpr double kEdgeShare = 0.03;

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

}  // namespace

DepthSensor::DepthSensor(const NoiseModel& model, const Intrinsics& intrinsics, int width,
                         int height, double unit, std::uint64_t seed)
    : model_(model),
      width_(width),
      height_(height),
      unit_(unit),
      seed_(seed),
      disparity_(intrinsics.fx * model.baseline),
      lit_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {}

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
        lit_[row + u] = kNone;
      }
    }
  }
}

double DepthSensor::measure_pixel(std::span<const float> depth, std::uint64_t frame_key, int u,
                                  int v) const {
  const auto index = [&](int column, int row) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(column);
  };
  const std::size_t pixel = index(u, v);
  const std::uint64_t uniforms = draw(frame_key, pixel, kUniforms);
  if (uniform(static_cast<std::uint32_t>(uniforms)) < model_.missing) return kNone;

  std::size_t source = pixel;
  if (model_.lateral > 0) {
    const std::uint64_t jitter = draw(frame_key, pixel, kJitter);
    const auto shifted = [&](int at, std::uint64_t coins, int size) {
      return std::clamp(
          at + static_cast<int>(std::floor(model_.lateral * normal(coins, 32, 0.5) + 0.5)), 0,
          size - 1);
    };
    const std::size_t other =
        index(shifted(u, jitter & 0xffffffffu, width_), shifted(v, jitter >> 32, height_));
    // Written so that an edge towards nothing (NaN) counts as well.
    const double step =
        std::abs(static_cast<double>(depth[other]) - static_cast<double>(depth[pixel]));
    if (!(step <= kEdgeShare * static_cast<double>(depth[pixel]))) source = other;
  }
  const double z = lit_[source];
  if (!(z > 0)) return kNone;

  const double sigma = model_.axial_base + model_.axial_growth * (z - 0.4) * (z - 0.4);
  const double noise = normal(draw(frame_key, pixel, kCoins), 64,
                              uniform(static_cast<std::uint32_t>(uniforms >> 32)));
  const double steps = disparity_ * model_.disparity_steps;
  if (!(steps > 0)) return z + sigma * noise;
  // The measured sigma contains the rounding error of variance step^2 / 12; it is not added twice.
  const double step = z * z / steps;
  const double spread = std::sqrt(std::max(0.0, sigma * sigma - step * step / 12));
  const double noisy = z + spread * noise;
  return noisy > 0 ? steps / std::max(1.0, std::floor(steps / noisy + 0.5)) : kNone;
}

void DepthSensor::measure(std::span<const float> depth, std::uint64_t frame,
                          std::span<std::uint16_t> counts) {
  if (model_.enabled) cast_shadows(depth);
  const std::uint64_t frame_key = mixed(mixed(seed_ + kGolden) + (frame + 1) * kGolden);
  for (int v = 0; v < height_; ++v) {
    for (int u = 0; u < width_; ++u) {
      const std::size_t pixel = static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) +
                                static_cast<std::size_t>(u);
      const double z = model_.enabled ? measure_pixel(depth, frame_key, u, v)
                                      : static_cast<double>(depth[pixel]);
      // NaN and whatever does not fit are no measurement.
      const double count = std::floor(z / unit_ + 0.5);
      counts[pixel] =
          count >= 1 && count < 65535 ? static_cast<std::uint16_t>(count) : std::uint16_t{0};
    }
  }
}

}}}  // namespace palpate::v0::scenes
