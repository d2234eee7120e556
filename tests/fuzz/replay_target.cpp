// Replays of a small run one of whose messages is a stranger's: the first two bytes say which one,
// the rest is its bytes.
#include <filesystem>
#include <map>
#include <utility>

#include "palpate/session/run.h"
#include "src/io/internal/mcap_file.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"
#include "tests/fuzz/target.h"
#include "tests/session/path_run.h"
#include "tests/session/synthetic_stream.h"

namespace palpate::fuzz {
namespace {

namespace fs = std::filesystem;

/// A recorded run in memory, and a folder that takes changed ones.
class Recorded {
 public:
  Recorded() {
    test::SyntheticStream stream(2);
    auto device = test::path_device(test::pressing_pose, 200);
    require(device && record_run(test::random_tool(20, 0.03, 7), stream, **device,
                                 test::path_settings(200), folder_),
            "a path is recorded");
    const fs::path file = folder_ / kRecordingFile;
    auto reader = McapReader::open(file);
    require(reader.has_value(), "a recording can be read");
    tool_ = reader->attachment(kToolFile).value();
    for (;;) {
      const auto message = reader->next();
      require(message.has_value(), "a recording can be read to its end");
      if (!*message) break;
      channels_ = reader->channels();
      messages_.push_back({(*message)->channel, (*message)->time, std::string((*message)->data)});
    }
    for (const auto& channel : {part_channel(), settings_channel(), frame_channel(),
                                contact_channel(), tick_channel(), note_channel()})
      schemas_[channel.topic] = channel;
  }
  ~Recorded() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }

  std::size_t num_messages() const { return messages_.size(); }
  const std::string& bytes(std::size_t i) const { return messages_[i].bytes; }

  /// As recorded, but for message `i`.
  const fs::path& with(std::size_t i, std::string_view bytes) {
    auto writer = McapWriter::create(folder_ / kRecordingFile);
    require(writer && writer->attach(kToolFile, "application/octet-stream", tool_),
            "a recording can be written");
    std::map<std::uint16_t, std::uint16_t> numbers;
    for (const auto& [number, channel] : channels_) {
      const auto known = schemas_.find(channel.topic);
      numbers[number] = writer->add_channel(known != schemas_.end()
                                                ? known->second
                                                : ros_channel(channel.topic, "sensor_msgs/Image"));
    }
    for (std::size_t k = 0; k < messages_.size(); ++k) {
      const Message& one = messages_[k];
      require(writer->write(numbers[one.channel], one.time, k == i ? bytes : one.bytes).has_value(),
              "a message can be written");
    }
    require(writer->end().has_value(), "a recording can be ended");
    return folder_;
  }

 private:
  struct Message {
    std::uint16_t channel = 0;
    std::uint64_t time = 0;
    std::string bytes;
  };
  const fs::path folder_ = [] {
    static ScratchFile name(".replayed");
    return name.path();
  }();
  std::string tool_;
  std::map<std::uint16_t, McapChannel> channels_;
  std::map<std::string, McapChannel> schemas_;
  std::vector<Message> messages_;
};

Recorded& recorded() {
  static Recorded one;
  return one;
}

std::string place(std::size_t i) {
  return {static_cast<char>(i & 255u), static_cast<char>(i >> 8)};
}

}  // namespace

/// The first message of each kind, as it is; what is as it was replays without a difference.
std::vector<std::string> seeds() {
  std::vector<std::string> seeds;
  for (std::size_t i = 0; i < recorded().num_messages(); ++i) {
    if (i < 6 || i + 2 > recorded().num_messages()) seeds.push_back(place(i) + recorded().bytes(i));
  }
  const auto replay = replay_run(recorded().with(0, recorded().bytes(0)));
  require(replay && replay->difference.empty() && replay->num_ticks > 0,
          "what was not changed repeats");
  return seeds;
}

}  // namespace palpate::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate::fuzz;
  if (size < 2) return 0;
  Recorded& run = recorded();
  const std::size_t i = (data[0] | data[1] << 8u) % run.num_messages();
  const std::string_view bytes = text_of(data + 2, size - 2);
  const auto replay = palpate::replay_run(run.with(i, bytes));
  if (replay && bytes == run.bytes(i)) {
    require(replay->difference.empty(), "what was not changed repeats");
  }
  return 0;
}
