// Our messages as CDR, the encoding of ROS 2, and their definitions as ROS messages. Both follow
// from the fields of a structure (run_fields.h): none is written down a second time.
//
// The structures here are those that only messages have; records are written as they are.
#pragma once

#include <algorithm>
#include <concepts>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#include "src/io/internal/cdr.h"
#include "src/io/internal/mcap_file.h"
#include "src/io/internal/ros_types.h"
#include "src/session/internal/run_fields.h"
#include "src/session/internal/run_messages.h"

namespace palpate { inline namespace v0 { namespace messages {

/// The settings as JSON, beside the fields of their own.
struct SettingsText {
  std::uint32_t revision = 0;
  double time_origin = 0;
  DeviceInfo device;
  std::string json;
};
template <Of<SettingsText> T>
void visit_fields(T& settings, auto&& visit) {
  visit("revision", settings.revision);
  visit("time_origin", settings.time_origin);
  visit("device", settings.device);
  visit("json", settings.json);
}

/// Length of a ground as numbers, in the order of its fields. A message has none of them for a
/// ground without a material and without motion.
constexpr std::uint32_t kGroundNumbers = 12;

/// Noise of a measure that may be unknown.
using Noise = std::optional<MeasureNoise>;
/// Length of a noise as numbers, in the order of its fields. A message has none of them where it is
/// unknown, and no field at its end if it is older than this one.
constexpr std::uint32_t kNoiseNumbers = 13;

/// Makes covariances of their upper halves.
inline void complete(MeasureNoise& noise) {
  for (Mat3d* const each : {&noise.force, &noise.torque}) {
    each->m[1][0] = each->m[0][1];
    each->m[2][0] = each->m[0][2];
    each->m[2][1] = each->m[1][2];
  }
}

template <Of<PartStart> T>
void visit_fields(T& part, auto&& visit) {
  visit("number", part.number);
  visit("tick", part.tick);
}

struct Note {
  std::string text;
};
template <Of<Note> T>
void visit_fields(T& note, auto&& visit) {
  visit("text", note.text);
}

inline std::span<const CameraBlend> seen(const CameraBlends& cameras) {
  return {cameras.of, std::min<std::size_t>(cameras.num, kMaxCameras)};
}

inline std::span<const Pose> poses(const BodyPoses& bodies) {
  return {bodies.of, std::min<std::size_t>(bodies.num, kMaxMovingBodies)};
}

template <class T>
concept Scalar = std::is_arithmetic_v<T> || std::is_enum_v<T>;

struct Writer {
  CdrWriter& to;

  template <class T>
  void operator()(const char*, const T& value) const {
    if constexpr (Scalar<T>) {
      to.number(value);
    } else if constexpr (std::same_as<T, std::string>) {
      to.text(value);
    } else if constexpr (std::same_as<T, Ground>) {
      const bool is_plain = value == Ground{};
      to.number(is_plain ? 0 : kGroundNumbers);
      if (!is_plain) visit_fields(value, *this);
    } else if constexpr (std::same_as<T, Noise>) {
      to.number(value ? kNoiseNumbers : 0);
      if (value) visit_fields(*value, *this);
    } else if constexpr (std::same_as<T, CameraBlends>) {
      to.number(value.num);
      for (const CameraBlend& blend : seen(value)) visit_fields(blend, *this);
    } else if constexpr (std::same_as<T, BodyPoses>) {
      to.number(value.num);
      for (const Pose& X_WB : poses(value)) visit_fields(X_WB, *this);
    } else if constexpr (std::same_as<T, Stiffness>) {
      for (const auto& row : value.m) {
        for (const double number : row) to.number(number);
      }
    } else {
      visit_fields(value, *this);
    }
  }
};

struct Reader {
  CdrReader& from;

  template <class T>
  void operator()(const char*, T& value) const {
    if constexpr (std::same_as<T, bool>) {
      value = from.number<std::uint8_t>() != 0;
    } else if constexpr (Scalar<T>) {
      value = from.number<T>();
    } else if constexpr (std::same_as<T, std::string>) {
      value = std::string(from.text());
    } else if constexpr (std::same_as<T, Ground>) {
      value = {};
      if (from.number<std::uint32_t>() == kGroundNumbers) visit_fields(value, *this);
    } else if constexpr (std::same_as<T, Noise>) {
      value.reset();
      if (from.num_left() == 0 || from.number<std::uint32_t>() != kNoiseNumbers) return;
      visit_fields(value.emplace(), *this);
      complete(*value);
    } else if constexpr (std::same_as<T, CameraBlends>) {
      value.num = from.number<std::uint32_t>();
      for (std::uint32_t k = 0; k < value.num && k < kMaxCameras; ++k) {
        visit_fields(value.of[k], *this);
      }
    } else if constexpr (std::same_as<T, BodyPoses>) {
      value.num = from.number<std::uint32_t>();
      for (std::uint32_t k = 0; k < value.num && k < kMaxMovingBodies; ++k) {
        visit_fields(value.of[k], *this);
      }
    } else if constexpr (std::same_as<T, Stiffness>) {
      for (auto& row : value.m) {
        for (double& number : row) number = from.number<double>();
      }
    } else {
      visit_fields(value, *this);
    }
  }
};

// Name of a type in ROS.
template <class T>
std::string type_name() {
  if constexpr (std::same_as<T, bool>) return "bool";
  if constexpr (std::same_as<T, double>) return "float64";
  if constexpr (std::same_as<T, std::uint64_t>) return "uint64";
  if constexpr (std::same_as<T, std::int64_t>) return "int64";
  if constexpr (std::same_as<T, std::uint32_t>) return "uint32";
  if constexpr (std::same_as<T, std::int32_t>) return "int32";
  if constexpr (std::same_as<T, Fault> || std::same_as<T, ForceState>) return "uint8";
  if constexpr (std::same_as<T, std::string>) return "string";
  if constexpr (std::same_as<T, Ground> || std::same_as<T, Noise>) return "float64[]";
  if constexpr (std::same_as<T, Stiffness>) return "float64[36]";
  if constexpr (std::same_as<T, Vec3d>) return "geometry_msgs/Vector3";
  if constexpr (std::same_as<T, Quaternion>) return "geometry_msgs/Quaternion";
  if constexpr (std::same_as<T, Pose>) return "geometry_msgs/Pose";
  if constexpr (std::same_as<T, Wrench>) return "geometry_msgs/Wrench";
  if constexpr (std::same_as<T, VolumeWrench>) return "palpate_msgs/VolumeWrench";
  if constexpr (std::same_as<T, Twist>) return "geometry_msgs/Twist";
  if constexpr (std::same_as<T, SurfaceStats>) return "palpate_msgs/SurfaceStats";
  if constexpr (std::same_as<T, PixelWindow>) return "palpate_msgs/PixelWindow";
  if constexpr (std::same_as<T, FrameRecord>) return "palpate_msgs/Frame";
  if constexpr (std::same_as<T, Penetration>) return "palpate_msgs/Penetration";
  if constexpr (std::same_as<T, ContactPatch>) return "palpate_msgs/ContactPatch";
  if constexpr (std::same_as<T, LocalContact>) return "palpate_msgs/LocalContact";
  if constexpr (std::same_as<T, CameraBlend>) return "palpate_msgs/CameraBlend";
  if constexpr (std::same_as<T, CameraBlends>) return "palpate_msgs/CameraBlend[]";
  if constexpr (std::same_as<T, BodyPoses>) return "geometry_msgs/Pose[]";
  if constexpr (std::same_as<T, ContactRecord>) return "palpate_msgs/ContactRecord";
  if constexpr (std::same_as<T, DeviceState>) return "palpate_msgs/DeviceState";
  if constexpr (std::same_as<T, CouplingStep>) return "palpate_msgs/CouplingStep";
  if constexpr (std::same_as<T, SafetyStatus>) return "palpate_msgs/SafetyStatus";
  if constexpr (std::same_as<T, TickRecord>) return "palpate_msgs/Tick";
  if constexpr (std::same_as<T, DeviceLimits>) return "palpate_msgs/DeviceLimits";
  if constexpr (std::same_as<T, DeviceInfo>) return "palpate_msgs/DeviceInfo";
  if constexpr (std::same_as<T, SettingsText>) return "palpate_msgs/Settings";
  if constexpr (std::same_as<T, PartStart>) return "palpate_msgs/Part";
  if constexpr (std::same_as<T, Note>) return "palpate_msgs/Note";
}

/// Writes down the definitions of our types.
struct Describer {
  std::map<std::string, std::string>& texts;
  std::string& text;

  template <class T>
  void operator()(const char* name, const T& value) const {
    const std::string type = type_name<T>();
    text += type + " " + name + "\n";
    constexpr bool is_plain = Scalar<T> || std::same_as<T, std::string> ||
                              std::same_as<T, Stiffness> || std::same_as<T, BodyPoses> ||
                              std::same_as<T, Ground> || std::same_as<T, Noise>;
    if constexpr (std::same_as<T, CameraBlends>) {
      describe(CameraBlend{});
    } else if constexpr (!is_plain) {
      if (type.starts_with("palpate_msgs/") && texts.count(type) == 0) describe(value);
    }
  }
  template <class T>
  void describe(const T& value) const {
    std::string inner;
    visit_fields(value, Describer{texts, inner});
    texts[type_name<T>()] = inner;
  }
};

template <class T>
McapChannel channel_of(const char* topic) {
  std::map<std::string, std::string> texts;
  std::string unused;
  Describer{texts, unused}.describe(T{});
  std::string type = type_name<T>();
  const std::string schema = message_schema(type, [&](const auto& name) { return texts[name]; });
  type.insert(type.find('/'), "/msg");
  return {topic, type, schema};
}

template <class T>
std::string message_of(const T& value) {
  CdrWriter to;
  visit_fields(value, Writer{to});
  return to.take();
}

template <class T>
Result<T> read(std::string_view message) {
  CdrReader from(message);
  T value;
  visit_fields(value, Reader{from});
  if (from.is_good()) return value;
  return Error{Errc::bad_input, "a message is no " + type_name<T>() + "; record the run again"};
}

}}}  // namespace palpate::v0::messages
