#include <fcntl.h>
#include <unistd.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <new>
#include <optional>
#include <utility>

#include "src/io/bags/mcap_format.h"
#include "src/io/internal/disk_sync.h"
#include "src/io/internal/mcap_file.h"

namespace palpate { inline namespace v0 {

using mcap::Bytes;
using mcap::Op;

namespace {

std::uint32_t checksum(std::string_view bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

constexpr int kLevel = 1;  // of compression: the fastest, half of what depth images need

/// Position of a chunk in the file.
struct ChunkPlace {
  std::uint64_t start_time, end_time, offset, length, num_bytes;
  std::uint64_t compressed_bytes, index_length;
  std::map<std::uint16_t, std::uint64_t> index_offsets;
};

}  // namespace

struct McapWriter::Impl {
  std::filesystem::path path;
  McapOptions options;
  int file = -1;
  std::uint64_t size = 0;
  Status status = Done{};
  bool has_ended = false;

  Bytes chunk;
  std::uint64_t chunk_start = 0, chunk_end = 0;
  std::chrono::steady_clock::time_point chunk_began;
  std::map<std::uint16_t, Bytes> chunk_index;  // of the messages of each channel

  Bytes channels;  // schemas and channels, for the summary
  std::uint16_t num_channels = 0;
  std::map<std::uint16_t, std::uint64_t> num_messages;
  std::map<std::uint16_t, std::uint32_t> sequence;
  std::vector<ChunkPlace> chunks;
  Bytes attachment_index;
  std::uint32_t num_attachments = 0;
  ZSTD_CCtx* const compressor = ZSTD_createCCtx();
  std::string compressed;
  std::uint64_t first_time = ~std::uint64_t{0}, last_time = 0;
  std::optional<DiskSync> sync;  // which closes the file

  ~Impl() { ZSTD_freeCCtx(compressor); }
  Status put(std::string_view bytes);
  Status end_chunk();
  Status judge_sync();
};

/// Writes all bytes or none: a part of a record would only take space that others need.
Status McapWriter::Impl::put(std::string_view bytes) {
  const std::uint64_t begin = size;
  while (status && !bytes.empty()) {
    const ssize_t written = ::write(file, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      status = Error{Errc::io_failure, "cannot write " + path.string() + ": " +
                                           std::strerror(errno) + "; free some space"};
      (void)!::ftruncate(file, static_cast<off_t>(begin));
      size = begin;
      break;
    }
    bytes.remove_prefix(static_cast<std::size_t>(written));
    size += static_cast<std::uint64_t>(written);
  }
  return status;
}

Status McapWriter::Impl::end_chunk() {
  if (!status || chunk.empty()) return status;
  compressed.resize(ZSTD_compressBound(chunk.size()));
  const std::size_t num_bytes = ZSTD_compressCCtx(compressor, compressed.data(), compressed.size(),
                                                  chunk.str().data(), chunk.size(), kLevel);
  if (ZSTD_isError(num_bytes) != 0) {
    return status = Error{Errc::io_failure, "cannot compress a part of " + path.string() + ": " +
                                                ZSTD_getErrorName(num_bytes)};
  }
  Bytes contents;
  contents.number(chunk_start)
      .number(chunk_end)
      .number(static_cast<std::uint64_t>(chunk.size()))
      .number(checksum(chunk.str()))
      .text(mcap::kZstd)
      .number(static_cast<std::uint64_t>(num_bytes))
      .raw(std::string_view(compressed).substr(0, num_bytes));
  Bytes record;
  record.record(Op::chunk, contents.str());
  ChunkPlace place{chunk_start, chunk_end, size, record.size(), chunk.size(), num_bytes, 0, {}};
  Bytes index;
  for (const auto& [channel, entries] : chunk_index) {
    place.index_offsets[channel] = size + record.size() + index.size();
    Bytes one;
    one.number(channel).text(entries.str());
    index.record(Op::message_index, one.str());
  }
  place.index_length = index.size();
  record.raw(index.str());
  if (const Status written = put(record.str()); !written) return written;
  chunks.push_back(std::move(place));
  chunk.clear();
  chunk_index.clear();
  return status;
}

/// Takes over the error of bringing bytes to the disk.
Status McapWriter::Impl::judge_sync() {
  if (const int error = sync->error(); status && error != 0) {
    status = Error{Errc::io_failure, "cannot bring " + path.string() + " to the disk: " +
                                         std::strerror(error) + "; check the disk"};
  }
  return status;
}

McapWriter::McapWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
McapWriter::McapWriter(McapWriter&&) noexcept = default;
McapWriter& McapWriter::operator=(McapWriter&&) noexcept = default;
McapWriter::~McapWriter() {
  if (impl_ == nullptr) return;
  try {
    (void)end();
  } catch (const std::bad_alloc&) {
    // Chunks written so far stay readable.
  }
}

Result<McapWriter> McapWriter::create(const std::filesystem::path& path,
                                      const McapOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->options = options;
  impl->file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (impl->file < 0) {
    return Error{Errc::io_failure, "cannot make " + path.string() + ": " + std::strerror(errno) +
                                       "; check the folder and its permissions"};
  }
  impl->sync.emplace(impl->file);
  Bytes header, start;
  header.text("ros2").text("palpate");
  start.raw(mcap::kMagic).record(Op::header, header.str());
  if (const Status status = impl->put(start.str()); !status) return status.error();
  return McapWriter(std::move(impl));
}

std::uint16_t McapWriter::add_channel(const McapChannel& channel) {
  Impl& d = *impl_;
  const std::uint16_t number = ++d.num_channels;
  Bytes schema, described, both;
  schema.number(number).text(channel.schema_name).text("ros2msg").text(channel.schema);
  described.number(number).number(number).text(channel.topic).text("cdr").text("");
  both.record(Op::schema, schema.str()).record(Op::channel, described.str());
  // In the chunk, for readers that go from the start; and in the summary.
  if (d.chunk.empty()) d.chunk_began = std::chrono::steady_clock::now();
  d.chunk.raw(both.str());
  d.channels.raw(both.str());
  d.num_messages[number] = 0;
  return number;
}

Status McapWriter::attach(std::string_view name, std::string_view media_type,
                          std::string_view file) {
  Impl& d = *impl_;
  Bytes contents, record, index;
  contents.number(std::uint64_t{0}).number(std::uint64_t{0}).text(name).text(media_type);
  contents.number(static_cast<std::uint64_t>(file.size())).raw(file);
  contents.number(checksum(contents.str()));
  record.record(Op::attachment, contents.str());
  index.number(d.size).number(static_cast<std::uint64_t>(record.size()));
  index.number(std::uint64_t{0}).number(std::uint64_t{0});
  index.number(static_cast<std::uint64_t>(file.size())).text(name).text(media_type);
  d.attachment_index.record(Op::attachment_index, index.str());
  ++d.num_attachments;
  return d.put(record.str());
}

Status McapWriter::write(std::uint16_t channel, std::uint64_t time, std::string_view message) {
  Impl& d = *impl_;
  if (!d.status) return d.status;
  const auto now = std::chrono::steady_clock::now();
  if (d.chunk.empty()) d.chunk_began = now;
  if (d.chunk_index.empty()) d.chunk_start = d.chunk_end = time;
  d.chunk_start = std::min(d.chunk_start, time);
  d.chunk_end = std::max(d.chunk_end, time);
  d.first_time = std::min(d.first_time, time);
  d.last_time = std::max(d.last_time, time);
  // If memory is exhausted, neither the record nor its index entry is written in part.
  const std::size_t begin = d.chunk.size();
  Bytes contents, &index = d.chunk_index[channel];
  contents.number(channel).number(d.sequence[channel]).number(time).number(time).raw(message);
  index.make_room(16);
  d.chunk.record(Op::message, contents.str());
  index.number(time).number(static_cast<std::uint64_t>(begin));
  ++d.sequence[channel];
  ++d.num_messages[channel];
  const std::chrono::duration<double> age = now - d.chunk_began;
  if (d.chunk.size() < d.options.chunk_bytes && age.count() < d.options.chunk_seconds) {
    return d.status;
  }
  return flush();
}

Status McapWriter::flush() {
  Impl& d = *impl_;
  if (const Status status = d.end_chunk(); !status) return status;
  d.sync->request(d.size);
  return d.judge_sync();
}

Status McapWriter::end() {
  Impl& d = *impl_;
  if (std::exchange(d.has_ended, true)) return d.status;
  if (const Status status = d.end_chunk(); !status) return status;
  Bytes end;
  end.record(Op::data_end, Bytes().number(std::uint32_t{0}).str());
  const std::uint64_t summary_start = d.size + end.size();
  end.raw(d.channels.str());
  std::uint64_t num_messages = 0;
  Bytes counts;
  for (const auto& [channel, num] : d.num_messages) {
    num_messages += num;
    counts.number(channel).number(num);
  }
  Bytes statistics;
  statistics.number(num_messages)
      .number(d.num_channels)
      .number(static_cast<std::uint32_t>(d.num_channels))
      .number(d.num_attachments)
      .number(std::uint32_t{0})
      .number(static_cast<std::uint32_t>(d.chunks.size()))
      .number(num_messages > 0 ? d.first_time : 0)
      .number(d.last_time)
      .text(counts.str());
  end.record(Op::statistics, statistics.str());
  end.raw(d.attachment_index.str());
  for (const ChunkPlace& chunk : d.chunks) {
    Bytes offsets, index;
    for (const auto& [channel, offset] : chunk.index_offsets) {
      offsets.number(channel).number(offset);
    }
    index.number(chunk.start_time)
        .number(chunk.end_time)
        .number(chunk.offset)
        .number(chunk.length)
        .text(offsets.str())
        .number(chunk.index_length)
        .text(mcap::kZstd)
        .number(chunk.compressed_bytes)
        .number(chunk.num_bytes);
    end.record(Op::chunk_index, index.str());
  }
  Bytes footer;
  footer.number(summary_start).number(std::uint64_t{0}).number(std::uint32_t{0});
  end.record(Op::footer, footer.str()).raw(mcap::kMagic);
  if (const Status status = d.put(end.str()); !status) return status;
  d.sync->request(d.size);
  return d.judge_sync();
}

bool McapWriter::waits_for_disk() const { return impl_->sync->is_busy(); }

Status McapWriter::finish() {
  if (const Status ended = end(); !ended) return ended;
  impl_->sync->wait();
  return impl_->judge_sync();
}

std::uint64_t McapWriter::bytes_written() const { return impl_->size; }

std::uint64_t McapWriter::bytes_kept() const {
  return impl_->sync->error() == 0 ? impl_->size : bytes_on_disk();
}

std::uint64_t McapWriter::bytes_on_disk() const { return impl_->sync->size_on_disk(); }

}}  // namespace palpate::v0
