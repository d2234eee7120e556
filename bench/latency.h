// Times of single calls inside a Google Benchmark: a haptic loop depends on the tail.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <vector>

#include <benchmark/benchmark.h>

namespace palpate::bench {

/// `Latency latency(state); for (auto _ : state) latency.time([&] { work(); });` Use with
/// UseManualTime(). Reports p50, p99, p99.9 and max in microseconds as counters.
class Latency {
 public:
  explicit Latency(benchmark::State& state) : state_(state) { times_.reserve(1 << 20); }
  ~Latency() {
    if (times_.empty()) return;
    std::sort(times_.begin(), times_.end());
    state_.counters["p50_us"] = at(0.5);
    state_.counters["p99_us"] = at(0.99);
    state_.counters["p999_us"] = at(0.999);
    state_.counters["max_us"] = times_.back() * 1e6;
  }
  Latency(const Latency&) = delete;
  Latency& operator=(const Latency&) = delete;

  template <class Work>
  void time(Work&& work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    times_.push_back(elapsed.count());
    state_.SetIterationTime(elapsed.count());
  }

 private:
  double at(double share) const {
    return times_[static_cast<std::size_t>(share * static_cast<double>(times_.size() - 1))] * 1e6;
  }

  benchmark::State& state_;
  std::vector<double> times_;
};

}  // namespace palpate::bench
