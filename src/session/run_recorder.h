// Writing a run down while it goes on: one MCAP file that ROS 2 tools, Foxglove and `palpate
// replay` read.
#pragma once

#include <filesystem>
#include <string>

#include "palpate/tool/tool.h"
#include "src/session/run_messages.h"

namespace palpate {

/// For the publishing thread of a loop. When the file cannot be written any more, the recording
/// ends and says so; everything else goes on.
class RunRecorder {
 public:
  /// `is_simulated`: times are not monotonic ones, but s since setup.time_origin. Errors: the file
  /// cannot be made.
  static Result<RunRecorder> create(const std::filesystem::path& path, const Tool& tool,
                                    const RunSetup& setup, bool is_simulated);

  /// Of a later revision; its first ones are those of the setup.
  void add_settings(std::uint32_t revision, const RunSettings& settings);
  void add_frame(const FrameRecord& record, const DepthFrame& frame);
  void add_contact(const ContactRecord& contact);
  void add_tick(const TickRecord& tick);
  void add_note(std::string_view text);
  /// Of that moment, s, monotonic.
  void add_note(std::string_view text, double time);

  /// Makes the file whole.
  void finish();
  /// Why the recording has ended before the run; else empty.
  const std::string& trouble() const { return trouble_; }

 private:
  RunRecorder(McapWriter writer, const Tool& tool, const RunSetup& setup, bool is_simulated);
  Status begin(const Tool& tool);
  std::uint64_t wall_time(double time);
  void write(std::uint16_t channel, std::uint64_t time, std::string_view message);
  void add_transforms(const TickRecord& tick, std::uint64_t time);
  void end_with(const Error& error);

  McapWriter writer_;
  RunSetup setup_;
  Vec3d centre_of_mass_T_;
  std::uint16_t settings_, frame_, depth_, points_, camera_, contact_, tick_, note_, transforms_,
      statics_, tool_wrench_, hand_wrench_, marker_;
  double wall_offset_ = 0;       // s from the run's clock to the time since 1970
  std::uint64_t last_time_ = 0;  // ns since 1970
  std::uint64_t next_transforms_ = 0, next_points_ = 0;
  std::string trouble_;
};

}  // namespace palpate
