#include "palpate/cloud/depth_average.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "palpate/core/assert.h"

namespace palpate {
namespace {

constexpr int kMostFrames = 64, kMostKept = 100;

bool is_measurement(std::uint16_t count) { return count != 0 && count != 65535; }

/// What a pixel remembers. Sums of counts are whole numbers, so that nothing drifts.
struct Memory {
  std::uint32_t sum = 0;         ///< moving: of the ring
  float mean = 0;                ///< exponential, in counts
  std::uint8_t num = 0;          ///< measurements in the average; exponential: 0 or 1
  std::uint8_t next = 0;         ///< moving: where the ring is written next
  std::uint8_t num_missing = 0;  ///< frames since the last measurement
};

}  // namespace

struct DepthAverager::Impl {
  int width, height;
  DepthAverageOptions options;
  std::vector<Memory> memories;
  std::vector<std::uint16_t> rings;  // moving: the last measurements, pixel by pixel
  std::vector<float> depth;

  double mean(const Memory& memory) const {
    return options.kind == DepthAverage::moving
               ? static_cast<double>(memory.sum) / static_cast<double>(memory.num)
               : static_cast<double>(memory.mean);
  }
  void add(Memory& memory, std::uint16_t* ring, std::uint16_t count) const;
  float update(std::size_t pixel, std::uint16_t count, double unit);
};

void DepthAverager::Impl::add(Memory& memory, std::uint16_t* ring, std::uint16_t count) const {
  if (memory.num > 0 && std::abs(count - mean(memory)) > options.max_jump * mean(memory)) {
    memory = {};
  }
  memory.num_missing = 0;
  if (options.kind == DepthAverage::exponential) {
    const float weight = memory.num > 0 ? static_cast<float>(options.weight) : 1.0f;
    memory.mean += weight * (static_cast<float>(count) - memory.mean);
    memory.num = 1;
    return;
  }
  if (memory.num == options.frames) {
    memory.sum -= ring[memory.next];
  } else {
    ++memory.num;
  }
  memory.sum += count;
  ring[memory.next] = count;
  memory.next = static_cast<std::uint8_t>((memory.next + 1) % options.frames);
}

float DepthAverager::Impl::update(std::size_t pixel, std::uint16_t count, double unit) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  if (options.kind == DepthAverage::none) {
    return is_measurement(count) ? static_cast<float>(count * unit) : kNone;
  }
  Memory& memory = memories[pixel];
  if (is_measurement(count)) {
    const auto ring_size = static_cast<std::size_t>(options.frames);
    add(memory, rings.empty() ? nullptr : &rings[pixel * ring_size], count);
  } else if (memory.num > 0 && ++memory.num_missing > options.keep_frames) {
    memory = {};
  }
  return memory.num > 0 ? static_cast<float>(mean(memory) * unit) : kNone;
}

Result<DepthAverager> DepthAverager::create(int width, int height,
                                            const DepthAverageOptions& options) {
  constexpr int kLeast = 8;
  if (width < kLeast || width > kMaxImageWidth || height < kLeast || height > kMaxImageHeight) {
    return Error{Errc::invalid_argument, "depth images of " + std::to_string(width) + " x " +
                                             std::to_string(height) +
                                             " pixels cannot be averaged; use 8 to 4096 a side"};
  }
  if (options.frames < 1 || options.frames > kMostFrames) {
    return Error{Errc::invalid_argument, "an average is over 1 to " + std::to_string(kMostFrames) +
                                             " frames, not " + std::to_string(options.frames)};
  }
  if (!(options.weight > 0 && options.weight <= 1 && options.max_jump >= 0) ||
      options.keep_frames < 0 || options.keep_frames > kMostKept) {
    return Error{Errc::invalid_argument,
                 "the average of depth needs a weight above 0 and up to 1, a jump of 0 or more, "
                 "and 0 to " +
                     std::to_string(kMostKept) + " frames to keep a pixel"};
  }
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

std::span<const float> DepthAverager::update(const DepthFrame& frame, ThreadPool& pool) {
  Impl& d = *impl_;
  PALPATE_ASSERT(frame.width == d.width && frame.height == d.height &&
                 frame.pixels.size() == d.depth.size());
  pool.parallel_for(d.height, [&](int v) {
    const std::size_t begin = static_cast<std::size_t>(v) * static_cast<std::size_t>(d.width);
    for (std::size_t i = begin; i < begin + static_cast<std::size_t>(d.width); ++i) {
      d.depth[i] = d.update(i, frame.pixels[i], frame.unit);
    }
  });
  return d.depth;
}

}  // namespace palpate
