#include "src/session/haptic_recording.h"

#include <chrono>
#include <cmath>
#include <utility>

namespace palpate {
namespace {

template <class Clock>
double seconds() {
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

}  // namespace

HapticRecorder::HapticRecorder(McapWriter writer, const HapticSetup& setup)
    : writer_(std::move(writer)), setup_(setup) {
  settings_ = writer_.add_channel(settings_channel());
  depth_ = writer_.add_channel(depth_channel());
  contact_ = writer_.add_channel(contact_channel());
  tick_ = writer_.add_channel(tick_channel());
  note_ = writer_.add_channel(note_channel());
  const double now = seconds<std::chrono::steady_clock>();
  wall_offset_ = seconds<std::chrono::system_clock>() - now;
  last_time_ = wall_time(now);
}

Result<HapticRecorder> HapticRecorder::create(const std::filesystem::path& path,
                                              const HapticSetup& setup) {
  auto writer = McapWriter::create(path);
  if (!writer) return writer.error();
  HapticRecorder recorder(*std::move(writer), setup);
  // On the disk before the run: without them nothing else can be understood.
  Status status =
      recorder.writer_.write(recorder.settings_, recorder.last_time_, settings_message(setup));
  if (status) status = recorder.writer_.flush();
  if (!status) return status.error();
  return recorder;
}

void HapticRecorder::end_with(const Error& error) {
  trouble_ = "the recording ended before the run: " + error.message;
}

std::uint64_t HapticRecorder::wall_time(double monotonic_time) {
  const double time = 1e9 * (monotonic_time + wall_offset_);
  if (time >= 0 && time < 1e19) last_time_ = static_cast<std::uint64_t>(time);
  return last_time_;
}

void HapticRecorder::write(std::uint16_t channel, std::uint64_t time, std::string_view message) {
  if (!trouble_.empty()) return;
  if (const Status status = writer_.write(channel, time, message); !status) {
    end_with(status.error());
  }
}

void HapticRecorder::add_settings(std::uint32_t revision, const HapticSettings& settings) {
  setup_.revision = revision;
  setup_.settings = settings;
  write(settings_, last_time_, settings_message(setup_));
}

void HapticRecorder::add_frame(std::uint64_t number, double capture_time, const DepthFrame& frame,
                               std::uint32_t revision) {
  if (!trouble_.empty()) return;
  const std::uint64_t time = wall_time(capture_time);
  const auto message = depth_message(number, capture_time, frame, time, revision);
  if (!message) return end_with(message.error());
  write(depth_, time, *message);
}

void HapticRecorder::add_contact(const ContactRecord& contact) {
  if (trouble_.empty()) write(contact_, wall_time(contact.contact.time), contact_message(contact));
}

void HapticRecorder::add_tick(const HapticRecord& tick) {
  if (trouble_.empty()) write(tick_, wall_time(tick.device.time), tick_message(tick));
}

void HapticRecorder::add_note(std::string_view text) {
  write(note_, last_time_, note_message(text, last_time_));
}

void HapticRecorder::add_note(std::string_view text, double time) {
  const std::uint64_t wall = wall_time(time);
  write(note_, wall, note_message(text, wall));
}

void HapticRecorder::finish() {
  const Status status = writer_.finish();
  if (!status && trouble_.empty()) end_with(status.error());
}

}  // namespace palpate
