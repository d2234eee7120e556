// Output of the benchmarks of the CUDA backend: one CSV row for each case.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "palpate/core/core.h"

namespace palpate::bench {

using Clock = std::chrono::steady_clock;

inline double microseconds_since(Clock::time_point start) {
  return std::chrono::duration<double, std::micro>(Clock::now() - start).count();
}

/// Prints one row: distribution of the times of single calls, microseconds.
inline void report(const std::string& name, std::vector<double>& times) {
  std::sort(times.begin(), times.end());
  const auto at = [&](double share) {
    return times[static_cast<std::size_t>(share * static_cast<double>(times.size() - 1))];
  };
  double mean = 0, squares = 0;
  for (const double t : times) mean += t / static_cast<double>(times.size());
  for (const double t : times) squares += (t - mean) * (t - mean);
  std::printf("%s,%zu,%.2f,%.2f,%.2f,%.2f,%.2f,%.2f\n", name.c_str(), times.size(), at(0.5),
              at(0.99), at(0.999), times.back(), mean,
              std::sqrt(squares / static_cast<double>(times.size())));
  std::fflush(stdout);
}

[[noreturn]] inline void stop(const Error& error) {
  std::fprintf(stderr, "gpu_bench: %s\n", error.message.c_str());
  std::exit(1);
}

template <class T>
T value_or_stop(Result<T> result) {
  if (!result) stop(result.error());
  return std::move(result).value();
}

}  // namespace palpate::bench
