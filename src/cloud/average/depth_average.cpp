#include "palpate/cloud/depth_noise.h"
#include "palpate/cloud/depth_source.h"

#include <algorithm>
#include <string>
#include <vector>

#include "src/cloud/average/depth_estimate_kernel.h"
#include "src/cloud/average/pixel_average.h"
#include "src/core/internal/assert.h"

namespace palpate { inline namespace v0 {

EstimateBlock estimate_block_for(Isa isa) {
  isa = std::min(isa, best_isa());
#if defined(__x86_64__)
  if (isa == Isa::avx512) return isa_avx512::estimate_block;
  if (isa == Isa::avx2) return isa_avx2::estimate_block;
#endif
  return isa_baseline::estimate_block;
}

struct DepthAverager::Impl {
  int width, height;
  DepthAverageOptions options;
  std::vector<float> depth;
  std::vector<PixelAverage> averages = {};
  std::vector<std::uint16_t> rings = {};  // moving: the last measurements, pixel by pixel
  // kalman
  std::vector<float> means = {}, gains = {};
  std::vector<BlockMemory> blocks = {};
  EstimatePass pass = {};
  EstimateBlock estimate_block = nullptr;

  float update(std::size_t pixel, std::uint16_t count, double unit);
};

float DepthAverager::Impl::update(std::size_t pixel, std::uint16_t count, double unit) {
  if (options.kind == DepthAverage::none) return newest_depth(count, unit);
  const auto ring_size = static_cast<std::size_t>(options.frames);
  const PixelRing ring{rings.empty() ? nullptr : &rings[pixel * ring_size], 1};
  return update_average(averages[pixel], ring, count, unit, options);
}

DepthAverageOptions depth_average_options_for(SensorKind sensor) {
  DepthAverageOptions options;
  switch (sensor) {
    case SensorKind::none: break;
    case SensorKind::structured_light: options.noise_patch = 16; break;
    case SensorKind::active_stereo:
      options.noise = 0.0005;
      options.noise_growth = 0.0045;
      options.noise_patch = 1000;
      options.keep_frames = 30;
      break;
    case SensorKind::tof: options.noise_growth = 0.0005; break;
  }
  return options;
}

DepthAverageOptions depth_average_options_for(const SensorNoise& sensor) {
  DepthAverageOptions options = depth_average_options_for(sensor.kind);
  options.noise = sensor.noise.at_zero;
  options.noise_growth = sensor.noise.growth;
  options.noise_patch = std::min(sensor.noise.patch(), 10000.0);
  return options;
}

Status check_average_settings(int width, int height, const DepthAverageOptions& options) {
  constexpr int kMinSide = 8;
  if (width < kMinSide || width > kMaxImageWidth || height < kMinSide || height > kMaxImageHeight) {
    return Error{Errc::invalid_argument, "depth images of " + std::to_string(width) + " x " +
                                             std::to_string(height) +
                                             " pixels cannot be averaged; use 8 to 4096 a side"};
  }
  return check_settings(options);
}

Result<DepthAverager> DepthAverager::create(int width, int height,
                                            const DepthAverageOptions& options, Isa isa) {
  const Status status = check_average_settings(width, height, options);
  if (!status) return status.error();
  const std::size_t size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  auto impl = std::make_unique<Impl>(Impl{width, height, options, std::vector<float>(size)});
  Impl& d = *impl;
  switch (options.kind) {
    case DepthAverage::none: break;
    case DepthAverage::moving:
      d.rings.resize(size * static_cast<std::size_t>(options.frames));
      [[fallthrough]];
    case DepthAverage::exponential: d.averages.resize(size); break;
    case DepthAverage::kalman: {
      d.pass.model = EstimateModel(options);
      d.pass.width = width;
      d.pass.height = height;
      d.pass.stride = d.pass.blocks_per_row() * kEstimateBlock;
      const std::size_t padded =
          static_cast<std::size_t>(height) * static_cast<std::size_t>(d.pass.stride);
      d.means.assign(padded, 0.0f);
      d.gains.assign(padded, kUnknownGain);
      d.blocks.resize(static_cast<std::size_t>(d.pass.num_blocks()));
      d.pass.blocks = d.blocks.data();
      d.pass.mean = d.means.data();
      d.pass.gain = d.gains.data();
      d.pass.depth = d.depth.data();
      d.estimate_block = estimate_block_for(isa);
      break;
    }
  }
  return DepthAverager(std::move(impl));
}

DepthAverager::DepthAverager(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DepthAverager::DepthAverager(DepthAverager&&) noexcept = default;
DepthAverager& DepthAverager::operator=(DepthAverager&&) noexcept = default;
DepthAverager::~DepthAverager() = default;

std::span<const float> DepthAverager::update(const DepthImageView& image, ThreadPool& pool) {
  Impl& d = *impl_;
  PALPATE_ASSERT(image.width == d.width && image.height == d.height && image.counts != nullptr);
  if (d.estimate_block != nullptr) {
    EstimatePass pass = d.pass;
    pass.counts = image.counts;
    pass.unit = image.unit;
    pool.parallel_for(pass.num_blocks(), [&](int block) { d.estimate_block(pass, block); });
    return d.depth;
  }
  pool.parallel_for(d.height, [&](int v) {
    const std::size_t begin = static_cast<std::size_t>(v) * static_cast<std::size_t>(d.width);
    for (std::size_t i = begin; i < begin + static_cast<std::size_t>(d.width); ++i) {
      d.depth[i] = d.update(i, image.counts[i], image.unit);
    }
  });
  return d.depth;
}

}}  // namespace palpate::v0
