// Times of single calls inside a Google Benchmark: a haptic loop depends on the tail.
#pragma once

#include <utility>
#include <vector>

#include <benchmark/benchmark.h>

#include "bench/harness.h"

namespace palpate::bench {

/// `Latency latency(state); for (auto _ : state) latency.time([&] { work(); });` Use with
/// UseManualTime(). Reports p50, p99, p99.9 and max in microseconds as counters.
class Latency {
 public:
  explicit Latency(benchmark::State& state) : state_(state) { times_.reserve(1 << 20); }
  ~Latency() {
    if (times_.empty()) return;
    const CallTimes times = call_times(std::move(times_));
    state_.counters["p50_us"] = times.median;
    state_.counters["p99_us"] = times.p99;
    state_.counters["p999_us"] = times.p999;
    state_.counters["max_us"] = times.max;
  }
  Latency(const Latency&) = delete;
  Latency& operator=(const Latency&) = delete;

  template <class Work>
  void time(Work&& work) {
    const Clock::time_point start = Clock::now();
    work();
    times_.push_back(microseconds_since(start));
    state_.SetIterationTime(1e-6 * times_.back());
  }

 private:
  benchmark::State& state_;
  std::vector<double> times_;  // microseconds
};

}  // namespace palpate::bench
