// Controls of the cameras of the emulated Orbbec SDK.
#pragma once

#include <atomic>

namespace palpate::test {

struct FakeOrbbec {
  std::atomic<bool> is_plugged = true, is_stalled = false, is_busy = false;
  std::atomic<int> width = 64, height = 48, microseconds = 5000;
  std::atomic<float> millimeters = 0.1f;
  std::atomic<int> lens = 4;  ///< its model of distortion
  std::atomic<float> k1 = 0;
  std::atomic<int> num_objects = 0;  ///< not yet deleted
};

}  // namespace palpate::test
