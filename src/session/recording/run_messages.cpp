#include "src/session/internal/run_messages.h"

#include <cstdio>
#include <utility>

#include "src/cloud/internal/frame_limits.h"
#include "src/session/recording/message_codec.h"
#include "src/session/recording/setup_json.h"

namespace palpate { inline namespace v0 {
namespace {

using messages::channel_of;
using messages::message_of;
using messages::Note;
using messages::read;
using messages::SettingsText;

}  // namespace

std::string depth_topic(std::uint32_t camera) {
  return camera == 0 ? "/depth" : "/camera_" + std::to_string(camera + 1) + "/depth";
}

std::string flow_topic(std::uint32_t camera) {
  return camera == 0 ? "/flow" : "/camera_" + std::to_string(camera + 1) + "/flow";
}

std::string object_file(std::size_t index) {
  char name[40];
  std::snprintf(name, sizeof name, "object-%03zu.palp", index);
  return name;
}

std::string labels_file(std::size_t camera) {
  char name[40];
  std::snprintf(name, sizeof name, "labels-%03zu.u8", camera);
  return name;
}

McapChannel ros_channel(const std::string& topic, const std::string& type) {
  std::string name = type;
  name.insert(name.find('/'), "/msg");
  return {topic, name, message_schema(type)};
}

McapChannel part_channel() { return channel_of<PartStart>(kPartTopic); }
McapChannel settings_channel() { return channel_of<SettingsText>(kSettingsTopic); }
McapChannel frame_channel() { return channel_of<FrameRecord>(kFrameTopic); }
McapChannel contact_channel() { return channel_of<ContactRecord>(kContactTopic); }
McapChannel tick_channel() { return channel_of<TickRecord>(kTickTopic); }
McapChannel note_channel() { return channel_of<Note>(kNoteTopic); }

std::string settings_message(const RunSetup& setup) {
  return message_of(
      SettingsText{setup.revision, setup.time_origin, setup.device, setup_json(setup)});
}
std::string part_message(const PartStart& part) { return message_of(part); }
std::string frame_message(const FrameRecord& frame) { return message_of(frame); }
std::string contact_message(const ContactRecord& contact) { return message_of(contact); }
std::string tick_message(const TickRecord& tick) { return message_of(tick); }
std::string note_message(std::string_view text) { return message_of(Note{std::string(text)}); }

Result<RunSetup> read_settings(std::string_view message) {
  const auto text = read<SettingsText>(message);
  if (!text) return text.error();
  auto setup = setup_from_json(text->json);
  if (!setup) return setup.error();
  setup->device = text->device;
  setup->revision = text->revision;
  setup->time_origin = text->time_origin;
  return setup;
}
Result<PartStart> read_part(std::string_view message) { return read<PartStart>(message); }
Result<FrameRecord> read_frame(std::string_view message) {
  auto frame = read<FrameRecord>(message);
  if (frame && !is_depth_unit(frame->unit)) {
    return Error{Errc::bad_input,
                 "a depth frame has a unit that is no length from 0 to 1 m; record "
                 "the run again"};
  }
  if (frame && !(is_finite(frame->X_WC) && frame->X_WC.rotation != Quaternion{0, 0, 0, 0})) {
    return Error{Errc::bad_input,
                 "a depth frame has a camera that is nowhere; record the run again"};
  }
  return frame;
}
Result<ContactRecord> read_contact(std::string_view message) {
  auto contact = read<ContactRecord>(message);
  if (contact && contact->cameras.num > kMaxCameras) {
    return Error{Errc::bad_input, "a contact has " + std::to_string(contact->cameras.num) +
                                      " cameras, more than there can be; record the run again"};
  }
  if (contact && contact->bodies.num > kMaxMovingBodies) {
    return Error{Errc::bad_input, "a contact has " + std::to_string(contact->bodies.num) +
                                      " bodies, more than can move; record the run again"};
  }
  return contact;
}
Result<TickRecord> read_tick(std::string_view message) { return read<TickRecord>(message); }
Result<std::string> read_note(std::string_view message) {
  auto note = read<Note>(message);
  if (!note) return note.error();
  return std::move(note->text);
}

}}  // namespace palpate::v0
