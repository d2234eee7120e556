// The messages of a recording, read all at once and written back as tests change them.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "src/io/internal/mcap_file.h"
#include "src/session/internal/run_folder.h"
#include "src/session/internal/run_messages.h"

namespace palpate::test {

struct RecordedMessage {
  McapChannel channel;
  std::uint64_t time;
  std::string data;
};

/// Returns the messages of the recording in a run folder.
inline std::vector<RecordedMessage> messages(const std::filesystem::path& run,
                                             bool* was_cut_off = nullptr) {
  auto reader = McapReader::open(run / kRecordingFile);
  EXPECT_TRUE(reader) << reader.error().message;
  std::vector<RecordedMessage> all;
  for (;;) {
    const auto message = reader->next();
    EXPECT_TRUE(message) << message.error().message;
    if (!message || !*message) break;
    all.push_back({reader->channels().at((*message)->channel), (*message)->time,
                   std::string((*message)->data)});
  }
  if (was_cut_off != nullptr) *was_cut_off = reader->was_cut_off();
  return all;
}

/// With the tool and the objects that the recording has.
inline void rewrite(const std::filesystem::path& run, const std::vector<RecordedMessage>& all,
                    const McapOptions& options = {}) {
  auto reader = McapReader::open(run / kRecordingFile);
  ASSERT_TRUE(reader) << reader.error().message;
  std::map<std::string, std::string> files;
  const auto tool = reader->attachment(kToolFile);
  ASSERT_TRUE(tool) << tool.error().message;
  files[kToolFile] = *tool;
  for (std::size_t i = 0;; ++i) {
    const auto object = reader->attachment(object_file(i));
    if (!object) break;
    files[object_file(i)] = *object;
  }
  auto writer = McapWriter::create(run / kRecordingFile, options);
  ASSERT_TRUE(writer);
  for (const auto& [name, bytes] : files) ASSERT_TRUE(writer->attach(name, "", bytes));
  std::map<std::string, std::uint16_t> channels;
  for (const RecordedMessage& message : all) {  // before the first message, as runs do
    if (!channels.contains(message.channel.topic)) {
      channels[message.channel.topic] = writer->add_channel(message.channel);
    }
  }
  for (const RecordedMessage& message : all) {
    ASSERT_TRUE(writer->write(channels[message.channel.topic], message.time, message.data));
  }
  ASSERT_TRUE(writer->finish());
}

}  // namespace palpate::test
