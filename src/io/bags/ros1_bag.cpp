// Bags of ROS 1, format 2.0 (http://wiki.ros.org/Bags/Format/2.0): records of a header, which is a
// list of NAME=VALUE, and data; all numbers little-endian.
#include <zstd.h>

#include <fstream>
#include <string>
#include <utility>

#include "src/io/bags/bag_formats.h"
#include "src/io/bags/mcap_format.h"
#include "src/io/bags/unpack.h"

namespace palpate { inline namespace v0 {
namespace {

using mcap::Cursor;

constexpr int kFastest = 1;  // level of Zstandard

enum class Op : std::uint8_t { message = 2, bag = 3, chunk = 5, connection = 7 };

/// Returns the value of a header's field; empty if there is none.
std::string_view value_of(std::string_view header, std::string_view name) {
  for (Cursor at(header); !at.at_end();) {
    const std::string_view field = at.text();
    if (field.size() > name.size() && field.starts_with(name) && field[name.size()] == '=') {
      return field.substr(name.size() + 1);
    }
  }
  return {};
}

template <class Int>
Int number_of(std::string_view header, std::string_view name) {
  return Cursor(value_of(header, name)).number<Int>();
}

class Ros1Bag final : public BagFile {
 public:
  Ros1Bag(std::filesystem::path path, std::size_t number, KeptChunks& kept)
      : path_(std::move(path)), number_(number), kept_(kept) {}

  Status open() {
    file_.open(path_, std::ios::binary | std::ios::ate);
    if (!file_) return Error{Errc::not_found, "cannot read " + path_.string()};
    size_ = static_cast<std::uint64_t>(file_.tellg());
    at_ = kRos1Magic.size();
    file_.seekg(static_cast<std::streamoff>(at_));
    return Done{};
  }

  const std::map<std::uint16_t, McapChannel>& channels() const override { return channels_; }
  bool was_cut_off() const override { return is_cut_off_; }

  Result<std::optional<McapMessage>> next() override {
    while (!is_over_) {
      if (in_chunk_.at_end()) {
        const auto more = next_chunk();
        is_over_ = !more || !*more;
        if (!more) return more.error();
        continue;
      }
      const std::string_view header = in_chunk_.text(), data = in_chunk_.text();
      if (!in_chunk_.is_good()) {
        is_over_ = true;
        return damaged("a record is longer than its chunk");
      }
      const auto message = take(header, data);
      if (!message) is_over_ = true;
      if (!message || *message) return message;
    }
    return std::optional<McapMessage>();
  }

 private:
  Error damaged(const std::string& what) const {
    return {Errc::bad_input, path_.string() + " is damaged at byte " + std::to_string(position_) +
                                 ": " + what + "; rosbag fix may repair it"};
  }

  /// Notes connections; returns a message if the record is one.
  Result<std::optional<McapMessage>> take(std::string_view header, std::string_view data) {
    const auto op = Op{number_of<std::uint8_t>(header, "op")};
    const auto connection = number_of<std::uint32_t>(header, "conn");
    if (op == Op::connection && !numbers_.contains(connection)) {
      if (numbers_.size() > 65535) return damaged("it has more topics than anybody has");
      const auto channel = static_cast<std::uint16_t>(numbers_.size());
      channels_[channel] = {std::string(value_of(header, "topic")),
                            std::string(value_of(data, "type")), "", "ros1"};
      numbers_[connection] = channel;
    }
    if (op != Op::message) return std::optional<McapMessage>();
    const auto found = numbers_.find(connection);
    if (found == numbers_.end()) return damaged("a message refers to an undeclared connection");
    const std::string_view time = value_of(header, "time");
    Cursor at(time);
    const auto seconds = at.number<std::uint32_t>(), nanoseconds = at.number<std::uint32_t>();
    if (!at.is_good()) return damaged("a message has no time");
    return std::optional(
        McapMessage{found->second, std::uint64_t{1'000'000'000} * seconds + nanoseconds, data});
  }

  /// Reads a length and so many bytes; false if the file ends before that.
  Result<bool> read(std::string& to) {
    std::string length(4, '\0');
    if (length.size() > size_ - at_) return false;
    if (!file_.read(length.data(), 4)) return unreadable(path_, at_);
    const auto size = Cursor(length).number<std::uint32_t>();
    at_ += length.size();
    if (size > size_ - at_) return false;
    to.resize(size);
    if (!file_.read(to.data(), size)) return unreadable(path_, at_);
    at_ += size;
    return true;
  }

  /// Reads the next chunk into in_chunk_. False at the end of the data.
  Result<bool> next_chunk() {
    std::string header, data;
    position_ = at_;
    if (position_ == size_) return false;
    for (std::string* const part : {&header, &data}) {
      const auto is_whole = read(*part);
      is_cut_off_ = is_whole && !*is_whole;
      if (!is_whole || is_cut_off_) return is_whole;
    }
    const auto op = Op{number_of<std::uint8_t>(header, "op")};
    if (op == Op::bag && !value_of(header, "encryptor").empty()) {
      return Error{Errc::bad_input,
                   path_.string() + " is encrypted; rewrite it without encryption"};
    }
    if (op != Op::chunk) {
      // A record by itself, as if it were alone in a chunk.
      mcap::Bytes record;
      chunk_ = record.text(header).text(data).str();
    } else {
      if (value_of(header, "size").size() != 4) return damaged("a chunk has no size field");
      const auto size = number_of<std::uint32_t>(header, "size");
      const std::string_view packing = value_of(header, "compression");
      Status unpacked = Done{};
      if (packing == "none" && data.size() != size) {
        return damaged("a chunk has a wrong size field");
      } else if (packing == "none") {
        chunk_ = std::move(data);
      } else if (packing == "lz4") {
        unpacked = unpack_lz4(data, size, chunk_);
      } else if (packing == "bz2") {
        if (!kept_.find({number_, position_}, chunk_)) {
          unpacked = unpack_bzip2(data, size, chunk_);
          if (unpacked) kept_.add({number_, position_}, chunk_);
        }
      } else {
        return damaged("its chunks are compressed by '" + std::string(packing.substr(0, 20)) + "'");
      }
      if (!unpacked && unpacked.error().code == Errc::bad_input) {
        return damaged(unpacked.error().message);
      }
      if (!unpacked)
        return Error{Errc::unavailable, path_.string() + ": " + unpacked.error().message};
    }
    in_chunk_ = Cursor(chunk_);
    return true;
  }

  const std::filesystem::path path_;
  const std::size_t number_;
  KeptChunks& kept_;
  std::ifstream file_;
  std::uint64_t size_ = 0, at_ = 0, position_ = 0;  // of the file, what is read next, the chunk
  std::string chunk_;
  Cursor in_chunk_{{}};
  std::map<std::uint16_t, McapChannel> channels_;
  std::map<std::uint32_t, std::uint16_t> numbers_;  // of channels, by connection
  bool is_over_ = false, is_cut_off_ = false;
};

}  // namespace

void KeptChunks::add(const Place& place, std::string_view chunk) {
  std::string packed(ZSTD_compressBound(chunk.size()), '\0');
  const std::size_t size =
      ZSTD_compress(packed.data(), packed.size(), chunk.data(), chunk.size(), kFastest);
  if (ZSTD_isError(size) != 0 || size > room_ || packed_.contains(place)) return;
  room_ -= size;
  packed_[place] = packed.substr(0, size);
}

bool KeptChunks::find(const Place& place, std::string& to) const {
  const auto found = packed_.find(place);
  return found != packed_.end() && unpack_zstd(found->second, {}, to);
}

Result<std::unique_ptr<BagFile>> open_ros1_bag(const std::filesystem::path& path,
                                               std::size_t number, KeptChunks& kept) {
  auto bag = std::make_unique<Ros1Bag>(path, number, kept);
  if (const Status opened = bag->open(); !opened) return opened.error();
  return std::unique_ptr<BagFile>(std::move(bag));
}

}}  // namespace palpate::v0
