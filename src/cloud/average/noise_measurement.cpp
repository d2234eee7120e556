#include "src/cloud/internal/noise_measurement.h"

#include <algorithm>
#include <cmath>

#include "src/cloud/frames/raw_depth.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kBlock = 16;               // side, pixels
constexpr std::size_t kMinPixels = 200;  // of a depth

/// A pixel over time.
struct PixelNoise {
  float depth = 0;     ///< mean, m
  float variance = 0;  ///< m^2; negative: unknown
  float turned = 0;    ///< variance by steps that turn back
};

PixelNoise noise_of(std::span<const DepthFrame> frames, std::size_t pixel) {
  double depths = 0, squares = 0, turned = 0, last = 0, last_step = 0;
  int num = 0, num_steps = 0, num_turns = 0, in_a_row = 0;
  for (const DepthFrame& frame : frames) {
    const std::uint16_t count = frame.pixels[pixel];
    if (!is_measurement(count)) {
      in_a_row = 0;
      continue;
    }
    const double z = count * frame.unit, step = z - last;
    depths += z, ++num;
    if (in_a_row > 0) squares += step * step, ++num_steps;
    if (in_a_row > 1) turned -= step * last_step, ++num_turns;
    last = z, last_step = step, ++in_a_row;
  }
  if (2 * num_turns < static_cast<int>(frames.size())) return {0, -1, 0};
  // Half of the steps' variance; the median of a mean of squares is a little less than it.
  const double lost = 1 - 2 / (9 * (2.0 / 3 * num_steps));
  return {static_cast<float>(depths / num),
          static_cast<float>(squares / (2 * num_steps) / (lost * lost * lost)),
          static_cast<float>(turned / num_turns)};
}

/// Marks the pixels of blocks that move as unknown. Returns the share of such blocks.
double drop_what_moves(std::vector<PixelNoise>& pixels, int width, int height) {
  int num = 0, num_moving = 0;
  for (int top = 0; top < height; top += kBlock) {
    for (int left = 0; left < width; left += kBlock) {
      double turned = 0, variance = 0;
      int num_known = 0;
      const auto each = [&](const auto& visit) {
        for (int v = top; v < std::min(top + kBlock, height); ++v) {
          for (int u = left; u < std::min(left + kBlock, width); ++u) {
            visit(pixels[static_cast<std::size_t>(v * width + u)]);
          }
        }
      };
      each([&](const PixelNoise& p) {
        if (p.variance < 0) return;
        turned += static_cast<double>(p.turned), variance += static_cast<double>(p.variance);
        ++num_known;
      });
      if (num_known < kBlock) continue;
      ++num;
      if (turned >= 0) continue;
      ++num_moving;
      each([](PixelNoise& p) { p.variance = -1; });
    }
  }
  return num > 0 ? static_cast<double>(num_moving) / num : 0;
}

float median_of(std::vector<float> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Fits sd = at_zero + growth z^2, with weights of pixels.
MeasurementNoise fit(const std::vector<NoiseAtDepth>& table, const MeasurementNoise& usual) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, u = 0;
  for (const NoiseAtDepth& at : table) {
    const double w = std::sqrt(static_cast<double>(at.num_pixels)) / (at.depth * at.depth);
    const double z2 = at.depth * at.depth;
    n += w, x += w * z2, y += w * at.deviation, xx += w * z2 * z2, xy += w * z2 * at.deviation;
    u += w * usual.deviation(at.depth);
  }
  constexpr double kMinRange = 1.3, kMinNoise = 1e-6;  // m
  const double growth = (n * xy - x * y) / (n * xx - x * x);
  MeasurementNoise noise{(y - growth * x) / n, growth, 0};
  if (table.back().depth < kMinRange * table.front().depth) {
    noise = {usual.at_zero * y / u, usual.growth * y / u, 0};
  } else if (growth < 0) {
    noise = {y / n, 0, 0};
  } else if (noise.at_zero < 0) {
    noise = {0, xy / xx, 0};
  }
  noise.at_zero = std::max(noise.at_zero, kMinNoise);
  return noise;
}

double fit_length(const std::array<double, kNoiseDistances.size()>& correlation) {
  constexpr double kNone = 0.05, kMin = 0.2, kMax = 40, kStep = 1.01;  // pixels
  double best = 0, least = INFINITY;
  if (correlation[0] < kNone) return 0;
  for (double length = kMin; length < kMax; length *= kStep) {
    double sum = 0;
    for (std::size_t i = 0; i < correlation.size(); ++i) {
      const double off = correlation[i] - std::exp(-kNoiseDistances[i] / length);
      sum += off * off;
    }
    if (sum < least) least = sum, best = length;
  }
  return best;
}

}  // namespace

Status NoiseMeasurement::add(const std::string& name, std::span<const DepthFrame> frames) {
  if (frames.size() < kMinNoiseFrames) {
    return Error{Errc::bad_input, name + " has " + std::to_string(frames.size()) +
                                      " frames; noise needs at least " +
                                      std::to_string(kMinNoiseFrames) + " of a scene at rest"};
  }
  const int width = frames[0].width, height = frames[0].height;
  std::vector<PixelNoise> pixels(frames[0].pixels.size());
  for (std::size_t i = 0; i < pixels.size(); ++i) pixels[i] = noise_of(frames, i);
  constexpr double kMaxMoving = 0.1;
  if (const double moving = drop_what_moves(pixels, width, height); moving > kMaxMoving) {
    return Error{Errc::bad_input,
                 name + ": " + std::to_string(static_cast<int>(100 * moving + 0.5)) +
                     " % of the image moves; let camera and scene rest for three seconds"};
  }
  // Edges that flicker have no part in the correlation.
  std::array<std::vector<float>, kBins> scene;
  const auto bin_of = [](const PixelNoise& p) {
    return std::clamp(static_cast<int>(8 * std::log2(static_cast<double>(p.depth) / 0.1)), 0,
                      kBins - 1);
  };
  for (const PixelNoise& p : pixels) {
    if (p.variance < 0) continue;
    const auto bin = static_cast<std::size_t>(bin_of(p));
    scene[bin].push_back(p.variance);
    bins_[bin].variances.push_back(p.variance);
    bins_[bin].depths += static_cast<double>(p.depth);
  }
  std::array<float, kBins> limits{};
  for (std::size_t b = 0; b < kBins; ++b) {
    if (scene[b].size() >= kMinPixels) limits[b] = 4 * median_of(scene[b]);
  }
  for (PixelNoise& p : pixels) {
    if (p.variance < 0) continue;
    if (p.variance <= 0 || p.variance > limits[static_cast<std::size_t>(bin_of(p))]) {
      p.variance = -1;
    }
  }
  // Steps in shares of their deviations; 0: unknown.
  std::vector<float> steps(pixels.size());
  for (std::size_t k = 1; k < frames.size(); k += 3) {
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const int count = frames[k].pixels[i], before = frames[k - 1].pixels[i];
      const bool is_known =
          pixels[i].variance > 0 && is_measurement(count) && is_measurement(before);
      steps[i] = is_known ? static_cast<float>((count - before) * frames[k].unit) /
                                std::sqrt(2 * pixels[i].variance)
                          : NAN;
    }
    for (std::size_t d = 0; d < kNoiseDistances.size(); ++d) {
      const int distance = kNoiseDistances[d];
      for (int v = 0; v < height; ++v) {
        for (int u = 0; u + distance < width; ++u) {
          const auto i = static_cast<std::size_t>(v * width + u);
          const std::size_t j = i + static_cast<std::size_t>(distance);
          constexpr float kSameSurface = 0.03f;  // of the depth
          const float apart = std::abs(pixels[i].depth - pixels[j].depth);
          const float product = steps[i] * steps[j];
          if (std::isnan(product) || apart > kSameSurface * pixels[i].depth) continue;
          correlations_[d].sum += static_cast<double>(product);
          correlations_[d].num += 1;
        }
      }
    }
  }
  return Done{};
}

Result<NoiseTable> NoiseMeasurement::result(const MeasurementNoise& usual) const {
  NoiseTable all{};
  for (const Bin& bin : bins_) {
    const std::size_t num = bin.variances.size();
    if (num < kMinPixels) continue;
    all.by_depth.push_back({bin.depths / static_cast<double>(num),
                            std::sqrt(static_cast<double>(median_of(bin.variances))), num});
  }
  if (all.by_depth.empty()) {
    return Error{Errc::bad_input, "fewer than " + std::to_string(kMinPixels) +
                                      " pixels at one depth were measured in most frames; show "
                                      "the camera a surface that it sees well"};
  }
  for (std::size_t d = 0; d < all.correlation.size(); ++d) {
    const Correlation& c = correlations_[d];
    all.correlation[d] = c.num > 0 ? c.sum / c.num : 0;
  }
  all.noise = fit(all.by_depth, usual);
  all.noise.length = fit_length(all.correlation);
  return all;
}

}}  // namespace palpate::v0
