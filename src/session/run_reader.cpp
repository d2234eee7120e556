#include "src/session/run_reader.h"

#include <utility>

#include "palpate/io/tool_file.h"
#include "src/session/ros_messages.h"

namespace palpate {

RunReader::RunReader(std::filesystem::path path, McapReader reader, RunSetup setup)
    : path_(std::move(path)), reader_(std::move(reader)), setup_(std::move(setup)) {}

Error RunReader::in_file(const Error& error) const {
  return {error.code, path_.string() + ": " + error.message};
}

Result<RunReader> RunReader::open(const std::filesystem::path& path) {
  auto reader = McapReader::open(path);
  if (!reader) return reader.error();
  const auto first = reader->next();
  if (!first) return first.error();
  if (!*first || reader->channels().at((*first)->channel).topic != kSettingsTopic) {
    return Error{Errc::bad_input,
                 path.string() + " is not the recording of a run; give another folder"};
  }
  auto setup = read_settings((*first)->data);
  if (!setup) return Error{setup.error().code, path.string() + ": " + setup.error().message};
  if (!(setup->device.rate > 0)) {
    return Error{Errc::bad_input,
                 path.string() + ": the recording tells no rate of ticks; record the run again"};
  }
  return RunReader(path, *std::move(reader), *std::move(setup));
}

Result<Tool> RunReader::load_tools() {
  const auto load = [&](const std::string& name) -> Result<Tool> {
    const auto bytes = reader_.attachment(name);
    if (!bytes) return bytes.error();
    auto tool = tool_from_bytes(*bytes);
    if (!tool) return in_file({tool.error().code, name + " " + tool.error().message});
    return tool;
  };
  std::vector<SceneObject>& objects = setup_.settings.objects;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    auto shape = load(object_file(i));
    if (!shape) return shape.error();
    objects[i].shape = std::make_shared<const Tool>(*std::move(shape));
  }
  return load(kToolFile);
}

Result<std::optional<RunReader::Message>> RunReader::next() {
  const auto message = reader_.next();
  if (!message) return message.error();
  if (!*message) return std::optional<Message>();
  return std::optional(Message{reader_.channels().at((*message)->channel).topic, (*message)->data,
                               (*message)->time});
}

Result<bool> RunReader::next_frame(RecordedDepth& frame) {
  FrameJoiner joiner;
  for (;;) {
    const auto message = next();
    if (!message) return message.error();
    if (!*message) return false;
    auto joined = joiner.take((*message)->topic, (*message)->data);
    if (!joined) return in_file(joined.error());
    if (!*joined) continue;
    frame = **std::move(joined);
    return true;
  }
}

Result<bool> RunReader::next_tick(TickRecord& tick) {
  for (;;) {
    const auto message = next();
    if (!message) return message.error();
    if (!*message) return false;
    if ((*message)->topic != kTickTopic) continue;
    const auto read = read_tick((*message)->data);
    if (!read) return in_file(read.error());
    tick = *read;
    return true;
  }
}

Result<std::optional<RecordedDepth>> FrameJoiner::take(std::string_view topic,
                                                       std::string_view message) {
  if (topic == kFrameTopic) {
    const auto record = read_frame(message);
    if (!record) return record.error();
    record_ = *record;
  } else if (topic == kDepthTopic && record_) {
    auto frame = read_image(message);
    if (!frame) return frame.error();
    frame->unit = record_->unit;
    frame->timestamp = record_->source_time;
    return std::optional(RecordedDepth{*std::exchange(record_, std::nullopt), *std::move(frame)});
  }
  return std::optional<RecordedDepth>();
}

}  // namespace palpate
