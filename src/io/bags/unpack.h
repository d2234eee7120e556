// Compressed parts of recordings: Zstandard, and others by libraries that are found when the
// program runs.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

inline constexpr std::string_view kZstdMagic = "\x28\xb5\x2f\xfd";  // of its frames

/// Unpacks frames of Zstandard, LZ4 frames (liblz4) and bzip2 (libbz2). `size`: bytes that were
/// packed, whatever the frames say; none: any number. Memory is taken as it is filled. Errors: the
/// library is missing, or Zstandard's window is larger than usual (both unavailable); the bytes are
/// damaged, too few or too many; an implausible ratio of compression; more than 1 GiB.
Status unpack_zstd(std::string_view packed, std::optional<std::uint64_t> size, std::string& to);
Status unpack_lz4(std::string_view packed, std::uint64_t size, std::string& to);
Status unpack_bzip2(std::string_view packed, std::uint64_t size, std::string& to);

}}  // namespace palpate::v0
