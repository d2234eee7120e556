// Validity of the wrench for ROS 2, with the reason if it is invalid, and the contact as robots get
// it: without numbers unless it is valid.
#pragma once

#include <cstdint>
#include <string>

#include "palpate/run/records.h"
#include "palpate/tool/tool.h"
#include "src/io/internal/ros_messages.h"

namespace palpate::apps {

/// Created a thousand times per second, so without text.
struct RosVerdict {
  enum class Why : std::uint8_t {
    none,
    camera_is_lost,
    gpu_is_lost,
    pose_is_old,
    nothing_measured,
    depth_is_old,
    contact_is_old,
    not_measured,
    has_ended,
    no_thread,
  };

  RosContact::State state = RosContact::State::valid;
  Why why = Why::none;
  double depth_age = 0, contact_age = 0;  // s

  bool is_valid() const { return state == RosContact::State::valid; }
  /// Returns the reason; empty if it is valid.
  std::string reason() const;
};

/// Judges the newest tick at a time, s, monotonic: its inputs may be as old as `max_age`, s.
RosVerdict judge(const TickRecord& tick, double time, double max_age);

/// Returns the contact of a tick in the frame of the tool. `newest`: the last measured contact, for
/// the stiffness and newtons. `full_volume`: that of the whole tool, m3.
RosContact contact_of(const TickRecord& tick, const RosVerdict& verdict,
                      const ContactRecord& newest, const Tool& tool, double full_volume);

}  // namespace palpate::apps
