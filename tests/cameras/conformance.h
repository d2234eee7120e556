// Promises of every source of depth, whatever is behind it.
#pragma once

#include <gtest/gtest.h>

#include <unistd.h>

#include <fstream>
#include <functional>
#include <memory>
#include <thread>

#include "palpate/cloud/depth_source.h"
#include "tests/cameras/camera_fakes.h"
#include "tests/test_util/sanitized.h"

namespace palpate::test {

using OpenSource = std::function<Result<std::unique_ptr<DepthSource>>()>;

/// Resident memory of this process, bytes.
inline std::int64_t resident_bytes() {
  std::ifstream file("/proc/self/statm");
  std::int64_t all = 0, resident = 0;
  file >> all >> resident;
  return resident * sysconf(_SC_PAGESIZE);
}

/// A recording of `num` frames of the pattern, from `first` on: all of them, exact to the count, in
/// order, with times that grow; then the end.
inline void expect_recording(const OpenSource& open, int num, int width, int height,
                             int first = 0) {
  auto source = open();
  ASSERT_TRUE(source) << source.error().message;
  const DepthStreamInfo& info = (*source)->info();
  EXPECT_FALSE(info.is_live);
  EXPECT_EQ(info.width, width);
  EXPECT_EQ(info.height, height);
  EXPECT_GT(info.intrinsics.fx, 0);
  EXPECT_EQ(info.distortion, Distortion{});
  DepthFrame frame;
  double last = -1e300;
  for (int k = 0; k < num; ++k) {
    const auto got = (*source)->next(frame);
    ASSERT_TRUE(got) << k << ": " << got.error().message;
    ASSERT_TRUE(*got) << "ended after " << k << " of " << num;
    EXPECT_TRUE(frame.pixels == pattern(width, height, first + k)) << k;
    EXPECT_GT(frame.timestamp, last);
    last = frame.timestamp;
  }
  const auto end = (*source)->next(frame);
  EXPECT_TRUE(end && !*end);
}

/// Function that returns the pixels of image `number` of a camera.
using PixelsOf = std::function<std::vector<std::uint16_t>(int width, int height, int number)>;

/// A camera that sends the pattern: each frame that is taken is exact to the count and newer than
/// the one before, in number and time; a cancelled `next` returns.
inline void expect_camera(const OpenSource& open, int num, int width, int height,
                          const PixelsOf& sent = pattern) {
  auto source = open();
  ASSERT_TRUE(source) << source.error().message;
  const DepthStreamInfo& info = (*source)->info();
  EXPECT_TRUE(info.is_live);
  EXPECT_EQ(info.width, width);
  EXPECT_EQ(info.height, height);
  EXPECT_GT(info.intrinsics.fx, 0);
  DepthFrame frame;
  double last = -1e300;
  int last_number = -1;
  for (int k = 0; k < num; ++k) {
    const auto got = (*source)->next(frame);
    ASSERT_TRUE(got) << k << ": " << got.error().message;
    ASSERT_TRUE(*got);
    int number = last_number + 1;
    while (number < last_number + 4000 && frame.pixels != sent(width, height, number)) ++number;
    EXPECT_LT(number, last_number + 4000) << "no frame that was sent";
    EXPECT_GT(frame.timestamp, last);
    last = frame.timestamp;
    last_number = number;
  }
  std::thread other([&] { (*source)->cancel(); });
  for (int k = 0; k < 100; ++k) {
    const auto got = (*source)->next(frame);
    ASSERT_TRUE(got);
    if (!*got) break;
  }
  other.join();
  EXPECT_FALSE(*(*source)->next(frame));
}

/// Calls `next` until `is_done`, at most so many times.
inline bool next_until(DepthSource& source, DepthFrame& frame, const std::function<bool()>& is_done,
                       int most = 100000) {
  for (int k = 0; k < most; ++k) {
    const auto got = source.next(frame);
    if (!got || !*got) return false;
    if (is_done()) return true;
  }
  return false;
}

inline std::string all_notes(DepthSource& source) {
  std::string all;
  for (const std::string& note : source.take_notes()) all += note + "\n";
  return all;
}

/// Expects that the camera is lost while `trouble` is on, and back with newer frames after it.
inline void expect_outlives(const OpenSource& open, const std::function<void(bool)>& trouble,
                            double seconds) {
  const auto camera = open();
  ASSERT_TRUE(camera) << camera.error().message;
  DepthFrame frame;
  ASSERT_TRUE(*(*camera)->next(frame));
  trouble(true);
  std::atomic<bool> is_over = false;
  double last = frame.timestamp;
  std::thread other([&] {
    sleep_seconds(seconds);
    is_over = true;
    trouble(false);
  });
  EXPECT_TRUE(next_until(**camera, frame, [&] {
    EXPECT_GT(frame.timestamp, last);
    last = frame.timestamp;
    return is_over.load();
  }));
  other.join();
  EXPECT_TRUE(*(*camera)->next(frame));
  EXPECT_GT(frame.timestamp, last);
  const std::string notes = all_notes(**camera);
  EXPECT_NE(notes.find("was lost"), std::string::npos) << notes;
  EXPECT_NE(notes.find("is back"), std::string::npos) << notes;
}
/// Expects the same of unplugging, during which the camera cannot be opened anew.
inline void expect_outlives_unplugging(const OpenSource& open,
                                       const std::function<void(bool)>& plug) {
  const auto unplug = [&](bool is_out) {
    plug(!is_out);
    if (is_out) {
      EXPECT_FALSE(open());
    }
  };
  expect_outlives(open, unplug, 4);
}
inline void expect_outlives_a_stall(const OpenSource& open,
                                    const std::function<void(bool)>& stall) {
  expect_outlives(open, stall, 3.5);
}

/// Memory after so many frames is that after the first tenth of them, give or take 4 MB. Not under
/// sanitizers, which keep what was freed.
inline void expect_no_growth(DepthSource& source, int num) {
  DepthFrame frame;
  std::int64_t before = 0;
  for (int k = 0; k < num; ++k) {
    const auto got = source.next(frame);
    ASSERT_TRUE(got) << got.error().message;
    ASSERT_TRUE(*got) << k;
    if (k == num / 10) before = resident_bytes();
  }
  if (!kIsSanitized) {
    EXPECT_LT(resident_bytes(), before + (4 << 20));
  }
}

}  // namespace palpate::test
