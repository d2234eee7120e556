#include <chrono>
#include <utility>

#include "palpate/session/run.h"

namespace palpate { inline namespace v0 {

void RunMarks::add(std::string text) {
  const std::chrono::duration<double> now = std::chrono::steady_clock::now().time_since_epoch();
  const std::lock_guard lock(mutex_);
  marks_.push_back({now.count(), std::move(text)});
}

std::vector<RunMarks::Mark> RunMarks::take() {
  const std::lock_guard lock(mutex_);
  return std::exchange(marks_, {});
}

}}  // namespace palpate::v0
