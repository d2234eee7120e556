// Our own messages in a recording, beside those of ROS: all data to repeat a run bit for bit.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/run/records.h"
#include "palpate/run/run_loop.h"
#include "palpate/session/run.h"
#include "src/io/internal/mcap_file.h"
#include "src/session/internal/run_folder.h"

namespace palpate { inline namespace v0 {

/// Everything that a repetition needs beside tool, frames, contacts and ticks.
struct RunSetup {
  RunSettings settings;                  ///< shapes of objects are files inside the recording
  std::vector<DepthStreamInfo> streams;  ///< of the cameras
  DeviceInfo device;
  std::uint32_t revision = 0;  ///< of the settings: counts their changes during the run
  /// Start of a run on a simulated clock, which begins at 0: s since 1970, or on the clock of path
  /// and frames.
  double time_origin = 0;
  std::optional<ProbeChoice> probe = {};  ///< path of the hand, if the user gave none
};

/// True if the part of the tool that no camera sees is known.
inline bool reports_unseen(const RunSetup& setup) {
  const RunSettings& settings = setup.settings;
  return settings.contact.method == MethodKind::field &&
         (setup.streams.size() > 1 || settings.backend.value_or(Backend::cpu) == Backend::cpu);
}

/// Start of a part of a recording that is not the first one, before its settings.
struct PartStart {
  std::int32_t number = 0;  ///< of the part
  std::uint64_t tick = 0;   ///< number of its first tick
};

/// A depth frame with all data to repeat its surface.
struct RecordedDepth {
  FrameRecord record;
  DepthFrame frame;
};

inline constexpr const char* kRunFormat = "palpate.run";
inline constexpr int kRunVersion = 1;

// Topics.
inline constexpr const char* kPartTopic = "/part";
inline constexpr const char* kSettingsTopic = "/settings";
inline constexpr const char* kFrameTopic = "/frame";  ///< palpate_msgs/Frame, before its image
std::string depth_topic(std::uint32_t camera);  ///< sensor_msgs/Image: "/depth", "/camera_2/depth"
std::string flow_topic(std::uint32_t camera);   ///< likewise, before the depth image
inline constexpr const char* kContactTopic = "/contact";
inline constexpr const char* kTickTopic = "/tick";
inline constexpr const char* kNoteTopic = "/note";

// Files inside the recording.
inline constexpr const char* kToolFile = "tool.palp";
std::string object_file(std::size_t index);
std::string labels_file(std::size_t camera);  ///< a byte for each pixel

/// Returns the channel of a ROS type, "sensor_msgs/Image".
McapChannel ros_channel(const std::string& topic, const std::string& type);

McapChannel part_channel();
McapChannel settings_channel();
McapChannel frame_channel();
McapChannel contact_channel();
McapChannel tick_channel();
McapChannel note_channel();

std::string part_message(const PartStart& part);
std::string settings_message(const RunSetup& setup);
std::string frame_message(const FrameRecord& frame);
std::string contact_message(const ContactRecord& contact);
std::string tick_message(const TickRecord& tick);
std::string note_message(std::string_view text);

/// Errors: not such a message, one of another version. Objects come without their shapes, regions
/// without their labels.
Result<RunSetup> read_settings(std::string_view message);
Result<PartStart> read_part(std::string_view message);
Result<FrameRecord> read_frame(std::string_view message);
Result<ContactRecord> read_contact(std::string_view message);
Result<TickRecord> read_tick(std::string_view message);
Result<std::string> read_note(std::string_view message);

/// "wrench/force/x: recorded 1, repeated 2"; empty if they are the same to the bit.
std::string difference(const ContactRecord& recorded, const ContactRecord& repeated);
std::string difference(const TickRecord& recorded, const TickRecord& repeated);

}}  // namespace palpate::v0
