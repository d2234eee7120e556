// Waiting for what other threads do.
#pragma once

#include <chrono>
#include <thread>

namespace palpate::test {

/// Until `condition` or for two minutes, when even a busy machine would have come to it.
/// Allocates nothing.
template <class Condition>
bool wait_for(Condition&& condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(2);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

}  // namespace palpate::test
