// The recorded depth frames of the optional data with their cameras, and made ones beside them:
// tests that query real frames run with both, the recorded ones skipped by name where there are
// none.
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/cloud/depth_source.h"
#include "tests/test_util/data.h"
#include "tests/test_util/made_frame.h"

namespace palpate::test {

struct RealFrame {
  const char* name;  ///< of frames/NAME.png
  Intrinsics intrinsics;
};

inline constexpr RealFrame kRealFrames[] = {
    {"pcl_person", {525, 525, 319.5, 239.5}},
    {"pcl_floor_box_chair", {525, 525, 320, 240}},
    {"pcl_milk_clorox_table", {525, 525, 319.5, 239.5}},
    {"pcl_stairs_shelf_1", {525, 525, 319.5, 239.5}},
    {"pcl_stairs_shelf_2", {525, 525, 319.5, 239.5}},
    {"pcl_grabber_1", {525, 525, 320, 240}},
    {"pcl_grabber_2", {525, 525, 320, 240}},
    {"pcl_grabber_3", {525, 525, 320, 240}},
    {"realsense_room_0", {617.25, 617.549, 317.392, 245.98}},
    {"realsense_room_2", {617.25, 617.549, 317.392, 245.98}},
    {"realsense_room_4", {617.25, 617.549, 317.392, 245.98}},
    {"slambook_desk_1", {518, 519, 325.5, 253.5}},
};

/// A frame to try something on.
struct TriedFrame {
  std::string name;
  Intrinsics intrinsics;
  DepthFrame frame;
};

/// Recorded: those of `names` (none: all) by load(path) -> DepthFrame, nothing where there are no
/// data. Made: all made ones.
template <class Load>
std::vector<TriedFrame> frames_of(Origin origin, const Load& load,
                                  const std::vector<std::string_view>& names = {}) {
  std::vector<TriedFrame> frames;
  if (origin == Origin::made) {
    for (int i = 0; i < kNumMadeFrames; ++i)
      frames.push_back({"made_" + std::to_string(i), kMadeIntrinsics, made_frame(i)});
    return frames;
  }
  const auto folder = data_folder();
  if (!folder) return frames;
  for (const RealFrame& real : kRealFrames) {
    if (!names.empty() && std::find(names.begin(), names.end(), real.name) == names.end()) continue;
    frames.push_back(
        {real.name, real.intrinsics, load(*folder / "frames" / (std::string(real.name) + ".png"))});
  }
  return frames;
}

/// `variable` = frames_of(GetParam(), ...); skips the test by name where there are none.
#define PALPATE_FRAMES_OR_SKIP(variable, ...)               \
  const std::vector<::palpate::test::TriedFrame> variable = \
      ::palpate::test::frames_of(GetParam(), __VA_ARGS__);  \
  if (variable.empty()) GTEST_SKIP() << "SKIPPED: no recorded depth frames (set PALPATE_DATA)"

/// Both kinds of frames for TEST_P(suite, ...).
#define PALPATE_ON_ALL_FRAMES(suite)                                                     \
  class suite : public testing::TestWithParam<::palpate::test::Origin> {};               \
  INSTANTIATE_TEST_SUITE_P(                                                              \
      Frames, suite,                                                                     \
      testing::Values(::palpate::test::Origin::recorded, ::palpate::test::Origin::made), \
      ::palpate::test::name_of)

}  // namespace palpate::test
