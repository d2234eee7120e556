#include <zlib.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <optional>
#include <utility>

#include "src/io/bags/bag_formats.h"
#include "src/io/bags/mcap_format.h"
#include "src/io/bags/unpack.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/mcap_file.h"

namespace palpate { inline namespace v0 {

using mcap::Cursor;
using mcap::Op;

namespace {

/// Limit of a type's name: a longer one is none that is known here. The rest of a schema is not
/// kept.
constexpr std::size_t kLongestName = 256;

}  // namespace

struct McapReader::Impl {
  /// A file inside the recording: where its record's contents are, and how long.
  struct Place {
    std::uint64_t begin = 0, length = 0;
  };
  std::filesystem::path path;
  std::ifstream file;
  std::uint64_t file_size = 0, position = 0, chunk_place = 0;
  std::uint64_t file_at = 0;  // what is read next without seeking
  std::string chunk;
  Cursor in_chunk{{}};
  std::map<std::uint16_t, McapChannel> channels;
  std::map<std::uint16_t, std::string> schemas;                          // their names
  std::optional<std::map<std::string, Place, std::less<>>> attachments;  // by name, once looked for
  bool is_cut_off = false, is_over = false;

  Error damaged(const std::string& what) const {
    return {Errc::bad_input, path.string() + " is damaged at byte " + std::to_string(position) +
                                 ": " + what + "; what comes before it can be read"};
  }
  bool read_at(std::uint64_t place, char* to, std::uint64_t size);
  Status find_attachments();
  Status unpack(std::string_view records, std::string_view compression, std::uint64_t size);
  Result<bool> next_chunk();
  std::optional<McapMessage> take(Op op, std::string_view contents);
};

// Seeks only where it must: a seek throws away bytes read ahead, which is expensive for small
// records.
bool McapReader::Impl::read_at(std::uint64_t place, char* to, std::uint64_t size) {
  constexpr std::uint64_t kNear = 4096;
  if (place < file_at || place > file_at + kNear || !file) {
    file.clear();
    file.seekg(static_cast<std::streamoff>(place));
  } else if (place > file_at) {
    file.ignore(static_cast<std::streamsize>(place - file_at));
  }
  file.read(to, static_cast<std::streamsize>(size));
  file_at = place + size;
  return static_cast<bool>(file);
}

// Notes schemas and channels; returns a message if the record is one.
std::optional<McapMessage> McapReader::Impl::take(Op op, std::string_view contents) {
  Cursor at(contents);
  if (op == Op::schema) {
    const auto id = at.number<std::uint16_t>();
    const std::string_view name = at.text();
    if (at.is_good()) schemas[id] = name.substr(0, kLongestName);
  } else if (op == Op::channel) {
    const auto id = at.number<std::uint16_t>();
    const std::string& schema = schemas[at.number<std::uint16_t>()];
    std::string topic(at.text());
    channels[id] = {std::move(topic), schema, "", std::string(at.text())};
  } else if (op == Op::message) {
    McapMessage message;
    message.channel = at.number<std::uint16_t>();
    at.number<std::uint32_t>();  // sequence
    message.time = at.number<std::uint64_t>();
    at.number<std::uint64_t>();  // publish time
    if (!at.is_good()) return std::nullopt;
    message.data = contents.substr(2 + 4 + 8 + 8);
    return message;
  }
  return std::nullopt;
}

// Unpacks into `chunk`. Memory is not taken by the size that a damaged file may announce.
Status McapReader::Impl::unpack(std::string_view records, std::string_view compression,
                                std::uint64_t size) {
  if (compression.empty()) {
    if (records.size() != size) return damaged("a chunk is too short");
    chunk = std::string(records);
    return Done{};
  }
  const Status unpacked = compression == mcap::kLz4 ? unpack_lz4(records, size, chunk)
                                                    : unpack_zstd(records, size, chunk);
  if (unpacked) return unpacked;
  if (unpacked.error().code != Errc::bad_input) {
    return Error{unpacked.error().code, path.string() + ": " + unpacked.error().message};
  }
  return damaged(unpacked.error().message);
}

// False at the end of the data.
Result<bool> McapReader::Impl::next_chunk() {
  for (;;) {
    char head[9];
    if (position + sizeof head > file_size) {
      is_cut_off = true;
      return false;
    }
    if (!read_at(position, head, sizeof head)) return unreadable(path, position);
    Cursor at(std::string_view(head, sizeof head));
    const auto op = static_cast<Op>(at.number<std::uint8_t>());
    const auto length = at.number<std::uint64_t>();
    if (length > file_size - position - sizeof head) {
      is_cut_off = true;
      return false;
    }
    if (op == Op::data_end || op == Op::footer) return false;
    if (op != Op::chunk && op != Op::schema && op != Op::channel && op != Op::message) {
      position += sizeof head + length;
      continue;
    }
    std::string contents(static_cast<std::size_t>(length), '\0');
    if (!read_at(position + sizeof head, contents.data(), length)) {
      return unreadable(path, position);
    }
    if (op != Op::chunk) {
      // Outside of chunks, as other writers may put them: as if it were a chunk of one record.
      mcap::Bytes record;
      record.record(op, contents);
      chunk = record.str();
    } else {
      Cursor fields(contents);
      fields.number<std::uint64_t>();
      fields.number<std::uint64_t>();
      const auto size = fields.number<std::uint64_t>();
      const auto crc = fields.number<std::uint32_t>();
      const std::string_view compression = fields.text();
      if (!compression.empty() && compression != mcap::kZstd && compression != mcap::kLz4) {
        return damaged("its chunks are compressed by " + std::string(compression) +
                       "; rewrite it with Zstandard (mcap compress --compression zstd)");
      }
      const std::string_view records = fields.raw(fields.number<std::uint64_t>());
      if (!fields.is_good()) return damaged("a chunk is too short");
      if (const Status status = unpack(records, compression, size); !status) {
        return status.error();
      }
      const auto got = crc32_z(0, reinterpret_cast<const Bytef*>(chunk.data()), chunk.size());
      if (crc != 0 && crc != got) return damaged("the checksum of a chunk is wrong");
    }
    in_chunk = Cursor(chunk);
    chunk_place = position;
    position += sizeof head + length;
    return true;
  }
}

McapReader::McapReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
McapReader::McapReader(McapReader&&) noexcept = default;
McapReader& McapReader::operator=(McapReader&&) noexcept = default;
McapReader::~McapReader() = default;

Result<McapReader> McapReader::open(const std::filesystem::path& path) {
  if (const Status status = check_regular_file(path); !status) return status.error();
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->file.open(path, std::ios::binary);
  std::string magic(mcap::kMagic.size(), '\0');
  if (!impl->file) {
    return Error{Errc::not_found,
                 "cannot read " + path.string() + "; check the name and its permissions"};
  }
  impl->file.seekg(0, std::ios::end);
  impl->file_size = static_cast<std::uint64_t>(impl->file.tellg());
  impl->file.seekg(0);
  impl->file.read(magic.data(), static_cast<std::streamsize>(magic.size()));
  if (impl->file.bad()) return unreadable(path, 0);
  if (!impl->file || magic != mcap::kMagic) {
    return Error{Errc::bad_input, path.string() + " is not an MCAP file"};
  }
  impl->position = impl->file_at = mcap::kMagic.size();
  return McapReader(std::move(impl));
}

Result<std::optional<McapMessage>> McapReader::next() {
  Impl& d = *impl_;
  while (!d.is_over) {
    if (d.in_chunk.at_end()) {
      const auto more = d.next_chunk();
      if (!more) {
        d.is_over = true;
        return more.error();
      }
      if (!*more) {
        d.is_over = true;
        break;
      }
      continue;
    }
    const auto op = static_cast<Op>(d.in_chunk.number<std::uint8_t>());
    const std::string_view contents = d.in_chunk.raw(d.in_chunk.number<std::uint64_t>());
    if (!d.in_chunk.is_good()) {
      d.is_over = true;
      return d.damaged("a record is longer than its chunk");
    }
    const auto message = d.take(op, contents);
    if (!message) continue;
    if (!d.channels.contains(message->channel)) {
      d.is_over = true;
      return d.damaged("a message refers to an undeclared channel");
    }
    return message;
  }
  return std::optional<McapMessage>();
}

const std::map<std::uint16_t, McapChannel>& McapReader::channels() const { return impl_->channels; }
bool McapReader::was_cut_off() const { return impl_->is_cut_off; }

// Attachments come before all messages. Of two of one name the first one counts.
Status McapReader::Impl::find_attachments() {
  std::map<std::string, Place, std::less<>> found;
  constexpr std::size_t kHead = 9;
  for (std::uint64_t at = mcap::kMagic.size(); at + kHead <= file_size;) {
    std::string head(kHead, '\0');
    if (!read_at(at, head.data(), kHead)) return unreadable(path, at);
    Cursor fields(head);
    const auto op = static_cast<Op>(fields.number<std::uint8_t>());
    const auto length = fields.number<std::uint64_t>();
    at += kHead;
    if (op == Op::chunk || op == Op::data_end || length > file_size - at) break;
    if (op == Op::attachment) {
      // Two times, then the name.
      std::string begin(std::min<std::uint64_t>(length, 8 + 8 + 4 + kLongestName), '\0');
      if (!read_at(at, begin.data(), begin.size())) return unreadable(path, at);
      Cursor of_begin(begin);
      of_begin.number<std::uint64_t>();
      of_begin.number<std::uint64_t>();
      const std::string_view name = of_begin.text();
      if (of_begin.is_good()) found.emplace(name, Place{at, length});
    }
    at += length;
  }
  attachments = std::move(found);
  return Done{};
}

Result<std::string> McapReader::attachment(std::string_view name) {
  Impl& d = *impl_;
  if (!d.attachments) {
    if (const Status looked = d.find_attachments(); !looked) return looked.error();
  }
  const auto found = d.attachments->find(name);
  if (found == d.attachments->end()) {
    return Error{Errc::not_found, d.path.string() + " holds no file " + std::string(name) +
                                      "; record the run again"};
  }
  const auto [begin, length] = found->second;
  std::string contents(length, '\0');
  if (!d.read_at(begin, contents.data(), length)) return unreadable(d.path, begin);
  Cursor fields(contents);
  fields.number<std::uint64_t>();
  fields.number<std::uint64_t>();
  fields.text();  // its name
  fields.text();  // media type
  const std::string_view file = fields.raw(fields.number<std::uint64_t>());
  const auto crc = fields.number<std::uint32_t>();
  const auto got =
      crc32_z(0, reinterpret_cast<const Bytef*>(contents.data()), contents.size() - sizeof crc);
  if (!fields.is_good() || (crc != 0 && crc != got)) {
    return Error{Errc::bad_input, d.path.string() + " is damaged: the checksum of " +
                                      std::string(name) + " is wrong; record the run again"};
  }
  return std::string(file);
}

std::uint64_t McapReader::chunk_place() const { return impl_->chunk_place; }

void McapReader::seek(std::uint64_t chunk_place) {
  impl_->position = chunk_place;
  impl_->in_chunk = Cursor({});
  impl_->is_over = impl_->is_cut_off = false;
}

}}  // namespace palpate::v0
