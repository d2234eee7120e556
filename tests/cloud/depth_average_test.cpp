#include "palpate/cloud/depth_source.h"

#include <cmath>
#include <cstring>
#include <optional>

#include <gtest/gtest.h>

#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr int kWidth = 20, kHeight = 12, kSize = kWidth * kHeight;

/// Noise around a surface that sometimes is another one, with lost pixels.
std::vector<DepthFrame> random_stream(int num_frames, std::uint64_t seed) {
  test::Random random(seed);
  std::vector<DepthFrame> frames(static_cast<std::size_t>(num_frames));
  for (DepthFrame& frame : frames) {
    frame.width = kWidth;
    frame.height = kHeight;
    for (int i = 0; i < kSize; ++i) {
      const double z = (random.uniform() < 0.1 ? 1500 : 800) + 6 * random.normal();
      const double dice = random.uniform();
      frame.pixels.push_back(dice < 0.15  ? 0
                             : dice < 0.2 ? 65535
                                          : static_cast<std::uint16_t>(std::lround(z)));
    }
  }
  return frames;
}

/// Computes the average of one pixel from its whole history.
std::optional<double> brute_force(const std::vector<DepthFrame>& frames, std::size_t end,
                                  std::size_t pixel, const DepthAverageOptions& options) {
  std::vector<double> history;  // of the surface that it shows
  int missing = 0;
  const auto average = [&] {
    double mean = history.front();
    for (std::size_t k = 1; k < history.size(); ++k) {
      mean += options.weight * (history[k] - mean);
    }
    if (options.kind == DepthAverage::exponential) return mean;
    const std::size_t first =
        history.size() - std::min(history.size(), static_cast<std::size_t>(options.frames));
    double sum = 0;
    for (std::size_t k = first; k < history.size(); ++k) sum += history[k];
    return sum / static_cast<double>(history.size() - first);
  };
  for (std::size_t k = 0; k <= end; ++k) {
    const int count = frames[k].pixels[pixel];
    if (count == 0 || count == 65535) {
      if (++missing > options.keep_frames) history.clear();
      continue;
    }
    missing = 0;
    if (!history.empty() && std::abs(count - average()) > options.max_jump * average()) {
      history.clear();
    }
    history.push_back(count);
  }
  if (history.empty()) return std::nullopt;
  return average() * frames[end].unit;
}

TEST(DepthAverager, EqualsBruteForce) {
  const std::vector<DepthFrame> frames = random_stream(40, 1);
  ThreadPool pool(2);
  for (const DepthAverage kind : {DepthAverage::moving, DepthAverage::exponential}) {
    for (const int num : {1, 3, 8}) {
      for (const int keep : {0, 2}) {
        const DepthAverageOptions options{kind, num, 0.3, 0.03, keep};
        DepthAverager averager = std::move(DepthAverager::create(kWidth, kHeight, options)).value();
        for (std::size_t k = 0; k < frames.size(); ++k) {
          const std::span<const float> depth = averager.update(frames[k], pool);
          for (std::size_t i = 0; i < kSize; ++i) {
            if (frames[k].pixels[i] == kFarCount) {
              ASSERT_EQ(depth[i], INFINITY) << k << " " << i;
              continue;
            }
            const auto expected = brute_force(frames, k, i, options);
            ASSERT_EQ(expected.has_value(), !std::isnan(depth[i])) << k << " " << i;
            if (!expected) continue;
            ASSERT_NEAR(static_cast<double>(depth[i]), *expected, 1e-6) << k << " " << i;
          }
        }
      }
    }
  }
}

// A wall that rests, by a camera that scales its counts: half a percent is less than `max_jump`.
TEST(DepthAverager, CountsOfAnotherUnitAreNotMixed) {
  ThreadPool pool(2);
  for (const DepthAverage kind : {DepthAverage::moving, DepthAverage::exponential}) {
    const DepthAverageOptions options{kind, 4, 0.3, 0.03, 2};
    DepthAverager averager = std::move(DepthAverager::create(kWidth, kHeight, options)).value();
    for (int k = 0; k < 12; ++k) {
      const std::uint16_t count = k / 3 % 2 == 0 ? 1000 : 1005;
      const DepthFrame frame{kWidth, kHeight, 1.0 / count, std::vector<std::uint16_t>(kSize, count),
                             0};
      for (const float z : averager.update(frame, pool)) ASSERT_NEAR(z, 1, 1e-6) << k;
    }
  }
}

TEST(DepthAverager, NoneOnlyConverts) {
  const std::vector<DepthFrame> frames = random_stream(2, 2);
  ThreadPool pool(1);
  DepthAverager averager = std::move(DepthAverager::create(kWidth, kHeight, {})).value();
  for (const DepthFrame& frame : frames) {
    const std::span<const float> depth = averager.update(frame, pool);
    for (std::size_t i = 0; i < kSize; ++i) {
      const int count = frame.pixels[i];
      if (count == kFarCount) {
        EXPECT_EQ(depth[i], INFINITY);
      } else if (count == 0) {
        EXPECT_TRUE(std::isnan(depth[i]));
      } else {
        EXPECT_EQ(depth[i], static_cast<float>(count * frame.unit));
      }
    }
  }
}

TEST(DepthAverager, SameBitsForAnyNumberOfThreadsAndNoAllocation) {
  const std::vector<DepthFrame> frames = random_stream(20, 3);
  for (const DepthAverage kind : {DepthAverage::moving, DepthAverage::exponential}) {
    std::vector<float> first;
    for (const int num_threads : {1, 2, 5}) {
      ThreadPool pool(num_threads);
      DepthAverageOptions options;
      options.kind = kind;
      DepthAverager averager = std::move(DepthAverager::create(kWidth, kHeight, options)).value();
      std::span<const float> depth;
      const test::AllocationCounter counter;
      for (const DepthFrame& frame : frames) depth = averager.update(frame, pool);
      EXPECT_EQ(counter.count(), 0u);
      if (first.empty()) first.assign(depth.begin(), depth.end());
      EXPECT_EQ(std::memcmp(first.data(), depth.data(), kSize * sizeof(float)), 0);
    }
  }
}

TEST(DepthAverager, RefusesBadOptions) {
  const auto refuses = [](const DepthAverageOptions& options) {
    return !DepthAverager::create(kWidth, kHeight, options);
  };
  const auto kind = DepthAverage::moving;
  EXPECT_TRUE(refuses({kind, 0}));
  EXPECT_TRUE(refuses({kind, 65}));
  EXPECT_TRUE(refuses({kind, 8, 0}));
  EXPECT_TRUE(refuses({kind, 8, 1.1}));
  EXPECT_TRUE(refuses({kind, 8, NAN}));
  EXPECT_TRUE(refuses({kind, 8, 0.5, -1}));
  EXPECT_TRUE(refuses({kind, 8, 0.5, 0.03, -1}));
  EXPECT_TRUE(refuses({kind, 8, 0.5, 0.03, 101}));
  EXPECT_FALSE(refuses({kind, 64, 1, 0, 100}));
  EXPECT_FALSE(DepthAverager::create(7, 100, {}));
  EXPECT_FALSE(DepthAverager::create(100, 5000, {}));
}

}  // namespace
}  // namespace palpate
