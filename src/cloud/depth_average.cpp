#include "palpate/cloud/depth_average.h"

#include <string>
#include <vector>

#include "src/cloud/depth_average_options.h"
#include "src/cloud/pixel_average.h"
#include "src/core/internal/assert.h"

namespace palpate {
struct DepthAverager::Impl {
  int width, height;
  DepthAverageOptions options;
  std::vector<PixelMemory> memories;
  std::vector<std::uint16_t> rings;  // moving: the last measurements, pixel by pixel
  std::vector<float> depth;

  float update(std::size_t pixel, std::uint16_t count, double unit);
};

float DepthAverager::Impl::update(std::size_t pixel, std::uint16_t count, double unit) {
  if (options.kind == DepthAverage::none) return newest_depth(count, unit);
  const auto ring_size = static_cast<std::size_t>(options.frames);
  const PixelRing ring{rings.empty() ? nullptr : &rings[pixel * ring_size], 1};
  return update_average(memories[pixel], ring, count, unit, options);
}

Status check_average_settings(int width, int height, const DepthAverageOptions& options) {
  constexpr int kLeast = 8;
  if (width < kLeast || width > kMaxImageWidth || height < kLeast || height > kMaxImageHeight) {
    return Error{Errc::invalid_argument, "depth images of " + std::to_string(width) + " x " +
                                             std::to_string(height) +
                                             " pixels cannot be averaged; use 8 to 4096 a side"};
  }
  return check_settings(options);
}

Result<DepthAverager> DepthAverager::create(int width, int height,
                                            const DepthAverageOptions& options) {
  const Status status = check_average_settings(width, height, options);
  if (!status) return status.error();
  auto impl = std::make_unique<Impl>(Impl{width, height, options, {}, {}, {}});
  const std::size_t size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  impl->depth.resize(size);
  if (options.kind != DepthAverage::none) impl->memories.resize(size);
  if (options.kind == DepthAverage::moving) {
    impl->rings.resize(size * static_cast<std::size_t>(options.frames));
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
  pool.parallel_for(d.height, [&](int v) {
    const std::size_t begin = static_cast<std::size_t>(v) * static_cast<std::size_t>(d.width);
    for (std::size_t i = begin; i < begin + static_cast<std::size_t>(d.width); ++i) {
      d.depth[i] = d.update(i, image.counts[i], image.unit);
    }
  });
  return d.depth;
}

}  // namespace palpate
