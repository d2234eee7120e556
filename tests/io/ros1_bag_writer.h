// Bags of ROS 1 as the description of the format says, byte by byte
// (http://wiki.ros.org/Bags/Format/2.0).
#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "src/io/bags/mcap_format.h"

namespace palpate::test {

using mcap::Bytes;

inline std::string ros1_header(const std::vector<std::pair<std::string, std::string>>& fields) {
  Bytes header;
  for (const auto& [name, value] : fields) header.text(name + "=" + value);
  return header.str();
}
inline std::string ros1_record(const std::vector<std::pair<std::string, std::string>>& fields,
                               std::string_view data) {
  return Bytes().text(ros1_header(fields)).text(data).str();
}
template <class Int>
std::string bytes_of(Int value) {
  return Bytes().number(value).str();
}
inline std::string op(int code) { return std::string(1, static_cast<char>(code)); }

inline std::string ros1_connection(std::uint32_t id, const std::string& topic,
                                   const std::string& type) {
  return ros1_record({{"op", op(7)}, {"conn", bytes_of(id)}, {"topic", topic}},
                     ros1_header({{"type", type}, {"md5sum", "x"}, {"message_definition", ""}}));
}
inline std::string ros1_message(std::uint32_t connection, std::uint32_t seconds,
                                std::uint32_t nanoseconds, std::string_view data) {
  return ros1_record({{"op", op(2)},
                      {"conn", bytes_of(connection)},
                      {"time", bytes_of(seconds) + bytes_of(nanoseconds)}},
                     data);
}
inline std::string ros1_chunk(std::string_view packed, const std::string& compression = "none",
                              std::optional<std::size_t> size = {}) {
  return ros1_record({{"op", op(5)},
                      {"compression", compression},
                      {"size", bytes_of(static_cast<std::uint32_t>(size.value_or(packed.size())))}},
                     packed);
}
/// Runs the program of that name, with files in the folder; empty: there is none.
inline std::string packed_by_bzip2(std::string_view bytes, const std::filesystem::path& folder) {
  std::ofstream(folder / "plain", std::ios::binary) << bytes;
  const std::string command = "bzip2 -f '" + (folder / "plain").string() + "'";
  if (std::system(command.c_str()) != 0) return {};
  std::ifstream file(folder / "plain.bz2", std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}
/// Without its index, as a recorder that was killed leaves it.
inline std::string ros1_bag(const std::vector<std::string>& chunks) {
  std::string bag = "#ROSBAG V2.0\n" + ros1_record({{"op", op(3)},
                                                    {"index_pos", bytes_of(std::uint64_t{0})},
                                                    {"conn_count", bytes_of(1)},
                                                    {"chunk_count", bytes_of(1)}},
                                                   std::string(4000, ' '));
  for (const std::string& chunk : chunks) bag += chunk;
  return bag;
}

/// std_msgs/Header of ROS 1.
inline Bytes ros1_stamp(std::uint32_t seconds, std::uint32_t nanoseconds, std::string_view frame) {
  Bytes header;
  header.number(std::uint32_t{7}).number(seconds).number(nanoseconds).text(frame);
  return header;
}
/// sensor_msgs/Image of 16UC1.
inline std::string ros1_image(const Bytes& stamp, int width, int height, std::string_view counts) {
  Bytes image = stamp;
  image.number(height).number(width).text("16UC1").number(std::uint8_t{0}).number(2 * width);
  return image.text(counts).str();
}

}  // namespace palpate::test
