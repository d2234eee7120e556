#include <zlib.h>
#include <zstd.h>

#include <fstream>
#include <utility>

#include "src/io/internal/mcap_file.h"
#include "src/io/mcap_format.h"
#include "src/io/unpack.h"

namespace palpate::inline v0 {

using mcap::Cursor;
using mcap::Op;

struct McapReader::Impl {
  std::filesystem::path path;
  std::ifstream file;
  std::uint64_t file_size = 0, position = 0, chunk_place = 0;
  std::string chunk;
  Cursor in_chunk{{}};
  std::map<std::uint16_t, McapChannel> channels;
  std::map<std::uint16_t, std::pair<std::string, std::string>> schemas;
  bool is_cut_off = false, is_over = false;

  Error damaged(const std::string& what) const {
    return {Errc::bad_input, path.string() + " is damaged at byte " + std::to_string(position) +
                                 ": " + what + "; what comes before it can be read"};
  }
  Status unpack(std::string_view records, std::string_view compression, std::uint64_t size);
  Result<bool> next_chunk();
  std::optional<McapMessage> take(Op op, std::string_view contents);
};

// Notes schemas and channels; returns a message if it is one.
std::optional<McapMessage> McapReader::Impl::take(Op op, std::string_view contents) {
  Cursor at(contents);
  if (op == Op::schema) {
    const auto id = at.number<std::uint16_t>();
    const std::string name(at.text());
    at.text();  // encoding
    if (at.is_good()) schemas[id] = {name, std::string(at.text())};
  } else if (op == Op::channel) {
    const auto id = at.number<std::uint16_t>();
    const auto& schema = schemas[at.number<std::uint16_t>()];
    channels[id] = {std::string(at.text()), schema.first, schema.second};
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

// Into `chunk`. What a damaged file says of its size is not believed before memory is taken.
Status McapReader::Impl::unpack(std::string_view records, std::string_view compression,
                                std::uint64_t size) {
  constexpr std::uint64_t kLargest = std::uint64_t{1} << 30;
  if (compression == mcap::kLz4) {
    const Status unpacked = unpack_lz4(records, size, chunk);
    if (unpacked || unpacked.error().code != Errc::bad_input) return unpacked;
    return damaged(unpacked.error().message);
  }
  if (compression.empty()) {
    if (records.size() != size) return damaged("a chunk is too short");
    chunk = std::string(records);
    return Done{};
  }
  const auto declared = ZSTD_getFrameContentSize(records.data(), records.size());
  if (size > kLargest || declared != size) return damaged("a compressed chunk has a wrong size");
  chunk.resize(static_cast<std::size_t>(size));
  const auto got = ZSTD_decompress(chunk.data(), chunk.size(), records.data(), records.size());
  if (ZSTD_isError(got) != 0 || got != size) return damaged("a chunk cannot be unpacked");
  return Done{};
}

// False at the end of the data.
Result<bool> McapReader::Impl::next_chunk() {
  for (;;) {
    char head[9];
    if (position + sizeof head > file_size) {
      is_cut_off = true;
      return false;
    }
    file.seekg(static_cast<std::streamoff>(position));
    file.read(head, sizeof head);
    Cursor at(std::string_view(head, sizeof head));
    const auto op = static_cast<Op>(at.number<std::uint8_t>());
    const auto length = at.number<std::uint64_t>();
    if (!file || length > file_size - position - sizeof head) {
      is_cut_off = true;
      return false;
    }
    if (op == Op::data_end || op == Op::footer) return false;
    if (op != Op::chunk && op != Op::schema && op != Op::channel && op != Op::message) {
      position += sizeof head + length;
      continue;
    }
    std::string contents(static_cast<std::size_t>(length), '\0');
    file.read(contents.data(), static_cast<std::streamsize>(length));
    if (!file) return damaged("it cannot be read");
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
  if (!impl->file || magic != mcap::kMagic) {
    return Error{Errc::bad_input, path.string() + " is not an MCAP file"};
  }
  impl->position = mcap::kMagic.size();
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

Result<std::string> McapReader::attachment(std::string_view name) {
  Impl& d = *impl_;
  const Error absent{Errc::not_found, d.path.string() + " holds no file " + std::string(name) +
                                          "; record the run again"};
  d.file.clear();
  for (std::uint64_t at = mcap::kMagic.size();;) {
    std::string head(9, '\0');
    d.file.seekg(static_cast<std::streamoff>(at));
    if (!d.file.read(head.data(), static_cast<std::streamsize>(head.size()))) return absent;
    Cursor fields(head);
    const auto op = static_cast<Op>(fields.number<std::uint8_t>());
    const auto length = fields.number<std::uint64_t>();
    // They come before all messages.
    if (op == Op::chunk || op == Op::data_end || length > d.file_size - at - head.size()) {
      return absent;
    }
    at += head.size() + length;
    if (op != Op::attachment) continue;
    std::string contents(static_cast<std::size_t>(length), '\0');
    if (!d.file.read(contents.data(), static_cast<std::streamsize>(length))) return absent;
    Cursor fields_of(contents);
    fields_of.number<std::uint64_t>();
    fields_of.number<std::uint64_t>();
    if (fields_of.text() != name) continue;
    fields_of.text();  // media type
    const std::string_view file = fields_of.raw(fields_of.number<std::uint64_t>());
    const auto crc = fields_of.number<std::uint32_t>();
    const auto got =
        crc32_z(0, reinterpret_cast<const Bytef*>(contents.data()), contents.size() - sizeof crc);
    if (!fields_of.is_good() || (crc != 0 && crc != got)) {
      return Error{Errc::bad_input, d.path.string() + " is damaged: the checksum of " +
                                        std::string(name) + " is wrong; record the run again"};
    }
    return std::string(file);
  }
}

std::uint64_t McapReader::chunk_place() const { return impl_->chunk_place; }

void McapReader::seek(std::uint64_t chunk_place) {
  impl_->file.clear();
  impl_->position = chunk_place;
  impl_->in_chunk = Cursor({});
  impl_->is_over = impl_->is_cut_off = false;
}

}  // namespace palpate::inline v0
