#include "palpate/core/core.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <thread>
#include <vector>

#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr double kBucketWidth = 1.0219;  // 2^(1/32)

TEST(LatencyHistogram, IsEmptyAtFirst) {
  const LatencyHistogram histogram;
  const auto summary = histogram.summary();
  EXPECT_EQ(summary.num, 0u);
  EXPECT_EQ(summary.p50, 0);
  EXPECT_EQ(summary.max, 0);
  EXPECT_EQ(summary.mean, 0);
  EXPECT_EQ(histogram.num_above(0), 0u);
}

TEST(LatencyHistogram, BucketsAreAThirtySecondOfAnOctave) {
  EXPECT_DOUBLE_EQ(LatencyHistogram::lower_end(0), 1);
  EXPECT_DOUBLE_EQ(LatencyHistogram::lower_end(32), 2);
  EXPECT_DOUBLE_EQ(LatencyHistogram::lower_end(320), 1024);
  for (int i = 0; i < LatencyHistogram::kNumBuckets; ++i) {
    EXPECT_LT(LatencyHistogram::lower_end(i + 1) / LatencyHistogram::lower_end(i), kBucketWidth);
  }
}

TEST(LatencyHistogram, EverySampleIsInItsBucket) {
  test::Random random(1);
  for (int i = 0; i < 20'000; ++i) {
    const auto time = static_cast<std::int64_t>(std::exp2(random.uniform(0, 34)));
    LatencyHistogram histogram;
    histogram.record(time);
    int bucket = 0;
    while (histogram.count(bucket) == 0) ++bucket;
    const double t = static_cast<double>(time), ulp = 1 + 1e-12;
    ASSERT_LE(LatencyHistogram::lower_end(bucket), t * ulp);
    ASSERT_GT(LatencyHistogram::lower_end(bucket + 1) * ulp, t);
  }
}

TEST(LatencyHistogram, PercentilesAreThoseOfTheSortedSamples) {
  test::Random random(2);
  for (int num : {1, 2, 10, 999, 100'000}) {
    LatencyHistogram histogram;
    std::vector<std::int64_t> samples;
    double sum = 0;
    for (int i = 0; i < num; ++i) {
      samples.push_back(static_cast<std::int64_t>(20'000 * std::exp(random.normal())));
      histogram.record(samples.back());
      sum += static_cast<double>(samples.back());
    }
    std::sort(samples.begin(), samples.end());
    const auto exact = [&](double share) {
      const auto rank = static_cast<std::size_t>(std::ceil(share * num));
      return static_cast<double>(samples[rank - 1]) / 1000;
    };
    const auto summary = histogram.summary();
    EXPECT_EQ(summary.num, static_cast<std::uint64_t>(num));
    EXPECT_NEAR(summary.p50 / exact(0.5), 1, 0.011);
    EXPECT_NEAR(summary.p99 / exact(0.99), 1, 0.011);
    EXPECT_NEAR(summary.p999 / exact(0.999), 1, 0.011);
    EXPECT_DOUBLE_EQ(summary.max, exact(1));
    EXPECT_NEAR(summary.mean, sum / num / 1000, 1e-9 * sum);
    EXPECT_LE(summary.p999, summary.max);

    const std::int64_t limit = 50'000;
    const auto above = [&](double t) {
      return static_cast<std::uint64_t>(
          std::count_if(samples.begin(), samples.end(),
                        [t](std::int64_t x) { return static_cast<double>(x) > t; }));
    };
    EXPECT_LE(histogram.num_above(limit), above(static_cast<double>(limit)));
    EXPECT_GE(histogram.num_above(limit), above(static_cast<double>(limit) * kBucketWidth));
  }
}

TEST(LatencyHistogram, TakesAnyTime) {
  LatencyHistogram histogram;
  for (std::int64_t time : {INT64_MIN, std::int64_t{-1}, std::int64_t{0}, std::int64_t{1}}) {
    histogram.record(time);
  }
  EXPECT_EQ(histogram.count(0), 4u);
  histogram.record(INT64_MAX / 2);
  EXPECT_EQ(histogram.count(LatencyHistogram::kNumBuckets - 1), 1u);
  EXPECT_GT(histogram.summary().max, 1e15);
  EXPECT_EQ(histogram.num_above(1), 1u);
  EXPECT_EQ(histogram.num_above(INT64_MAX), 0u);
}

TEST(LatencyHistogram, AnotherThreadReadsWhileOneRecords) {
  LatencyHistogram histogram;
  constexpr std::uint64_t kNumSamples = 200'000;
  std::thread recorder([&histogram] {
    const test::AllocationCounter counter;
    for (std::uint64_t i = 0; i < kNumSamples; ++i) histogram.record(1000);
    EXPECT_EQ(counter.count(), 0u);
  });
  std::uint64_t num = 0;
  bool only_grows = true;
  while (num < kNumSamples) {
    const auto summary = histogram.summary();
    only_grows = only_grows && summary.num >= num;
    num = summary.num;
    std::this_thread::yield();
  }
  recorder.join();
  EXPECT_TRUE(only_grows);
  EXPECT_DOUBLE_EQ(histogram.summary().mean, 1);
  EXPECT_NEAR(histogram.summary().p50, 1, 0.022);
}

}  // namespace
}  // namespace palpate
