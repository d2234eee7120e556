// How long something takes, again and again: percentiles without keeping the samples.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace palpate {

/// Counts durations in buckets that are 1/32 of an octave wide (error <= 2.2 %), from 1 ns to 18 s.
/// One thread records, wait-free and without allocation; any thread may read meanwhile.
class LatencyHistogram {
 public:
  void record(std::int64_t nanoseconds) noexcept;

  struct Summary {
    std::uint64_t num = 0;
    double p50 = 0, p99 = 0, p999 = 0, max = 0, mean = 0;  ///< microseconds
  };
  Summary summary() const noexcept;
  std::uint64_t num_above(std::int64_t nanoseconds) const noexcept;

  static constexpr int kBucketsPerOctave = 32, kNumBuckets = 35 * kBucketsPerOctave;
  /// For drawing: samples in a bucket, and its lower end in nanoseconds.
  std::uint64_t count(int bucket) const noexcept;
  static double lower_end(int bucket) noexcept;

 private:
  std::array<std::atomic<std::uint64_t>, kNumBuckets> counts_{};
  std::atomic<std::int64_t> max_ = 0, sum_ = 0;
};

}  // namespace palpate
