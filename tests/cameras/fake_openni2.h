// Controls of the camera behind OpenNI2.
#pragma once

#include <atomic>

namespace palpate::test {

struct FakeOpenni2 {
  std::atomic<bool> is_plugged = false, is_stalled = false;
  std::atomic<int> width = 64, height = 48, microseconds = 5000;
  std::atomic<int> num_frames = -1;  ///< so many per start; -1: no end
  std::atomic<int> num_sent = 0;
  void (*plug)(bool) = nullptr;
};

}  // namespace palpate::test
