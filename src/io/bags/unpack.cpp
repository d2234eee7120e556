#include "src/io/bags/unpack.h"

#include <zstd.h>
#include <zstd_errors.h>

#include <algorithm>
#include <bit>
#include <memory>
#include <new>

#include "src/core/internal/shared_library.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::uint64_t kLargest = std::uint64_t{1} << 30, kFirstStep = std::uint64_t{1} << 22;
/// Largest ratio of compression, and the size that is allowed at any ratio: zeros pack well.
constexpr std::uint64_t kMaxRatio = 1000, kSmall = std::uint64_t{64} << 20;

/// Largest plausible size of data packed into so many bytes; depth images are packed to a tenth.
std::uint64_t max_unpacked(std::uint64_t packed) {
  return std::min(kLargest, kSmall + kMaxRatio * std::min(packed, kLargest));
}

Result<SharedLibrary> library(const std::string& name, const char* package) {
  auto found = SharedLibrary::open({&name, 1});
  if (found) return found;
  return Error{Errc::unavailable, found.error().message + "; install " + package};
}

/// `step(place, room)` puts up to `room` bytes there and returns how many, 0 at the end or damage.
template <class Step>
Status fill(std::string_view packed, std::optional<std::uint64_t> size, std::string& to,
            const Step& step) {
  std::uint64_t filled = 0;
  to.clear();
  const std::uint64_t most = size.value_or(max_unpacked(packed.size()));
  if (most > max_unpacked(packed.size())) {
    return Error{Errc::bad_input, "a compressed chunk of " + std::to_string(packed.size()) +
                                      " bytes would be " + std::to_string(most) +
                                      " bytes, which is implausible"};
  }
  const std::uint64_t first = std::min(kFirstStep, 4096 + 16 * std::uint64_t{packed.size()});
  while (filled < most) {
    to.resize(static_cast<std::size_t>(std::min(most, std::max(first, 2 * filled))));
    while (filled < to.size()) {
      const std::size_t got = step(to.data() + filled, to.size() - filled);
      if (got == 0 && size) return Error{Errc::bad_input, "a compressed chunk is damaged"};
      if (got == 0) {
        to.resize(static_cast<std::size_t>(filled));
        return Done{};
      }
      filled += got;
    }
  }
  char more = 0;
  if (step(&more, 1) == 0) return Done{};
  return Error{Errc::bad_input, "a compressed chunk is larger than its size field"};
}

// lz4frame.h
struct Lz4 {
  struct Context;
  std::size_t (*create)(Context**, unsigned version);
  std::size_t (*free)(Context*);
  std::size_t (*decompress)(Context*, void* to, std::size_t* to_size, const void* from,
                            std::size_t* from_size, const void* options);
  unsigned (*is_error)(std::size_t);
};
constexpr unsigned kLz4Version = 100;

Result<Lz4> load_lz4() {
  auto found = library("liblz4.so.1", "liblz4-1");
  if (!found) return found.error();
  Lz4 lz4{};
  found->require("LZ4F_createDecompressionContext", lz4.create);
  found->require("LZ4F_freeDecompressionContext", lz4.free);
  found->require("LZ4F_decompress", lz4.decompress);
  found->require("LZ4F_isError", lz4.is_error);
  if (const Status status = found->check(""); !status) return status.error();
  return lz4;
}

// bzlib.h
struct Bzip2Stream {
  const char* next_in;
  unsigned avail_in, total_in_low, total_in_high;
  char* next_out;
  unsigned avail_out, total_out_low, total_out_high;
  void* state;
  void* (*allocate)(void*, int, int);
  void (*release)(void*, void*);
  void* opaque;
};
struct Bzip2 {
  int (*begin)(Bzip2Stream*, int verbosity, int small);
  int (*decompress)(Bzip2Stream*);
  int (*end)(Bzip2Stream*);
};
constexpr int kBzip2Ok = 0, kBzip2End = 4;

Result<Bzip2> load_bzip2() {
  auto found = library("libbz2.so.1.0", "libbz2-1.0");
  if (!found) return found.error();
  Bzip2 bzip2{};
  found->require("BZ2_bzDecompressInit", bzip2.begin);
  found->require("BZ2_bzDecompress", bzip2.decompress);
  found->require("BZ2_bzDecompressEnd", bzip2.end);
  if (const Status status = found->check(""); !status) return status.error();
  return bzip2;
}

}  // namespace

Status unpack_zstd(std::string_view packed, std::optional<std::uint64_t> size, std::string& to) {
  constexpr int kUsualWindow = 27;  // bits of an offset, of those that writers of streams may use
  const std::unique_ptr<ZSTD_DCtx, std::size_t (*)(ZSTD_DCtx*)> context(ZSTD_createDCtx(),
                                                                        ZSTD_freeDCtx);
  if (!context) throw std::bad_alloc();
  ZSTD_DCtx_setParameter(
      context.get(), ZSTD_d_windowLogMax,
      std::max(kUsualWindow, static_cast<int>(std::bit_width(size.value_or(0)))));
  ZSTD_inBuffer from{packed.data(), packed.size(), 0};
  bool is_too_wide = false;
  const Status filled = fill(packed, size, to, [&](char* place, std::size_t room) -> std::size_t {
    // A frame may be followed by others, and by some to be skipped.
    ZSTD_outBuffer into{place, room, 0};
    for (std::size_t taken = from.size; into.pos == 0 && taken != from.pos;) {
      taken = from.pos;
      const std::size_t status = ZSTD_decompressStream(context.get(), &into, &from);
      is_too_wide = ZSTD_getErrorCode(status) == ZSTD_error_frameParameter_windowTooLarge;
      if (ZSTD_isError(status) != 0) return 0;
    }
    return into.pos;
  });
  if (!is_too_wide) return filled;
  return Error{Errc::unavailable,
               "a chunk is compressed with a window of more than 128 MiB; rewrite it with a usual "
               "one (mcap compress --compression zstd)"};
}

Status unpack_lz4(std::string_view packed, std::uint64_t size, std::string& to) {
  static const Result<Lz4> lz4 = load_lz4();
  if (!lz4) return lz4.error();
  Lz4::Context* raw = nullptr;
  if (lz4->is_error(lz4->create(&raw, kLz4Version)) != 0) throw std::bad_alloc();
  const std::unique_ptr<Lz4::Context, std::size_t (*)(Lz4::Context*)> context(raw, lz4->free);
  return fill(packed, size, to, [&](char* place, std::size_t room) -> std::size_t {
    // It may take bytes and give none yet.
    for (;;) {
      std::size_t got = room, taken = packed.size();
      const std::size_t status =
          lz4->decompress(context.get(), place, &got, packed.data(), &taken, nullptr);
      if (lz4->is_error(status) != 0) return 0;
      packed.remove_prefix(taken);
      if (got > 0 || taken == 0) return got;
    }
  });
}

Status unpack_bzip2(std::string_view packed, std::uint64_t size, std::string& to) {
  static const Result<Bzip2> bzip2 = load_bzip2();
  if (!bzip2) return bzip2.error();
  Bzip2Stream stream{};
  if (packed.size() > kLargest) return Error{Errc::bad_input, "a compressed chunk is too large"};
  stream.next_in = packed.data();
  stream.avail_in = static_cast<unsigned>(packed.size());
  if (bzip2->begin(&stream, 0, 0) != kBzip2Ok) throw std::bad_alloc();
  const std::unique_ptr<Bzip2Stream, int (*)(Bzip2Stream*)> ending(&stream, bzip2->end);
  bool is_over = false;
  return fill(packed, size, to, [&](char* place, std::size_t room) -> std::size_t {
    stream.next_out = place;
    stream.avail_out = static_cast<unsigned>(room);
    while (!is_over && stream.avail_out == room) {
      const unsigned left = stream.avail_in;
      const int status = bzip2->decompress(&stream);
      is_over = status == kBzip2End;
      if (status != kBzip2Ok && !is_over) return 0;
      if (stream.avail_in == left && stream.avail_out == room) break;  // it has ended too early
    }
    return room - stream.avail_out;
  });
}

}}  // namespace palpate::v0
