// The messages of a haptic recording: JSON whose numbers read back to the same bits.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/io/mcap_file.h"
#include "palpate/run/haptic_loop.h"
#include "palpate/session/probe_choice.h"
#include "palpate/session/run_folder.h"

namespace palpate {

/// Everything that a repetition needs beside tool, frames, contacts and ticks.
struct HapticSetup {
  HapticSettings settings;
  DepthStreamInfo stream;
  DeviceInfo device;
  std::string tool_checksum;   ///< of the file kHapticTool beside the recording
  std::uint32_t revision = 0;  ///< of the settings: counts what was changed while the loop ran
  std::optional<ProbeChoice> probe = {};  ///< where the hand was led, if nobody gave a path
};

/// A depth frame, and when the surfaces were told it was captured.
struct HapticFrame {
  std::uint64_t number = 0;
  double capture_time = 0;  ///< s, monotonic
  DepthFrame frame;
  std::uint32_t revision = 0;  ///< of the settings that its surface was made with
};

inline constexpr const char* kHapticFormat = "palpate haptic run";
inline constexpr int kHapticVersion = 1;

// Topics.
inline constexpr const char* kSettingsTopic = "/settings";
inline constexpr const char* kDepthTopic = "/depth";
inline constexpr const char* kContactTopic = "/contact";
inline constexpr const char* kTickTopic = "/tick";
inline constexpr const char* kNoteTopic = "/note";

McapChannel settings_channel();
McapChannel depth_channel();
McapChannel contact_channel();
McapChannel tick_channel();
McapChannel note_channel();

std::string settings_message(const HapticSetup& setup);
/// `time` since 1970 in ns, for viewers. Error: the frame is no image.
Result<std::string> depth_message(std::uint64_t number, double capture_time,
                                  const DepthFrame& frame, std::uint64_t time,
                                  std::uint32_t revision = 0);
std::string contact_message(const ContactRecord& contact);
std::string tick_message(const HapticRecord& tick);
std::string note_message(std::string_view text, std::uint64_t time);

/// Errors: not such a message, one of another version.
Result<HapticSetup> read_settings(std::string_view message);
Result<HapticFrame> read_depth(std::string_view message);
Result<ContactRecord> read_contact(std::string_view message);
Result<HapticRecord> read_tick(std::string_view message);

}  // namespace palpate
