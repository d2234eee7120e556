// MCAP files record by record, as the description of the format says (https://mcap.dev/spec).
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "src/io/bags/mcap_format.h"

namespace palpate::test {

inline std::string mcap_record(mcap::Op op, const mcap::Bytes& contents) {
  return mcap::Bytes().record(op, contents.str()).str();
}
/// A channel with its schema.
inline std::string mcap_channel(std::uint16_t id, std::string_view topic, std::string_view type,
                                std::string_view encoding = "cdr") {
  mcap::Bytes schema, channel;
  schema.number(id).text(type).text(encoding == "cdr" ? "ros2msg" : "ros1msg").text("");
  channel.number(id).number(id).text(topic).text(encoding).number(std::uint32_t{0});
  return mcap_record(mcap::Op::schema, schema) + mcap_record(mcap::Op::channel, channel);
}
inline std::string mcap_message(std::uint16_t channel, std::uint64_t time, std::string_view data) {
  mcap::Bytes message;
  message.number(channel).number(std::uint32_t{0}).number(time).number(time).raw(data);
  return mcap_record(mcap::Op::message, message);
}
/// Records in a chunk, which says that they are `size` bytes.
inline std::string mcap_chunk(std::string_view packed, std::uint64_t size,
                              std::string_view compression) {
  mcap::Bytes chunk;
  chunk.number(std::uint64_t{0}).number(std::uint64_t{0}).number(size).number(std::uint32_t{0});
  chunk.text(compression).number(std::uint64_t{packed.size()}).raw(packed);
  return mcap_record(mcap::Op::chunk, chunk);
}
inline std::string mcap_file(std::string_view records) {
  return std::string(mcap::kMagic) + std::string(records) +
         mcap_record(mcap::Op::data_end, mcap::Bytes().number(std::uint32_t{0}));
}

}  // namespace palpate::test
