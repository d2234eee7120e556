// Wall time and CPU time of this process since construction.
#pragma once

#include <chrono>
#include <ctime>

namespace palpate::bench {

struct Times {
  double wall = 0, cpu = 0;  ///< seconds
};

class Stopwatch {
 public:
  Times elapsed() const {
    const std::chrono::duration<double> wall = Clock::now() - wall_;
    return {wall.count(), static_cast<double>(std::clock() - cpu_) / CLOCKS_PER_SEC};
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point wall_ = Clock::now();
  std::clock_t cpu_ = std::clock();
};

}  // namespace palpate::bench
