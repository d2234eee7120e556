// Records of a run: frames, contacts and ticks, as recorded and shown.
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

namespace palpate { inline namespace v0 {

// Output conventions.

/// The frame in which a wrench is reported.
enum class WrenchFrame {
  world,
  camera,  ///< the first one, at the capture of its newest image in use
  tool,    ///< its center point E
  device,  ///< its base
  named,   ///< N, a frame of the user's
};
constexpr auto names_of(WrenchFrame) {
  return std::array{"world", "camera", "tool", "device", "named"};
}

/// The reference point of a reported torque.
enum class WrenchPoint {
  center_of_mass,  ///< of the tool's spheres, as used internally
  tcp,             ///< the tool center point
  origin,          ///< of the frame of the wrench
};
constexpr auto names_of(WrenchPoint) { return std::array{"center_of_mass", "tcp", "origin"}; }

/// Additional output of pose and wrench in another frame. Internally everything stays in world axes
/// and about the center of mass.
struct OutputOptions {
  std::optional<WrenchFrame> wrench_frame;  ///< none: the world; over ROS 2 the tool
  WrenchPoint wrench_point = WrenchPoint::center_of_mass;
  Pose X_TE;  ///< the tool center point with its own axes, in the tool
  Pose X_WN;  ///< the named frame in the world

  friend bool operator==(const OutputOptions&, const OutputOptions&) = default;
};
inline void add_settings(SettingTable& t, OutputOptions& o) {
  t.section("output");
  t.add("wrench_frame", o.wrench_frame,
        "frame of pose and wrench in the columns reported_* of wrench.csv; auto: the "
        "world, over ROS 2 the tool");
  t.add("wrench_point", o.wrench_point, "reference point of the torque in reported_*");
  t.add("tcp", o.X_TE,
        "X_TE, tool center point in the frame of its mesh: x y z in m, quaternion x y "
        "z w; reported_* reports its pose");
  t.add("named_frame", o.X_WN,
        "X_WN of wrench_frame = named, in the world: x y z in m, quaternion");
}

// Records for recordings and display.

/// A depth frame that became a surface.
struct FrameRecord {
  std::uint64_t number = 0;        ///< from 0, without gaps, of all cameras together
  std::uint32_t camera = 0;        ///< index of the camera
  std::uint64_t camera_frame = 0;  ///< from 0, without gaps, of that camera
  std::uint32_t revision = 0;      ///< of the settings that its surface was made with
  double capture_time = 0;         ///< s, on the clock of the device states
  double source_time = 0;          ///< s, DepthFrame::timestamp
  double unit = 0.001;             ///< m per count
  Pose X_WC;                       ///< pose of the camera in the world at the capture of the frame
  SurfaceStats surface;
  PixelWindow requested;  ///< as DepthFieldView: the window in which its surface is valid
  std::int64_t compute_nanoseconds = 0;
};

/// One tick of the haptic thread, as published.
struct TickRecord {
  std::uint32_t revision = 0;  ///< of the settings that it was computed with, from 0
  double time = 0;             ///< s since the start of the loop
  DeviceState device;
  CouplingStep step;
  Wrench F_H_B;             ///< on the hand, as sent to the device: after the safety filter
  Penetration penetration;  ///< of the contact in use: cloud and objects
  Penetration objects;      ///< the objects' share of it
  std::int64_t num_object_pairs = 0;
  std::optional<MeasureNoise> noise;  ///< of `penetration`, if it is asked for and known
  double contact_age = 0;             ///< s
  double sensor_age = 0;              ///< s, from the depth frame to this force
  std::uint64_t contact_number = 0, frame_number = 0;
  SafetyStatus safety;
  std::int64_t compute_nanoseconds = 0;

  // Further data to replay the tick.
  std::uint64_t number = 0;         ///< from 0
  double dt = 0;                    ///< s, of the coupling's step; 0: no hand yet
  bool is_stopping = false;         ///< stop() was called on the safety filter
  bool is_force_requested = false;  ///< the user requests the force after a fault
  bool is_suspended = false;        ///< RunLoop::suspend_force
  bool has_sensor_failed = false, has_backend_failed = false;
};

/// The blend of one camera at a contact.
struct CameraBlend {
  /// FrameRecord::camera_frame of its newest surface; -1: none yet.
  std::int64_t camera_frame = -1;
  double progress = 1;  ///< from the previous surface to that one

  friend bool operator==(const CameraBlend&, const CameraBlend&) = default;
};

/// One per camera of a run.
struct CameraBlends {
  std::uint32_t num = 0;
  CameraBlend of[kMaxCameras] = {};
};

/// Poses of moving objects, in the order of the objects.
struct BodyPoses {
  std::uint32_t num = 0;
  Pose of[kMaxMovingBodies] = {};  ///< X_WB
};

/// One contact query, with all data to replay it.
struct ContactRecord {
  std::uint32_t revision = 0;  ///< of the settings that it was computed with, from 0
  double time = 0;
  Pose X_WT;
  Penetration penetration;            ///< cloud and objects, see BodyMeasure::total
  Penetration objects;                ///< the objects' share of it
  std::int64_t num_object_pairs = 0;  ///< spheres of tool and objects that overlap
  std::optional<MeasureNoise> noise;  ///< of `penetration`, if it is asked for and known
  std::uint64_t number = 0;
  std::uint64_t frame_number = 0;  ///< of the newest frame in use
  CameraBlends cameras;
  BodyPoses bodies;  ///< against which the tool was measured

  double capture_time = 0;         ///< s, monotonic: the oldest of the cameras' newest frames
  LocalContact contact;            ///< passed to the haptic thread
  bool has_new_stiffness = false;  ///< otherwise that of an earlier contact, or none
};

}}  // namespace palpate::v0
