#include "palpate/core/core.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;

int bucket_of(std::int64_t nanoseconds) {
  if (nanoseconds <= 1) return 0;
  const double octaves = std::log2(static_cast<double>(nanoseconds));
  return std::min(static_cast<int>(octaves * LatencyHistogram::kBucketsPerOctave),
                  LatencyHistogram::kNumBuckets - 1);
}

/// One writer: what it has read is still true when it writes.
template <class T>
void add(std::atomic<T>& sum, T value) {
  sum.store(sum.load(kRelaxed) + value, kRelaxed);
}

}  // namespace

void LatencyHistogram::record(std::int64_t nanoseconds) noexcept {
  const std::int64_t time = std::max<std::int64_t>(nanoseconds, 0);
  add<std::uint64_t>(counts_[static_cast<std::size_t>(bucket_of(time))], 1);
  add(sum_, time);
  if (time > max_.load(kRelaxed)) max_.store(time, kRelaxed);
}

LatencyHistogram::Summary LatencyHistogram::summary() const noexcept {
  std::array<std::uint64_t, kNumBuckets> counts;
  Summary summary;
  for (int i = 0; i < kNumBuckets; ++i) {
    const std::uint64_t n = counts[static_cast<std::size_t>(i)] = count(i);
    summary.num += n;
  }
  if (summary.num == 0) return summary;

  const double max = static_cast<double>(max_.load(kRelaxed));
  // The middle of the bucket that holds the sample of that rank, in microseconds.
  const auto percentile = [&](double share) {
    const auto rank =
        static_cast<std::uint64_t>(std::ceil(share * static_cast<double>(summary.num)));
    std::uint64_t num = 0;
    int bucket = 0;
    while (num + counts[static_cast<std::size_t>(bucket)] < rank) {
      num += counts[static_cast<std::size_t>(bucket++)];
    }
    return std::min(std::sqrt(lower_end(bucket) * lower_end(bucket + 1)), max) / 1000;
  };
  summary.p50 = percentile(0.5);
  summary.p99 = percentile(0.99);
  summary.p999 = percentile(0.999);
  summary.max = max / 1000;
  summary.mean = static_cast<double>(sum_.load(kRelaxed)) / static_cast<double>(summary.num) / 1000;
  return summary;
}

std::uint64_t LatencyHistogram::num_above(std::int64_t nanoseconds) const noexcept {
  std::uint64_t num = 0;
  for (int i = bucket_of(nanoseconds) + 1; i < kNumBuckets; ++i) num += count(i);
  return num;
}

std::uint64_t LatencyHistogram::count(int bucket) const noexcept {
  return counts_[static_cast<std::size_t>(bucket)].load(kRelaxed);
}

double LatencyHistogram::lower_end(int bucket) noexcept {
  return std::exp2(static_cast<double>(bucket) / kBucketsPerOctave);
}

}}  // namespace palpate::v0
