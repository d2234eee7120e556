#include "src/session/internal/run_reader.h"

#include <utility>

#include "palpate/io/files.h"
#include "src/io/internal/ros_image.h"
#include "src/io/internal/ros_messages.h"
#include "src/session/internal/run_folder.h"

namespace palpate { inline namespace v0 {
namespace fs = std::filesystem;

RunReader::RunReader(std::vector<fs::path> parts, McapReader reader, RunSetup setup)
    : parts_(std::move(parts)), reader_(std::move(reader)), setup_(std::move(setup)) {}

Error RunReader::in_file(const Error& error) const {
  return {error.code, path().string() + ": " + error.message};
}

Result<RunReader> RunReader::open(const fs::path& place) {
  std::error_code why;
  std::vector<fs::path> parts{place};
  if (fs::is_directory(place, why)) {
    parts = recording_parts(place, &why);
    if (why) {
      return Error{Errc::io_failure, "cannot list " + place.string() + ": " + why.message() +
                                         "; check its disk and permissions"};
    }
    if (parts.empty()) parts = {place / kRecordingFile};
  }
  const fs::path path = parts.front();
  const auto in_path = [&](const Error& error) {
    return Error{error.code, path.string() + ": " + error.message};
  };
  auto reader = McapReader::open(path);
  if (!reader) return reader.error();
  std::optional<PartStart> start;
  auto first = reader->next();
  if (!first) return first.error();
  const auto topic = [&] { return reader->channels().at((*first)->channel).topic; };
  if (*first && topic() == kPartTopic) {
    const auto part = read_part((*first)->data);
    if (!part) return in_path(part.error());
    start = *part;
    first = reader->next();
    if (!first) return first.error();
  }
  if (!*first || topic() != kSettingsTopic) {
    return Error{Errc::bad_input,
                 path.string() + " is not the recording of a run; give another folder"};
  }
  auto setup = read_settings((*first)->data);
  if (!setup) return in_path(setup.error());
  if (!(setup->device.rate > 0)) {
    return Error{Errc::bad_input,
                 path.string() + ": the recording has no tick rate; record the run again"};
  }
  RunReader run(std::move(parts), *std::move(reader), *std::move(setup));
  run.start_ = std::move(start);
  return run;
}

Status RunReader::begins_with_run() const {
  if (!start_) return Done{};
  return Error{Errc::bad_input,
               parts_.front().string() + " is part " + std::to_string(start_->number) +
                   " of its run, and only a recording from the run's start can be repeated; look "
                   "at it with palpate view, or record the run again without --record-keep"};
}

Status RunReader::open_part(std::size_t part) {
  auto reader = McapReader::open(parts_[part]);
  if (!reader) return reader.error();
  reader_ = *std::move(reader);
  part_ = part;
  return Done{};
}

// A place has the number of a part in its high bits and a byte's in its low ones.
constexpr int kPlaceBits = 48;

std::uint64_t RunReader::chunk_place() const {
  return static_cast<std::uint64_t>(part_) << kPlaceBits | reader_.chunk_place();
}

Status RunReader::seek(std::uint64_t chunk_place) {
  const auto part = static_cast<std::size_t>(chunk_place >> kPlaceBits);
  if (part != part_) {
    if (const Status opened = open_part(part); !opened) return opened;
    // The channels of a part stand before its first message.
    if (const auto first = reader_.next(); !first) return first.error();
  }
  reader_.seek(chunk_place & ((std::uint64_t{1} << kPlaceBits) - 1));
  return Done{};
}

std::uint64_t RunReader::num_bytes() const {
  return num_bytes_before(static_cast<std::uint64_t>(parts_.size()) << kPlaceBits);
}

std::uint64_t RunReader::num_bytes_before(std::uint64_t chunk_place) const {
  std::uint64_t num = chunk_place & ((std::uint64_t{1} << kPlaceBits) - 1);
  for (std::size_t part = 0; part < chunk_place >> kPlaceBits; ++part) {
    std::error_code error;
    const std::uintmax_t size = fs::file_size(parts_[part], error);
    if (!error) num += size;
  }
  return num;
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
  for (std::size_t k = 0; k < setup_.settings.regions.size(); ++k) {
    auto& regions = setup_.settings.regions[k];
    if (regions->width == 0) continue;
    auto labels = reader_.attachment(labels_file(k));
    if (!labels) return labels.error();
    auto whole = std::make_shared<MaterialRegions>(*regions);
    whole->labels.assign(labels->begin(), labels->end());
    regions = std::move(whole);
  }
  return load(kToolFile);
}

Result<std::optional<RunReader::Message>> RunReader::next() {
  for (;;) {
    const auto message = reader_.next();
    if (!message) return message.error();
    if (*message) {
      return std::optional(Message{reader_.channels().at((*message)->channel).topic,
                                   (*message)->data, (*message)->time});
    }
    if (part_ + 1 == parts_.size()) return std::optional<Message>();
    if (const Status opened = open_part(part_ + 1); !opened) return opened.error();
  }
}

Result<bool> RunReader::next_frame(RecordedDepth& frame) {
  FrameJoiner joiner(setup_.streams);
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

Result<bool> RunReader::next_tick(TickRecord& tick,
                                  const std::function<void(const FrameRecord&)>& on_frame) {
  for (;;) {
    const auto message = next();
    if (!message) return message.error();
    if (!*message) return false;
    if (on_frame && (*message)->topic == kFrameTopic) {
      const auto frame = read_frame((*message)->data);
      if (!frame) return in_file(frame.error());
      on_frame(*frame);
    }
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
    if (record->camera >= streams_.size()) {
      return Error{Errc::bad_input,
                   "a depth frame of a camera that the run has not; record the run again"};
    }
    record_ = *record;
    depth_topic_ = depth_topic(record_->camera);
    flow_topic_ = flow_topic(record_->camera);
    flow_.clear();
  } else if (record_ && topic == flow_topic_) {
    auto flow = read_flow_image(message);
    if (!flow) return Error{Errc::bad_input, flow.error().message + "; record the run again"};
    flow_ = *std::move(flow);
  } else if (record_ && topic == depth_topic_) {
    auto frame = read_depth_image(message, record_->unit);
    if (!frame) return Error{Errc::bad_input, frame.error().message + "; record the run again"};
    const DepthStreamInfo& stream = streams_[record_->camera];
    if (frame->width != stream.width || frame->height != stream.height) {
      return Error{Errc::bad_input,
                   "a depth frame of another size than its camera's; record the run again"};
    }
    frame->unit = record_->unit;
    frame->timestamp = record_->source_time;
    frame->X_WC = record_->X_WC;
    frame->flow = std::exchange(flow_, {});
    return std::optional(RecordedDepth{*std::exchange(record_, std::nullopt), *std::move(frame)});
  }
  return std::optional<RecordedDepth>();
}

}}  // namespace palpate::v0
