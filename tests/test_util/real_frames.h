// The recorded depth frames of the optional data, with their cameras.
#pragma once

#include <string_view>

#include "palpate/cloud/intrinsics.h"

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

/// One of them that exists.
constexpr const RealFrame& real_frame(std::string_view name) {
  const RealFrame* frame = kRealFrames;
  while (name != frame->name) ++frame;
  return *frame;
}

}  // namespace palpate::test
