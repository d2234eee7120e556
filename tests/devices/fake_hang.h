// Calls of a fake library that never come back: those that the test or FAKE_SDK_HANG=CALL[:N]
// names, the latter from the N-th on.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>

namespace palpate::test {

class Hang {
 public:
  Hang() {
    const char* const given = std::getenv("FAKE_SDK_HANG");
    if (given == nullptr) return;
    name_ = given;
    const std::size_t colon = name_.find(':');
    if (colon == std::string::npos) return;
    first_ = std::atoi(name_.c_str() + colon + 1);
    name_.resize(colon);
  }

  /// At the begin of every call.
  void pass(const char* call) {
    const bool is_named = name_ == call && ++num_calls_ >= first_;
    if (!is_named && !is_in(call)) return;
    ++num_hanging;
    while (is_named || is_in(call)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    --num_hanging;
  }

  std::atomic<const char*> in{nullptr};  ///< the call that hangs until this is something else
  std::atomic<int> num_hanging{0};       ///< calls at the moment

 private:
  bool is_in(const char* call) const {
    const char* const name = in;
    return name != nullptr && std::strcmp(name, call) == 0;
  }

  std::string name_;
  int first_ = 1;
  std::atomic<int> num_calls_{0};
};

}  // namespace palpate::test
