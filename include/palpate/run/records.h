// What happens in a run: contacts and ticks, as they are recorded and shown.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/body_contact.h"
#include "palpate/field/sensor.h"
#include "palpate/haptics/coupling.h"
#include "palpate/haptics/local_contact.h"
#include "palpate/haptics/safety.h"
#include "palpate/math/geometry.h"
#include "palpate/settings/setting_table.h"

namespace palpate::inline v0 {

// How they are told to others.

/// In whose axes a wrench is told.
enum class WrenchFrame {
  world,
  camera,  ///< the first one, where it was at the newest of its images that is felt
  tool,    ///< its centre point E
  device,  ///< its base
  named,   ///< N, a frame of the user's
};
constexpr auto names_of(WrenchFrame) {
  return std::array{"world", "camera", "tool", "device", "named"};
}

/// About which point a torque is told.
enum class WrenchPoint {
  center_of_mass,  ///< of the tool's spheres, as everything inside counts it
  tcp,             ///< the tool's centre point
  origin,          ///< of the frame that it is told in
};
constexpr auto names_of(WrenchPoint) { return std::array{"center_of_mass", "tcp", "origin"}; }

/// What is told of pose and wrench beside what everything inside counts, which no setting changes:
/// the world's axes and the center of mass.
struct OutputOptions {
  std::optional<WrenchFrame> wrench_frame;  ///< none: the world; over ROS 2 the tool
  WrenchPoint wrench_point = WrenchPoint::center_of_mass;
  Pose X_TE;  ///< the tool's centre point, with axes of its own, in the tool
  Pose X_WN;  ///< the named frame in the world

  friend bool operator==(const OutputOptions&, const OutputOptions&) = default;
};
inline void add_settings(SettingTable& t, OutputOptions& o) {
  t.section("output");
  t.add("wrench_frame", o.wrench_frame,
        "in whose axes pose and wrench are told once more, in columns told_* of wrench.csv; auto: "
        "the world's; over ROS 2 the tool's");
  t.add("wrench_point", o.wrench_point, "about which point the torque of told_* is");
  t.add("tcp", o.X_TE,
        "X_TE, the tool's centre point in the frame of its mesh: x y z in m, quaternion x y z w; "
        "poses of told_* are its");
  t.add("named_frame", o.X_WN,
        "X_WN of wrench_frame = named, in the world: x y z in m, quaternion");
}

// What is recorded and shown.

/// A depth frame that has become a surface.
struct FrameRecord {
  std::uint64_t number = 0;        ///< from 0, without gaps, of all cameras together
  std::uint32_t camera = 0;        ///< which one saw it
  std::uint64_t camera_frame = 0;  ///< from 0, without gaps, of that camera
  std::uint32_t revision = 0;      ///< of the settings that its surface was made with
  double capture_time = 0;         ///< s, on the clock of the device states
  double source_time = 0;          ///< s, DepthFrame::timestamp
  double unit = 0.001;             ///< m per count
  Pose X_WC;                       ///< of the camera in the world, when the frame was captured
  SurfaceStats surface;
  PixelWindow asked;  ///< as DepthFieldView: where its surface can be asked
  std::int64_t compute_nanoseconds = 0;
  double period = 0;  ///< s, to the next frame as the timeline expects it; not recorded with it
};

/// The hand's side between two ticks: where a recording, and a repetition, can begin.
struct HandMoment {
  std::uint64_t tick = 0;      ///< number of the next one
  std::uint32_t revision = 0;  ///< of the settings that the last one was computed with
  StateNumbers numbers;        ///< HandPart::remember
};

/// One tick of the haptic thread, as it is published.
struct TickRecord {
  std::uint32_t revision = 0;  ///< of the settings that it was computed with, from 0
  double time = 0;             ///< s since the loop began
  DeviceState device;
  CouplingStep step;
  Wrench F_H_B;             ///< what went to the device
  Penetration penetration;  ///< of the contact it rests on: cloud and objects
  Penetration objects;      ///< the objects' share of it
  std::int64_t num_object_pairs = 0;
  double contact_age = 0;  ///< s
  double sensor_age = 0;   ///< s, from the depth frame to this force
  std::uint64_t contact_number = 0, frame_number = 0;
  SafetyStatus safety;
  std::int64_t compute_nanoseconds = 0;

  // What else it takes to repeat the tick.
  std::uint64_t number = 0;         ///< from 0
  double dt = 0;                    ///< s, of the coupling's step; 0: no hand has been seen yet
  bool is_stopping = false;         ///< the safety filter has been told to stop
  bool is_force_asked_for = false;  ///< somebody wants it back after a fault
  bool has_sensor_failed = false, has_backend_failed = false;
};

/// What one camera showed at a contact.
struct CameraMoment {
  /// FrameRecord::camera_frame of its newest surface; -1: it had shown nothing yet.
  std::int64_t camera_frame = -1;
  double progress = 1;  ///< from the surface before to that one

  friend bool operator==(const CameraMoment&, const CameraMoment&) = default;
};

/// Of each camera of a run.
struct CameraMoments {
  std::uint32_t num = 0;
  CameraMoment of[kMostCameras] = {};
};

/// Where objects that move were, in the order of the objects.
struct BodyPoses {
  std::uint32_t num = 0;
  Pose of[kMostMovingBodies] = {};  ///< X_WB
};

/// One contact query, with all that it takes to repeat it.
struct ContactRecord {
  std::uint32_t revision = 0;  ///< of the settings that it was computed with, from 0
  double time = 0;
  Pose X_WT;
  Penetration penetration;            ///< cloud and objects, see BodyMeasure::total
  Penetration objects;                ///< the objects' share of it
  std::int64_t num_object_pairs = 0;  ///< spheres of tool and objects that overlap
  std::uint64_t number = 0;
  std::uint64_t frame_number = 0;  ///< of the newest frame that it rests on
  CameraMoments cameras;
  BodyPoses bodies;  ///< that the tool was measured against

  double capture_time = 0;  ///< s, monotonic: of the oldest one of the cameras' newest frames
  LocalContact contact;     ///< what the haptic thread is told
  bool has_new_stiffness = false;  ///< else that of an earlier contact, or none
};

}  // namespace palpate::inline v0
