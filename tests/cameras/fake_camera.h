// Controls of the camera of an emulated library.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "tests/cameras/camera_fakes.h"

namespace palpate::test {

struct FakeCamera {
  std::atomic<bool> is_plugged = true, is_stalled = false;
  std::atomic<int> microseconds = 5000;  ///< between frames
  std::atomic<int> num_objects = 0;      ///< of the library, not yet released
};

/// Frames are pattern(width, height, number % kNumPatterns), made once.
inline constexpr int kNumPatterns = 30;
inline std::uint16_t* repeated_pattern(int width, int height, int number) {
  static auto all = [&] {
    std::vector<std::vector<std::uint16_t>> made;
    for (int k = 0; k < kNumPatterns; ++k) made.push_back(pattern(width, height, k));
    return made;
  }();
  return all[static_cast<std::size_t>(number % kNumPatterns)].data();
}

}  // namespace palpate::test
