// Writing a haptic run down while it goes on.
#pragma once

#include <filesystem>
#include <string>

#include "src/session/haptic_messages.h"

namespace palpate {

/// Everything of a run in one MCAP file. For the publishing thread of a loop. When the file cannot
/// be written any more, the recording ends and says so; everything else goes on.
class HapticRecorder {
 public:
  /// Errors: the file cannot be made.
  static Result<HapticRecorder> create(const std::filesystem::path& path, const HapticSetup& setup);

  /// Of a later revision; its first ones are those of the setup.
  void add_settings(std::uint32_t revision, const HapticSettings& settings);
  void add_frame(std::uint64_t number, double capture_time, const DepthFrame& frame,
                 std::uint32_t revision);
  void add_contact(const ContactRecord& contact);
  void add_tick(const HapticRecord& tick);
  void add_note(std::string_view text);
  /// Of that moment, s, monotonic.
  void add_note(std::string_view text, double time);

  /// Makes the file whole.
  void finish();
  /// Why the recording has ended before the run; else empty.
  const std::string& trouble() const { return trouble_; }

 private:
  HapticRecorder(McapWriter writer, const HapticSetup& setup);
  std::uint64_t wall_time(double monotonic_time);
  void write(std::uint16_t channel, std::uint64_t time, std::string_view message);
  void end_with(const Error& error);

  McapWriter writer_;
  HapticSetup setup_;
  std::uint16_t settings_, depth_, contact_, tick_, note_;
  double wall_offset_ = 0;       // s from the monotonic clock to the time since 1970
  std::uint64_t last_time_ = 0;  // ns since 1970
  std::string trouble_;
};

}  // namespace palpate
